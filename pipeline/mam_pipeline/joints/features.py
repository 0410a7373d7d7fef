"""Features of joint hypotheses, invariant to the object's scale and yaw.

Three rows: of the part alone (does it move, and how), of a line as revolute axis, of a direction as
slide. Lengths are relative to the part or to the object's diagonal; directions are stated against
up, against the part's own box and against the front it shows to the outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.geometry.boxes import principal_axes
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.geometry.sweep import motion_points
from mam_pipeline.joints.context import PartContext, directions_of, revolute_lines
from mam_pipeline.types import FloatArray

ANGLES = np.deg2rad([10.0, 30.0, 60.0, 90.0])
STEPS = np.array([0.06, 0.2, 0.45, 0.75, 1.0])
_SPIN_TURNS = np.deg2rad([47.0, 101.0, 163.0])  # coprime to square and hexagonal symmetry

PART_NAMES = (
    "size", "area_share", "flat", "long", "middle", "thin_up", "long_up", "front_up",
    "height_low", "height_mid", "height_high", "top_gap", "bottom_gap", "front_gap",
    "exposure_front", "exposure_back", "exposure_side_max", "exposure_side_min", "exposure_up",
    "exposure_mean", "depth_over_width", "contact_share", "contact_gap", "contact_long",
    "contact_flat", "contact_span", "contact_ahead", "contact_height", "handle_share",
    "handle_reach", "handle_aside", "handle_up", "handle_long", "symmetric", "symmetric_up",
    "symmetric_front", "fill", "box_fill", "centre_aside", "aligned",
)  # fmt: skip
LINE_NAMES = (
    *(f"free_{k}" for k in (10, 30, 60, 90)), *(f"other_{k}" for k in (10, 30, 60, 90)),
    "line_part", "line_static", "mirror_static", "off_axis", "radius", "along_share", "is_long",
    "is_thin", "up", "to_front", "tilted", "side_front", "side_lateral", "side_height",
    "handle_far", "handle_lateral", "handle_parallel", "outer_side", "spin_match", "contact_near",
    "contact_mean", "contact_span", "contact_centred", "opens_front", "opens_up", "other_gap",
    "line_height", "lateral_abs", "thin_pos",
)  # fmt: skip
SLIDE_NAMES = (
    *(f"free_{k}" for k in range(5)), *(f"other_{k}" for k in range(5)), "up", "to_front",
    "along_share", "is_long", "is_thin", "tilted", "free_exposure", "other_exposure",
    "leaves_object", "other_leaves", "handle_along", "contact_normal", "contact_span",
    "symmetric", "room", "free_up", "free_front", "length",
)  # fmt: skip


@dataclass(frozen=True)
class Hypothesis:
    """A line or direction with its features, opening sign already chosen.

    Attributes:
        revolute: line (True) or slide (False). spin: the line passes the part's middle.
        axis, origin: (3,) asset frame; positive motion opens.
        features: (LINE_NAMES) or (SLIDE_NAMES). sure: how clearly the sign was decided, 0..1.
    """

    revolute: bool
    spin: bool
    axis: FloatArray
    origin: FloatArray
    features: FloatArray
    sure: float


def enumerate_hypotheses(context: PartContext) -> list[Hypothesis]:
    """All slides and lines of a part with their features (about 0.2 s)."""
    out = []
    for axis in directions_of(context):
        out.append(slide_hypothesis(context, axis))
        for origin in revolute_lines(context, axis):
            out.append(line_hypothesis(context, axis, origin))
    return out


def part_features(context: PartContext) -> FloatArray:
    """Row of PART_NAMES."""
    frame, box, scene, d = context.frame, context.box, context.scene, context.diagonal
    order = np.argsort(-box.half)
    half = np.maximum(box.half[order], 1e-6 * d)
    long, thin = box.axes[order[0]], box.axes[order[2]]
    low, high = scene.points @ frame.up, frame.high[2] - frame.low[2]
    z = (np.quantile(low, [0.0, 0.5, 1.0]) - frame.low[2]) / max(high, 1e-9 * d)
    e = context.exposure
    f = np.concatenate([box.axes, -box.axes]) @ context.front
    k_front = int(np.argmax(f))
    side = [i for i in range(6) if abs(f[i]) < 0.5]
    k_up = int(np.argmax(np.concatenate([box.axes, -box.axes]) @ frame.up))
    contact = context.contact.points
    spread = principal_axes(contact)[1] if len(contact) > 3 else np.ones(3)
    spread = np.sqrt(np.maximum(spread, 0.0)) + 1e-6 * d
    mean = contact.mean(axis=0) - box.center if len(contact) else np.zeros(3)
    symmetric = [_self_match(context, a, box.center) for a in box.axes]
    best = int(np.argmin(symmetric))
    local = frame.axes @ (context.front)
    front_high = float(np.max((frame.high * local)[np.abs(local) > 0.5], initial=-np.inf))
    front_high = max(front_high, float(np.max((frame.low * local)[np.abs(local) > 0.5],
                                              initial=-np.inf)))  # fmt: skip
    front_gap = front_high - float((scene.points @ context.front).max())
    handle = context.handle
    level = np.cross(frame.up, context.front)
    reach = float(np.abs(box.axes @ level) @ box.half) + 1e-9 * d
    rise = float(np.abs(box.axes @ frame.up) @ box.half) + 1e-9 * d
    spot = handle.center * box.half @ box.axes
    depth = float(np.abs(box.axes @ context.front) @ box.half)
    object_volume = float(np.prod(np.maximum(frame.high - frame.low, 1e-6 * d)))
    centre = 0.5 * (frame.low + frame.high) @ frame.axes
    return np.array([
        2 * np.linalg.norm(half) / d, scene.area / d**2, half[2] / half[1], half[0] / half[1],
        half[1] / d, abs(thin @ frame.up), abs(long @ frame.up), context.front @ frame.up,
        z[0], z[1], z[2], 1.0 - z[2], z[0], front_gap / d,
        e[k_front], e[(k_front + 3) % 6], max(e[i] for i in side), min(e[i] for i in side),
        e[k_up], e.mean(), depth / np.sqrt(reach * rise + 1e-12), context.contact.share,
        min(context.contact.gap / d, 1.0), spread[0] / spread[1], spread[2] / spread[1],
        spread[0] / half[0], float(mean @ context.front) / max(depth, 1e-3 * d),
        float(mean @ frame.up) / rise, handle.share, handle.reach / d,
        abs(float(spot @ level)) / reach if handle.share else -1.0,
        float(spot @ frame.up) / rise if handle.share else -2.0,
        float(handle.half.max() / half[0]) if handle.share else 0.0,
        symmetric[best], abs(box.axes[best] @ frame.up), abs(box.axes[best] @ context.front),
        scene.area / (8 * (half[0] * half[1] + half[1] * half[2] + half[0] * half[2])),
        box.volume / object_volume,
        np.linalg.norm(np.cross(frame.up, box.center - centre)) / d,
        float(box is context.aligned),
    ])  # fmt: skip


def _self_match(context: PartContext, axis: FloatArray, origin: FloatArray) -> float:
    """How badly the part fits itself when turned about a line, relative to its radius (0..1).

    Half turns weigh as well, so that a bar, which fits only itself turned by 180 degrees, fails.
    """
    points = context.scene.points[:120]
    arm = points - origin
    radius = np.linalg.norm(arm - (arm @ axis)[:, None] * axis, axis=1)
    turned = motion_points("revolute", axis, origin, _SPIN_TURNS, points)
    far = context.scene.part_scene.distance(turned.reshape(-1, 3))
    return float(min(np.quantile(far, 0.9) / max(radius.max(), 1e-9), 1.0))


def line_hypothesis(context: PartContext, axis: FloatArray, origin: FloatArray) -> Hypothesis:
    """Measure a revolute hypothesis; its axis is turned so that positive motion opens."""
    scene, d = context.scene, context.diagonal
    plus = scene.sweep("revolute", axis, origin, ANGLES).blocked
    minus = scene.sweep("revolute", axis, origin, -ANGLES).blocked
    arm = context.box.center - origin
    arm = arm - (arm @ axis) * axis
    swing = unit(np.cross(axis, arm)) if np.linalg.norm(arm) > 0.004 * d else np.zeros(3)
    towards = float(swing @ context.front) + 0.3 * float(swing @ context.frame.up)
    preference = float(minus.mean() - plus.mean())
    sign = 1.0 if preference + 0.02 * np.sign(towards) >= 0 else -1.0
    free, other = (plus, minus) if sign > 0 else (minus, plus)
    axis, swing = sign * axis, sign * swing
    points = scene.points
    along = points @ axis
    radial = points - origin - ((points - origin) @ axis)[:, None] * axis
    radius = max(float(np.linalg.norm(radial, axis=1).max()), 1e-4 * d)
    off = float(np.linalg.norm(arm)) / radius
    features = np.concatenate([free, other, _line_shape(context, axis, origin, arm, radius, off)])
    features = np.concatenate([features, _line_surroundings(context, axis, origin, swing, radius)])
    mirrored = origin + 2.0 * arm
    gap_part, gap_static = scene.line_gap(axis, origin)
    mirror = scene.line_gap(axis, mirrored)[1] if off > 0.1 else gap_static
    gaps = np.minimum(np.array([gap_part, gap_static, mirror]) / d, 0.5)
    values = dict(zip((*_FREE, *_SHAPE, *_AROUND), features))
    values.update(line_part=gaps[0], line_static=gaps[1], mirror_static=gaps[2] - gaps[1])
    values["along_share"] = float(np.ptp(along)) / max(scene.size, 1e-9)
    row = np.array([values[name] for name in LINE_NAMES])
    return Hypothesis(True, off < 0.3, axis, origin, row, min(abs(preference) * 5.0, 1.0))


_FREE = LINE_NAMES[:8]
_SHAPE = (
    "off_axis", "radius", "is_long", "is_thin", "up", "to_front", "tilted", "side_front",
    "side_lateral", "side_height", "lateral_abs", "thin_pos", "line_height",
)  # fmt: skip
_AROUND = (
    "handle_far", "handle_lateral", "handle_parallel", "outer_side", "spin_match", "contact_near",
    "contact_mean", "contact_span", "contact_centred", "opens_front", "opens_up", "other_gap",
)  # fmt: skip


def _line_shape(
    context: PartContext, axis: FloatArray, origin: FloatArray, arm: FloatArray,
    radius: float, off: float,
) -> FloatArray:  # fmt: skip
    """Where the line lies in the part: row of _SHAPE."""
    box, frame, d = context.box, context.frame, context.diagonal
    order = np.argsort(-box.half)
    share = np.abs(box.axes @ axis)
    front = context.front
    level = np.cross(axis, front)
    lateral = float(-arm @ unit(level)) if np.linalg.norm(level) > 0.3 else 0.0
    reach = float(np.abs(box.axes @ unit(level)) @ box.half) + 1e-9 * d
    depth = float(np.abs(box.axes @ front) @ box.half) + 1e-9 * d
    rise = float(np.abs(box.axes @ frame.up) @ box.half) + 1e-9 * d
    thin = box.axes[order[2]]
    height = float(origin @ frame.up) if abs(axis @ frame.up) < 0.5 else float(
        box.center @ frame.up)  # fmt: skip
    return np.array([
        off, radius / d, share[order[0]], share[order[2]], abs(axis @ frame.up),
        abs(axis @ front), 1.0 - float(np.abs(frame.axes @ axis).max()),
        float(-arm @ front) / depth, lateral / reach,
        float(-arm @ frame.up) / rise if abs(axis @ frame.up) < 0.5 else 0.0,
        abs(lateral) / reach, abs(float(arm @ thin)) / max(box.half[order[2]], 1e-4 * d),
        (height - frame.low[2]) / max(frame.high[2] - frame.low[2], 1e-9 * d),
    ])  # fmt: skip


def _line_surroundings(
    context: PartContext, axis: FloatArray, origin: FloatArray, swing: FloatArray, radius: float
) -> FloatArray:
    """Handle, contact and object around the line: row of _AROUND."""
    box, frame, d, scene = context.box, context.frame, context.diagonal, context.scene

    def across(vector: FloatArray) -> FloatArray:
        return np.asarray(vector - (vector @ axis)[..., None] * axis)

    handle = context.handle
    far = lateral = parallel = -1.0
    if handle.share > 0:
        spot = box.center + (handle.center * box.half) @ box.axes
        flat = across(spot - origin)
        flat = flat - (flat @ context.front) * context.front
        far = float(np.linalg.norm(flat)) / radius
        arm = across(box.center - origin)
        lateral = float(flat @ unit(arm)) / radius
        long = box.axes[int(np.argmax(handle.half))]
        parallel = abs(float(long @ axis))
    centre = 0.5 * (frame.low + frame.high) @ frame.axes
    mine, line = across(box.center - centre), across(origin - centre)
    outer = float(np.linalg.norm(line) - np.linalg.norm(mine)) / radius
    contact = context.contact.points
    near = mean = span = centred = 0.0
    if len(contact):
        distance = np.linalg.norm(across(contact - origin), axis=1) / radius
        near, mean = float((distance < 0.12).mean()), float(distance.mean())
        span = float(np.ptp(contact @ axis)) / max(float(np.ptp(scene.points @ axis)), 1e-6 * d)
        centred = float(np.linalg.norm(across(contact.mean(axis=0) - origin))) / radius
    spin = _self_match(context, axis, origin)
    hinge_part = across(scene.dense.points - origin)
    close = np.linalg.norm(hinge_part, axis=1) < 0.15 * radius
    edge = scene.rest_distance[close]
    return np.array([
        far, lateral, parallel, outer, spin, near, mean, span, centred,
        float(swing @ context.front), float(swing @ frame.up),
        min(float(np.quantile(edge, 0.1)) / d, 0.3) if len(edge) else 0.3,
    ])  # fmt: skip


def slide_hypothesis(context: PartContext, axis: FloatArray) -> Hypothesis:
    """Measure a slide along a direction; its axis is turned so that positive motion opens."""
    scene, d, box, frame = context.scene, context.diagonal, context.box, context.frame
    extent = float(np.ptp(scene.points @ axis))
    length = max(extent, 0.35 * scene.size)
    plus = scene.sweep("prismatic", axis, np.zeros(3), STEPS * length).blocked
    minus = scene.sweep("prismatic", axis, np.zeros(3), -STEPS * length).blocked
    corners = _object_corners(context)
    ends = [
        (float((corners @ (s * axis)).max()) - float((scene.points @ (s * axis)).max())) / d
        for s in (1.0, -1.0)
    ]
    preference = float(minus.mean() - plus.mean())
    tie = np.sign(float(axis @ context.front) + 0.1 * (ends[1] - ends[0]))
    sign = 1.0 if preference + 0.02 * tie >= 0 else -1.0
    free, other = (plus, minus) if sign > 0 else (minus, plus)
    leave, other_leave = ends if sign > 0 else ends[::-1]
    axis = sign * axis
    order = np.argsort(-box.half)
    share = np.abs(box.axes @ axis)
    six = np.concatenate([box.axes, -box.axes]) @ axis
    k = int(np.argmax(six))
    contact = context.contact
    normal = float(np.abs(contact.normals @ axis).mean()) if len(contact.points) else 0.0
    span = float(np.ptp(contact.points @ axis)) / max(extent, 1e-6 * d) if len(
        contact.points) else 0.0  # fmt: skip
    handle = context.handle
    spot = handle.center * box.half @ box.axes
    row = np.array([
        *free, *other, abs(axis @ frame.up), abs(axis @ context.front),
        extent / max(scene.size, 1e-9), share[order[0]], share[order[2]],
        1.0 - float(np.abs(frame.axes @ axis).max()), context.exposure[k],
        context.exposure[(k + 3) % 6], leave, other_leave,
        float(spot @ axis) / max(0.5 * extent, 1e-4 * d) if handle.share else 0.0,
        normal, span, _self_match(context, axis, box.center),
        extent / max(float(np.ptp(corners @ axis)), 1e-6 * d), float(axis @ frame.up),
        float(axis @ context.front), extent / d,
    ])  # fmt: skip
    origin = contact.points.mean(axis=0) if len(contact.points) else box.center
    return Hypothesis(False, False, axis, origin, row, min(abs(preference) * 5.0, 1.0))


def _object_corners(context: PartContext) -> FloatArray:
    """The 8 corners (8, 3) of the object's box, asset frame."""
    f = context.frame
    pick = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=bool)
    return np.asarray(np.where(pick, f.high, f.low) @ f.axes)
