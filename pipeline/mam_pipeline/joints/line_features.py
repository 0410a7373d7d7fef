"""Features of revolute hypotheses, measured for all lines of a part at once.

Each row tells how freely the part turns both ways, where the line lies in the part and in the
object, what it is near to, and whether contact stays. Lengths are relative to the part or to the
object's diagonal.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.geometry.motion import motion_points
from mam_pipeline.geometry.sampling import thin_out, unit
from mam_pipeline.joints.context import PartContext
from mam_pipeline.types import FloatArray

ANGLES = np.deg2rad([10.0, 30.0, 60.0, 90.0])
SPIN_TURNS = np.deg2rad([47.0, 101.0, 163.0])  # coprime to square and hexagonal symmetry
KEEP_TURN = np.deg2rad(50.0)

LINE_NAMES = (
    *(f"free_{k}" for k in (10, 30, 60, 90)), *(f"other_{k}" for k in (10, 30, 60, 90)),
    "off_axis", "radius", "is_long", "is_thin", "up", "to_front", "tilted", "side_front",
    "side_lateral", "side_height", "lateral_abs", "thin_pos", "line_height", "along_share",
    "mass_off", "mass_above", "beyond_box", "corner",
    "line_part", "line_static", "mirror_static", "part_max", "static_min", "static_max",
    "handle_far", "handle_lateral", "handle_parallel", "outer_side", "swing_escape",
    "back_escape", "line_room", "far_room", "opens_front", "opens_up",
    "spin_match", "contact_near", "contact_mean", "contact_span", "contact_centred", "keep",
    "keep_other", "near_gap", "far_gap",
)  # fmt: skip


def measure_lines(
    context: PartContext, axes: FloatArray, origins: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure revolute hypotheses.

    Args:
        axes: (L, 3) unit directions, either sense. origins: (L, 3) points on the lines.

    Returns:
        Axes (L, 3) turned so that positive motion opens, rows (L, LINE_NAMES), and how clearly the
        sense was decided, (L,) 0..1.
    """
    scene, d = context.scene, context.diagonal
    count = len(axes)
    both = scene.blocked_many(
        "revolute", np.concatenate([axes, -axes]), np.concatenate([origins, origins]), ANGLES
    )
    plus, minus = both[:count], both[count:]
    arm = _across(context.box.center - origins, axes)
    length = np.linalg.norm(arm, axis=1)
    swing = np.where((length > 0.004 * d)[:, None], unit(np.cross(axes, arm)), 0.0)
    towards = swing @ context.front + 0.3 * swing @ context.frame.up
    preference = minus.mean(axis=1) - plus.mean(axis=1)
    sign = np.where(preference + 0.02 * np.sign(towards) >= 0, 1.0, -1.0)[:, None]
    free, other = np.where(sign > 0, plus, minus), np.where(sign > 0, minus, plus)
    axes, swing = sign * axes, sign * swing
    radial = _across(scene.points[None] - origins[:, None], axes[:, None])
    radius = np.maximum(np.linalg.norm(radial, axis=2).max(axis=1), 1e-4 * d)
    rows = np.concatenate([
        free, other, _shape(context, axes, origins, arm, radius),
        _gaps(context, axes, origins, arm, radius),
        _outlook(context, axes, origins, arm, swing, radius),
        _contact(context, axes, origins, radius),
    ], axis=1)  # fmt: skip
    return axes, rows, np.minimum(np.abs(preference) * 5.0, 1.0)


