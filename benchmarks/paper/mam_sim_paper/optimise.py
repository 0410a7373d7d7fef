"""The paper's physics-constrained trajectory optimisation (section 3.3, equation 9).

The loss is the paper's: squared distance of the moved contact points to the static surface, summed
over the virtual states. It squares a signed distance, so the sign has no effect, and its least
value is not at the truth (measured: lower than at ground truth from nearly every start). The
refined joint is therefore accepted only when the whole part penetrates no more than before and the
axis line lies no farther from both bodies; `Refinement.accepted` says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares, minimize

from mam_pipeline.geometry.motion import Motion, motion_points
from mam_pipeline.geometry.sampling import thin_out, unit
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.types import FloatArray

Method = Literal["lm", "nelder-mead"]


@dataclass(frozen=True)
class OptimiserSettings:
    """What the paper's optimisation spends.

    Attributes:
        contacts: contact points used by the loss.
        evaluations: evaluations of the loss.
    """

    contacts: int = 150
    evaluations: int = 120


OPTIMISER = OptimiserSettings()


@dataclass(frozen=True)
class Refinement:
    """What an optimisation did.

    Attributes:
        axis, origin: (3,) the joint to use: the refined one if accepted, else the initial one.
        accepted: whether the refined joint passed the whole-part check.
        loss_before, loss_after: mean squared distance, normalised units.
        curve: best loss so far at every evaluation.
        why: reason of a refusal, or "".
    """

    axis: FloatArray
    origin: FloatArray
    accepted: bool
    loss_before: float
    loss_after: float
    curve: tuple[float, ...]
    why: str = ""


def residuals(
    distance: Callable[[FloatArray], FloatArray], contact: FloatArray, motion: Motion,
    axis: FloatArray, origin: FloatArray, states: FloatArray,
) -> FloatArray:  # fmt: skip
    """Distances (len(states) * n,) of the moved contact points to the static surface (eq. 9)."""
    moved = motion_points(motion, unit(axis), origin, states, contact)
    return distance(moved.reshape(-1, 3))


def states_of(motion: Motion, reach: float) -> FloatArray:
    """The discrete virtual states Phi: a quarter turn in the opening direction, or a slide."""
    share = np.array([0.25, 0.5, 0.75, 1.0])
    return share * (np.pi / 2 if motion == "revolute" else reach)


def pack(motion: Motion, axis: FloatArray, origin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Frame (3, 3) whose rows are axis and two perpendiculars, and the zero parameter vector.

    Parameters are two tilts of the axis and, for a revolute joint, two shifts of the line, so that
    no direction is without effect.
    """
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    b = unit(np.cross(axis, helper))
    return np.stack([unit(axis), b, np.cross(unit(axis), b)]), np.zeros(
        4 if motion == "revolute" else 2
    )


def unpack(frame: FloatArray, origin: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axis and origin of a parameter vector."""
    axis = unit(frame[0] + x[0] * frame[1] + x[1] * frame[2])
    if len(x) == 2:
        return axis, origin
    return axis, origin + x[2] * frame[1] + x[3] * frame[2]


def minimise(
    distance: Callable[[FloatArray], FloatArray], contact: FloatArray, motion: Motion,
    axis: FloatArray, origin: FloatArray, states: FloatArray, method: Method,
) -> tuple[FloatArray, FloatArray, float, float, list[float]]:  # fmt: skip
    """Minimise equation 9 from (axis, origin), all in normalised units.

    Args:
        distance: (n, 3) points to (n,) distances to the static surface; signed or not is the same.

    Returns:
        Axis, origin, loss before, loss after, curve of the best loss so far.
    """
    frame, start = pack(motion, axis, origin)
    curve: list[float] = []

    def fun(x: FloatArray) -> FloatArray:
        a, o = unpack(frame, origin, x)
        r = residuals(distance, contact, motion, a, o, states)
        loss = float((r**2).mean())
        curve.append(min(loss, curve[-1]) if curve else loss)
        return r

    before = float((fun(start) ** 2).mean())
    if method == "lm":
        found = least_squares(
            fun, start, method="lm", max_nfev=OPTIMISER.evaluations, diff_step=1e-3
        )
        x, after = found.x, float((found.fun**2).mean())
    else:
        simplex = np.vstack([start, start + 0.03 * np.eye(len(start))])
        result = minimize(
            lambda x: float((fun(x) ** 2).mean()), start, method="Nelder-Mead",
            options={"maxfev": OPTIMISER.evaluations, "initial_simplex": simplex, "xatol": 1e-4},
        )  # fmt: skip
        x, after = result.x, float(result.fun)
    new_axis, new_origin = unpack(frame, origin, x)
    return new_axis, new_origin, before, after, curve


def refine(
    scene: SweepScene, motion: Motion, axis: FloatArray, origin: FloatArray, method: Method,
    contact: FloatArray | None = None,
) -> Refinement:  # fmt: skip
    """Optimise a joint by the paper's loss and accept the result only if it is physical.

    Args:
        scene: the part against its static surroundings; axis, origin: (3,) asset frame, positive
            motion opens. contact: (n, 3) S_contact, asset frame (default: the scene's).
    """
    points = scene.contact().points if contact is None else contact
    points = points[thin_out(len(points), OPTIMISER.contacts)]
    if len(points) < 3:
        return Refinement(axis, origin, False, 0.0, 0.0, (), "no contact")
    center, d = scene.center, scene.diagonal
    reach = 0.5 * float(np.ptp(scene.points @ unit(axis)))
    states = states_of(motion, reach / d)

    def distance(x: FloatArray) -> FloatArray:
        return scene.static_scene.distance(x * d + center) / d

    new_axis, new_origin, before, after, curve = minimise(
        distance, (points - center) / d, motion, unit(axis), (origin - center) / d, states, method
    )
    moved = new_origin * d + center
    values = states * (1.0 if motion == "revolute" else d)
    why = _refusal(scene, motion, (axis, origin), (new_axis, moved), values)
    if not after < before:
        why = "the loss did not fall"
    chosen = (axis, origin) if why else (new_axis, moved)
    return Refinement(chosen[0], chosen[1], not why, before, after, tuple(curve[:200]), why)


def _refusal(
    scene: SweepScene, motion: Motion, old: tuple[FloatArray, FloatArray],
    new: tuple[FloatArray, FloatArray], values: FloatArray,
) -> str:  # fmt: skip
    """Why the new joint is worse for the whole part than the old one; "" if it is not."""
    was = scene.sweep(motion, *old, values).blocked.mean()
    now = scene.sweep(motion, *new, values).blocked.mean()
    if now > was + 0.002:
        return f"the part would run into more: {now:.3f} of its area instead of {was:.3f}"
    if motion == "revolute":
        gap_was, gap_now = sum(scene.line_gap(*old)), sum(scene.line_gap(*new))
        if gap_now > gap_was + 0.002 * scene.diagonal:
            return "the axis would leave the bodies"
    return ""
