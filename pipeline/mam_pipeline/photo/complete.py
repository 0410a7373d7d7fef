"""Second thoughts on a front: like panels agree, missing handles are completed, strips are fixed.

What is added is marked: `inferred` where like panels show it, `assumed` for a virtual grasp line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.handles import Blob
from mam_pipeline.photo.panel import Panel

LIKE = 0.14  # relative size difference of panels that are of one make
WEAK_HANDLE = 0.12  # a faint candidate where like panels have their handle is the handle


def complete(
    panels: Sequence[Panel], blobs: Sequence[Blob], size: tuple[int, int], keep_all: bool = False
) -> list[Panel]:
    """Complete the panels of a front of (width, height) pixels; `keep_all`: none becomes fixed."""
    out = list(panels) if keep_all else fix_controls(list(panels), blobs, size)
    out = agree_on_kinds(out)
    out = complete_handles(out, blobs)
    if not keep_all:
        out = fix_strips(out, size)
    out = pair_doors(out)
    return [virtual_grasp(p) for p in out]


def _like(a: Panel, b: Panel) -> bool:
    wa, ha = a.box[2] - a.box[0], a.box[3] - a.box[1]
    wb, hb = b.box[2] - b.box[0], b.box[3] - b.box[1]
    return abs(wa - wb) < LIKE * max(wa, wb) and abs(ha - hb) < LIKE * max(ha, hb)


def agree_on_kinds(panels: list[Panel]) -> list[Panel]:
    """Panels of like size are of one kind: the surer ones decide."""
    out = []
    for p in panels:
        if not p.movable:
            out.append(p)
            continue
        group = [q for q in panels if q.movable and _like(p, q)]
        vote = sum((q.kind_confidence - 0.4) * (1 if q.kind == "drawer" else -1) for q in group)
        kind = "drawer" if vote > 0 else "door"
        if kind != p.kind:
            p = replace(p, kind=kind, hinge_side="left" if kind == "door" else None)
            if kind == "door" and p.handles:
                middle = (p.box[0] + p.box[2]) / 2
                p = replace(p, hinge_side="left" if p.handles[0].center[0] > middle else "right")
        out.append(p)
    return out


def _spot(p: Panel, b: Blob) -> NDArray[np.float64]:
    """Where a handle sits: for drawers (u, v) shares; for doors from the opening edge in pixels."""
    x0, y0, x1, y1 = p.box
    x, y = b.center
    if p.kind == "drawer":
        return np.array([(x - x0) / (x1 - x0), (y - y0) / (y1 - y0)])
    edge = min(x - x0, x1 - x) / (x1 - x0)
    return np.array([edge, (y - y0) / (y1 - y0)])


def complete_handles(panels: list[Panel], blobs: Sequence[Blob]) -> list[Panel]:
    """Give a panel the handle that at least half of its like panels (or its twin) show."""
    out = []
    for p in panels:
        group = [q for q in panels if q.kind == p.kind and q is not p and _like(p, q)]
        having = [q for q in group if q.handles]
        if not p.movable or p.handles or not having or 2 * len(having) < len(group):
            out.append(p)
            continue
        model = max(having, key=lambda q: q.handles[0].score)
        added = []
        for handle in model.handles:
            u, v = _spot(model, handle)
            if p.kind == "door" and p.hinge_side in ("left", "right", None):
                u = _door_side(p, model, panels, float(u))
            x = p.box[0] + u * (p.box[2] - p.box[0])
            y = p.box[1] + v * (p.box[3] - p.box[1])
            added.append(_faint(blobs, x, y, handle) or _copy(handle, x, y))
        side = p.hinge_side
        if p.kind == "door" and side in ("left", "right", None):
            side = "left" if added[0].center[0] > (p.box[0] + p.box[2]) / 2 else "right"
        out.append(replace(p, handles=tuple(added), hinge_side=side))
    return out


def _door_side(p: Panel, model: Panel, panels: list[Panel], edge: float) -> float:
    """Horizontal share of a door's missing handle: next to its twin's, else as the model's."""
    for q in panels:
        if q.kind != "door" or q is p or not q.handles or not _like(p, q):
            continue
        right_of = abs(q.box[2] - p.box[0]) < 0.15 * (p.box[2] - p.box[0])
        left_of = abs(q.box[0] - p.box[2]) < 0.15 * (p.box[2] - p.box[0])
        middle = (q.box[0] + q.box[2]) / 2
        if right_of and q.handles[0].center[0] > middle:
            return edge
        if left_of and q.handles[0].center[0] < middle:
            return 1 - edge
    inside = model.handles[0].center[0] > (model.box[0] + model.box[2]) / 2
    return 1 - edge if inside else edge


