"""Splitting one fused surface along its creases: superfaces, then a hierarchy of greedy merges.

Superfaces are a graph segmentation (Felzenszwalb and Huttenlocher, IJCV 2004) of the faces under
dihedral angles; they are merged cheapest border first. Concave creases cost more than convex ones,
because parts meet at them; convex ones keep some weight, because flush fronts end at them.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from mam_pipeline.segment.topology import Topology
from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class MergeWeights:
    """How faces of a fused mesh join into primitives.

    Attributes:
        scale: how readily faces join in the graph segmentation, times the total area.
        smallest: share of the total area: superfaces below it join a neighbour.
        convex: weight of a convex crease against a concave one.
        area_power: how much the smaller side's area counts for a merge.
    """

    scale: float = 5e-6
    smallest: float = 5e-6
    convex: float = 0.15
    area_power: float = 0.45


MERGES = MergeWeights()


@dataclass(frozen=True)
class Hierarchy:
    """Leaves of a merge tree over some faces.

    Attributes:
        leaf: (F,) leaf of every face that was split, -1 for the others.
        merges: (leaves - roots, 2) rows join two nodes into node leaves + row.
        costs: (leaves - roots,) cost of each merge, in the order made.
        area: (leaves + merges,) share of the total area of every node.
    """

    leaf: IntArray
    merges: IntArray
    costs: FloatArray
    area: FloatArray


def hierarchy(topo: Topology, chosen: IntArray) -> Hierarchy:
    """Superfaces of the chosen faces and all merges of neighbours, cheapest first.

    Args:
        chosen: (n,) kept faces to split; those on different surfaces are never merged.
    """
    from mam_pipeline.segment.superfaces import superfaces

    local = np.full(len(topo.faces), -1, dtype=np.int64)
    local[chosen] = np.arange(len(chosen))
    inside = (local[topo.manifold] >= 0).all(axis=1)
    pairs = local[topo.manifold[inside]]
    ends = topo.points[topo.manifold_edge[inside]]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    # angles are taken raw: smoothing normals first, however guided, measured worse under noise
    areas = topo.areas[chosen]
    share = areas / max(float(areas.sum()), 1e-30)
    normals = topo.normals[chosen]
    centres = topo.points[topo.faces[chosen]].mean(axis=1)
    angle, concave = _angles(normals, centres, pairs)
    order = np.argsort(angle, kind="stable")
    super_ = superfaces(pairs[order], angle[order], share, MERGES.scale, MERGES.smallest)
    super_ = np.unique(super_, return_inverse=True)[1].astype(np.int64)
    weight = length * np.where(concave, angle, MERGES.convex * angle)
    merges, costs, area = _merge(super_, pairs, length, weight, share)
    leaf = np.full(len(topo.faces), -1, dtype=np.int64)
    leaf[chosen] = super_
    return Hierarchy(leaf, merges, costs, area)


def cut(tree: Hierarchy, count: int) -> tuple[IntArray, IntArray]:
    """Undo the last merges until `count` nodes are left (or all leaves).

    Returns:
        (F,) node numbers 0 .. n - 1 (-1 where the tree has no leaf) and the (n - 1 or fewer, 2)
        merges above them, numbered as in a SciPy linkage.
    """
    leaves = len(tree.area) - len(tree.merges)
    done = int(np.clip(leaves - count, 0, len(tree.merges)))
    node = np.arange(leaves + len(tree.merges))
    for row in range(done):
        node[tree.merges[row]] = leaves + row
    for k in range(leaves + done - 1, -1, -1):  # children have lower numbers than their parent
        node[k] = node[node[k]] if node[k] != k else k
    alive = np.unique(node[:leaves])
    number = np.full(leaves + len(tree.merges), -1, dtype=np.int64)
    number[alive] = np.arange(len(alive))
    label = np.where(tree.leaf >= 0, number[node[tree.leaf]], -1)
    rest = []
    for row in range(done, len(tree.merges)):
        rest.append(number[tree.merges[row]])
        number[leaves + row] = len(alive) + len(rest) - 1
    return label, np.array(rest, dtype=np.int64).reshape(-1, 2)


def _angles(normals: FloatArray, centres: FloatArray, pairs: IntArray) -> tuple[FloatArray, ...]:
    """Unsigned angle between neighbours, rad, and whether the edge between them is concave."""
    a, b = normals[pairs[:, 0]], normals[pairs[:, 1]]
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    step = centres[pairs[:, 1]] - centres[pairs[:, 0]]
    # both views, so that neither face's tilt decides alone
    concave = np.einsum("ij,ij->i", a - b, step) > 0
    return angle, concave


def _merge(
    label: IntArray, pairs: IntArray, length: FloatArray, weight: FloatArray, share: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Greedy merging of neighbouring regions; a border's cost is its mean angle times area."""
    count = int(label.max()) + 1
    border = label[pairs]
    cross = border[:, 0] != border[:, 1]
    low, high = border[cross].min(axis=1), border[cross].max(axis=1)
    key, inverse = np.unique(low * count + high, return_inverse=True)
    span = np.bincount(inverse, weights=length[cross], minlength=len(key))
    heavy = np.bincount(inverse, weights=weight[cross], minlength=len(key))
    near: list[dict[int, tuple[float, float]]] = [{} for _ in range(count)]
    for k, s, h in zip(key.tolist(), span.tolist(), heavy.tolist()):
        a, b = divmod(k, count)
        near[a][b] = near[b][a] = (s, h)
    area = np.bincount(label, weights=share, minlength=count).tolist()

    def cost(a: int, b: int) -> float:
        s, h = near[a][b]
        return h / max(s, 1e-30) * min(area[a], area[b]) ** MERGES.area_power

    heap = [(cost(a, b), a, b) for a in range(count) for b in near[a] if a < b]
    heapq.heapify(heap)
    alive = [True] * count
    merges, costs = [], []
    while heap:
        price, a, b = heapq.heappop(heap)
        if not (alive[a] and alive[b]):
            continue
        new = len(near)
        joined = dict(near[a])
        for c, (s, h) in near[b].items():
            s0, h0 = joined.get(c, (0.0, 0.0))
            joined[c] = (s + s0, h + h0)
        joined.pop(a, None)
        joined.pop(b, None)
        near.append(joined)
        area.append(area[a] + area[b])
        alive[a] = alive[b] = False
        alive.append(True)
        for c, value in joined.items():
            near[c].pop(a, None)
            near[c].pop(b, None)
            near[c][new] = value
        for c in joined:
            heapq.heappush(heap, (cost(c, new), c, new))
        near[a], near[b] = {}, {}
        merges.append((a, b))
        costs.append(price)
    rows = np.array(merges, dtype=np.int64).reshape(-1, 2)
    return rows, np.array(costs), np.array(area)