def _across(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    """Component of vectors (..., 3) across unit axes (..., 3)."""
    along = (vectors * axes).sum(axis=-1, keepdims=True)
    return np.asarray(vectors - along * axes)


def _shape(
    context: PartContext, axes: FloatArray, origins: FloatArray, arm: FloatArray, radius: FloatArray
) -> FloatArray:
    """Where each line lies in the part and in the object: (L, 18)."""
    box, frame, d, scene = context.box, context.frame, context.diagonal, context.scene
    order = np.argsort(-box.half)
    share = np.abs(axes @ box.axes.T)
    front, up = context.front, frame.up
    level = unit(np.cross(axes, front))
    sideways = np.linalg.norm(np.cross(axes, front), axis=1) > 0.3
    lateral = np.where(sideways, -(arm * level).sum(axis=1), 0.0)
    reach = np.abs(level @ box.axes.T) @ box.half + 1e-9 * d
    rise = context.half_along(up)
    lying = np.abs(axes @ up) < 0.5
    height = np.where(lying, origins @ up, box.center @ up)
    mass = _across(scene.dense.points.mean(axis=0) - origins, axes)
    flat = np.abs(arm @ box.axes.T) / np.maximum(box.half, 1e-4 * d)
    flat = np.where(share > 0.7, 0.0, flat)
    along = scene.points @ axes.T
    return np.stack([
        np.linalg.norm(arm, axis=1) / radius, radius / d, share[:, order[0]], share[:, order[2]],
        np.abs(axes @ up), np.abs(axes @ front), 1.0 - np.abs(axes @ frame.axes.T).max(axis=1),
        -(arm @ front) / context.half_along(front), lateral / reach,
        np.where(lying, -(arm @ up) / rise, 0.0), np.abs(lateral) / reach,
        np.abs(arm @ box.axes[order[2]]) / max(float(box.half[order[2]]), 1e-4 * d),
        (height - frame.low[2]) / max(float(frame.high[2] - frame.low[2]), 1e-9 * d),
        np.ptp(along, axis=0) / max(scene.size, 1e-9), np.linalg.norm(mass, axis=1) / radius,
        mass @ up / radius, np.maximum(flat.max(axis=1) - 1.0, 0.0),
        np.sort(flat, axis=1)[:, 1],
    ], axis=1)  # fmt: skip


def _gaps(
    context: PartContext, axes: FloatArray, origins: FloatArray, arm: FloatArray, radius: FloatArray
) -> FloatArray:
    """Distance of the lines to both bodies, also at the far side of the part: (L, 6)."""
    scene, d = context.scene, context.diagonal
    along = np.einsum("lpk,lk->lp", scene.points[None] - origins[:, None], axes)
    ends = np.quantile(along, [0.03, 0.97], axis=1)
    spots = ends[0] + np.linspace(0.0, 1.0, 9)[:, None] * (ends[1] - ends[0])  # (9, L)
    line = origins + spots[..., None] * axes
    mirror = line + 2.0 * arm
    count = len(axes)
    part = scene.part_scene.distance(line.reshape(-1, 3)).reshape(9, count) / d
    queries = np.concatenate([line, mirror]).reshape(-1, 3)
    static = np.minimum(scene.static_scene.distance(queries).reshape(2, 9, count) / d, 0.5)
    off = np.linalg.norm(arm, axis=1) / radius
    here = static[0].mean(axis=0)
    return np.stack([
        np.minimum(part.mean(axis=0), 0.5), here,
        np.where(off > 0.1, static[1].mean(axis=0), here) - here,
        np.minimum(part.max(axis=0), 0.5), static[0].min(axis=0), static[0].max(axis=0),
    ], axis=1)  # fmt: skip


def _outlook(
    context: PartContext, axes: FloatArray, origins: FloatArray, arm: FloatArray,
    swing: FloatArray, radius: FloatArray,
) -> FloatArray:  # fmt: skip
    """Handle, object and room around the part as seen from each line: (L, 10)."""
    box, frame = context.box, context.frame
    count = len(axes)
    handle = context.handle
    far = lateral = parallel = np.full(count, -1.0)
    if handle.share > 0:
        spot = box.center + (handle.center * box.half) @ box.axes
        flat = _across(spot - origins, axes)
        flat = flat - (flat @ context.front)[:, None] * context.front
        far = np.linalg.norm(flat, axis=1) / radius
        lateral = (flat * unit(arm)).sum(axis=1) / radius
        parallel = np.abs(axes @ box.axes[int(np.argmax(handle.half))])
    centre = 0.5 * (frame.low + frame.high) @ frame.axes
    mine = np.linalg.norm(_across(box.center - centre, axes), axis=1)
    line = np.linalg.norm(_across(origins - centre, axes), axis=1)
    escape = context.exposure
    room = np.minimum(np.quantile(np.minimum(context.clearance, 1.0), 0.3, axis=1), 0.6)

    def row(direction: FloatArray) -> int:
        return context.towards(direction) if np.linalg.norm(direction) > 0.5 else -1

    ahead = np.array([row(v) for v in swing])
    aside = np.array([row(unit(-v)) if np.linalg.norm(v) > 0 else -1 for v in arm])
    turned = (aside + 3) % 6
    return np.stack([
        far, lateral, parallel, (line - mine) / radius,
        np.where(ahead < 0, 0.5, escape[ahead]), np.where(ahead < 0, 0.5, escape[(ahead + 3) % 6]),
        np.where(aside < 0, 0.3, room[aside]), np.where(aside < 0, 0.3, room[turned]),
        swing @ context.front, swing @ frame.up,
    ], axis=1)  # fmt: skip


def _contact(
    context: PartContext, axes: FloatArray, origins: FloatArray, radius: FloatArray
) -> FloatArray:
    """Symmetry about the lines, contact around them and what turning leaves of it: (L, 9)."""
    scene, d = context.scene, context.diagonal
    count = len(axes)
    spin = self_match(context, axes, origins)
    points = context.contact.points[thin_out(len(context.contact.points), 120)]
    near = mean = span = centred = keep = lost = np.zeros(count)
    if len(points):
        rel = points[None] - origins[:, None]
        far = np.linalg.norm(_across(rel, axes[:, None]), axis=2) / radius[:, None]
        near, mean = (far < 0.12).mean(axis=1), far.mean(axis=1)
        extent = np.maximum(np.ptp(scene.points @ axes.T, axis=0), 1e-6 * d)
        span = np.ptp(points @ axes.T, axis=0) / extent
        middle = _across(points.mean(axis=0) - origins, axes)
        centred = np.linalg.norm(middle, axis=1) / radius
        few = points[thin_out(len(points), 32)]
        moved = np.stack([
            motion_points("revolute", a, o, np.array([KEEP_TURN, -KEEP_TURN]), few)
            for a, o in zip(axes, origins)
        ])  # fmt: skip
        gap = scene.static_scene.distance(moved.reshape(-1, 3)).reshape(count, 2, -1)
        held = (gap < context.contact.tau + 0.002 * d).mean(axis=2)
        keep, lost = held[:, 0], held[:, 1]
    edge, other = _edge_gaps(context, axes, origins, radius)
    return np.stack([spin, near, mean, span, centred, keep, lost, edge, other], axis=1)


def _edge_gaps(
    context: PartContext, axes: FloatArray, origins: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Small quantile of the gap to what stands still, near each line and far from it (L,)."""
    order = np.argsort(context.scene.rest_distance)
    points = context.scene.dense.points[order]
    gap = np.minimum(context.scene.rest_distance[order] / context.diagonal, 0.3)
    rel = points[None] - origins[:, None]
    far = np.linalg.norm(_across(rel, axes[:, None]), axis=2) / radius[:, None]
    found = []
    for mask in (far < 0.15, far > 0.8):
        running = np.cumsum(mask, axis=1)
        total = running[:, -1]
        at = (running >= np.maximum(0.1 * total, 1)[:, None]).argmax(axis=1)
        found.append(np.where(total > 0, gap[at], 0.3))
    return found[0], found[1]


def self_match(context: PartContext, axes: FloatArray, origins: FloatArray) -> FloatArray:
    """How badly the part fits itself when turned about each line, by its radius: (L,) 0..1.

    Large turns weigh as well, so that a bar, which fits only itself turned by 180 degrees, fails.
    """
    points = context.scene.points[thin_out(len(context.scene.points), 50)]
    turned = np.stack([
        motion_points("revolute", a, o, SPIN_TURNS, points) for a, o in zip(axes, origins)
    ])  # fmt: skip
    far = context.scene.part_scene.distance(turned.reshape(-1, 3)).reshape(len(axes), -1)
    radial = _across(points[None] - origins[:, None], axes[:, None])
    radius = np.maximum(np.linalg.norm(radial, axis=2).max(axis=1), 1e-9)
    return np.asarray(np.minimum(np.quantile(far, 0.9, axis=1) / radius, 1.0))
