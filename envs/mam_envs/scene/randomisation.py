"""Drawing what changes from episode to episode, from the environment's own seeded generators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_envs.config import JointGoal, RandomisationConfig
from mam_envs.object_model import ObjectModel
from mam_pipeline.asset.dynamics import set_joint_friction

SLIDE, TURN = "prismatic", "revolute"


@dataclass(frozen=True)
class Draw:
    """One episode's chances.

    Attributes:
        shift: (2,) metres; yaw: radians; start: share of the way open, or None for the task's.
        friction, damping, mass: factors.
        noise: (n,) radians on the arm's joints.
    """

    shift: np.ndarray
    yaw: float
    start: float | None
    friction: float
    damping: float
    mass: float
    noise: np.ndarray


def draw(config: RandomisationConfig, rng: np.random.RandomState, arm: int) -> Draw:
    """Draw one episode; always the same numbers in the same order."""
    shift = rng.uniform(-1, 1, 2) * config.position
    yaw = float(np.deg2rad(rng.uniform(-1, 1) * config.yaw))
    share = rng.uniform()
    start = None
    if config.start is not None:
        start = float(config.start[0] + share * (config.start[1] - config.start[0]))
    friction, damping, mass = (
        float(pair[0] + rng.uniform() * (pair[1] - pair[0]))
        for pair in (config.friction, config.damping, config.mass)
    )
    noise = rng.normal(0.0, 1.0, arm) * config.robot_qpos
    return Draw(shift, yaw, start, friction, damping, mass, noise)


def start_value(goal: JointGoal, drawn: Draw) -> float:
    """The joint value at which an episode starts."""
    if drawn.start is None:
        return goal.q_start
    return goal.closed + drawn.start * (goal.open - goal.closed)


def set_physics(articulation: object, model: ObjectModel, joints: list[str], drawn: Draw) -> None:
    """Give SAPIEN's joints the card's friction and damping, and scale masses and inertias.

    Args:
        articulation: ManiSkill articulation of one object.
        joints: names of the joints whose dynamics are randomised (the task's).
    """
    masses = _masses(articulation)
    moving = {link for name in joints for link in model.moving_links(name)}
    for joint in articulation.joints:  # type: ignore[attr-defined]
        raw = joint._objs[0]
        if raw.dof == 0:
            continue
        card = next((j for j in model.asset.card.joints if j.name == joint.name), None)
        friction, damping, type_ = 0.05, 0.05, TURN
        if card is not None:
            # forces grow with the cube of the scale, torques with the fourth power (same density)
            slide = card.type == SLIDE
            power = model.scale ** (3 if slide else 4)
            friction, damping = card.friction * power, card.damping * power
            type_ = SLIDE if slide else TURN
        if joint.name in joints:
            friction, damping = friction * drawn.friction, damping * drawn.damping
        set_joint_friction(raw, type_, friction, damping)
    for link in articulation.links:  # type: ignore[attr-defined]
        raw = link._objs[0]
        mass, inertia = masses[link.name]
        factor = drawn.mass if link.name in moving else 1.0
        raw.mass, raw.inertia = mass * factor, inertia * factor


def _masses(articulation: object) -> dict[str, tuple[float, np.ndarray]]:
    """Mass and inertia of every link as the asset has them, remembered at the first call."""
    known = getattr(articulation, "_mam_masses", None)
    if known is None:
        known = {
            link.name: (float(link._objs[0].mass), np.array(link._objs[0].inertia))
            for link in articulation.links  # type: ignore[attr-defined]
        }
        articulation._mam_masses = known  # type: ignore[attr-defined]
    return known
