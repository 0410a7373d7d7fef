"""Features of slide hypotheses, measured for all directions of a part at once."""

from __future__ import annotations

import numpy as np

from mam_pipeline.geometry.sampling import thin_out
from mam_pipeline.joints.context import PartContext
from mam_pipeline.joints.line_features import self_match
from mam_pipeline.types import FloatArray

STEPS = np.array([0.06, 0.2, 0.45, 0.75, 1.0])  # of the part's extent along the slide
KEEP_STEP = 0.5

SLIDE_NAMES = (
    *(f"free_{k}" for k in range(5)), *(f"other_{k}" for k in range(5)), "up", "to_front",
    "along_share", "is_long", "is_thin", "tilted", "length", "room", "free_up", "free_front",
    "symmetric", "handle_along", "contact_normal", "contact_span", "keep", "keep_other",
    "free_exposure", "other_exposure", "free_room", "other_room", "free_touch", "other_touch",
    "snug_more", "snug_less", "sunk", "leaves_object", "other_leaves", "centre_along",
)  # fmt: skip


def measure_slides(
    context: PartContext, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure slides along unit directions (D, 3).

    Returns:
        Axes (D, 3) turned so that positive motion opens, rows (D, SLIDE_NAMES), and how clearly
        the sense was decided, (D,) 0..1.
    """
    scene, d = context.scene, context.diagonal
    count = len(axes)
    extent = np.ptp(scene.points @ axes.T, axis=0)
    steps = np.maximum(extent, 0.35 * scene.size)[:, None] * STEPS
    both = scene.blocked_many(
        "prismatic", np.concatenate([axes, -axes]), np.zeros((2 * count, 3)),
        np.concatenate([steps, steps]),
    )  # fmt: skip
    plus, minus = both[:count], both[count:]
    corners = object_corners(context)
    ends = np.stack([
        ((corners @ (s * axes).T).max(axis=0) - (scene.points @ (s * axes).T).max(axis=0)) / d
        for s in (1.0, -1.0)
    ])  # fmt: skip
    preference = minus.mean(axis=1) - plus.mean(axis=1)
    tie = np.sign(axes @ context.front + 0.1 * (ends[1] - ends[0]))
    positive = preference + 0.02 * tie >= 0
    free = np.where(positive[:, None], plus, minus)
    other = np.where(positive[:, None], minus, plus)
    leave = np.where(positive, ends, ends[::-1])
    axes = np.where(positive, 1.0, -1.0)[:, None] * axes
    rows = np.concatenate([
        free, other, _shape(context, axes, extent, corners), _contact(context, axes, extent),
        _around(context, axes), leave.T, _along(context, axes, corners)[:, None],
    ], axis=1)  # fmt: skip
    return axes, rows, np.minimum(np.abs(preference) * 5.0, 1.0)


def _shape(
    context: PartContext, axes: FloatArray, extent: FloatArray, corners: FloatArray
) -> FloatArray:
    """The direction within the part and the object: (D, 12)."""
    box, frame, d = context.box, context.frame, context.diagonal
    order = np.argsort(-box.half)
    share = np.abs(axes @ box.axes.T)
    handle = np.zeros(len(axes))
    if context.handle.share:
        spot = context.handle.center * box.half @ box.axes
        handle = axes @ spot / np.maximum(0.5 * extent, 1e-4 * d)
    centre = np.repeat(box.center[None], len(axes), axis=0)
    return np.stack([
        np.abs(axes @ frame.up), np.abs(axes @ context.front),
        extent / max(context.scene.size, 1e-9), share[:, order[0]], share[:, order[2]],
        1.0 - np.abs(axes @ frame.axes.T).max(axis=1), extent / d,
        extent / np.maximum(np.ptp(corners @ axes.T, axis=0), 1e-6 * d),
        axes @ frame.up, axes @ context.front, self_match(context, axes, centre), handle,
    ], axis=1)  # fmt: skip


def _contact(context: PartContext, axes: FloatArray, extent: FloatArray) -> FloatArray:
    """Contact with what stands still, and what sliding leaves of it (derailment): (D, 4)."""
    found, scene, d = context.contact, context.scene, context.diagonal
    if not len(found.points):
        return np.zeros((len(axes), 4))
    keep = thin_out(len(found.points), 60)
    points = found.points[keep]
    normal = np.abs(found.normals @ axes.T).mean(axis=0)
    span = np.ptp(found.points @ axes.T, axis=0) / np.maximum(extent, 1e-6 * d)
    step = KEEP_STEP * np.maximum(extent, 0.1 * scene.size)[:, None] * axes  # (D, 3)
    moved = np.stack([points[None] + step[:, None], points[None] - step[:, None]])
    gap = scene.static_scene.distance(moved.reshape(-1, 3)).reshape(2, len(axes), -1)
    held = (gap < found.tau + 0.002 * d).mean(axis=2)
    return np.stack([normal, span, held[0], held[1]], axis=1)


def _around(context: PartContext, axes: FloatArray) -> FloatArray:
    """Room ahead and behind, and walls that guide from the sides: (D, 9)."""
    clear = np.minimum(context.clearance, 1.0)
    room = np.minimum(np.quantile(clear, 0.2, axis=1), 0.6)
    touch = (clear < 0.006).mean(axis=1)
    escape = context.exposure
    ahead = np.array([context.towards(a) for a in axes])
    behind = (ahead + 3) % 6
    close = clear < 0.02
    snug = np.stack([(close[k] & close[k + 3]).mean() for k in range(3)])
    out = []
    for k in ahead % 3:
        i, j = (m for m in range(3) if m != k)
        sunk = float((close[i] & close[i + 3] & close[j] & close[j + 3]).mean())
        out.append([max(snug[i], snug[j]), min(snug[i], snug[j]), sunk])
    return np.concatenate([
        np.stack([escape[ahead], escape[behind], room[ahead], room[behind], touch[ahead],
                  touch[behind]], axis=1), np.array(out).reshape(-1, 3),
    ], axis=1)  # fmt: skip


def _along(context: PartContext, axes: FloatArray, corners: FloatArray) -> FloatArray:
    """Place of the part along the opening direction within the object, -1..1: (D,)."""
    spread = corners @ axes.T
    middle = 0.5 * (spread.max(axis=0) + spread.min(axis=0))
    half = np.maximum(0.5 * np.ptp(spread, axis=0), 1e-6 * context.diagonal)
    return np.asarray((axes @ context.box.center - middle) / half)


def object_corners(context: PartContext) -> FloatArray:
    """The 8 corners (8, 3) of the object's box, asset frame."""
    f = context.frame
    pick = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=bool)
    return np.asarray(np.where(pick, f.high, f.low) @ f.axes)
