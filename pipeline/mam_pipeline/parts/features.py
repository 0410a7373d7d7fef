"""What the models see of single primitives and of pairs: invariant to scale, yaw and names.

Horizontal directions are never told apart by name: quantities along them are sorted. Lengths are
shares of the object's diagonal. Prior columns hold NaN when there is no kinematic prior; the
models are trained with and without.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.parts import solid
from mam_pipeline.parts.graph import CONTACT, Graph
from mam_pipeline.prior.probe import NEAR
from mam_pipeline.types import FloatArray, IntArray

PAIR_UNARY = (
    "area", "thin", "slim", "fill", "revolve", "low", "high", "see_up", "see_side",
    "upright_thin", "upright_long", "span_z", "twins", "curved", "mobility",
)  # fmt: skip


@dataclass(frozen=True)
class Table:
    """Named feature columns: `values` (n, len(names)) float32."""

    names: tuple[str, ...]
    values: np.ndarray

    def column(self, name: str) -> np.ndarray:
        """(n,) one column."""
        out: np.ndarray = self.values[:, self.names.index(name)]
        return out

    def columns(self, names: tuple[str, ...]) -> np.ndarray:
        """(n, len(names)) some columns.

        Raises:
            ValueError: a column that is not there.
        """
        if names == self.names:
            return self.values
        if missing := set(names) - set(self.names):
            raise ValueError(f"trained on other features ({sorted(missing)} missing); train again")
        return self.values[:, [self.names.index(n) for n in names]]


def table(columns: dict[str, np.ndarray]) -> Table:
    """Stack named columns of equal length."""
    values = np.stack([np.asarray(c, dtype=np.float32) for c in columns.values()], axis=1)
    return Table(tuple(columns), values)


def object_extent(graph: Graph) -> FloatArray:
    """(3,) extents of the whole object, object frame."""
    size: FloatArray = graph.high.max(axis=0) - graph.low.min(axis=0)
    return np.maximum(size, 1e-6)


def shape_columns(
    graph: Graph,
    area: FloatArray,
    low: FloatArray,
    high: FloatArray,
    size: FloatArray,
    axes: FloatArray,
    see: FloatArray,
) -> dict[str, np.ndarray]:
    """Columns on the shape and place of boxes: primitives and groups of them alike.

    Args:
        area: (n,). low, high: (n, 3) boxes. size, axes: (n, 3), (n, 3, 3) tight boxes.
        see: (n, 6) share seen from the six directions.
    """
    whole = object_extent(graph)
    bottom, top = graph.low.min(axis=0), graph.high.max(axis=0)
    extent = high - low
    side = np.sort(see[:, :4], axis=1)
    span = np.sort(extent[:, :2] / whole[:2], axis=1)
    inset = np.sort(
        np.concatenate([low[:, :2] - bottom[:2], top[:2] - high[:, :2]], axis=1), axis=1
    )
    shell = 2 * (size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 0] * size[:, 2])
    volume = np.prod(extent / whole + 1e-3, axis=1)
    middle = (low + high) / 2
    away = np.linalg.norm((middle - (bottom + top) / 2)[:, :2], axis=1)
    return {
        "area": area, "log_area": np.log(area + 1e-6),
        "size0": size[:, 0], "size1": size[:, 1], "size2": size[:, 2],
        "slim": size[:, 1] / size[:, 0], "thin": size[:, 2] / size[:, 1],
        "flat": size[:, 2] / size[:, 0],
        "upright_thin": np.abs(axes[:, 2, 2]), "upright_long": np.abs(axes[:, 0, 2]),
        "tilted": 1 - np.abs(axes).max(axis=2).min(axis=1),
        "fill": np.minimum(area * graph.probe.surface / np.maximum(shell, 1e-6), 4.0),
        "solid": np.log(volume), "extent_z": extent[:, 2], "span_z": extent[:, 2] / whole[2],
        "span_small": span[:, 0], "span_big": span[:, 1],
        "low": (low[:, 2] - bottom[2]) / whole[2], "high": (high[:, 2] - bottom[2]) / whole[2],
        "middle": (middle[:, 2] - bottom[2]) / whole[2], "away": away,
        "lift": low[:, 2] - bottom[2], "drop": top[2] - high[:, 2],
        "inset0": inset[:, 0], "inset1": inset[:, 1], "inset2": inset[:, 2], "inset3": inset[:, 3],
        "see_up": see[:, 4], "see_down": see[:, 5], "see_side": side[:, 3],
        "see_side1": side[:, 2], "see_side2": side[:, 1], "see_side3": side[:, 0],
        "see": see.mean(axis=1),
    }  # fmt: skip


def object_columns(graph: Graph, count: int) -> dict[str, np.ndarray]:
    """The same values on every row: what kind of object this is."""
    whole = object_extent(graph)
    flat = np.sort(whole[:2])
    box = np.prod(graph.high - graph.low + 1e-3, axis=1) / np.prod(whole + 1e-3)
    values = {
        "n": float(np.log(graph.count)), "tall": float(whole[2]),
        "deep": float(flat[0] / flat[1]), "largest": float(graph.area.max()),
        "largest_box": float(box.max()), "border": float(graph.border.sum()),
        "round_share": float(graph.area[graph.revolve > 0.8].sum()),
        "thin_share": float(graph.area[graph.size[:, 2] < 0.12 * graph.size[:, 1]].sum()),
    }  # fmt: skip
    return {f"object_{k}": np.full(count, v) for k, v in values.items()}


def seen(graph: Graph) -> FloatArray:
    """(P, 6) share of every primitive's area seen from outside along six directions."""
    free = graph.probe.escapes()
    total = np.stack(
        [np.bincount(graph.probe.owner, graph.probe.weight * free[:, d], minlength=graph.count)
         for d in range(6)], axis=1,
    )  # fmt: skip
    return total / np.maximum(graph.area, 1e-12)[:, None]


