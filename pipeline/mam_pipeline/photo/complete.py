"""Second thoughts on a front: like panels agree, missing handles are completed.

What is added is marked: `inferred` where like panels show it, `assumed` for a virtual grasp line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.handles import FAINT, Blob
from mam_pipeline.photo.panel import Panel

LIKE = 0.14  # relative size difference of panels that are of one make


def complete(panels: Sequence[Panel], blobs: Sequence[Blob]) -> list[Panel]:
    """Complete the panels of a front; `blobs`: the patches on it that may be handles."""
    out = complete_handles(agree_on_kinds(list(panels)), blobs)
    return [virtual_grasp(p) for p in pair_doors(out)]


def _like(a: Panel, b: Panel) -> bool:
    wa, ha = a.box[2] - a.box[0], a.box[3] - a.box[1]
    wb, hb = b.box[2] - b.box[0], b.box[3] - b.box[1]
    return abs(wa - wb) < LIKE * max(wa, wb) and abs(ha - hb) < LIKE * max(ha, hb)


def agree_on_kinds(panels: list[Panel]) -> list[Panel]:
    """Panels of like size are of one kind: the surer ones decide."""
    out = []
    for p in panels:
        if not p.movable or p.told:
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
        if p.kind == "door" and side in ("left", "right", None) and p.provenance == "observed":
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
        if b.score > FAINT
        and abs(b.center[0] - x) < 0.5 * like.size[0] + 4
        and abs(b.center[1] - y) < 0.5 * like.size[1] + 6
        and np.abs(np.log(np.array(b.size) / np.array(like.size))).max() < 0.6
    ]  # fmt: skip
    return max(near, key=lambda b: b.score) if near else None


def _copy(b: Blob, x: float, y: float) -> Blob:
    w, h = b.size
    box = (x - w / 2, y - h / 2, x + w / 2, y + h / 2)
    return Blob(box, 0.5 * b.score, "inferred")


def pair_doors(panels: list[Panel]) -> list[Panel]:
    """Doors without a handle: two neighbours open from the middle, one alone hinges left."""
    out = list(panels)
    order = sorted(range(len(out)), key=lambda i: out[i].box[0])
    done: set[int] = set()
    for i in order:
        p = out[i]
        if p.kind != "door" or p.handles or i in done or p.provenance != "observed":
            continue
        for j in order:
            q = out[j]
            if j in done or q.kind != "door" or not _like(p, q):
                continue
            if abs(q.box[0] - p.box[2]) < 0.15 * (p.box[2] - p.box[0]):
                out[i] = replace(p, hinge_side="left")
                if not q.handles and q.provenance == "observed":
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
    return replace(p, handles=(Blob(box, 0.0, "assumed"),))


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
