"""Features of a part and of its joint hypotheses, invariant to the object's scale and yaw.

Three rows: of the part alone (does it move, and how), of a line as revolute axis, of a direction as
slide. Lengths are relative to the part or to the object's diagonal; directions are stated against
up, against the part's own box and against the front it shows to the outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.geometry.boxes import principal_axes
from mam_pipeline.joints.context import PartContext, directions_of, revolute_lines
from mam_pipeline.joints.line_features import LINE_NAMES, measure_lines, self_match
from mam_pipeline.joints.slide_features import SLIDE_NAMES, measure_slides
from mam_pipeline.joints.surroundings import (
    SIBLING_NAMES,
    SURROUNDING_NAMES,
    sibling_features,
    surrounding_features,
)
from mam_pipeline.types import FloatArray

_OWN = (
    "size", "area_share", "flat", "long", "middle", "thin_up", "long_up", "front_up",
    "height_low", "height_mid", "height_high", "top_gap", "bottom_gap", "front_gap",
    "exposure_front", "exposure_back", "exposure_side_max", "exposure_side_min", "exposure_up",
    "exposure_mean", "depth_over_width", "contact_share", "contact_gap", "contact_long",
    "contact_flat", "contact_span", "contact_ahead", "contact_height", "handle_share",
    "handle_reach", "handle_aside", "handle_up", "handle_long", "symmetric", "symmetric_up",
    "symmetric_front", "fill", "box_fill", "centre_aside", "aligned",
)  # fmt: skip

PART_NAMES = (*_OWN, *SURROUNDING_NAMES, *SIBLING_NAMES)

__all__ = ["LINE_NAMES", "PART_NAMES", "SLIDE_NAMES", "Hypothesis", "enumerate_hypotheses",
           "part_features", "remeasured"]  # fmt: skip


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
    """All slides, then all lines of a part with their features (about 0.05 s)."""
    directions = np.array(directions_of(context))
    axes, rows, sure = measure_slides(context, directions)
    contact = context.contact.points
    middle = contact.mean(axis=0) if len(contact) else context.box.center
    out = [Hypothesis(False, False, a, middle, r, float(s)) for a, r, s in zip(axes, rows, sure)]
    found = [(a, o) for a in directions for o in revolute_lines(context, a)]
    along, origins = np.array([a for a, _ in found]), np.array([o for _, o in found])
    axes, rows, sure = measure_lines(context, along, origins)
    off = rows[:, LINE_NAMES.index("off_axis")]
    out += [
        Hypothesis(True, bool(f < 0.3), a, o, r, float(s))
        for f, a, o, r, s in zip(off, axes, origins, rows, sure)
    ]
    return out


def remeasured(context: PartContext, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The same lines and directions in another sampling of the part; a sense may turn."""
    ways, lines = ([h for h in hypotheses if h.revolute == turns] for turns in (False, True))
    found: list[tuple[Hypothesis, FloatArray, FloatArray, float]] = []
    if ways:
        found += zip(ways, *measure_slides(context, np.array([h.axis for h in ways])))
    if lines:
        axes, origins = np.array([h.axis for h in lines]), np.array([h.origin for h in lines])
        found += zip(lines, *measure_lines(context, axes, origins))
    return [replace(h, axis=a, features=row, sure=float(s)) for h, a, row, s in found]


def part_features(context: PartContext) -> FloatArray:
    """Row of PART_NAMES."""
    return np.concatenate(
        [_own_features(context), surrounding_features(context), sibling_features(context)]
    )


def _own_features(context: PartContext) -> FloatArray:
    """Row of the names in _OWN: size, place, exposure, contact, handle, symmetry."""
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
    symmetric = self_match(context, box.axes, np.repeat(box.center[None], 3, axis=0))
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
