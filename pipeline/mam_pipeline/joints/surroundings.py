"""Features of what is around a part: room on every side, grooves, the hollow behind it, siblings.

They are told in the part's own terms (front, back, above, below, the two sides in order of
openness), so they do not depend on the object's yaw or scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.joints.context import PartContext
from mam_pipeline.types import FloatArray

_SIDES = ("front", "back", "above", "below", "open_side", "shut_side")
SURROUNDING_NAMES = (
    *(f"{what}_{side}" for side in _SIDES for what in ("escape", "touch", "near", "room")),
    "groove_all", "groove_above", "groove_below", "groove_open", "groove_shut", "snug_level",
    "snug_rise", "snug_depth", "hollow", "hollow_share", "lies_on", "seen", "depth_25", "depth_50",
    "depth_75", "depth_95", "share_front", "share_rise", "share_level", "place_front",
    "place_rise", "place_level", "rise_over_level", "front_turned", "mass_rise", "mass_front",
)  # fmt: skip
SIBLING_NAMES = (
    "others", "alike", "beside_alike", "above_alike", "behind_alike", "overlap_alike",
    "mirror_gap", "covered", "mounted", "inside_other", "larger_others",
)  # fmt: skip


@dataclass(frozen=True)
class WallThresholds:
    """What is near a part; diagonals.

    Attributes:
        near: a wall closer than this may guide or cover.
        touch: closer than this is contact.
    """

    near: float = 0.04
    touch: float = 0.006


WALLS = WallThresholds()


def surrounding_features(context: PartContext) -> FloatArray:
    """Row of SURROUNDING_NAMES."""
    front, rise = context.front, context.rise
    level = np.asarray(np.cross(rise, front), dtype=np.float64)
    index = [context.towards(d) for d in (front, -front, rise, -rise, level, -level)]
    clear = context.clearance[index]
    escape = (~np.isfinite(clear)).mean(axis=1)
    if (escape[5], float(np.median(np.minimum(clear[5], 1)))) > (
        escape[4], float(np.median(np.minimum(clear[4], 1)))
    ):  # fmt: skip
        clear, level = clear[[0, 1, 2, 3, 5, 4]], -level
        escape = escape[[0, 1, 2, 3, 5, 4]]
    rows = np.stack([
        escape, (clear < WALLS.touch).mean(axis=1), (clear < WALLS.near).mean(axis=1),
        np.minimum(np.quantile(np.minimum(clear, 1.0), 0.3, axis=1), 0.6),
    ], axis=1).reshape(-1)  # fmt: skip
    guides = _captured(context, clear, rise, level)
    return np.concatenate(
        [rows, guides, _shape_behind(context, clear), _place(context, rise, level)]
    )


def _captured(
    context: PartContext, clear: FloatArray, rise: FloatArray, level: FloatArray
) -> FloatArray:
    """Where walls stand on both sides of the part: in a groove, in a hole."""
    local = context.scene.points - context.box.center
    up = local @ rise / context.half_along(rise)
    aside = local @ level / context.half_along(level)
    groove = (clear[0] < WALLS.near) & (clear[1] < WALLS.near)

    def share(mask: NDArray[np.bool_]) -> float:
        return float(groove[mask].mean()) if mask.any() else 0.0

    return np.array([
        groove.mean(), share(up > 0.85), share(up < -0.85), share(aside > 0.85),
        share(aside < -0.85), (clear[4:6] < 0.5 * WALLS.near).all(axis=0).mean(),
        (clear[2:4] < 0.5 * WALLS.near).all(axis=0).mean(),
        (clear[2:6] < WALLS.near).all(axis=0).mean(),
    ])  # fmt: skip


def _shape_behind(context: PartContext, clear: FloatArray) -> FloatArray:
    """Panel or box: how deep the hollow behind the front is, and how the part's area fills it."""
    front = context.front
    local = (context.scene.points - context.box.center) @ front / context.half_along(front)
    d = context.diagonal
    plate = local > np.quantile(local, 0.6) - 0.2
    behind = np.minimum(clear[1][plate], 1.0)
    along = 2 * context.half_along(front) / d
    below = (local.max() - np.quantile(local, [0.75, 0.5, 0.25, 0.05])) * context.half_along(front)
    level = np.asarray(np.cross(context.rise, front), dtype=np.float64)
    width = np.sqrt(context.half_along(context.rise) * context.half_along(level))
    seen = (~np.isfinite(clear)).any(axis=0).mean()
    return np.array([
        float(np.median(behind)), float((behind > 1.5 * along + 0.01).mean()),
        float((behind < WALLS.touch).mean()), seen, *(below / width),
    ])  # fmt: skip


