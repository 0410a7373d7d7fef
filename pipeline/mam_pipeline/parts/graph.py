"""The graph of primitives: boxes, contacts and borders, scale- and yaw-free.

Everything is measured in the object's own frame (`prior.probe`): diagonal 1, floor z = 0, main
walls along x and y. Nothing here depends on names, units or on which way the object faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from mam_pipeline.geometry.rows import row_keys
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.parts.rules.handle_feet import Seams, Surface, disjoint, standing
from mam_pipeline.parts.rules.sheets import sheets, through
from mam_pipeline.prior.probe import Probe, probe
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives, fused_by_cuts


@dataclass(frozen=True)
class ContactThresholds:
    """Which primitives are neighbours; lengths in bounding-box diagonals.

    Attributes:
        reach: pairs farther apart than this are no neighbours.
        touch: nearer than this counts as contact.
        nearest: neighbours that every primitive gets at least.
    """

    reach: float = 0.04
    touch: float = 0.006
    nearest: int = 4


CONTACT = ContactThresholds()


@dataclass(frozen=True)
class Graph:
    """Primitives as nodes, neighbouring pairs as edges.

    Attributes:
        probe: samples and crossings. area: (P,) share of the object's area.
        low, high: (P, 3) axis-aligned box, object frame.
        axes: (P, 3, 3) rows are the directions of a tight box, longest first; size: (P, 3) its
            extents in that order. revolve: (P,) 0..1 roundness about the tight box's best axis;
            spin_axis: (P, 3) that axis.
        pairs: (E, 2) i < j. gap: (E,) smallest distance. touch: (E, 2) share of i's area in
            contact with j, and of j's of i. patch: (E, 3) extents of the contact region's box.
        border: (E,) length of shared mesh edges; concave, convex: (E,) mean angle over it, rad.
        merges: (M, 2) the segmenter's own merge order, as in `Primitives`.
        rigid: (T, P) what moves as one, see `standing`, `Primitives.fronts`, `sheets`, `through`;
            of fused meshes only. fronts: (T,) which of it are fronts with handles, each a part.
    """

    probe: Probe
    area: FloatArray
    low: FloatArray
    high: FloatArray
    axes: FloatArray
    size: FloatArray
    revolve: FloatArray
    spin_axis: FloatArray
    pairs: IntArray
    gap: FloatArray
    touch: FloatArray
    patch: FloatArray
    border: FloatArray
    concave: FloatArray
    convex: FloatArray
    merges: IntArray | None = None
    rigid: NDArray[np.bool_] | None = None
    fronts: NDArray[np.bool_] | None = None

    @property
    def count(self) -> int:
        """Number of primitives."""
        return len(self.area)

    @property
    def is_fused(self) -> bool:
        """See `fused_by_cuts`."""
        return fused_by_cuts(self.merges, self.count)

    @property
    def center(self) -> FloatArray:
        """(P, 3) centres of the axis-aligned boxes."""
        return (self.low + self.high) / 2

    def bulk(self, mask: NDArray[np.bool_], share: float) -> NDArray[np.bool_]:
        """(P,) the largest primitives of `mask` with this share of its area: its body."""
        own = np.flatnonzero(mask)
        own = own[np.argsort(-self.area[own], kind="stable")]
        total = np.cumsum(self.area[own]) / max(float(self.area[own].sum()), 1e-12)
        return np.isin(np.arange(self.count), own[: 1 + int(np.searchsorted(total, share))])


def build_graph(
    mesh: Mesh, primitives: Primitives, seed: int = 0, probed: Probe | None = None,
    rules: Rules = ALL_RULES,
) -> Graph:  # fmt: skip
    """Measure the graph.

    Args:
        probed: samples and crossings that a prior already made.
        rules: hand rules that are followed.
    """
    sampled = probed if probed is not None else probe(mesh, primitives, seed)
    count = primitives.count
    order = np.argsort(primitives.labels, kind="stable")
    bounds = np.searchsorted(primitives.labels[order], np.arange(count + 1))
    groups = [order[bounds[k] : bounds[k + 1]] for k in range(count)]
    low, high = np.zeros((count, 3)), np.zeros((count, 3))
    axes, size = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    revolve, spin = np.zeros(count), np.tile([0.0, 0.0, 1.0], (count, 1))
    starts = np.searchsorted(sampled.owner, np.arange(count + 1))
    for k, faces in enumerate(groups):
        if len(faces) == 0:
            continue
        points = sampled.vertices[np.unique(mesh.faces[faces])]
        low[k], high[k] = points.min(axis=0), points.max(axis=0)
        axes[k], size[k] = tight_box(points)
        own = slice(starts[k], starts[k + 1])
        revolve[k], spin[k] = roundness(sampled.points[own], axes[k], size[k])
    pairs, gap, touch, patch = _contacts(mesh, sampled, groups, low, high)
    seams = _seams(sampled.vertices, mesh.faces, primitives.labels)
    normals, areas = face_geometry(sampled.vertices, mesh.faces)
    middle = sampled.vertices[mesh.faces].mean(axis=1)
    surface = Surface(primitives.labels, middle, normals, areas)
    rigid: NDArray[np.bool_] | None = None
    fronts: NDArray[np.bool_] | None = None
    if primitives.is_fused:
        rigid, fronts = _rigid(sampled, primitives, seams, surface, low, high, rules)
    return Graph(
        sampled,
        sampled.area,
        low,
        high,
        axes,
        size,
        revolve,
        spin,
        pairs,
        gap,
        touch,
        patch,
        *_borders(seams, surface, pairs, count),
        primitives.merges,
        rigid,
        fronts,
    )


def _rigid(
    sampled: Probe, primitives: Primitives, seams: Seams, surface: Surface, low: FloatArray,
    high: FloatArray, rules: Rules,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:  # fmt: skip
    """What moves as one body of a fused mesh (T, P), and (T,) what of it are fronts."""
    count = primitives.count
    apart = primitives.fronts
    if rules.handle_on_panel:
        apart = np.vstack([standing(seams, surface, count), apart])
    faces = sheets(sampled, low, high)
    both = through(seams, faces, sampled.area, low, high) if rules.through_sheet else apart[:0]
    pairs = faces if rules.two_sided_sheet else faces[:0]
    sides = np.array([np.isin(np.arange(count), pair) for pair in pairs]).reshape(-1, count)
    rigid = disjoint(np.vstack([apart, sides, both]))
    return rigid, np.array((rigid @ apart.T).any(axis=1), dtype=bool)


def tight_box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smallest of the boxes that turn about one coordinate axis: (axes, extents), longest first.

    Args:
        points: (n, 3).
    """
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, 1e-6)
    best_axes, best_size, best = np.eye(3), extent, float(np.prod(extent + 1e-3)) * 0.9
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        flat = points[:, [a, b]].astype(np.float32)
        _, (w, h), degrees = cv2.minAreaRect(np.ascontiguousarray(flat))
        volume = (w + 1e-3) * (h + 1e-3) * (extent[k] + 1e-3)
        if volume < best:
            turn = np.radians(degrees)
            axes = np.zeros((3, 3))
            axes[0, [a, b]] = [np.cos(turn), np.sin(turn)]
            axes[1, [a, b]] = [-np.sin(turn), np.cos(turn)]
            axes[2, k] = 1.0
            best_axes, best_size, best = (
                axes,
                np.array([max(w, 1e-6), max(h, 1e-6), extent[k]]),
                volume,
            )
    order = np.argsort(-best_size, kind="stable")
    return best_axes[order], best_size[order]


