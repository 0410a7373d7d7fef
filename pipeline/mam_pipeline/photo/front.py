"""Read a rectified front: panels, their handles, and whether each is a drawer or a door."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.complete import complete, round_door, virtual_grasp
from mam_pipeline.photo.front_network import FrontMaps, look_at_front
from mam_pipeline.photo.handles import HALF, TOLD, Blob, Box, handles_seen, with_told
from mam_pipeline.photo.layout import arranged, cells_of_layout, kinds_of
from mam_pipeline.photo.options import Layout
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.repeat import handles_by_repetition
from mam_pipeline.photo.tiling import SeamMaps, Tile, best_tiling, seams_of


@dataclass(frozen=True)
class Told:
    """Where a language model sees handles: boxes (x0, y0, x1, y1), front pixels, and how far it is
    believed, 0..1."""

    boxes: tuple[Box, ...] = ()
    sure: float = 0.0


NOTHING = Told()
NARROW = 0.08  # of the front's longer side: no shelf is narrower
HINGES = ("left", "right", "bottom", "top")


@dataclass(frozen=True)
class FrontReading:
    """A rectified front (h, w, 3) and what was read on it.

    `missed`: the greatest probability of a handle where a panel might be and none was read.
    `kinds`: the odds of kinds of panels that it was read with.
    """

    image: NDArray[np.uint8]
    panels: tuple[Panel, ...]
    confidence: float = 0.0
    missed: float = 0.0
    kinds: Mapping[str, float] = field(default_factory=dict)

    @property
    def movable(self) -> tuple[Panel, ...]:
        """Panels that open."""
        return tuple(p for p in self.panels if p.movable)


def read_front(
    image: NDArray[np.uint8],
    layout: Layout | None = None,
    category: str | None = None,
    kinds: Mapping[str, float] | None = None,
    sure: float = 1.0,
    handles: Told = NOTHING,
) -> FrontReading:
    """Find panels and handles on a rectified front picture (h, w, 3).

    Args:
        layout: what somebody says is on it. Where as many panels are read in its rows and columns,
            they stay where they are, and only what is said otherwise changes; else it is cut anew.
        category: of the object, where somebody says it. kinds: odds of KINDS for such an object.
        sure: how far the layout is believed, 0..1; below 1 a language model says it.
        handles: where a language model sees handles.
    """
    maps = look_at_front(image)
    seams = seams_of(maps)
    blobs = with_told(handles_seen(maps), handles.boxes, handles.sure, max(image.shape[:2]))
    read = _read(image, maps, seams, blobs, None if layout else category, kinds or {})
    if layout is None:
        return read
    panels = _renamed(read.panels, layout, maps, blobs, sure)
    if not panels:
        cells = cells_of_layout(seams, blobs, layout)
        repeated = handles_by_repetition([box for _, box in cells], blobs)
        panels = [
            _given_panel(kind, box, blobs, maps, sure, repeated.get(k))
            for k, (kind, box) in enumerate(cells)
        ]
        panels = [with_own_handles(p) for p in complete(panels, blobs)]
    return FrontReading(image, tuple(panels), 1.0, kinds=kinds or {})


def _read(
    image: NDArray[np.uint8], maps: FrontMaps, seams: SeamMaps, blobs: list[Blob],
    category: str | None, kinds: Mapping[str, float],
) -> FrontReading:  # fmt: skip
    """What the maps of a front say by themselves."""
    tiles = best_tiling(maps, seams)
    shut = [tile for tile in tiles if tile.panel]
    repeated = handles_by_repetition([tile.box for tile in shut], blobs)
    panels = [panel_of(tile, blobs, maps, repeated.get(k), kinds) for k, tile in enumerate(shut)]
    panels += [_shelf(t) for t in tiles if not t.panel and looks_open(image, t.box)]
    panels.sort(key=lambda p: (round(p.box[1] / 20), p.box[0]))
    panels = complete(panels, blobs)
    panels = [with_own_handles(p) for p in _with_round_door(image, panels, category)]
    missed = _missed(panels, [tile.box for tile in tiles if not tile.panel], blobs)
    return FrontReading(image, tuple(panels), panels_confidence(panels), missed, kinds)


def _missed(
    panels: Sequence[Panel], free: Sequence[tuple[float, float, float, float]], blobs: list[Blob],
    wide: float = 0.5,
) -> float:  # fmt: skip
    """The greatest probability of a handle in what is free and roomy enough for a panel.

    What lies on a frame beside a panel is a hinge, a lock or a screw.

    Args:
        wide: share of the narrowest panel's narrow side from which a place may hold a panel.
    """
    narrow = min((_narrow(p.box) for p in panels if p.movable), default=0.0)
    roomy = [box for box in free if _narrow(box) > wide * narrow]
    inside = [b for box in roomy for b in _within(blobs, box)]
    loose = [b.score for b in inside if not any(_within([b], p.box) for p in panels if p.movable)]
    return max(loose, default=0.0)


def _narrow(box: tuple[float, float, float, float]) -> float:
    return min(box[2] - box[0], box[3] - box[1])


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
    name: str,
    box: tuple[int, int, int, int],
    blobs: list[Blob],
    maps: FrontMaps,
    sure: float,
    repeated: Blob | None = None,
) -> Panel:
    """A panel that somebody named (kind, or kind-hinge): what is not said is to be found."""
    rect = tuple(float(v) for v in box)
    handles = _handles_on(rect, blobs, repeated, name.partition("-")[2])  # type: ignore[arg-type]
    return _named(Panel(rect, "", None, handles, 0.95, 1.0), name, maps, sure)  # type: ignore[arg-type]


def _renamed(
    panels: Sequence[Panel], layout: Layout, maps: FrontMaps, blobs: list[Blob], sure: float
) -> list[Panel]:
    """The panels as read, called as a layout says; none where it has others or in other places."""
    columns, named = arranged([p.box for p in panels]), [kinds_of(c) for c in layout.columns]
    if [list(map(len, rows)) for rows in columns] != [list(map(len, rows)) for rows in named]:
        return []
    out = list(panels)
    for rows, names in zip(columns, named, strict=True):
        for i, name in zip(chain(*rows), chain(*names), strict=True):
            panel, side = _named(panels[i], name, maps, sure), name.partition("-")[2]
            if side and not panel.handles:  # what was read as its handle lies at the hinge
                others = _handles_on(panel.box, blobs, None, side)
                panel = with_own_handles(replace(panel, handles=others))
            out[i] = virtual_grasp(panel)
    return out


def _named(panel: Panel, name: str, maps: FrontMaps, sure: float) -> Panel:
    """A panel of which somebody says the kind, and of a door perhaps the hinge.

    The rest stays as read where the kind does; a hinge that nobody says is nobody's. Where a
    language model counts the panels as they are read, the place is no less sure than its word.

    Args:
        sure: how far the name is believed, 0..1: 1 where a person says it.
    """
    who = "user" if sure >= 1.0 else "model"
    place = panel.confidence if who == "user" else max(panel.confidence, sure)
    panel = replace(panel, confidence=place, kind_confidence=sure, told=True)
    kind, _, side = name.partition("-")
    if kind != panel.kind:
        seen = tuple(b for b in panel.handles if b.provenance != "assumed")
        panel = replace(panel, kind=kind, hinge_side=None, handles=seen if kind != "open" else ())
    if kind != "door":
        return replace(panel, provenance=who)
    if not side and panel.hinge_side is None:
        shares = maps.kind_shares(panel.box)
        found = max(HINGES, key=lambda s: shares[f"door {s}"])
        if panel.handles and found in ("left", "right"):
            middle = (panel.box[0] + panel.box[2]) / 2
            found = "left" if panel.handles[0].center[0] > middle else "right"
        panel = replace(panel, hinge_side=found)
    if side and side != panel.hinge_side:  # a grasp line that was assumed lies across the hinge
        seen = tuple(b for b in panel.handles if b.provenance != "assumed")
        panel = replace(panel, hinge_side=side, handles=seen)
    panel = replace(panel, handles=tuple(_off_the_hinge(panel.handles, panel.box, side)))
    return replace(panel, provenance=who if side else "observed")


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
    tile: Tile,
    blobs: list[Blob],
    maps: FrontMaps,
    repeated: Blob | None = None,
    kinds: Mapping[str, float] | None = None,
) -> Panel:
    """Turn a tile into a panel with its best handle(s), kind and hinge.

    Args:
        repeated: the handle that like panels show too, if any; it goes before all others.
        kinds: odds of KINDS for such an object.
    """
    shares = maps.kind_shares(tile.box)
    weighed = {k: v * (kinds or {}).get(k, 1.0) for k, v in shares.items()}
    shares = {k: v / sum(weighed.values()) for k, v in weighed.items()}
    kind = max(shares, key=lambda k: shares[k]).partition(" ")[0]
    sure = sum(v for k, v in shares.items() if k.startswith(kind))
    side = "" if kind == "drawer" else _hinge_of(tile.box, blobs, repeated, shares)
    handles = _handles_on(tile.box, blobs, repeated, side)
    confidence = float(np.clip(tile.agreement, 0.05, 0.98))
    rect = tuple(float(v) for v in tile.box)
    return Panel(rect, kind, side or None, handles, confidence, sure)  # type: ignore[arg-type]


def _hinge_of(
    box: Box, blobs: list[Blob], repeated: Blob | None, shares: Mapping[str, float]
) -> str:
    """The likeliest hinge side of a door: a patch that lies there is then no handle.

    Args:
        shares: kinds of panels to how likely they are by their looks alone.
    """
    seen = _likely(_within(blobs, box), repeated)

    def likely(side: str) -> float:
        opens = _off_the_hinge(seen, box, side)
        return shares[f"door {side}"] * math.prod(1.0 - b.score for b in seen if b not in opens)

    return max(HINGES, key=likely)


def _shelf(tile: Tile) -> Panel:
    rect = tuple(float(v) for v in tile.box)
    return Panel(rect, "open", None, (), 0.7, 0.7)  # type: ignore[arg-type]


def looks_open(image: NDArray[np.uint8], box: tuple[float, float, float, float]) -> bool:
    """Whether a region is a dark cavity rather than a board: darker than the front, and shaded."""
    x0, y0, x1, y1 = (int(v) for v in box)
    if min(x1 - x0, y1 - y0) < NARROW * max(image.shape[:2]):
        return False
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2LAB)[..., 0].astype(np.float64) * 100 / 255
    m = max(2, round(0.04 * min(x1 - x0, y1 - y0)))
    cell = grey[y0 + m : y1 - m, x0 + m : x1 - m]
    bright = float(np.percentile(grey, 70))
    upper = float(np.median(cell[: max(1, len(cell) // 3)]))
    return float(np.median(cell)) < 0.62 * bright and upper < 0.58 * bright


def _within(blobs: list[Blob], box: Box) -> list[Blob]:
    x0, y0, x1, y1 = box
    return [b for b in blobs if x0 < b.center[0] < x1 and y0 < b.center[1] < y1]


def _off_the_hinge(
    blobs: Sequence[Blob], box: tuple[float, ...], side: str, apart: float = 0.4
) -> list[Blob]:
    """Those of a door that may be its handle: what lies near a hinge that is known opens nothing.

    Args:
        side: of the hinge; "" where nobody says it.
        apart: share of the door's width, or of a flap's height, from the hinge to a handle.
    """
    if not side:
        return list(blobs)
    at = 0 if side in ("left", "right") else 1
    low, high = box[at], box[at + 2]
    near, far = (low, high) if side in ("left", "top") else (high, low)
    return [b for b in blobs if (b.center[at] - near) / (far - near) >= apart]


def _handles_on(
    box: Box, blobs: list[Blob], repeated: Blob | None, side: str = ""
) -> tuple[Blob, ...]:
    """The handles of a panel: those that a language model sees on it, else the likeliest patches.

    Args:
        side: of its hinge, where somebody says it: what lies there is no handle.
    """
    inside = _within(blobs, box)
    told = [b for b in inside if b.told and TOLD.fits(b, box)]
    seen = _likely([b for b in inside if not b.told], repeated)
    return _choose_handles(_off_the_hinge(told, box, side) or _off_the_hinge(seen, box, side), box)


def _likely(blobs: list[Blob], repeated: Blob | None) -> list[Blob]:
    """Candidates that may be handles, likeliest first; the repeated one leads."""
    good = sorted((b for b in blobs if b.score > HALF), key=lambda b: -b.score)
    return good if repeated is None else [repeated, *(b for b in good if b.box != repeated.box)]


def _choose_handles(mine: list[Blob], box: Box) -> tuple[Blob, ...]:
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


def panels_confidence(panels: list[Panel]) -> float:
    """0..1 how far to trust the panels as a whole: what their places vote, and a handle on each."""
    movable = [p for p in panels if p.movable]
    if not movable:
        return 0.0
    seen = [any(b.provenance == "observed" for b in p.handles) for p in movable]
    shape = float(np.mean([p.kind_confidence for p in movable]))
    voted = float(np.mean([p.confidence for p in movable]))
    return float(np.clip(0.35 * voted + 0.5 * float(np.mean(seen)) + 0.15 * shape, 0, 1))
