"""What the models see of a candidate part: its shape, its bonds, its freedom, its surroundings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.parts import solid
from mam_pipeline.parts.features import (
    Table,
    object_columns,
    seen,
    shape_columns,
    table,
)
from mam_pipeline.parts.graph import CONTACT, Graph, roundness, tight_box
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.network import Reading
from mam_pipeline.prior.probe import DIRECTIONS, NEAR
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class GroupThresholds:
    """What is counted of a candidate part.

    Attributes:
        swing: radians: a hinge that does not turn so far is none.
        proud: diagonals: what stands out farther than this before a face is a handle, knob or trim.
    """

    swing: float = 0.35
    proud: float = 0.008


GROUP = GroupThresholds()


def group_features(
    graph: Graph,
    masks: Masks,
    same: FloatArray,
    move: FloatArray,
    prior: KinematicPrior | None,
    views: dict[str, FloatArray] | None = None,
) -> Table:
    """(C, F) features of candidate groups.

    Args:
        masks: (C, P). same: (E,), move: (P,) probabilities from the pair and primitive models.
        views: more columns (C,): what networks say of the groups.
    """
    weight = masks * graph.area[None]
    area = np.maximum(weight.sum(axis=1), 1e-9)
    low = np.where(masks[:, :, None], graph.low[None], np.inf).min(axis=1)
    high = np.where(masks[:, :, None], graph.high[None], -np.inf).max(axis=1)
    see = weight @ seen(graph) / area[:, None]
    axes, size, revolve, spin = _boxes(graph, masks)
    columns = shape_columns(graph, area, low, high, size, axes, see)
    columns |= object_columns(graph, len(masks))
    columns["revolve"], columns["spin_up"] = revolve, np.abs(spin[:, 2])
    columns["revolve_most"] = (masks * graph.revolve[None] * (weight / area[:, None])).sum(axis=1)
    columns["members"] = masks.sum(axis=1)
    columns["member_share"] = masks.mean(axis=1)
    columns["largest_member"] = weight.max(axis=1) / area
    columns["twins"] = _loose_twins(size, area, masks)
    columns |= _bonds(graph, masks, weight, same, move)
    columns |= _surroundings(graph, masks, low, high)
    columns |= _handles(graph, masks, see, low, high)
    columns |= solid.group_columns(graph, masks)
    columns |= _freedom(graph, masks, axes, size, prior)
    return table(columns | (views or {}))


def measured(graph: Graph, masks: Masks, reading: Reading, prior: KinematicPrior | None) -> Table:
    """(C, F) the same, with what the networks of a reading say of the groups."""
    views = reading.group_columns(graph, masks)
    return group_features(graph, masks, reading.same, reading.move, prior, views)


def joined(groups: Table, more: Table, masks: Masks) -> Table:
    """Features of candidates measured in two lots; `masks` (C, P) of both: twins counted anew."""
    values = np.concatenate([groups.values, more.values])
    both = Table(groups.names, values)
    size = np.stack([both.column(n) for n in ("size0", "size1", "size2")], axis=1)
    values[:, groups.names.index("twins")] = _loose_twins(size, both.column("area"), masks)
    return both


def _boxes(graph: Graph, masks: Masks) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Tight box and roundness of every group (of the samples; single primitives as measured)."""
    n = len(masks)
    axes, size = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    revolve, spin = np.zeros(n), np.zeros((n, 3))
    for c, mask in enumerate(masks):
        if mask.sum() == 1:
            k = int(np.argmax(mask))
            axes[c], size[c] = graph.axes[k], graph.size[k]
            revolve[c], spin[c] = graph.revolve[k], graph.spin_axis[k]
            continue
        rows = graph.probe.members(mask)
        points = graph.probe.points[rows[:: max(1, len(rows) // 300)]]
        lead = int(np.argmax(np.where(mask, graph.area, 0)))
        if np.abs(graph.axes[lead]).max(axis=1).min() < 0.99:
            axes[c], size[c] = tight_box(points)
        else:  # square to the object, as its largest member is
            extent = graph.high[mask].max(axis=0) - graph.low[mask].min(axis=0)
            order = np.argsort(-extent, kind="stable")
            axes[c], size[c] = np.eye(3)[order], np.maximum(extent[order], 1e-6)
        revolve[c], spin[c] = roundness(points, axes[c], size[c])
    return axes, size, revolve, spin


def _loose_twins(size: FloatArray, area: FloatArray, masks: Masks) -> FloatArray:
    """(C,) other candidates of the same size that share no primitive with this one."""
    ratio = np.abs(np.log((size[:, None] + 5e-3) / (size[None] + 5e-3))).max(axis=2)
    like = (ratio < 0.08) & (np.abs(np.log(area[:, None] / area[None])) < 0.15)
    apart = masks.astype(np.float32) @ masks.T.astype(np.float32) == 0
    out: FloatArray = (like & apart).sum(axis=1).astype(np.float64)
    return out


def _bonds(
    graph: Graph, masks: Masks, weight: FloatArray, same: FloatArray, move: FloatArray
) -> dict[str, np.ndarray]:
    """How well a group hangs together, how well it is cut off, how its members would move."""
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    inner, cut = masks[:, i] & masks[:, j], masks[:, i] ^ masks[:, j]
    out: dict[str, np.ndarray] = {}
    for name, choose in (("inner", inner), ("cut", cut)):
        number = choose.sum(axis=1)
        out[f"{name}_pairs"] = number
        out[f"{name}_mean"] = np.where(
            number > 0, (choose * same).sum(axis=1) / np.maximum(number, 1), np.nan
        )
        out[f"{name}_low"] = np.where(choose, same, 2.0).min(axis=1, initial=2.0)
        out[f"{name}_high"] = np.where(choose, same, -1.0).max(axis=1, initial=-1.0)
    strong = np.zeros(masks.shape)
    bond = (inner * same).T
    np.maximum.at(strong.T, i, bond)
    np.maximum.at(strong.T, j, bond)
    weakest = np.where(masks, strong, 2.0).min(axis=1)
    out["weakest"] = np.where(masks.sum(axis=1) > 1, weakest, np.nan)
    area = np.maximum(weight.sum(axis=1), 1e-9)
    out["move"] = weight @ move / area
    out["move_low"] = np.where(masks, move, 2.0).min(axis=1)
    out["move_high"] = np.where(masks, move, -1.0).max(axis=1)
    rest = (~masks) * graph.area[None]
    out["rest_move"] = rest @ move / np.maximum(rest.sum(axis=1), 1e-9)
    out["rest_still"] = np.where(masks, 2.0, move).min(axis=1)
    return out


def _surroundings(
    graph: Graph, masks: Masks, low: FloatArray, high: FloatArray
) -> dict[str, np.ndarray]:
    """Contact with the rest, what would be left hanging, what lies inside the group's box."""
    p = graph.count
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    cut = masks[:, i] ^ masks[:, j]
    shared = graph.touch[:, 0] * graph.area[i] + graph.touch[:, 1] * graph.area[j]
    area = masks @ graph.area
    touching = np.zeros((p, p), dtype=np.float32)
    close = graph.gap < CONTACT.touch
    touching[i[close], j[close]] = touching[j[close], i[close]] = 1.0
    to_group = masks.astype(np.float32) @ touching
    to_rest = (~masks).astype(np.float32) @ touching
    hanging = ~masks & (to_group > 0) & (to_rest == 0)
    lonely = masks & (to_group == 0) & (masks.sum(axis=1) > 1)[:, None]
    margin = 0.004
    within = np.all(
        (graph.center[None] > low[:, None] - margin)
        & (graph.center[None] < high[:, None] + margin),
        axis=2,
    )
    gap = np.where(cut, graph.gap, 1.0).min(axis=1, initial=1.0)
    lead = int(np.argmax(np.prod(graph.high - graph.low + 1e-3, axis=1)))
    patch = np.where(cut[:, :, None] & close[None, :, None], graph.patch[None], 0.0)
    patch = patch.max(axis=1, initial=0.0)
    longest = np.maximum((high - low).max(axis=1), 1e-3)
    return {
        "held": (cut * shared).sum(axis=1) / np.maximum(area, 1e-9),
        "held_area": (cut * shared).sum(axis=1), "cut_touching": (cut & close).sum(axis=1),
        "gap": gap, "touches_lead": to_group[:, lead] > 0, "has_lead": masks[:, lead],
        "hanging": hanging @ graph.area / np.maximum(area, 1e-9), "hanging_n": hanging.sum(axis=1),
        "hanging_share": hanging @ graph.area,
        "lonely": (lonely * graph.area).sum(axis=1) / np.maximum(area, 1e-9),
        "within": ((within & ~masks) * graph.area).sum(axis=1) / np.maximum(area, 1e-9),
        "patch0": np.sort(patch, axis=1)[:, 2] / longest,
        "patch1": np.sort(patch, axis=1)[:, 1] / longest,
        "border": (cut * graph.border).sum(axis=1) / longest,
        "border_concave": (cut * graph.border * graph.concave).sum(axis=1)
        / np.maximum((cut * graph.border).sum(axis=1), 1e-9),
        "border_inner": ((masks[:, i] & masks[:, j]) * graph.border * graph.concave).sum(axis=1)
        / longest,
    }  # fmt: skip


def _handles(
    graph: Graph, masks: Masks, see: FloatArray, low: FloatArray, high: FloatArray
) -> dict[str, np.ndarray]:
    """What stands proud of the group's most visible face, and where on it."""
    names = ("proud", "proud_off_a", "proud_off_b", "proud_long_z", "proud_reach", "face_dir_z",
             "face_flat")  # fmt: skip
    out = {name: np.full(len(masks), np.nan) for name in names}
    free = graph.probe.escapes()
    for c, mask in enumerate(masks):
        d = int(np.argmax(see[c] - np.array([0, 0, 0, 0, 0, 0.3])))
        rows = graph.probe.members(mask)
        rows = rows[free[rows, d]]
        out["face_dir_z"][c] = abs(DIRECTIONS[d, 2])
        if len(rows) < 8:
            continue
        depth = graph.probe.points[rows] @ DIRECTIONS[d]
        weight = graph.probe.weight[rows]
        order = np.argsort(depth)
        cumulative = np.cumsum(weight[order])
        plane = depth[order[np.searchsorted(cumulative, 0.5 * cumulative[-1])]]
        proud = depth > plane + GROUP.proud
        out["face_flat"][c] = weight[np.abs(depth - plane) < GROUP.proud / 2].sum() / cumulative[-1]
        out["proud"][c] = weight[proud].sum() / cumulative[-1]
        if not proud.any():
            continue
        points = graph.probe.points[rows[proud]]
        axis = [k for k in range(3) if k != d // 2]
        half = np.maximum((high[c] - low[c])[axis] / 2, 1e-3)
        offset = np.abs((points.mean(axis=0) - (low[c] + high[c]) / 2)[axis]) / half
        extent = points.max(axis=0) - points.min(axis=0)
        # the last of the two in-plane axes is the vertical one on every upright face
        out["proud_off_a"][c], out["proud_off_b"][c] = offset
        out["proud_long_z"][c] = extent[axis[1]] / max(extent[axis[0]] + extent[axis[1]], 1e-6)
        out["proud_reach"][c] = (depth.max() - plane) / max(half.max(), 1e-3)
    return out


def _freedom(
    graph: Graph, masks: Masks, axes: FloatArray, size: FloatArray, prior: KinematicPrior | None
) -> dict[str, np.ndarray]:
    """Motion probing of the complete group (kinematic prior only; NaN without)."""
    names = [f"{what}_{axis}_{side}" for what in ("free", "near")
             for axis in ("long", "mid", "thin") for side in ("more", "less")]  # fmt: skip
    names += ["free_best", "free_dirs", "travel_best", "travel_median", "near_up", "near_down",
              "free_up", "free_down", "mobility", "affinity_in", "affinity_cut",
              "blocked_one_way"]  # fmt: skip
    names += ["swing_best", "swing_free", "swing_held", "swing_upright", "swing_second",
              "swing_long", "swing_mid", "swing_thin"]  # fmt: skip
    out = {name: np.full(len(masks), np.nan) for name in names}
    if prior is None:
        return out
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    bond = prior.affinity[i, j]
    inner, cut = masks[:, i] & masks[:, j], masks[:, i] ^ masks[:, j]
    out["affinity_in"] = (inner * bond).sum(axis=1) / np.maximum(inner.sum(axis=1), 1)
    out["affinity_cut"] = np.where(cut, bond, 0).max(axis=1, initial=0.0)
    out["mobility"] = (masks * graph.area * prior.mobility).sum(axis=1) / (
        masks @ graph.area + 1e-9
    )
    for c, mask in enumerate(masks):
        clear = graph.probe.clearance(mask)
        if len(clear) == 0:
            continue
        rows = graph.probe.members(mask)
        w = graph.probe.weight[rows]
        w = w / w.sum()
        swings = _swings(graph.probe.points[rows], clear, w, axes[c], size[c])
        for name, value in swings.items():
            out[name][c] = value
        length = size[c, 0]
        free, near = w @ (clear > length), w @ (clear < NEAR)
        rank = len(clear) // 20  # the 5 % that meet something first
        travel = np.partition(np.minimum(clear, length), rank, axis=0)[rank] / max(length, 1e-6)
        taken: list[int] = []
        for name, axis in zip(("thin", "mid", "long"), (2, 1, 0)):
            along = np.argsort(-np.abs(axes[c, axis]))
            k = next(int(r) for r in along if int(r) not in taken)
            taken.append(k)
            for what, value in (("free", free), ("near", near)):
                pair = np.sort(value[[2 * k, 2 * k + 1]])
                out[f"{what}_{name}_more"][c], out[f"{what}_{name}_less"][c] = pair[1], pair[0]
        out["free_best"][c], out["free_dirs"][c] = free.max(), (free > 0.9).sum()
        out["travel_best"][c], out["travel_median"][c] = travel.max(), np.median(travel)
        out["near_up"][c], out["near_down"][c] = near[4], near[5]
        out["free_up"][c], out["free_down"][c] = free[4], free[5]
        out["blocked_one_way"][c] = np.abs(free[0::2] - free[1::2]).max()
    return out


def _swings(
    points: FloatArray, clear: FloatArray, weight: FloatArray, axes: FloatArray, size: FloatArray
) -> dict[str, float]:
    """How freely a group could swing about the edges of its box, and what holds it there.

    Free: the share of the surface whose way ahead, along the main direction of its first motion, is
    longer than the least swing needs. Held: the share of the edge along which the group is near
    the rest. Axes are told apart by the box's longest, middle and shortest direction.

    Args:
        points, clear, weight: (n, 3), (n, 6), (n,) samples. axes, size: (3, 3), (3,) tight box.
    """
    step = max(1, len(points) // 150)
    x, ahead, w = points[::step], clear[::step], weight[::step] / weight[::step].sum()
    local = x @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    u, p = [], []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for a in (low[i], high[i]):
            for b in (low[j], high[j]):
                u.append(axes[k])
                p.append(a * axes[i] + b * axes[j])
    edge, corner = np.array(u), np.array(p)  # (12, 3)
    arm = x[None] - corner[:, None]
    motion = np.cross(edge[:, None], arm)  # (12, n, 3)
    main = np.argmax(np.abs(motion), axis=2)
    lever = np.take_along_axis(motion, main[:, :, None], axis=2)[:, :, 0]
    need = np.abs(lever) * GROUP.swing
    row = np.arange(len(x))[None]
    there = ahead[row, 2 * main + (lever < 0)] > need
    back = ahead[row, 2 * main + (lever >= 0)] > need
    free = np.maximum(there @ w, back @ w)
    along = np.einsum("ei,eni->en", edge, arm)
    away = np.linalg.norm(motion, axis=2)
    near = (ahead.min(axis=1) < 0.02)[None] & (away < 0.1 * size[0] + 0.005)
    reach = np.where(near, along, -np.inf).max(axis=1) - np.where(near, along, np.inf).min(axis=1)
    length = np.repeat(size, 4)
    held = np.clip(np.where(near.sum(axis=1) > 1, reach, 0.0) / np.maximum(length, 1e-6), 0, 1)
    good = free * (0.2 + 0.8 * held)
    order = np.argsort(-good, kind="stable")
    best = int(order[0])
    return {
        "swing_best": good[best], "swing_free": free[best], "swing_held": held[best],
        "swing_upright": abs(edge[best, 2]), "swing_second": good[order[1]],
        "swing_long": good[:4].max(), "swing_mid": good[4:8].max(), "swing_thin": good[8:].max(),
    }  # fmt: skip


def with_rivals(groups: Table, masks: Masks, value: FloatArray) -> Table:
    """The features with what a first answer (`value`, (C,)) says of rivals, twins and the rest."""
    share = masks.astype(np.float32) @ masks.T.astype(np.float32)
    size = masks.sum(axis=1).astype(np.float32)
    rival = share > 0
    np.fill_diagonal(rival, False)
    inside = (share == size[None, :]) & rival  # column's members all in the row's group
    around = (share == size[:, None]) & rival
    apart = ~rival
    np.fill_diagonal(apart, False)
    extent = np.stack([groups.column(k) for k in ("size0", "size1", "size2")], axis=1)
    like = np.abs(np.log((extent[:, None] + 5e-3) / (extent[None] + 5e-3))).max(axis=2) < 0.1

    def best(where: np.ndarray) -> np.ndarray:
        out: np.ndarray = np.where(where, value[None, :], 0.0).max(axis=1, initial=0.0)
        return out

    columns = dict(zip(groups.names, groups.values.T))
    columns |= {
        "value": value, "best_rival": best(rival), "best_inside": best(inside),
        "best_around": best(around), "best_twin": best(apart & like), "best_apart": best(apart),
        "rank_rivals": (rival & (value[None, :] > value[:, None])).sum(axis=1),
        "rank_all": (value[None, :] > value[:, None]).sum(axis=1),
        "strong_apart": (apart & (value[None, :] > 0.5)).sum(axis=1),
        "strong_inside": (inside & (value[None, :] > 0.5)).sum(axis=1),
        "best_all": np.full(len(value), value.max(initial=0.0)),
    }  # fmt: skip
    return table(columns)