def roundness(points: FloatArray, axes: FloatArray, size: FloatArray) -> tuple[float, FloatArray]:
    """How much a surface looks like one of revolution, 0..1, and the best axis (3,).

    Outline radii in 13 sectors about each box axis must agree (13 shares no factor with the four
    sides of a plate or the six of a nut), and the outline must be as wide as high.
    """
    best, axis = 0.0, axes[2]
    middle = (points @ axes.T).max(axis=0) / 2 + (points @ axes.T).min(axis=0) / 2
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        aspect = min(size[a], size[b]) / max(size[a], size[b])
        if aspect < 0.75 or len(points) < 16:
            continue
        flat = (points @ axes.T - middle)[:, [a, b]]
        radius = np.linalg.norm(flat, axis=1)
        sector = ((np.arctan2(flat[:, 1], flat[:, 0]) + np.pi) / (2 * np.pi) * 13).astype(int) % 13
        outline = np.zeros(13)
        np.maximum.at(outline, sector, radius)
        score = float(aspect * outline.min() / max(outline.max(), 1e-9))
        if score > best:
            best, axis = score, axes[k]
    return best, axis


def _contacts(
    mesh: Mesh, sampled: Probe, groups: list[IntArray], low: FloatArray, high: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Neighbouring pairs with their gap and contact, measured from samples to triangles."""
    near, distance = _neighbours(low, high)
    i, j = np.nonzero(np.triu(near, 1))
    pairs = np.stack([i, j], axis=1).astype(np.int64)
    index = np.full(near.shape, -1, dtype=np.int64)
    index[i, j] = index[j, i] = np.arange(len(i))
    found, touch = np.full(len(i), np.inf), np.zeros((len(i), 2))
    patch_low, patch_high = np.full((len(i), 3), np.inf), np.full((len(i), 3), -np.inf)
    for k, faces in enumerate(groups):
        box = np.all(
            (sampled.points > low[k] - CONTACT.reach) & (sampled.points < high[k] + CONTACT.reach),
            axis=1,
        )
        rows = np.flatnonzero(box & near[k][sampled.owner])
        if len(rows) == 0 or len(faces) == 0:
            continue
        d = _distances(sampled.vertices, mesh.faces[faces], sampled.points[rows])
        edge = index[k, sampled.owner[rows]]
        np.minimum.at(found, edge, d)
        close = d < CONTACT.touch
        side = (sampled.owner[rows] > k).astype(np.int64)  # the column of the sampled primitive
        np.add.at(touch, (edge[close], side[close]), sampled.weight[rows[close]])
        np.minimum.at(patch_low, edge[close], sampled.points[rows[close]])
        np.maximum.at(patch_high, edge[close], sampled.points[rows[close]])
    gap = np.where(np.isfinite(found), found, np.maximum(distance[i, j], CONTACT.reach))
    touch /= np.maximum(sampled.area[pairs], 1e-12)
    patch = np.where(np.isfinite(patch_low), patch_high - patch_low, 0.0)
    return pairs, gap, touch, patch


def _neighbours(low: FloatArray, high: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """(P, P) neighbours by box distance (within reach, or among the nearest), and distances."""
    count = len(low)
    apart = np.maximum(low[:, None] - high[None], low[None] - high[:, None])
    distance = np.linalg.norm(np.maximum(apart, 0.0), axis=2)
    np.fill_diagonal(distance, np.inf)
    near = distance < CONTACT.reach
    if count > 1:
        rank = np.argsort(distance, axis=1, kind="stable")[:, : min(CONTACT.nearest, count - 1)]
        near[np.repeat(np.arange(count), rank.shape[1]), rank.reshape(-1)] = True
    return near | near.T, distance


def _distances(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    """(n,) unsigned distances from points to a few triangles."""
    used, inverse = np.unique(faces.reshape(-1), return_inverse=True)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(vertices[used].astype(np.float32)),
        o3d.core.Tensor.from_numpy(inverse.reshape(-1, 3).astype(np.uint32)),
    )
    query = o3d.core.Tensor.from_numpy(points.astype(np.float32))
    return scene.compute_distance(query, nthreads=1).numpy().astype(np.float64)


def _seams(vertices: FloatArray, faces: IntArray, labels: IntArray) -> Seams:
    """Mesh edges between primitives: none in authored meshes, whose primitives share no edge."""
    rounded = np.round(vertices[faces.reshape(-1)], 6)
    _, first, inverse = np.unique(row_keys(rounded), return_index=True, return_inverse=True)
    used = rounded[first]
    corner = inverse.reshape(-1, 3)
    ends = np.sort(corner[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    key = ends[:, 0] * np.int64(len(used)) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    sides = np.stack([owner[order[same]], owner[order[same + 1]]], axis=1)
    cross = labels[sides[:, 0]] != labels[sides[:, 1]]
    sides, at = sides[cross], ends[order[same][cross]]
    length = np.linalg.norm(used[at[:, 0]] - used[at[:, 1]], axis=1)
    return Seams(used, at, sides, labels[sides], length)


def _borders(
    seams: Seams, surface: Surface, pairs: IntArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Seams between primitives: total length, mean concave and mean convex angle, each (E,)."""
    a, b = seams.faces.T
    normal, middle = surface.normal, surface.middle
    angle = np.arccos(np.clip(np.sum(normal[a] * normal[b], axis=1), -1, 1))
    bent_in = np.sum(normal[a] * (middle[b] - middle[a]), axis=1) > 0
    index = {int(i) * count + int(j): e for e, (i, j) in enumerate(pairs)}
    low, high = seams.labels.min(axis=1), seams.labels.max(axis=1)
    edge = np.array([index.get(int(k), -1) for k in low * count + high], dtype=np.int64)
    keep = edge >= 0
    edge, length, angle, bent_in = edge[keep], seams.length[keep], angle[keep], bent_in[keep]
    total = np.bincount(edge, length, minlength=len(pairs)).astype(np.float64)
    hollow = np.bincount(edge, length * angle * bent_in, minlength=len(pairs))
    ridge = np.bincount(edge, length * angle * ~bent_in, minlength=len(pairs))
    return total, hollow / np.maximum(total, 1e-12), ridge / np.maximum(total, 1e-12)
