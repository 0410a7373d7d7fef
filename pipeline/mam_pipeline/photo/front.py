"""Read a rectified front: panels, their handles, and whether each is a drawer or a door."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.complete import complete, round_door, virtual_grasp
from mam_pipeline.photo.handles import Blob, find_blobs
from mam_pipeline.photo.layout import cells_of_layout
from mam_pipeline.photo.options import Layout
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.partition import Leaf, best_partition
from mam_pipeline.photo.repeat import handles_by_repetition
from mam_pipeline.photo.seams import find_seams

Array = NDArray[np.float64]
HANDLE_THRESHOLD = 0.35


@dataclass(frozen=True)
class FrontReading:
    """A rectified front (h, w, 3) and what was read on it."""

    image: NDArray[np.uint8]
    panels: tuple[Panel, ...]
    value: float = 0.0
    confidence: float = 0.0
    details: dict[str, float] = field(default_factory=dict)

    @property
    def movable(self) -> tuple[Panel, ...]:
        """Panels that open."""
        return tuple(p for p in self.panels if p.movable)


def read_front(
    image: NDArray[np.uint8],
    layout: Layout | None = None,
    category: str | None = None,
    metres_per_pixel: float = 0.0015,
) -> FrontReading:
    """Find panels and handles on a rectified front picture (h, w, 3)."""
    seams = find_seams(image)
    blobs = find_blobs(image, seams)
    size = (image.shape[1], image.shape[0])
    if layout is not None:
        cells = cells_of_layout(seams, blobs, layout)
        repeated = handles_by_repetition([box for _, box in cells], blobs)
        given = [
            _given_panel(kind, box, blobs, image, metres_per_pixel, repeated.get(k))
            for k, (kind, box) in enumerate(cells)
        ]
        done = tuple(with_own_handles(p) for p in complete(given, blobs, size, True))
        return FrontReading(image, done, 1.0, 1.0)
    partition = best_partition(seams, blobs)
    leaves = [leaf for leaf in partition.leaves if leaf.kind == "panel"]
    repeated = handles_by_repetition([leaf.box for leaf in leaves], blobs)
    panels = [
        panel_of(leaf, blobs, image, metres_per_pixel, repeated.get(k))
        for k, leaf in enumerate(leaves)
    ]
    panels.sort(key=lambda p: (round(p.box[1] / 20), p.box[0]))
    panels = complete(panels, blobs, size)
    panels = [with_own_handles(p) for p in _with_round_door(image, panels, category)]
    sides = [leaf.sides for leaf in leaves]
    details = {
        "support": float(np.mean(sides)) if sides else 0.0,
        "weakest": float(np.mean([min(s) for s in sides])) if sides else 0.0,
    }
    sure = panels_confidence(leaves, panels)
    return FrontReading(image, tuple(panels), partition.value, sure, details)


def with_own_handles(panel: Panel, rim: float = 0.015) -> Panel:
    """Cut a panel's handles off at its rim: one that reaches over would bar the neighbour's way.

    Two knobs on either side of a seam, or a knob and its shadow, are often one patch.
    """
    x0, y0, x1, y1 = panel.box
    m = min(rim * min(x1 - x0, y1 - y0), 6.0)
    out = []
    for b in panel.handles:
        box = (
            max(b.box[0], x0 + m), max(b.box[1], y0 + m),
            min(b.box[2], x1 - m), min(b.box[3], y1 - m),
        )  # fmt: skip
        if box[2] - box[0] >= 3 and box[3] - box[1] >= 3:
            out.append(replace(b, box=box))
    handles = tuple(out)
    return panel if handles == panel.handles else virtual_grasp(replace(panel, handles=handles))


def _given_panel(
    kind: str,
    box: tuple[int, int, int, int],
    blobs: list[Blob],
    image: NDArray[np.uint8],
    scale: float,
    repeated: Blob | None = None,
) -> Panel:
    """A panel that the user named: only its handle and hinge are to be found."""
    x0, y0, x1, y1 = box
    inside = [b for b in blobs if x0 < b.center[0] < x1 and y0 < b.center[1] < y1]
    handles = _choose_handles(_likely(inside, repeated), box)
    side = None
    if kind == "door":
        side = classify(box, handles, image, scale)[1] or "left"
        if handles and side not in ("bottom", "top"):
            side = "left" if handles[0].center[0] > (x0 + x1) / 2 else "right"
    rect = tuple(float(v) for v in box)
    return Panel(rect, kind, side, handles, 0.95, 1.0, "user")  # type: ignore[arg-type]


def _with_round_door(
    image: NDArray[np.uint8], panels: list[Panel], category: str | None
) -> list[Panel]:
    """Washing machines: a round door in place of what the straight lines suggested."""
    seen = sum(b.provenance == "observed" for p in panels for b in p.handles)
    ratio = image.shape[1] / image.shape[0]
    plausible = seen <= 1 and len(panels) <= 3 and 0.55 < ratio < 1.1
    if category != "washing_machine" and (category is not None or not plausible):
        return panels
    circle = round_door(image)
    if circle is None:
        return panels
    x, y, r = circle
    door = Panel((x - r, y - r, x + r, y + r), "door", "left", (), 0.8, 0.9)
    return [virtual_grasp(door)]


def panel_of(
    leaf: Leaf,
    blobs: list[Blob],
    image: NDArray[np.uint8],
    scale: float,
    repeated: Blob | None = None,
) -> Panel:
    """Turn a leaf into a panel with its best handle(s), kind and hinge.

    Args:
        repeated: the handle that like panels show too, if any; it goes before all others.
    """
    chosen = _choose_handles(_likely([blobs[i] for i in leaf.handles], repeated), leaf.box)
    kind, side, sure = classify(leaf.box, chosen, image, scale)
    support = float(np.mean(leaf.sides))
    confidence = float(np.clip(0.9 * support + (0.15 if chosen else -0.1), 0.05, 0.98))
    return Panel(tuple(float(v) for v in leaf.box), kind, side, chosen, confidence, sure)  # type: ignore[arg-type]


def _likely(blobs: list[Blob], repeated: Blob | None) -> list[Blob]:
    """Candidates that may be handles, likeliest first; the repeated one leads."""
    good = sorted((b for b in blobs if b.score > HANDLE_THRESHOLD), key=lambda b: -b.score)
    return good if repeated is None else [repeated, *(b for b in good if b.box != repeated.box)]


def _choose_handles(mine: list[Blob], box: tuple[int, int, int, int]) -> tuple[Blob, ...]:
    if not mine:
        return ()
    first = mine[0]
    width = box[2] - box[0]
    middle = (box[0] + box[2]) / 2
    if abs(first.center[0] - middle) > 0.12 * width:
        for other in mine[1:]:
            mirrored = abs((first.center[0] + other.center[0]) / 2 - middle) < 0.06 * width
            like = np.abs(np.log(np.array(first.size) / np.array(other.size))).max() < 0.4
            level = abs(first.center[1] - other.center[1]) < 0.05 * width
            if mirrored and like and level:
                return (first, other)
    return (first,)


def classify(
    box: tuple[float, float, float, float],
    handles: tuple[Blob, ...],
    image: NDArray[np.uint8],
    scale: float,
) -> tuple[str, str | None, float]:
    """(kind, hinge side, confidence) from the panel's shape and where its handle sits."""
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    if not handles and looks_open(image, box):
        return "open", None, 0.7
    z = 0.0  # > 0 drawer, < 0 door
    z += 1.6 * float(np.clip(np.log(w / h), -1.5, 1.5))
    z += 2.0 * float(np.clip((0.33 - h * scale) / 0.2, -1.5, 1.0))
    side: str | None = None
    if len(handles) == 2:
        return "drawer", None, 0.9
    if handles:
        u = (handles[0].center[0] - x0) / w
        v = (handles[0].center[1] - y0) / h
        hw, hh = handles[0].size
        off = abs(u - 0.5)
        z += 2.5 * float(np.clip((0.2 - off) / 0.12, -1.5, 1.2))
        z += (
            1.2 * float(np.clip(np.log(hw / hh), -1.5, 1.0))
            if max(hw, hh) > 2.2 * min(hw, hh)
            else 0.0
        )
        side = "left" if u > 0.5 else "right"
        if off < 0.2 and h * scale > 0.3 and v < 0.25 and hw > 0.45 * w:
            return "door", "bottom", 0.8
    kind = "drawer" if z > 0 else "door"
    if kind == "door" and side is None:
        side = "left"
    sure = float(1 / (1 + np.exp(-abs(z))))
    return kind, side if kind == "door" else None, sure


