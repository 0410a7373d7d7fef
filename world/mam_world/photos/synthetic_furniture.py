"""Procedural furniture for synthetic photos: a layout of the front becomes boxes and handles.

Nothing is copied from any catalogue: proportions, layouts, mouldings, handles and woods are
drawn at random from ranges that furniture commonly has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mam_world.photos.photo_renderer import Scene, Surface
from mam_world.photos.truth import PanelTruth, Rect

CATEGORIES = (
    "nightstand", "drawer_unit", "cabinet", "sideboard", "wardrobe",
    "fridge", "microwave", "oven", "dishwasher", "washing_machine",
)  # fmt: skip
WEIGHTS = (0.16, 0.2, 0.24, 0.14, 0.08, 0.05, 0.03, 0.04, 0.03, 0.03)
WOODS = (
    ((0.55, 0.33, 0.16), (0.38, 0.20, 0.09)),
    ((0.72, 0.52, 0.31), (0.60, 0.40, 0.22)),
    ((0.28, 0.14, 0.07), (0.16, 0.08, 0.04)),
    ((0.78, 0.64, 0.46), (0.68, 0.52, 0.35)),
    ((0.45, 0.36, 0.28), (0.33, 0.26, 0.19)),
    ((0.40, 0.18, 0.09), (0.27, 0.11, 0.05)),
)
PAINTS = (
    (0.86, 0.86, 0.84), (0.75, 0.75, 0.73), (0.05, 0.07, 0.12), (0.20, 0.28, 0.22),
    (0.06, 0.06, 0.06), (0.35, 0.42, 0.38), (0.60, 0.55, 0.45), (0.50, 0.12, 0.10),
    (0.15, 0.25, 0.38), (0.90, 0.88, 0.80), (0.33, 0.33, 0.34),
)  # fmt: skip
METALS = (
    (0.02, 0.02, 0.02), (0.35, 0.35, 0.36), (0.55, 0.40, 0.15), (0.16, 0.10, 0.06),
    (0.6, 0.6, 0.6), (0.08, 0.07, 0.06),
)  # fmt: skip


@dataclass(frozen=True)
class Style:
    """How one piece is made: frame widths, mouldings, handles, in metres and names."""

    board: float = 0.018
    frame: float = 0.0
    gap: float = 0.003
    inset: bool = False
    panel: str = "slab"
    handle: str = "bar"
    overhang: float = 0.0
    legs: float = 0.0
    plinth: float = 0.0
    handle_size: float = 0.12
    vertical_bars: bool = True
    handle_share: float = 0.0  # > 0: bars take this share of their panel's side, however long
    handle_thick: float = 0.012
    handle_high: float | None = None  # of doors: share of the height, from the bottom


@dataclass(frozen=True)
class Cell:
    """A rectangle of the front in front coordinates and what fills it."""

    kind: str  # drawer | door | open | fixed | control
    rect: Rect
    hinge_side: str | None = None


def random_style(rng: np.random.Generator, category: str) -> Style:
    """Draw mouldings, frame and handles."""
    appliance = category in ("fridge", "microwave", "oven", "dishwasher", "washing_machine")
    pick = rng.random()
    if appliance:
        return Style(
            board=0.02, gap=float(rng.uniform(0.004, 0.008)), panel="slab",
            handle="bar" if category != "washing_machine" else "none",
            handle_size=float(rng.uniform(0.25, 0.5)),
            plinth=0.06 if category == "dishwasher" else 0.0,
            handle_thick=float(rng.uniform(0.012, 0.03)),
        )  # fmt: skip
    handle = str(
        rng.choice(
            ["knob", "bar", "cup", "ring", "square", "arch", "drop", "none"],
            p=[0.24, 0.28, 0.09, 0.07, 0.08, 0.12, 0.08, 0.04],
        )
    )
    long = handle == "bar" and rng.random() < 0.4
    return Style(
        board=float(rng.uniform(0.016, 0.03)),
        frame=float(rng.choice([0.0, rng.uniform(0.015, 0.05)])),
        gap=float(rng.uniform(0.0025, 0.005)),
        inset=bool(rng.random() < 0.5),
        panel=str(rng.choice(["slab", "shaker", "raised", "ornament"], p=[0.45, 0.28, 0.17, 0.1])),
        handle=handle,
        overhang=float(rng.choice([0.0, rng.uniform(0.005, 0.03)])),
        legs=float(rng.uniform(0.06, 0.22)) if pick < 0.35 else 0.0,
        plinth=float(rng.uniform(0.04, 0.1)) if 0.35 <= pick < 0.6 else 0.0,
        handle_size=float(rng.uniform(0.08, 0.2)),
        vertical_bars=bool(rng.random() < 0.85),
        handle_share=float(rng.uniform(0.35, 0.9)) if long else 0.0,
        handle_thick=float(rng.uniform(0.008, 0.022)),
        handle_high=float(rng.uniform(0.3, 0.85)) if rng.random() < 0.6 else None,
    )  # fmt: skip


def random_size(rng: np.random.Generator, category: str) -> tuple[float, float, float]:
    """(width, depth, height) metres of the body."""
    ranges = {
        "nightstand": ((0.38, 0.6), (0.33, 0.45), (0.4, 0.65)),
        "drawer_unit": ((0.4, 1.2), (0.38, 0.52), (0.6, 1.2)),
        "cabinet": ((0.5, 1.1), (0.33, 0.5), (0.65, 1.2)),
        "sideboard": ((1.1, 1.8), (0.35, 0.48), (0.6, 0.9)),
        "wardrobe": ((0.8, 1.6), (0.5, 0.62), (1.7, 2.1)),
        "fridge": ((0.55, 0.9), (0.6, 0.72), (1.5, 1.9)),
        "microwave": ((0.45, 0.55), (0.32, 0.42), (0.26, 0.32)),
        "oven": ((0.56, 0.6), (0.52, 0.58), (0.58, 0.9)),
        "dishwasher": ((0.58, 0.6), (0.55, 0.6), (0.8, 0.86)),
        "washing_machine": ((0.58, 0.62), (0.5, 0.62), (0.82, 0.88)),
    }[category]
    w, d, h = (float(rng.uniform(*r)) for r in ranges)
    return w, d, h


def _split(n: int, rng: np.random.Generator, even: float = 0.6) -> list[float]:
    parts = np.ones(n) if rng.random() < even else rng.uniform(0.7, 1.5, n)
    return [0.0, *np.cumsum(parts / parts.sum()).tolist()]


def _grid(
    rect: Rect, rows: int, columns: int, kind: str, rng: np.random.Generator, even: float = 0.6
) -> list[Cell]:
    u0, v0, u1, v1 = rect
    us = [u0 + t * (u1 - u0) for t in _split(columns, rng, 0.85)]
    vs = [v0 + t * (v1 - v0) for t in _split(rows, rng, even)]
    return [
        Cell(kind, (us[j], vs[i], us[j + 1], vs[i + 1]))
        for i in range(rows)
        for j in range(columns)
    ]


def _doors(rect: Rect, n: int, rng: np.random.Generator) -> list[Cell]:
    cells = _grid(rect, 1, n, "door", rng)
    first = "left" if n > 1 or rng.random() < 0.5 else "right"
    sides = [first if i % 2 == 0 else "right" for i in range(n)]
    return [replace(c, hinge_side=s) for c, s in zip(cells, sides)]


def random_layout(
    rng: np.random.Generator, category: str, size: tuple[float, float, float]
) -> list[Cell]:
    """Cells of the front (inside the carcass boards), in 0..1 of the opening."""
    full: Rect = (0.0, 0.0, 1.0, 1.0)
    aspect = size[0] / size[2]
    if category == "nightstand":
        pick = rng.random()
        if pick < 0.5:
            return _grid(full, int(rng.integers(1, 4)), 1, "drawer", rng)
        v = float(rng.uniform(0.25, 0.5))
        top = "open" if pick > 0.75 else "drawer"
        low = _doors((0, v, 1, 1), 1, rng) if rng.random() < 0.6 else [Cell("drawer", (0, v, 1, 1))]
        return [Cell(top, (0, 0, 1, v)), *low]
    if category == "drawer_unit":
        columns = 1 if aspect < 0.9 else int(rng.integers(1, 4))
        cells = _grid(full, int(rng.integers(2, 6)), columns, "drawer", rng)
        if columns == 1 and aspect > 0.6 and rng.random() < 0.3:
            v = cells[0].rect[3]
            cells = [*_grid((0, 0, 1, v), 1, 2, "drawer", rng), *cells[1:]]
        return cells
    if category in ("cabinet", "sideboard"):
        pick = rng.random()
        n = max(1, min(4, round(aspect * 2)))
        if pick < 0.3:
            return _doors(full, n, rng)
        if pick < 0.65:
            v = float(rng.uniform(0.2, 0.35))
            return [*_grid((0, 0, 1, v), 1, n, "drawer", rng), *_doors((0, v, 1, 1), n, rng)]
        u = float(rng.uniform(0.38, 0.62))
        rows = int(rng.integers(2, 5))
        if rng.random() < 0.5:
            return [
                *_grid((0, 0, u, 1), rows, 1, "drawer", rng),
                *_doors((u, 0, 1, 1), 2 if aspect > 1.3 else 1, rng),
            ]
        if aspect > 1.2:
            return [
                *_doors((0, 0, 0.33, 1), 1, rng),
                *_grid((0.33, 0, 0.67, 1), rows, 1, "drawer", rng),
                *_doors((0.67, 0, 1, 1), 1, rng),
            ]
        return [
            *_doors((0, 0, u, 1), 1, rng),
            *_grid((u, 0, 1, 1), rows, 1, "drawer", rng),
        ]
    if category == "wardrobe":
        n = max(2, round(size[0] / 0.5))
        if rng.random() < 0.4:
            return [
                *_doors((0, 0, 1, 0.78), n, rng),
                *_grid((0, 0.78, 1, 1), 1, max(1, n // 2), "drawer", rng),
            ]
        return _doors(full, n, rng)
    side = str(rng.choice(["left", "right"]))
    if category == "fridge":
        if size[0] > 0.8:
            return _doors(full, 2, rng)
        v = float(rng.choice([rng.uniform(0.25, 0.4), rng.uniform(0.55, 0.7)]))
        return [Cell("door", (0, 0, 1, v), side), Cell("door", (0, v, 1, 1), side)]
    if category == "microwave":
        u = float(rng.uniform(0.7, 0.8))
        return [Cell("door", (0, 0, u, 1), "left"), Cell("control", (u, 0, 1, 1))]
    if category == "oven":
        v = float(rng.uniform(0.12, 0.2))
        return [Cell("control", (0, 0, 1, v)), Cell("door", (0, v, 1, 1), "bottom")]
    if category == "dishwasher":
        return [Cell("door", full, "bottom")]
    return [Cell("control", (0, 0, 1, 0.18)), Cell("round", (0, 0.18, 1, 1), side)]


def random_surfaces(rng: np.random.Generator, category: str) -> dict[str, Surface]:
    """Body, panel, top, inlay, handle and dark surfaces."""
    off = tuple(float(v) for v in rng.uniform(0, 40, 3))
    if category in ("fridge", "microwave", "oven", "dishwasher", "washing_machine"):
        color = ((0.82,) * 3, (0.05,) * 3, (0.42, 0.42, 0.43))[int(rng.integers(3))]
        body = Surface("plain", color, gloss=0.15)  # type: ignore[arg-type]
    elif rng.random() < 0.5:
        a, b = WOODS[int(rng.integers(len(WOODS)))]
        scale = float(rng.uniform(0.5, 2.0))
        body = Surface("wood", a, b, grain=2, scale=scale, offset=off, gloss=0.04)  # type: ignore[arg-type]
    else:
        body = Surface("plain", PAINTS[int(rng.integers(len(PAINTS)))], gloss=0.05)
    panel = body
    if rng.random() < 0.25 and body.kind != "plain":
        panel = Surface("plain", PAINTS[int(rng.integers(len(PAINTS)))])
    elif body.kind == "wood":
        panel = replace(body, grain=int(rng.choice([1, 2])))
    top = body
    if rng.random() < 0.25:
        a, b = WOODS[int(rng.integers(len(WOODS)))]
        top = Surface("wood", a, b, grain=1)
    elif rng.random() < 0.1:
        top = Surface("noise", (0.75, 0.74, 0.72), (0.5, 0.5, 0.5))
    inlay = panel
    pick = rng.random()
    if pick < 0.35:
        tint = tuple(min(1.0, 1.35 * c + 0.1) for c in panel.color)
        kind = str(rng.choice(["weave", "glyph", "mirror"]))
        inlay = Surface(kind, panel.color, tint, scale=float(rng.uniform(0.7, 1.6)))  # type: ignore[arg-type]
    metal = METALS[int(rng.integers(len(METALS)))]
    handle = Surface("plain", metal, gloss=0.5)
    pick = rng.random()
    if pick < 0.25:  # the panel's own colour: little but shading tells it
        tone = float(rng.uniform(0.6, 0.95))
        handle = replace(panel, gloss=0.1, color=tuple(min(1.0, tone * c) for c in panel.color))  # type: ignore[arg-type]
    elif pick < 0.4:
        a, b = WOODS[int(rng.integers(len(WOODS)))]
        handle = Surface("wood", a, b, grain=1, gloss=0.05)
    return {
        "body": body, "panel": panel, "top": top, "inlay": inlay, "handle": handle,
        "dark": Surface("plain", (0.01, 0.01, 0.012), gloss=0.25),
        "inside": replace(body, color=tuple(0.75 * c for c in body.color)),  # type: ignore[arg-type]
    }  # fmt: skip


def panel_truth(
    cell: Cell, rect: Rect, handles: tuple[Rect, ...], round_door: bool = False
) -> PanelTruth:
    """Truth of a movable cell."""
    kind = "door" if round_door or cell.kind == "door" else cell.kind
    return PanelTruth(kind, rect, cell.hinge_side, handles)


def new_scene_surfaces(scene: Scene, surfaces: dict[str, Surface]) -> dict[str, int]:
    """Register a palette in a scene."""
    return {name: scene.material(surface) for name, surface in surfaces.items()}