def _place(context: PartContext, rise: FloatArray, level: FloatArray) -> FloatArray:
    """Size and place within the object's box, and where the part's own mass sits."""
    frame, box = context.frame, context.box
    centre = 0.5 * (frame.low + frame.high) @ frame.axes
    half = 0.5 * (frame.high - frame.low)
    whole = [max(float(np.abs(frame.axes @ a) @ half), 1e-6 * frame.diagonal)
             for a in (context.front, rise, level)]  # fmt: skip
    mine = [context.half_along(a) for a in (context.front, rise, level)]
    offset = box.center - centre
    mass = context.scene.dense.points.mean(axis=0) - box.center
    return np.array([
        mine[0] / whole[0], mine[1] / whole[1], mine[2] / whole[2],
        float(offset @ context.front) / whole[0], float(offset @ rise) / whole[1],
        abs(float(offset @ level)) / whole[2], np.log(mine[1] / mine[2]),
        1.0 - float(np.abs(frame.axes @ context.front).max()),
        float(mass @ rise) / mine[1], float(mass @ context.front) / mine[0],
    ])  # fmt: skip


def sibling_features(context: PartContext) -> FloatArray:
    """Row of SIBLING_NAMES; all NaN when the other parts are not known."""
    if context.others is None:
        return np.full(len(SIBLING_NAMES), np.nan)
    if not len(context.others):
        return np.array([0, 0, 0, 0, 0, 0, 2.0, 0, 0, 0, 0], dtype=np.float64)
    axes, half = context.box.axes, np.maximum(context.box.half, 1e-5 * context.diagonal)
    center = axes @ context.box.center
    level = np.cross(context.rise, context.front)
    order = [int(np.argmax(np.abs(axes @ v))) for v in (context.front, context.rise, level)]
    sign = np.sign(axes[order[0]] @ context.front)
    low, high = context.others[:, 0][:, order], context.others[:, 1][:, order]
    half, center = half[order], center[order]
    size = np.maximum(0.5 * (high - low), 1e-5 * context.diagonal)
    offset = (0.5 * (low + high) - center) / half  # in half extents: 2 is next door
    alike = (np.abs(np.log(size / half)) < 0.12).all(axis=1)
    over = np.minimum(high, center + half) - np.maximum(low, center - half)
    share = np.clip(over / (2 * np.minimum(size, half)), 0.0, 1.0)
    beside = alike & (share[:, 1] > 0.8) & (share[:, 0] > 0.5)
    above = alike & (share[:, 2] > 0.8) & (share[:, 0] > 0.5)
    behind = alike & (share[:, 1] > 0.8) & (share[:, 0] < 0.3) & (np.abs(offset[:, 2]) < 2.2)
    flat = share[:, 1] * share[:, 2]
    ahead = sign * offset[:, 0] * half[0] - size[:, 0] > 0.5 * half[0]
    larger = size[:, 1:].prod(axis=1) > 1.5 * half[1:].prod()
    inside = (over > 1.6 * half).all(axis=1)
    near = np.abs(offset[beside, 2]).min(initial=4.0)
    return np.array([
        np.log1p(len(alike)), alike.sum(), beside.sum(), above.sum(), behind.sum(),
        float(flat[behind].max(initial=0.0)), near,
        float(flat[ahead & larger].max(initial=0.0)),
        float(flat[~ahead & larger].max(initial=0.0)), float(inside.any()), larger.sum(),
    ])  # fmt: skip