def normal_shares(graph: Graph) -> FloatArray:
    """(P, 2) share of area that is level (faces up or down) and that is curved or tilted."""
    n, w, o = np.abs(graph.probe.normals), graph.probe.weight, graph.probe.owner
    level = np.bincount(o, w * (n[:, 2] > 0.98), minlength=graph.count)
    skew = np.bincount(o, w * (n.max(axis=1) < 0.98), minlength=graph.count)
    return np.stack([level, skew], axis=1) / np.maximum(graph.area, 1e-12)[:, None]


def twins(size: FloatArray, area: FloatArray) -> FloatArray:
    """(n,) how many others have the same extents and area within 6 %."""
    ratio = np.abs(np.log((size[:, None] + 5e-3) / (size[None] + 5e-3))).max(axis=2)
    like = (ratio < 0.06) & (np.abs(np.log((area[:, None] + 1e-7) / (area[None] + 1e-7))) < 0.12)
    return like.sum(axis=1).astype(np.float64) - 1


def primitive_features(graph: Graph, prior: KinematicPrior | None) -> Table:
    """(P, F) features of single primitives with their surroundings."""
    p, see = graph.count, seen(graph)
    columns = shape_columns(graph, graph.area, graph.low, graph.high, graph.size, graph.axes, see)
    shares = normal_shares(graph)
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    touching = graph.gap < CONTACT.touch
    degree = np.bincount(i[touching], minlength=p) + np.bincount(j[touching], minlength=p)
    held = np.bincount(i, graph.touch[:, 0], minlength=p) + np.bincount(
        j, graph.touch[:, 1], minlength=p
    )
    biggest, most, little, nearest = np.zeros(p), np.zeros(p), np.zeros(p), np.full(p, 1.0)
    for a, b, side in ((i, j, 0), (j, i, 1)):
        ratio = graph.area[b] / np.maximum(graph.area[a], 1e-9)
        np.maximum.at(biggest, a[touching], ratio[touching])
        np.maximum.at(most, a, graph.touch[:, side])
        np.add.at(little, a[touching & (ratio < 0.3)], 1.0)
        np.minimum.at(nearest, a, graph.gap)
    cover = graph.probe.cover()
    cover[np.arange(p), np.arange(p)] = 0.0
    wrapped = cover.max(axis=1)
    near = graph.probe.cover(NEAR)
    rank = np.argsort(np.argsort(-graph.area)) / max(p - 1, 1)
    columns |= {
        "revolve": graph.revolve, "spin_up": np.abs(graph.spin_axis[:, 2]),
        "level": shares[:, 0], "curved": shares[:, 1], "rank": rank,
        "degree": degree, "degree_share": degree / max(p - 1, 1), "held": held,
        "held_most": most, "biggest": np.log(biggest + 1e-3), "little": little,
        "nearest": nearest, "twins": twins(graph.size, graph.area),
        "wrapped": wrapped.mean(axis=1), "wrapped_sides": (wrapped > 0.5).sum(axis=1),
        "ahead_small": _small_ahead(graph, near),
    }  # fmt: skip
    columns |= solid.primitive_columns(graph)
    columns |= object_columns(graph, p)
    columns["mobility"] = np.full(p, np.nan) if prior is None else prior.mobility
    return table(columns)


def _small_ahead(graph: Graph, near: np.ndarray) -> FloatArray:
    """(P,) whether a much smaller primitive sits right before a face: a handle's mark."""
    smaller = graph.area[None, :] < 0.35 * graph.area[:, None]
    before = near.transpose(1, 0, 2).max(axis=2)  # before[i, j]: share of j that has i ahead
    out: FloatArray = (before.T * smaller.T).max(axis=0) if graph.count else np.zeros(0)
    return out.astype(np.float64)


