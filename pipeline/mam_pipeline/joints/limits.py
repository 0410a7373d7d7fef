"""Joint limits from collision, contact loss and what such joints usually do (paper section 3.4).

A joint opens towards the freer side only, stops before the part enters anything by the check's own
rule and sweep, and goes no farther than such joints usually do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from mam_pipeline.geometry.boxes import least_rectangle
from mam_pipeline.geometry.motion import Motion
from mam_pipeline.geometry.paths import DENSE, Crossing, PartPaths, Rule
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.thresholds import THRESHOLDS
from mam_pipeline.types import (
    MOVES,
    FloatArray,
    IntArray,
    JointSubtype,
    JointType,
    Mesh,
    RangeRule,
    UsualTravel,
)


@dataclass(frozen=True)
class RangeThresholds:
    """Where a range ends.

    Attributes:
        strict: diagonals: deepest crossing that the paper's rule allows.
        deep: share of the check's depth that a range may use up.
        wide: share of the check's area (sampled) that a range may use up.
        hinge: radians that a hinge opens where nothing else is known.
        slide: share of its depth that a slide opens: drawers keep some of their rails. The depth is
            the part's own; that of the body behind it for a bare front.
        bare: share of the body's depth behind a part from which its own depth counts.
        front: diagonals: a part whose longer side across its slide is shorter is no drawer's front.
        against: share of the body's depth within which what lies behind a front touches it.
        guided: share of its way that a part must be long to be held by what it slides in; of one
            that is shorter the loss of contact says nothing.
        closing: radians within which the closed pose of an open part is looked for.
        back_off: share of the way to a collision: where exactly it begins is within sampling's
            error. shut: the same of the way to the closed pose, where the part is to touch.
    """

    strict: float = 0.0045
    deep: float = 0.75
    wide: float = 0.6
    hinge: float = float(np.pi / 2)
    slide: float = 0.8
    bare: float = 0.25
    front: float = 0.12
    against: float = 0.05
    guided: float = 0.5
    closing: float = float(np.deg2rad(200.0))
    back_off: float = 0.93
    shut: float = 0.98


RANGES = RangeThresholds()


@dataclass(frozen=True)
class Limits:
    """Range of a joint, q = 0 at rest and positive q opening.

    Attributes:
        type: revolute, continuous or prismatic. lower, upper: rad or mesh unit.
        closed, open: the values called closed and open. rule: which rule ended the range.
        evidence: travel found in both directions and the penetration over the range.
        share: of the usual way that the joint was left with, 0..1; 1 where nobody measured.
        wanted: how far the part should go towards open, rad or mesh unit; None: as far as `upper`.
        sibling_at: the value at which another part that moves would stop it; None: none would.
        of_part: the way over the part's length along it (extent of a slide, radius of a turn).
    """

    type: JointType
    lower: float
    upper: float
    closed: float
    open: float
    rule: RangeRule
    evidence: Mapping[str, Any] = field(default_factory=dict)
    share: float = 1.0
    wanted: float | None = None
    sibling_at: float | None = None
    of_part: float = 1.0


@dataclass(frozen=True)
class Surroundings:
    """A part and what it may run into: `scene` for contact and curves, `paths` for the check's
    rule of penetration, `again` the same, denser, on a mesh moved by `shift` and rounded."""

    scene: SweepScene
    paths: PartPaths
    again: Callable[[], PartPaths]
    shift: FloatArray
    behind: Callable[[FloatArray], float]

    @staticmethod
    def of(mesh: Mesh, part: IntArray, static: IntArray, seed: int = 0) -> Surroundings:
        """From the face indices of the part, with all that it carries, and of what stands still."""
        scene = SweepScene(mesh, part, static, static_samples=1500, seed=seed)
        shift = -mesh.bounds.mean(axis=0)

        @cache
        def again() -> PartPaths:
            moved = mesh.vertices + shift
            single = moved.astype(np.float32).astype(np.float64)  # as files keep them
            return PartPaths(replace(mesh, vertices=single), part, static, density=DENSE)

        def behind(axis: FloatArray) -> float:
            return depth_behind(mesh, part, static, axis)

        return Surroundings(scene, PartPaths(mesh, part, static), again, shift, behind)

    def free(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, end: float,
        back_off: float = RANGES.back_off,
    ) -> tuple[float, Crossing]:  # fmt: skip
        """How far towards `end` (signed) the check would let the part go, and what stops it.

        Args:
            back_off: share of the way to what stops it that is kept.
        """
        limit = THRESHOLDS.penetration_share, THRESHOLDS.penetration_area
        rule = Rule(RANGES.deep * limit[0] * self.paths.diagonal, RANGES.wide * limit[1])
        free, found = self.paths.free_range(motion, axis, origin, end, rule)
        if free != 0.0:  # few samples and, between coincident surfaces, rounding err: ask twice
            free, second = self.again().free_range(motion, axis, origin + self.shift, free, rule)
            found = second if found.value is None else found
        return free if found.value is None else back_off * free, found


def depth_behind(mesh: Mesh, part: IntArray, static: IntArray, axis: FloatArray) -> float:
    """How deep the body is behind a front that slides along `axis`, out of it; 0 behind none.

    From the front's back to the first surface behind it, the median over its cross-section; what
    lies against its back (the face of a solid body) is passed.
    """
    corners, out = mesh.vertices[mesh.faces[part].reshape(-1)], unit(axis)
    across = least_rectangle(corners, out)[:2]
    low, high = (corners @ across.T).min(axis=0), (corners @ across.T).max(axis=0)
    if max(high - low) < RANGES.front * mesh.diagonal:
        return 0.0
    body = mesh.vertices[mesh.faces[static].reshape(-1)] @ out
    back = float((corners @ out).min())
    touching = RANGES.against * max(back - float(body.min()), 0.0)
    steps = np.linspace(0.1, 0.9, 9)
    plane = low + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * (high - low)
    start = plane @ across + (back - touching) * out
    scene = RayScene(mesh.vertices, mesh.faces[static])
    hits = scene.first_hits(start, np.tile(-out, (len(start), 1)))
    found = hits.t[np.isfinite(hits.t)]
    if touching <= 0.0 or len(found) < 0.5 * len(start):
        return 0.0
    return float(np.median(found)) + touching


@dataclass(frozen=True)
class Travel:
    """How far a part goes in one direction (all >= 0, rad or mesh unit).

    Attributes:
        strict: to the first crossing deeper than RANGES.strict.
        contact: until contact is lost (infinite for revolute joints).
        values, depth, blocked: (n,) the curve, for the report.
    """

    strict: float
    contact: float
    values: FloatArray
    depth: FloatArray
    blocked: FloatArray


def travel(
    scene: SweepScene, motion: Motion, axis: FloatArray, origin: FloatArray, end: float,
    steps: int = 36,
) -> Travel:  # fmt: skip
    """Sweep from rest to `end` (signed) and say where it stops."""
    values: FloatArray = np.linspace(0.0, end, steps + 1)[1:].astype(np.float64)
    slide = motion == "prismatic"
    found = scene.sweep(motion, axis, origin, values, contact=slide)
    step = abs(end) / steps
    bad = np.flatnonzero(found.depth > RANGES.strict * scene.diagonal)
    strict = abs(end) if not len(bad) else step * int(bad[0])
    if len(bad):  # depth grows steadily with motion: find where it crosses within the step
        k = int(bad[0])
        before = found.depth[k - 1] if k else 0.0
        rise = max(found.depth[k] - before, 1e-12)
        strict += step * max(0.0, (RANGES.strict * scene.diagonal - before) / rise)
    lost = np.inf
    if slide and len(found.contact) and scene.rest_gap < 0.02 * scene.diagonal:
        gone = np.flatnonzero(found.gap > scene.rest_gap + 0.015 * scene.diagonal)
        lost = step * int(gone[0]) if len(gone) else np.inf
    return Travel(strict, lost, values, found.depth, found.blocked)


def embedded_limits(
    around: Surroundings, subtype: JointSubtype, axis: FloatArray, origin: FloatArray,
    *, alone: Callable[[], Surroundings] | None = None, given: tuple[float, float] | None = None,
    usual: UsualTravel | None = None, plain: bool = True, closing: float = 0.0,
) -> Limits:  # fmt: skip
    """Our rule.

    Args:
        around: everything that stands still, siblings included.
        alone: the same without the siblings: where only a sibling is in the way (a drawer behind a
            closed door) the joint's own range counts. Asked for only when something is in the way.
        usual: how far such joints go; without it a quarter turn and 0.8 extents.
        plain: whether these also hold for what goes about as far as doors and drawers do.
        given: limits that a person or the reasoner set; they are kept as they are.
        closing: radians to the closed pose of what stands open; 0 where they are not known.
    """
    motion: Motion = "prismatic" if subtype == "slide" else "revolute"
    if given is not None:
        lower, upper = given
        far = upper if abs(upper) >= abs(lower) else lower
        kind: JointType = "prismatic" if motion == "prismatic" else "revolute"
        if not np.isfinite(lower + upper):
            return Limits("continuous", -np.inf, np.inf, 0.0, 0.0, "given")
        return Limits(kind, lower, upper, lower + upper - far, far, "given")
    limits = _open_way(around, subtype, motion, axis, origin, usual, plain, closing)
    if alone is not None and limits.type != "continuous" and limits.share < 0.9:
        free = _open_way(alone(), subtype, motion, axis, origin, usual, plain, closing)
        if free.type != "continuous" and free.upper > 3.0 * limits.upper + 1e-9:
            return replace(free, sibling_at=limits.upper)
    return limits


def _open_way(
    around: Surroundings, subtype: JointSubtype, motion: Motion, axis: FloatArray,
    origin: FloatArray, usual: UsualTravel | None, keep_plain: bool, closing: float = 0.0,
) -> Limits:  # fmt: skip
    """Range towards the opening side, and back where rest is not the closed pose."""
    slide, scene = motion == "prismatic", around.scene
    extent = float(np.ptp(scene.points @ unit(axis))) if slide else 1.0
    depth = around.behind(axis) if slide else 0.0
    own, bare = extent, extent < RANGES.bare * depth
    if bare:
        extent = depth
    cap, back = (RANGES.slide * extent if slide else RANGES.hinge), 0.0
    assumed = f"{RANGES.slide:g} of {'the depth behind it' if bare else 'its own depth'}"
    if usual is not None and not bare:
        plain = (0.4, 1.1) if slide else (1.2, 2.2)  # what drawers and doors do: keep to the rule
        if not (keep_plain and plain[0] < usual.open < plain[1]):
            cap = float(np.clip(usual.open, 0.02, 2.0 if slide else np.pi)) * extent
            assumed = ""
        if usual.back > (0.15 if slide else 0.3):  # rest is not the closed pose
            back = 2.0 * extent if slide else RANGES.closing
    if not slide and (subtype == "spin" if usual is None else usual.endless > 0.5):
        endless = _endless(around, axis, origin)
        if endless is not None:
            return endless
        if usual is None:
            back = cap
    if closing > 0.0:
        back = closing
    out = travel(scene, motion, axis, origin, 1.15 * cap)
    if slide and own < RANGES.guided * cap:
        out = replace(out, contact=np.inf)
    upper, rule = _stop(around, motion, axis, origin, out, cap)
    evidence = {**range_evidence(out, None), "cap": cap}
    if slide and assumed and rule == "usual":
        rule, evidence["assumed"] = "depth", f"assumed: {assumed}"
    lower = 0.0
    if back > 0.0:
        behind = travel(scene, motion, axis, origin, -back)
        lower, why = _stop(around, motion, axis, origin, behind, -back, RANGES.shut)
        if why == "usual" and usual is not None and not closing:  # nothing says where it is closed
            lower = -min(usual.back * extent, back)
        evidence["free_travel_back"] = back = -lower
    wanted = min(cap, out.contact) + (back if back > 0.0 else 0.0)
    share = float((upper - lower) / max(wanted, 1e-12))
    if subtype == "spin" and share < MOVES and around.paths.turns_in_itself(axis, origin):
        return Limits("continuous", -np.inf, np.inf, 0.0, 0.0, "endless", evidence)
    if upper - lower < (1e-3 * scene.diagonal if slide else np.deg2rad(1.0)):
        upper = 0.02 * scene.diagonal if slide else np.deg2rad(5.0)
        rule = "token"
    kind: JointType = "prismatic" if slide else "revolute"
    closed = lower if back > 0.0 and (usual is not None or closing > 0.0) else 0.0
    of_part = float(upper - lower) / max(extent, 1e-12)
    return Limits(kind, float(lower), float(upper), float(closed), float(upper), rule, evidence,
                  share, cap, of_part=of_part)  # fmt: skip


def _stop(
    around: Surroundings, motion: Motion, axis: FloatArray, origin: FloatArray, found: Travel,
    cap: float, back_off: float = RANGES.back_off,
) -> tuple[float, RangeRule]:  # fmt: skip
    """Where a motion towards `cap` (signed) ends and why; `back_off` as in `Surroundings.free`."""
    reach = min(abs(cap), found.contact)
    end = float(np.copysign(reach, cap))
    stop = abs(around.free(motion, axis, origin, end, back_off)[0])
    rule: RangeRule = "collision"
    if stop >= reach:
        rule = "usual" if found.contact >= abs(cap) else "contact_loss"
    return float(np.copysign(stop, cap)), rule


def _endless(around: Surroundings, axis: FloatArray, origin: FloatArray) -> Limits | None:
    """No limits, if a whole turn is free."""
    for half in (np.pi, -np.pi):
        if around.free("revolute", axis, origin, half)[1].value is not None:
            return None
    out = travel(around.scene, "revolute", axis, origin, np.pi, steps=24)
    return Limits("continuous", -np.inf, np.inf, 0.0, 0.0, "endless",
                  range_evidence(out, None))  # fmt: skip


def range_evidence(out: Travel, back: Travel | None) -> dict[str, Any]:
    """Plain curves for the report."""
    keep = slice(None, None, 3)
    found: dict[str, Any] = {
        "free_travel": out.strict,
        "penetration": {
            "q": [round(float(v), 5) for v in out.values[keep]],
            "depth": [round(float(v), 6) for v in out.depth[keep]],
            "blocked": [round(float(v), 5) for v in out.blocked[keep]],
        },
    }
    if back is not None:
        found["free_travel_back"] = back.strict
    if np.isfinite(out.contact):
        found["contact_lost_at"] = out.contact
    return found