def looks_open(image: NDArray[np.uint8], box: tuple[float, float, float, float]) -> bool:
    """Whether a cell is a dark cavity rather than a panel: darker than the front, and shaded."""
    x0, y0, x1, y1 = (int(v) for v in box)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2LAB)[..., 0].astype(np.float64) * 100 / 255
    m = max(2, round(0.04 * min(x1 - x0, y1 - y0)))
    cell = grey[y0 + m : y1 - m, x0 + m : x1 - m]
    if cell.size < 50:
        return False
    bright = float(np.percentile(grey, 70))
    upper = float(np.median(cell[: max(1, len(cell) // 3)]))
    middle = float(np.median(cell))
    return middle < 0.62 * bright and upper < 0.58 * bright


def panels_confidence(leaves: list[Leaf], panels: list[Panel]) -> float:
    """0..1 how far to trust the partition as a whole: seam support, and a handle on each panel."""
    movable = [p for p in panels if p.movable]
    if not movable or not leaves:
        return 0.0
    support = float(np.mean([min(leaf.sides) for leaf in leaves]))
    seen = [any(b.provenance == "observed" for b in p.handles) for p in movable]
    shape = float(np.mean([p.kind_confidence for p in movable]))
    return float(np.clip(0.35 * support + 0.5 * float(np.mean(seen)) + 0.15 * shape, 0, 1))