def pair_features(graph: Graph, unary: Table, prior: KinematicPrior | None) -> Table:
    """(E, F) features of neighbouring pairs; the larger primitive of a pair comes first."""
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    swap = graph.area[i] < graph.area[j]
    a, b = np.where(swap, j, i), np.where(swap, i, j)
    touch = np.where(swap[:, None], graph.touch[:, ::-1], graph.touch)
    sa, sb = graph.size[a], graph.size[b]
    low, high = np.maximum(graph.low[a], graph.low[b]), np.minimum(graph.high[a], graph.high[b])
    overlap = np.maximum(high - low, 0.0) / np.maximum(graph.high[b] - graph.low[b], 1e-6)
    overlap = np.where(graph.high[b] - graph.low[b] < 1e-6, 1.0, overlap)
    order = np.sort(overlap, axis=1)
    columns: dict[str, np.ndarray] = {
        "gap": graph.gap, "log_gap": np.log(graph.gap + 1e-4),
        "touch_a": touch[:, 0], "touch_b": touch[:, 1],
        "touch_area": touch[:, 0] * graph.area[a] + touch[:, 1] * graph.area[b],
        "patch": np.sort(graph.patch, axis=1)[:, 2] / sb[:, 0],
        "patch1": np.sort(graph.patch, axis=1)[:, 1] / sb[:, 0],
        "border": graph.border / sb[:, 0], "concave": graph.concave, "convex": graph.convex,
        "area_ratio": np.log((graph.area[b] + 1e-7) / (graph.area[a] + 1e-7)),
        "size_ratio": sb[:, 0] / sa[:, 0], "inside": np.prod(overlap, axis=1),
        "overlap0": order[:, 0], "overlap1": order[:, 1], "overlap2": order[:, 2],
        "overlap_z": overlap[:, 2],
    }  # fmt: skip
    columns |= _placement(graph, a, b)
    columns |= _occlusion(graph, a, b)
    columns |= solid.pair_columns(graph, a, b)
    for name in PAIR_UNARY:
        column = unary.column(name)
        columns[f"a_{name}"], columns[f"b_{name}"] = column[a], column[b]
    for name in ("object_n", "object_tall", "object_border", "object_largest"):
        columns[name] = unary.column(name)[a]
    columns["affinity"] = np.full(len(a), np.nan) if prior is None else prior.affinity[a, b]
    return table(columns)


def _placement(graph: Graph, a: IntArray, b: IntArray) -> dict[str, np.ndarray]:
    """How two boxes stand to each other: offsets along the larger one's axes, alignment."""
    offset = graph.center[b] - graph.center[a]
    local = np.abs(np.einsum("eij,ej->ei", graph.axes[a], offset)) / np.maximum(graph.size[a], 1e-3)
    across = np.abs(np.einsum("ei,ei->e", graph.axes[a][:, 2], graph.axes[b][:, 2]))
    along = np.abs(np.einsum("ei,ei->e", graph.axes[a][:, 0], graph.axes[b][:, 0]))
    spin = np.abs(np.einsum("ei,ei->e", graph.spin_axis[a], graph.spin_axis[b]))
    lateral = offset - np.sum(offset * graph.spin_axis[a], 1)[:, None] * graph.spin_axis[a]
    scale = graph.size[b][:, 0] + 1e-3
    likeness = np.abs(np.log((graph.size[a] + 5e-3) / (graph.size[b] + 5e-3))).max(axis=1)
    extent_a, extent_b = graph.high[a] - graph.low[a], graph.high[b] - graph.low[b]
    face = np.minimum(np.abs(graph.low[a] - graph.low[b]), np.abs(graph.high[a] - graph.high[b]))
    return {
        "off_long": local[:, 0], "off_mid": local[:, 1], "off_thin": local[:, 2],
        "off_z": offset[:, 2], "across": across, "along": along, "coaxial": spin,
        "lateral": np.linalg.norm(lateral, axis=1) / scale,
        "distance": np.linalg.norm(offset, axis=1),
        "likeness": likeness, "flush0": np.sort(face, 1)[:, 0], "flush1": np.sort(face, 1)[:, 1],
        "flush2": np.sort(face, 1)[:, 2],
        "extent_like": np.sort(np.abs(extent_a - extent_b), axis=1)[:, 1],
    }  # fmt: skip


def _occlusion(graph: Graph, a: IntArray, b: IntArray) -> dict[str, np.ndarray]:
    """How much each lies before the other, over all distances and right before it."""
    out: dict[str, np.ndarray] = {}
    for tag, reach in (("", np.inf), ("near_", NEAR)):
        cover = graph.probe.cover(reach)
        for name, share in (("ab", cover[a, b]), ("ba", cover[b, a])):
            order = np.sort(share, axis=1)
            out[f"{tag}cover_{name}"] = order[:, 5]
            out[f"{tag}cover_{name}1"] = order[:, 4]
            out[f"{tag}cover_{name}_sides"] = (share > 0.5).sum(axis=1)
            out[f"{tag}cover_{name}_z"] = share[:, 4:].max(axis=1)
    return out