def _faint(blobs: Sequence[Blob], x: float, y: float, like: Blob) -> Blob | None:
    near = [
        b for b in blobs
        if b.score > WEAK_HANDLE
        and abs(b.center[0] - x) < 0.5 * like.size[0] + 4
        and abs(b.center[1] - y) < 0.5 * like.size[1] + 6
        and np.abs(np.log(np.array(b.size) / np.array(like.size))).max() < 0.6
    ]  # fmt: skip
    return max(near, key=lambda b: b.score) if near else None


def _copy(b: Blob, x: float, y: float) -> Blob:
    w, h = b.size
    box = (x - w / 2, y - h / 2, x + w / 2, y + h / 2)
    return Blob(box, 0.5 * b.score, b.features, "inferred")


def fix_strips(panels: list[Panel], size: tuple[int, int]) -> list[Panel]:
    """Cells without a handle, small or thin, among cells with handles are fixed strips."""
    w, h = size
    handled = [p for p in panels if p.movable and p.handles]
    out = []
    for p in panels:
        pw, ph = p.box[2] - p.box[0], p.box[3] - p.box[1]
        area = pw * ph / (w * h)
        thin = ph < 0.1 * h or pw < 0.1 * w
        lone = not p.handles and p.movable and not any(_like(p, q) for q in handled)
        largest = max((_area(q) / (w * h) for q in panels), default=0.0)
        strip = lone and (
            (thin and area < 0.12 and area < 0.5 * largest)
            or (len(handled) >= 1 and area < 0.07)
            or (len(handled) >= 3 and area < 0.12 and thin)
        )
        out.append(replace(p, kind="fixed", hinge_side=None) if strip else p)
    return out if any(p.movable for p in out) else panels


def fix_controls(
    panels: list[Panel], blobs: Sequence[Blob], size: tuple[int, int]
) -> list[Panel]:
    """Panels with knobs and displays, which do not open: beside a microwave's door, over an oven's.

    Beside: whatever lies in a narrow column next to the one panel that fills the rest of a wide
    front. Over: a strip that three or more like knobs share; no drawer has three handles.
    """
    w, h = size
    out = list(panels)
    largest = max(panels, key=_area, default=None)
    if largest is not None and 1.2 < w / h < 2.6:
        x0, y0, x1, y1 = largest.box
        others = [p for p in panels if p is not largest]
        beside = all(p.box[0] > x1 - 0.02 * w or p.box[2] < x0 + 0.02 * w for p in others)
        narrow = all(p.box[2] - p.box[0] < 0.31 * w for p in others)
        one_side = len({p.box[0] > x1 - 0.02 * w for p in others}) == 1
        fills = x1 - x0 > 0.55 * w and y1 - y0 > 0.7 * h
        twins = any(_alike(a, b) for p in others for a in p.handles for b in largest.handles)
        if beside and narrow and one_side and fills and not twins:
            out = [p if p is largest else _fixed(p) for p in out]
    return [_fixed(p) if _row_of_knobs(p, blobs, size) else p for p in out]


def _fixed(p: Panel) -> Panel:
    return replace(p, kind="fixed", hinge_side=None, handles=())


