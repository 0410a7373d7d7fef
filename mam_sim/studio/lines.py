"""Lines of a mesh that an axis can run along: straight edges, middles of strips and of rims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from mam_pipeline.render.tracer import Tracer
from mam_pipeline.types import FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class LineThresholds:
    """Which edges count, what is straight or round, and what is near the pointer.

    Attributes:
        crease: radians between two faces at an edge. weld: diagonals within which two corners are
            one. turned: radians between edges that continue each other. straight: the farthest
            that a point may lie from its line, as a share of the line's length.
        short: diagonals below which a straight line is left out.
        bend: radians that a rim turns at a corner, at most. uneven: how often a rim's edge may be
            longer than the next. corners: of a rim, at least. gap: radians of a rim that may be
            missing. out_of_round: of a rim's points, shares of its radius.
        rims: that are looked for, the largest first.
        strip: width over length of a strip between two edges that run alike, at most. like: length
            of the shorter one over the longer, at least. longest: edges of a mesh that are looked
            at for strips, the longest first.
        near: tangent of the angle between the pointer's ray and a line that is near it.
        before: diagonals that a surface must lie before a line to hide it.
        same: diagonals within which two lines that run alike are one.
        offered: lines at one place.
    """

    crease: float = 0.5
    weld: float = 1e-5
    turned: float = 0.035
    straight: float = 0.01
    short: float = 0.01
    bend: float = 0.9
    uneven: float = 2.5
    corners: int = 8
    gap: float = 3.3
    out_of_round: float = 0.03
    rims: int = 200
    strip: float = 0.2
    like: float = 0.8
    longest: int = 400
    near: float = 0.015
    before: float = 0.004
    same: float = 0.002
    offered: int = 8


LINES = LineThresholds()


@dataclass(frozen=True)
class Lines:
    """n lines at rest, each of one owner, and the m segments by which they are seen.

    Attributes:
        axis: (n, 3) unit. origin: (n, 3) middle of the edge, or of the rim, metres.
        length: (n,) of an edge, or across a rim, metres. round: (n,) whether it is a rim.
        owner: (n,) whose it is.
        ends: (m, 2, 3) of the segments, metres. line: (m,) which line a segment belongs to.
    """

    axis: FloatArray
    origin: FloatArray
    length: FloatArray
    round: NDArray[np.bool_]
    owner: IntArray
    ends: FloatArray
    line: IntArray


@dataclass(frozen=True)
class LineHit:
    """A line near the pointer: its row in `Lines`, and whether a surface hides it there."""

    line: int
    hidden: bool


@dataclass(frozen=True)
class _Edges:
    """k edges of the surface.

    Attributes:
        corners: (k, 2) numbers, for each owner apart. ends: (k, 2, 3) where they are, metres.
        owner: (k,).
    """

    corners: IntArray
    ends: FloatArray
    owner: IntArray

    def of(self, chosen: NDArray[np.bool_] | IntArray) -> _Edges:
        return _Edges(self.corners[chosen], self.ends[chosen], self.owner[chosen])

    @property
    def length(self) -> FloatArray:
        return np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1))


def mesh_lines(mesh: Mesh, owner: IntArray) -> Lines:
    """The straight edges of a mesh, fused where they continue each other, and its round rims.

    Between two long edges that run alike near each other, as on the side of a door, lies one more
    line: many hinges are drawn in the middle of a leaf.

    An edge is where the surface ends, or bends by more than `LineThresholds.crease`; which way its
    faces are wound, and whether each is there twice, makes no difference.

    Args:
        mesh: at rest. owner: (F,) body of every face; bodies do not share edges. Faces of a
            negative owner are left out.
    """
    edges = _fused(_sharp_edges(mesh, owner))
    links, bend = _continued(edges)
    length = edges.length[links]
    alike = length.max(axis=1, initial=0) < LINES.uneven * length.min(axis=1, initial=np.inf)
    rims, in_rim = _rims(edges, links[(bend < LINES.bend) & alike])
    straight = edges.of(~in_rim & (edges.length > LINES.short * mesh.diagonal))
    straight = _with_middles(straight, mesh.diagonal)
    along = straight.ends[:, 1] - straight.ends[:, 0]
    lines = Lines(
        along / straight.length[:, None], straight.ends.mean(axis=1), straight.length,
        np.zeros(len(along), np.bool_), straight.owner, straight.ends, np.arange(len(along)),
    )  # fmt: skip
    return _joined([lines, *rims])


def _sharp_edges(mesh: Mesh, owner: IntArray) -> _Edges:
    """Edges at which the faces are not just two that continue each other."""
    kept = np.flatnonzero(owner >= 0)
    place = np.round(mesh.vertices / max(LINES.weld * mesh.diagonal, 1e-12)).astype(np.int64)
    first, point = np.unique(place, axis=0, return_index=True, return_inverse=True)[1:]
    at = mesh.vertices[first]
    corners = point.reshape(-1)[mesh.faces[kept]]
    ends: IntArray = corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    across = corners[:, [2, 0, 1]].reshape(-1)
    whose = np.repeat(owner[kept], 3)
    ends = np.sort(ends, axis=1)
    along = at[ends[:, 1]] - at[ends[:, 0]]
    long = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-15)
    away = at[across] - at[ends[:, 0]]  # into the face, square to the edge
    away = away - np.einsum("ij,ij->i", away, along / long)[:, None] * along / long
    wide = np.linalg.norm(away, axis=1)
    solid = (ends[:, 0] != ends[:, 1]) & (wide > 1e-9 * mesh.diagonal)
    ends, whose = ends[solid], whose[solid]
    away = away[solid] / wide[solid, None]
    key = (whose * len(at) + ends[:, 0]) * len(at) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    start = np.flatnonzero(np.diff(key[order], prepend=-1))
    if not len(start):
        return _Edges(np.zeros((0, 2), np.int64), np.zeros((0, 2, 3)), np.zeros(0, np.int64))
    count = np.diff(start, append=len(order))
    cosine = np.einsum("ij,ij->i", away[order], np.repeat(away[order[start]], count, axis=0))
    limit = np.cos(LINES.crease)
    goes_on = np.minimum.reduceat(cosine, start) < -limit
    flat = np.minimum.reduceat(np.abs(cosine), start) > limit
    sharp = order[start[~(goes_on & flat)]]
    return _Edges(
        whose[sharp, None] * len(at) + ends[sharp], at[ends[sharp]], whose[sharp]
    )  # fmt: skip


def _continued(edges: _Edges) -> tuple[IntArray, FloatArray]:
    """Pairs (p, 2) of edges with a common corner, each with its best partners, and their bend (p,).

    Where many edges meet, an edge is asked for those beside it in a list of eight at most.
    """
    along = edges.ends[:, 1] - edges.ends[:, 0]
    along = along / np.maximum(edges.length[:, None], 1e-15)
    corner = edges.corners.T.reshape(-1)  # first all beginnings, then all ends
    outward = np.concatenate([along, -along])
    who = np.tile(np.arange(len(along)), 2)
    order = np.argsort(corner, kind="stable")
    pairs, bends = [np.zeros((0, 2), np.int64)], [np.zeros(0)]
    for step in range(1, 8):
        a, b = order[:-step], order[step:]
        both = corner[a] == corner[b]
        a, b = a[both], b[both]
        pairs.append(np.stack([who[a], who[b]], axis=1))
        cosine = -np.einsum("ij,ij->i", outward[a], outward[b])
        bends.append(np.arccos(np.clip(cosine, -1, 1)))
    return np.concatenate(pairs), np.concatenate(bends)


def _fused(edges: _Edges) -> _Edges:
    """The edges, those that continue each other as one; a curve of many edges stays as it is."""
    links, bend = _continued(edges)
    run = trimesh.graph.connected_component_labels(
        links[bend < LINES.turned], node_count=len(edges.owner)
    )  # fmt: skip
    first, count = np.unique(run, return_index=True, return_counts=True)[1:]
    along = edges.ends[:, 1] - edges.ends[:, 0]
    sign = np.sign(np.einsum("ij,ij->i", along, along[first][run]))
    axis = np.stack([np.bincount(run, along[:, k] * sign) for k in range(3)], axis=1)
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-15)
    local = edges.ends - edges.ends[first, 0][run][:, None]
    share = np.einsum("kij,kj->ki", local, axis[run])
    off = np.linalg.norm(local - share[..., None] * axis[run][:, None], axis=2).max(axis=1)
    far = np.zeros(len(first))
    np.maximum.at(far, run, off)
    order = np.lexsort((share.reshape(-1), np.repeat(run, 2)))  # ends of each run, along it
    last = np.cumsum(2 * count) - 1
    outer = order[np.stack([last - 2 * count + 1, last], axis=1)]
    length = np.diff(share.reshape(-1)[outer], axis=1)[:, 0]
    straight = (far < LINES.straight * length) & (count > 1)
    kept, ends = edges.of(~straight[run]), edges.ends.reshape(-1, 3)[outer[straight]]
    return _Edges(
        np.concatenate([kept.corners, edges.corners.reshape(-1)[outer[straight]]]),
        np.concatenate([kept.ends, ends]),
        np.concatenate([kept.owner, edges.owner[first[straight]]]),
    )


def _with_middles(edges: _Edges, size: float) -> _Edges:
    """Edges (k,), and the middle lines of the narrow strips between two of one owner."""
    longest = edges.of(np.argsort(-edges.length, kind="stable")[: LINES.longest])
    length, middle = longest.length, longest.ends.mean(axis=1)
    along = (longest.ends[:, 1] - longest.ends[:, 0]) / np.maximum(length[:, None], 1e-15)
    a, b = np.triu_indices(len(length), 1)
    cosine = np.einsum("ij,ij->i", along[a], along[b])
    apart = middle[b] - middle[a]
    shifted = np.abs(np.einsum("ij,ij->i", apart, along[a]))
    wide = np.linalg.norm(apart, axis=1)
    strip = (
        (longest.owner[a] == longest.owner[b])
        & (np.abs(cosine) > np.cos(LINES.turned))
        & (length[b] > LINES.like * length[a])  # the longest come first
        & (shifted < (1 - LINES.like) * length[a])
        & (wide < LINES.strip * length[a])
        & (wide > 2 * LINES.same * size)
    )
    a, b, cosine = a[strip], b[strip], cosine[strip]
    other = np.where(cosine[:, None, None] < 0, longest.ends[b][:, ::-1], longest.ends[b])
    return _Edges(
        np.concatenate([edges.corners, longest.corners[a]]),
        np.concatenate([edges.ends, (longest.ends[a] + other) / 2]),
        np.concatenate([edges.owner, longest.owner[a]]),
    )


def _rims(edges: _Edges, links: IntArray) -> tuple[list[Lines], NDArray[np.bool_]]:
    """Rims among the chains of smoothly linked edges, and which edges (k,) they have."""
    taken = np.zeros(len(edges.owner), dtype=np.bool_)
    groups = trimesh.graph.connected_components(links, min_len=LINES.corners // 2)
    groups = sorted(groups, key=lambda g: -float(np.ptp(edges.ends[g], axis=(0, 1)).max()))
    found = []
    for group in groups[: LINES.rims]:
        points = edges.ends[group].reshape(-1, 3)
        middle = points.mean(axis=0)
        across, up, normal = np.linalg.svd(points - middle, full_matrices=False)[2]
        flat = (points - middle) @ np.stack([across, up], axis=1)
        rows = np.column_stack([2 * flat, np.ones(len(flat))])
        center = np.linalg.lstsq(rows, (flat**2).sum(axis=1), rcond=None)[0][:2]
        reach = np.linalg.norm(flat - center, axis=1)
        radius = float(reach.mean())
        wrong = max(np.abs((points - middle) @ normal).max(), np.abs(reach - radius).max())
        if wrong > LINES.out_of_round * radius:
            continue
        turns = np.arctan2(flat[:, 1] - center[1], flat[:, 0] - center[0])
        turns = np.unique(np.round(turns, 3))
        gap = np.diff(turns, append=turns[0] + 2 * np.pi).max()
        whole = 2 * np.pi / max(2 * np.pi - gap, 1e-9)  # how many corners it would have, closed
        if gap > LINES.gap or len(turns) * whole < LINES.corners:
            continue
        taken[group] = True
        origin = middle + center[0] * across + center[1] * up
        found.append(Lines(
            normal[None], origin[None], np.array([2 * radius]), np.ones(1, np.bool_),
            edges.owner[group[:1]], edges.ends[group], np.zeros(len(group), np.int64),
        ))  # fmt: skip
    return found, taken


def _joined(several: list[Lines]) -> Lines:
    """All lines as one set."""
    shift = np.cumsum([0, *(len(one.axis) for one in several)])
    line = np.concatenate([one.line + k for one, k in zip(several, shift)])

    def each(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(one, name) for one in several])

    return Lines(
        each("axis"), each("origin"), each("length"), each("round"), each("owner"), each("ends"),
        line,
    )  # fmt: skip


def posed_lines(lines: Lines, poses: FloatArray) -> Lines:
    """Lines where their owners are.

    Args:
        poses: (owners, 4, 4).
    """
    turn, shift = poses[lines.owner, :3, :3], poses[lines.owner, :3, 3]
    of = lines.line
    return Lines(
        np.einsum("nij,nj->ni", turn, lines.axis),
        np.einsum("nij,nj->ni", turn, lines.origin) + shift,
        lines.length, lines.round, lines.owner,
        np.einsum("mij,mkj->mki", turn[of], lines.ends) + shift[of][:, None], of,
    )  # fmt: skip


def lines_near(
    lines: Lines, tracer: Tracer, eye: FloatArray, ray: FloatArray, size: float
) -> list[LineHit]:
    """Lines that pass near a ray: first those that are seen, the nearest to the ray before others,
    then the hidden ones, from the front to the back. Of lines that are one, the first alone.

    Args:
        lines, tracer: of the object as posed. ray: (3,) unit. size: diagonal of the object, metres.
    """
    if not len(lines.ends):
        return []
    deep, off, at = _approach(lines.ends, eye, ray)
    angle = np.where(deep > 1e-9, off / np.maximum(deep, 1e-9), np.inf)
    near = np.flatnonzero(angle < LINES.near)
    near = near[np.argsort(angle[near], kind="stable")]
    near = near[np.sort(np.unique(lines.line[near], return_index=True)[1])]
    if not len(near):
        return []
    toward = at[near] - eye
    far = np.linalg.norm(toward, axis=1)
    free = tracer.distance(np.broadcast_to(eye, toward.shape), toward)
    hidden = (1 - free) * far > LINES.before * size
    order = np.lexsort((np.where(hidden, deep[near], angle[near]), hidden))
    out: list[LineHit] = []
    for k in order:
        line = int(lines.line[near[k]])
        if not any(_one_line(lines, line, hit.line, size) for hit in out):
            out.append(LineHit(line, bool(hidden[k])))
        if len(out) == LINES.offered:
            break
    return out


def _approach(
    ends: FloatArray, eye: FloatArray, ray: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far along a ray (m,) segments come nearest, how near (m,), and where on them (m, 3)."""
    start, along = ends[:, 0] - eye, ends[:, 1] - ends[:, 0]
    flat_start = start - np.outer(start @ ray, ray)  # as seen along the ray
    flat = along - np.outer(along @ ray, ray)
    share = -np.einsum("ij,ij->i", flat_start, flat) / np.maximum((flat**2).sum(axis=1), 1e-18)
    point = start + np.clip(share, 0, 1)[:, None] * along
    deep = point @ ray
    return deep, np.linalg.norm(point - np.outer(deep, ray), axis=1), point + eye


def _one_line(lines: Lines, a: int, b: int, size: float) -> bool:
    """Whether two lines run along the same one."""
    apart = np.cross(lines.origin[a] - lines.origin[b], lines.axis[b])
    alike = abs(float(lines.axis[a] @ lines.axis[b])) > np.cos(LINES.turned)
    return alike and float(np.linalg.norm(apart)) < LINES.same * size
