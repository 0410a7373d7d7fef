"""Where the gap between two fronts has closed, their handles tell that there are two.

A generator or a scanner often leaves no trace of the gap between the doors of a cupboard or the
drawers of a chest: their fronts are one flat. What stands out of that flat and is as small as a
handle says where it ends: alike ones above each other belong to a stack of fronts, two beside the
middle, or an upright one on it, to a pair of doors.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage

from mam_pipeline.segment.topology import Topology, groups
from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class FrontThresholds:
    """When handles tell that a flat is several fronts; lengths in bounding-box diagonals unless
    said otherwise.

    Attributes:
        least_area: share of all area: smaller primitives are no fronts.
        upright: most vertical component of a front's normal.
        aligned: least cosine of a flat's faces with its normal.
        level: how far a face may lie off its flat's plane.
        filled: share of a primitive that lies in its flat, at least.
        sliver: share of its area: a primitive loses no less to a cut.
        whole: share of a front that its largest primitive has; several side by side may be fronts
            of their own.
        carved: share of a primitive: a front that is less of it is cut out of it.
        stack: a number larger than that of the fronts of one flat.
        edge: share of the front's width: what stands nearer to its sides is a hinge.
        grid: cells across a flat.
        handle_area: most area of a handle, as a share of the front that it stands on.
        hover: how far before the front a handle may float that no surface joins to it.
        stout: a handle stands out by this share of its narrower side at least; mouldings do not.
        out: how far a handle stands out at least.
        row: share of the front's height: handles closer than that are beside each other.
        same_size: most difference of two handles' sizes, as a share.
        middle: share of the front's width that counts as its middle.
        even: most difference between the distances of handles in a regular stack, over the
            distance.
        jagged: most difference between the heights of fronts in a regular stack, over the distance.
        pair: share of the front's width: two handles that are farther apart may pull one drawer.
        slender: height of an upright handle over its width, at least.
        thin: share of a panel's width: its other face lies no deeper.
    """

    least_area: float = 0.015
    upright: float = 0.25
    aligned: float = float(np.cos(np.radians(12.0)))
    level: float = 0.004
    filled: float = 0.4
    sliver: float = 0.15
    whole: float = 0.75
    carved: float = 0.6
    stack: int = 64
    edge: float = 0.09
    grid: int = 96
    handle_area: float = 0.2
    hover: float = 0.05
    stout: float = 0.3
    out: float = 0.005
    row: float = 0.06
    same_size: float = 0.35
    middle: float = 0.08
    even: float = 0.1
    jagged: float = 0.4
    pair: float = 0.3
    slender: float = 1.8
    thin: float = 0.15


FRONTS = FrontThresholds()


@dataclass(frozen=True)
class _Flat:
    """A large upright flat, of one primitive or several; lengths in diagonals.

    Attributes:
        frame: (3, 3) columns: to the right, up along the flat, outwards.
        low, high: (2,) its corners along the first two. depth: of its plane along the third.
        faces: (F,) those in the flat. pieces: primitives that lie in it.
    """

    frame: FloatArray
    low: FloatArray
    high: FloatArray
    depth: float
    faces: NDArray[np.bool_]
    pieces: list[int]


@dataclass(frozen=True)
class _Handle:
    """What stands on a front; fractions of the front from its lower left corner, and sizes."""

    at: FloatArray
    low: FloatArray
    high: FloatArray
    size: FloatArray  # (3,) its narrower side, its longer side, how far it stands out; diagonals
    upright: bool
    faces: IntArray


def divide(topo: Topology, label: IntArray, leaves: int) -> tuple[IntArray, list[int], IntArray]:
    """Cut the primitives of a fused surface that carry handles of several fronts.

    Args:
        label: (F,) primitive of every face, -1 for none. leaves: how many of them, the first ones,
            were cut out of the fused surface; others are surfaces of their own, and stay whole.

    Returns:
        The labels with new ones after these, for each new one the primitive it was cut out of, and
        (F,) for each front of several, its handle and other face included, `stack` times the number
        of its flat and one of its own, -1 elsewhere.
    """
    middle = topo.points[topo.faces].mean(axis=1)
    flats = _flats(topo, label, middle, leaves)
    handles = [_handles(topo, flat) for flat in flats]
    total = int(label.max()) + 1
    out, body = label.copy(), np.full(len(label), -1, dtype=np.int64)
    origin: list[int] = []

    def cut(pieces: list[int], side: NDArray[np.bool_]) -> None:
        for old in np.unique(out[np.isin(label, pieces)]):
            area = topo.areas * (out == old)
            if FRONTS.sliver < area[side].sum() / area.sum() < 1.0 - FRONTS.sliver:
                out[side & (out == old)] = total + len(origin)
                origin.append(int(old))

    def carve(faces: IntArray, old: int) -> None:
        mine = faces[out[faces] == old]
        own = old < leaves or old >= total
        if own and topo.areas[mine].sum() < FRONTS.carved * topo.areas[out == old].sum():
            out[mine] = total + len(origin)
            origin.append(old)

    taken: set[int] = set()
    for number, front in enumerate(flats):
        if number in taken:
            continue
        place = (middle @ front.frame[:, :2] - front.low) / (front.high - front.low)
        rows = _rows(handles[number])
        levels = _levels(rows, _rectangle(topo, front, rows))
        for level in levels:
            cut(front.pieces, place[:, 1] > level)
        strip = np.searchsorted(levels, place[:, 1])
        which, faces = strip.copy(), [number]
        for k, (bottom, top) in enumerate(pairwise([0.0, *levels, 1.0])):
            inside = [row for row in rows if bottom < row[0].at[1] < top]
            if len(inside) == 1 and _two_leaves(inside[0], bottom, top):
                right = (strip == k) & (place[:, 0] > 0.5)
                which[right] += len(levels) + 1
                faces += [] if levels else _behind(flats, front)
                for face in faces:
                    cut(flats[face].pieces, right)
        taken.update(faces)
        if which.any():
            ours = np.zeros(len(label), dtype=bool)
            for face in faces:
                ours |= flats[face].faces
                for handle in handles[face]:
                    ours[handle.faces] = True
            strips = [np.flatnonzero(front.faces & (which == k)) for k in np.unique(which[ours])]
            areas = [np.bincount(out[f], topo.areas[f], minlength=1) for f in strips]
            if all(a.max() > FRONTS.whole * a.sum() for a in areas):
                body[ours] = FRONTS.stack * number + which[ours]
                for strip_faces, area in zip(strips, areas):
                    carve(strip_faces, int(area.argmax()))
    new = np.arange(leaves, leaves + len(origin))
    move = np.concatenate([np.arange(leaves), np.arange(leaves, total) + len(new), new])
    return np.where(out >= 0, move[out], -1), [int(move[k]) for k in origin], body


def joined(merges: IntArray, count: int, origin: list[int]) -> IntArray:
    """The merge order with the new primitives joined to those they were cut out of first.

    Args:
        merges: (M, 2) over the first `count` primitives, as in `Primitives`.
        origin: as `divide` gives it, for those that follow them.
    """
    new = len(origin)
    moved = np.where(merges >= count, merges + 2 * new, merges)
    rows: list[tuple[int, int]] = []
    node: dict[int, int] = {}
    for k in range(new)[::-1]:  # the last cut is undone first
        a, b = origin[k], count + k
        rows.append((node.get(a, a), node.get(b, b)))
        node[a] = count + new + len(rows) - 1
    whole = moved.copy()
    for p, top in node.items():
        whole[moved == p] = top
    return np.vstack([np.array(rows, dtype=np.int64).reshape(-1, 2), whole])


def fronts(topo: Topology, label: IntArray, body: IntArray) -> NDArray[np.bool_]:
    """(T, P) the primitives of each front with its handle, as `Primitives.fronts`.

    None of a flat where one of its fronts has no primitive of its own.

    Args:
        label: (F,) primitive of every face. body: (F,) as `divide` gives it.
    """
    whole = np.bincount(label, weights=topo.areas)
    each = [body == k for k in np.unique(body[body >= 0])]
    areas = [np.bincount(label[own], topo.areas[own], minlength=len(whole)) for own in each]
    most = np.max(areas, axis=0, initial=0.0)
    rows = [(area > FRONTS.filled * whole) & (area == most) for area in areas]
    told = [area[row].sum() > 0.5 * area.sum() for row, area in zip(rows, areas)]  # not handles
    flat = np.unique(body[body >= 0]) // FRONTS.stack
    kept = [row for row, at in zip(rows, flat) if all(np.array(told)[flat == at])]
    return np.array(kept, dtype=bool).reshape(-1, len(whole))


def _flats(topo: Topology, label: IntArray, middle: FloatArray, leaves: int) -> list[_Flat]:
    """The large upright flats, those of large primitives first."""
    found: list[_Flat] = []
    size = np.bincount(label[label >= 0], weights=topo.areas[label >= 0])
    for p in np.argsort(-size):
        if size[p] < FRONTS.least_area * size.sum():
            break
        mine = label == p
        plane = _plane(topo, middle, mine)
        if plane is None:
            continue
        out, depth = plane
        flat = (topo.normals @ out > FRONTS.aligned) & (np.abs(middle @ out - depth) < FRONTS.level)
        flat &= topo.kept & (label >= 0)
        region = groups(topo.manifold[flat[topo.manifold].all(axis=1)], len(label))
        main = np.bincount(region[flat & mine], weights=topo.areas[flat & mine]).argmax()
        flat &= region == main
        if any((flat & f.faces).sum() > 0.5 * flat.sum() for f in found):
            continue
        right = np.cross([0.0, 0.0, 1.0], out)
        right /= np.linalg.norm(right)
        frame = np.column_stack([right, np.cross(out, right), out])
        corners = topo.points[topo.faces[flat]].reshape(-1, 3) @ frame[:, :2]
        low, high = corners.min(axis=0), corners.max(axis=0)
        inside = np.bincount(label[flat], weights=topo.areas[flat], minlength=len(size))
        pieces = [int(q) for q in np.flatnonzero(inside > FRONTS.filled * size) if q < leaves]
        if len(pieces) and (high - low).min() > 2 * FRONTS.out:
            found.append(_Flat(frame, low, high, depth, flat, pieces))
    return found


def _plane(
    topo: Topology, middle: FloatArray, mine: NDArray[np.bool_]
) -> tuple[FloatArray, float] | None:
    """Normal (3,) and offset of the upright plane that most of a primitive lies in, if it does."""
    areas, normals = topo.areas[mine], topo.normals[mine]
    out = areas @ normals
    for cosine in (0.5, 0.9, FRONTS.aligned):
        out /= max(float(np.linalg.norm(out)), 1e-12)
        out = (areas * (normals @ out > cosine)) @ normals
    if not out.any():
        return None
    out /= np.linalg.norm(out)
    if abs(out[2]) > FRONTS.upright:
        return None
    aligned = normals @ out > FRONTS.aligned
    if not aligned.any():
        return None
    depths = middle[mine][aligned] @ out
    order = np.argsort(depths)
    weight = np.cumsum(areas[aligned][order])
    depth = float(depths[order][np.searchsorted(weight, weight[-1] / 2)])
    if areas[aligned][np.abs(depths - depth) < FRONTS.level].sum() < FRONTS.filled * areas.sum():
        return None
    return out, depth


def _rectangle(topo: Topology, front: _Flat, rows: list[list[_Handle]]) -> FloatArray:
    """(2, 2) corners of what reaches out evenly from the handles; fractions of the flat."""
    if len(rows) < 2:  # no stack
        return np.array([[0.0, 0.0], [1.0, 1.0]])
    picture = Image.new("1", (FRONTS.grid, FRONTS.grid))
    draw = ImageDraw.Draw(picture)
    span = front.high - front.low
    corners = (topo.points[topo.faces[front.faces]] @ front.frame[:, :2] - front.low) / span
    for triangle in corners * FRONTS.grid:
        draw.polygon([tuple(c) for c in triangle.tolist()], fill=1)
    for handle in (h for row in rows for h in row):
        draw.rectangle([*(handle.low * FRONTS.grid), *(handle.high * FRONTS.grid)], fill=1)
    solid = ndimage.binary_closing(np.pad(np.array(picture), 4), iterations=2)[4:-4, 4:-4]
    ends = []
    for handle in (h for row in rows for h in row):
        x, y = np.clip((handle.at * FRONTS.grid).astype(int), 0, FRONTS.grid - 1)
        runs = (ndimage.label(solid[y])[0], x), (ndimage.label(solid[:, x])[0], y)
        ends.append([np.flatnonzero(run == run[cell])[[0, -1]] for run, cell in runs])
    first_last = np.median(np.array(ends), axis=0).T  # from (handles, axes, 2)
    return np.array([first_last[0], first_last[1] + 1.0]) / FRONTS.grid


def _handles(topo: Topology, front: _Flat) -> list[_Handle]:
    """The small pieces that stand on a front with flat all around them, or float before it."""
    island = groups(topo.manifold[~front.faces[topo.manifold].any(axis=1)], len(topo.faces))
    border = topo.manifold[front.faces[topo.manifold].sum(axis=1) == 1]
    on_flat = front.faces[border]
    touched = island[border[~on_flat]]
    area = topo.areas[front.faces].sum()
    found = []
    beyond = np.flatnonzero(~front.faces & topo.kept)
    sizes = np.bincount(island[beyond], topo.areas[beyond], minlength=int(island.max()) + 1)
    touched = np.unique(touched)
    nearest = np.full(len(sizes), np.inf)
    height = (topo.points[topo.faces[beyond]] @ front.frame[:, 2]).min(axis=1) - front.depth
    np.minimum.at(nearest, island[beyond], height)
    floats = np.flatnonzero((nearest > 0) & (nearest < FRONTS.hover))
    touched = np.union1d(touched, floats)
    for k in touched[
        (sizes[touched] > FRONTS.out**2) & (sizes[touched] < FRONTS.handle_area * area)
    ]:
        faces = beyond[island[beyond] == k]
        corners = topo.points[topo.faces[faces]].reshape(-1, 3) @ front.frame
        low, high = corners.min(axis=0), corners.max(axis=0)
        wide, tall = high[:2] - low[:2]
        stands = high[2] - front.depth
        if (
            stands < max(FRONTS.out, FRONTS.stout * min(wide, tall))
            or low[2] < front.depth - 2 * FRONTS.level
        ):
            continue
        span = front.high - front.low
        ends = (low[:2] - front.low) / span, (high[:2] - front.low) / span
        middle = (ends[0] + ends[1]) / 2
        if not FRONTS.edge < middle[0] < 1.0 - FRONTS.edge or not 0.0 < middle[1] < 1.0:
            continue
        size = np.array([min(wide, tall), max(wide, tall), stands])
        upright = bool(tall > FRONTS.slender * wide)
        found.append(_Handle(middle, *ends, size, upright, faces))
    return found


def _rows(handles: list[_Handle]) -> list[list[_Handle]]:
    """Handles beside each other, from the lowest row; rows of three or more are switches."""
    rows: list[list[_Handle]] = []
    for handle in sorted(handles, key=lambda h: float(h.at[1])):
        if rows and handle.at[1] - rows[-1][-1].at[1] < FRONTS.row:
            rows[-1].append(handle)
        else:
            rows.append([handle])
    return [row for row in rows if len(row) == 1 or (len(row) == 2 and _alike(*row))]


def _alike(a: _Handle, b: _Handle) -> bool:
    return bool((np.abs(a.size - b.size) < FRONTS.same_size * np.maximum(a.size, b.size)).all())


def _levels(rows: list[list[_Handle]], whole: FloatArray) -> list[float]:
    """Heights between a stack of fronts, upwards; fractions of the flat.

    Args:
        whole: (2, 2) corners of the stack.
    """
    if len(rows) < 2:
        return []
    centre, width = whole[:, 0].mean(), whole[1, 0] - whole[0, 0]
    for row in rows:
        aside = abs(float(np.mean([h.at[0] for h in row])) - centre)
        if aside > 1.5 * FRONTS.middle * width and not row[0].upright:
            return []
    if not all(_alike(a[0], b[0]) for a, b in pairwise(rows)):
        return []
    at = np.array([row[0].at[1] for row in rows])
    between = (at[:-1] + at[1:]) / 2
    if rows[0][0].upright:  # the handles of a freezer's and a fridge's doors are near each other
        return list(between)
    for levels in (_centred(at, *whole[:, 1]), at[:-1] + whole[1, 1] - at[-1]):
        if levels is not None and (levels > at[:-1]).all() and (levels < at[1:]).all():
            return list(levels)
    return list(between)


def _centred(at: FloatArray, low: float, high: float) -> FloatArray | None:
    """The levels if every handle sits in the middle of its front, None if they cannot.

    Three handles and more at even distances are on fronts of one height.
    """
    levels = [low]
    for height in at:
        levels.append(2 * float(height) - levels[-1])
    spare, steps = high - levels[-1], np.diff(at)
    even = len(steps) > 1 and np.ptp(steps) < FRONTS.even * steps.mean()
    jagged = np.ptp(np.diff([low, *(np.array(levels[1:-1]) + spare / 2), high]))
    if abs(spare) > FRONTS.middle or (even and jagged > FRONTS.jagged * steps.mean()):
        return None
    return np.array(levels[1:-1]) + spare / 2


def _two_leaves(row: list[_Handle], bottom: float, top: float) -> bool:
    """Whether the handles of a front say that it is a pair of doors."""
    at = [float(h.at[0]) for h in row]
    if len(row) == 2:
        return abs(sum(at) - 1.0) < FRONTS.middle and abs(at[0] - at[1]) < FRONTS.pair
    height = (float(row[0].at[1]) - bottom) / (top - bottom)
    if not 0.25 < height < 0.75:
        return False
    aside = abs(at[0] - 0.5)
    if row[0].upright and aside < FRONTS.middle:
        return True
    inner = min(abs(float(row[0].low[0]) - 0.5), abs(float(row[0].high[0]) - 0.5))
    return FRONTS.middle / 2 < aside < 2 * FRONTS.middle and inner < FRONTS.middle / 2


def _behind(flats: list[_Flat], front: _Flat) -> list[int]:
    """Which flats are the other faces of the doors that `front` is the front of."""
    found = []
    span = front.high[0] - front.low[0]
    for k, other in enumerate(flats):
        if other.frame[:, 2] @ front.frame[:, 2] > -FRONTS.aligned:
            continue
        ends = np.sort([-other.low[0], -other.high[0]])  # its right is our left
        if not 0 < front.depth + other.depth < FRONTS.thin * span:
            continue
        if np.abs(ends - [front.low[0], front.high[0]]).max() < FRONTS.middle * span:
            found.append(k)
    return found