def _alike(a: Blob, b: Blob) -> bool:
    return bool(np.abs(np.log(np.array(a.size) / np.array(b.size))).max() < 0.35)


def _row_of_knobs(p: Panel, blobs: Sequence[Blob], size: tuple[int, int]) -> bool:
    """Whether a low strip holds three or more like small candidates side by side."""
    x0, y0, x1, y1 = p.box
    if not p.movable or y1 - y0 > 0.25 * size[1] or x1 - x0 < 0.6 * size[0]:
        return False
    knobs = [
        b for b in blobs
        if b.score > 0.15 and x0 < b.center[0] < x1 and y0 < b.center[1] < y1
        and max(b.size) < 0.12 * (x1 - x0)
    ]  # fmt: skip
    for a in knobs:
        like = [b for b in knobs if abs(b.center[1] - a.center[1]) < 0.12 * (y1 - y0)]
        like = [b for b in like if _alike(a, b)]
        if len(like) >= 3:
            return True
    return False


def _area(p: Panel) -> float:
    return (p.box[2] - p.box[0]) * (p.box[3] - p.box[1])


def pair_doors(panels: list[Panel]) -> list[Panel]:
    """Doors without a handle: two neighbours open from the middle, one alone hinges left."""
    out = list(panels)
    order = sorted(range(len(out)), key=lambda i: out[i].box[0])
    done: set[int] = set()
    for i in order:
        p = out[i]
        if p.kind != "door" or p.handles or i in done:
            continue
        for j in order:
            q = out[j]
            if j in done or q.kind != "door" or not _like(p, q):
                continue
            if abs(q.box[0] - p.box[2]) < 0.15 * (p.box[2] - p.box[0]):
                out[i] = replace(p, hinge_side="left")
                if not q.handles:
                    out[j] = replace(q, hinge_side="right")
                done |= {i, j}
                break
    return out


def virtual_grasp(p: Panel) -> Panel:
    """A movable panel without any handle gets a grasp line: drawer top edge, door opening edge."""
    if not p.movable or p.handles:
        return p
    x0, y0, x1, y1 = p.box
    w, h = x1 - x0, y1 - y0
    t = max(4.0, 0.04 * min(w, h))
    if p.kind == "drawer" or p.hinge_side == "bottom":
        box = (x0 + 0.3 * w, y0, x1 - 0.3 * w, y0 + t)
    elif p.hinge_side == "right":
        box = (x0, y0 + 0.35 * h, x0 + t, y1 - 0.35 * h)
    else:
        box = (x1 - t, y0 + 0.35 * h, x1, y1 - 0.35 * h)
    return replace(p, handles=(Blob(box, 0.0, (), "assumed"),))


def round_door(image: NDArray[np.uint8]) -> tuple[float, float, float] | None:
    """(x, y, radius) of a large round door near the middle of a front, or None."""
    h, w = image.shape[:2]
    grey = cv2.medianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), 7)
    found = cv2.HoughCircles(
        grey, cv2.HOUGH_GRADIENT, 1.5, w, param1=90, param2=70,
        minRadius=round(0.2 * w), maxRadius=round(0.46 * w),
    )  # fmt: skip
    if found is None:
        return None
    x, y, r = (float(v) for v in found.reshape(-1, 3)[0])
    if abs(x / w - 0.5) > 0.12 or not 0.3 < y / h < 0.75:
        return None
    edges = cv2.dilate(cv2.Canny(grey, 40, 110), np.ones((3, 3), np.uint8)) > 0
    t = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    px, py = np.round(x + r * np.cos(t)).astype(int), np.round(y + r * np.sin(t)).astype(int)
    inside = (px >= 0) & (py >= 0) & (px < w) & (py < h)
    drawn = np.zeros(len(t), bool)
    drawn[inside] = edges[py[inside], px[inside]]
    if drawn.mean() < 0.7 or edges.mean() > 0.35:  # ornaments draw edges everywhere
        return None
    return x, y, r
