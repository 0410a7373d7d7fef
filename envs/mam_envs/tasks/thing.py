"""A loose thing in a drawer: where there is free space for it, in the drawer's own shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mam_envs.object_model import ObjectModel
from mam_pipeline.types import FloatArray, IntArray

CELLS = 6
"""Cells of the grid along one edge of the thing: walls may seem half a cell thicker."""
GAP = 0.004
"""Metres that are kept between the thing and what stands beside it."""


@dataclass(frozen=True)
class Thing:
    """A cube that lies in a drawer or shall lie there. Points are in the asset's frame, with the
    drawer's joint at 0, as the drawer carries them.

    Attributes:
        size: edge, metres. mass: kilograms.
        low, high: (3,) box of the drawer's inside, up to where its walls end.
        places: middles (3,) of the thing where it can lie.
    """

    size: float
    mass: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    places: tuple[tuple[float, float, float], ...]


def free_space(
    model: ObjectModel, joint: str, q_open: float, size: float, mass: float, q_least: float,
    most: int = 24,
) -> Thing | None:  # fmt: skip
    """The thing and its places in what a joint moves, or None where it fits nowhere.

    The inside is what the moving part's own shapes enclose on four sides and from below. A place
    has a flat floor and room for the thing at any yaw, nothing above it at `q_open`, and nothing in
    its way from there to `q_least`.

    Args:
        q_open: joint value at which the hand gets at it. size: edge of the cube, metres.
        q_least: joint value to which the part goes with the thing in it. most: places at most,
            spread evenly.
    """
    moving, rest = model.moving_links(joint), model.kinematics.link_poses({})
    shapes = [p.moved(rest[name][0]) for name in moving for p in model.pieces[name]]
    if not shapes:
        return None
    points = np.concatenate([s.points for s in shapes])
    cell = size / CELLS
    start = points.min(axis=0)
    counts = np.ceil(np.ptp(points, axis=0) / cell).astype(int) + 1
    axes = [start[k] + cell * (np.arange(counts[k]) + 0.5) for k in range(3)]
    solid = np.zeros(counts, dtype=bool)
    for shape in shapes:
        low, high = (((b - start) / cell).astype(int) for b in shape.box)
        at = tuple(slice(max(0, a - 1), b + 2) for a, b in zip(low, high))
        grid = np.stack(np.meshgrid(*(x[s] for x, s in zip(axes, at)), indexing="ij"), axis=-1)
        away = (grid @ shape.planes[:, :3].T + shape.planes[:, 3]).max(axis=-1)
        solid[at] |= away <= 0.5 * cell
    inside = ~solid & _behind(solid, 2)
    for axis in (0, 1):
        inside &= _behind(solid, axis) & _behind(solid[_turned(axis)], axis)[_turned(axis)]
    if not inside.any():
        return None
    first = np.where(inside.any(axis=2), inside.argmax(axis=2), -1)
    floor = int(np.bincount(first[first >= 0]).argmax())
    layer = (first == floor) & inside[:, :, floor : floor + CELLS // 2 + 1].all(axis=2)
    free = layer & ~solid[:, :, floor : floor + CELLS + 1].any(axis=2)
    reach = int(np.ceil((np.sqrt(0.5) * size + GAP) / cell))
    disc = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    found = _thinned(np.argwhere(ndimage.binary_erosion(free, disc)), 10 * most)
    bottom = _floor_below(shapes, axes, found, axes[2][floor] + size) if len(found) else np.zeros(0)
    middles = np.array(
        [(axes[0][i], axes[1][j], z + 0.5 * size) for (i, j), z in zip(found, bottom)]
    ).reshape(-1, 3)
    fine = [m for m in middles if _open_above(model, joint, q_open, m, size)]
    fine = [m for m in fine if _carried(model, joint, (q_open, q_least), m, size)]
    if not fine:
        return None
    places = _thinned(np.array(fine), most)
    where = np.argwhere(inside & layer[:, :, None])
    low, high = (start + cell * (where.min(axis=0))), start + cell * (where.max(axis=0) + 1)
    low[2] = bottom.min()
    return Thing(size, mass, _triple(low), _triple(high), tuple(_triple(p) for p in places))


def _thinned(rows: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the rows, spread evenly."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, most).astype(int))] if len(rows) else rows


def _behind(solid: np.ndarray, axis: int) -> np.ndarray:
    """Which cells have something solid before them along an axis."""
    return np.asarray(np.logical_or.accumulate(solid, axis=axis))


def _turned(axis: int) -> tuple[slice, ...]:
    return tuple(slice(None, None, -1) if k == axis else slice(None) for k in range(3))


def _floor_below(shapes: list, axes: list[FloatArray], cells: IntArray, top: float) -> FloatArray:
    """(N,) height of the surface below each column of the grid, by a ray from `top` down."""
    xy = np.stack([axes[0][cells[:, 0]], axes[1][cells[:, 1]]], axis=1)
    best = np.full(len(xy), -np.inf)
    for shape in shapes:
        n, d = shape.planes[:, :3], shape.planes[:, 3]
        height = -(xy @ n[:, :2].T + d)  # of n_z z <= height
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = height / n[:, 2]
        upper = np.where(n[:, 2] > 1e-9, bound, np.inf).min(axis=1)
        lower = np.where(n[:, 2] < -1e-9, bound, -np.inf).max(axis=1)
        beside = ((np.abs(n[:, 2]) <= 1e-9) & (height < 0)).any(axis=1)
        hit = ~beside & (lower <= upper) & (upper <= top)
        best[hit] = np.maximum(best, upper)[hit]
    return best


def _open_above(model: ObjectModel, joint: str, q: float, middle: FloatArray, size: float) -> bool:
    """Whether the thing can be lifted straight up with the joint at `q`."""
    motion = model.motion(joint, np.array([q]), {})[0]
    top = float(model.bounds({joint: q})[1, 2])
    side = np.linspace(-0.5, 0.5, 3) * size
    heights = np.arange(middle[2], max(top, middle[2]) + size, 0.5 * size)
    grid = np.stack(np.meshgrid(middle[0] + side, middle[1] + side, heights), axis=-1)
    points = grid.reshape(-1, 3) @ motion[:3, :3].T + motion[:3, 3]
    return not model.runs_into(points, {joint: q})


def _carried(
    model: ObjectModel, joint: str, span: tuple[float, float], middle: FloatArray, size: float
) -> bool:
    """Whether the thing meets nothing where the part carries it, from one joint value to another.

    It may be turned: what is looked at is the cylinder round it.
    """
    steps = 1 + int(np.ceil(abs(span[1] - span[0]) / GAP))
    values = np.asarray(np.linspace(span[0], span[1], steps), dtype=float)
    turns = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
    ring = np.sqrt(0.5) * size * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    heights = np.linspace(GAP, size, 6) - 0.5 * size
    rings = [np.column_stack([s * ring, np.full(16, h)]) for s in (0.5, 1.0) for h in heights]
    points = np.concatenate(rings) + middle
    return not any(
        model.runs_into(points @ m[:3, :3].T + m[:3, 3], {joint: float(q)})
        for q, m in zip(values, model.motion(joint, values, {}))
    )


def _triple(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
