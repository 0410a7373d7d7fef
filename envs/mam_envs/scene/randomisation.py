"""Drawing what changes from episode to episode, from the environment's own seeded generators."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mani_skill.utils.structs import Articulation

from mam_envs.config import RandomisationConfig
from mam_envs.grasping.candidates import PlacementError
from mam_envs.object_model import between
from mam_envs.placement.arm_path import rest_is_clear
from mam_envs.placement.base import object_pose
from mam_envs.placement.drive import begin_at, drive_is_clear
from mam_envs.scene.layout import Layout
from mam_envs.tasks import JointGoal, Task
from mam_pipeline.asset.dynamics import catch_pull, opening, rubbing, set_joint_friction
from mam_pipeline.types import FloatArray

SLIDE, TURN = "prismatic", "revolute"


@dataclass(frozen=True)
class Draw:
    """One episode's chances.

    Attributes:
        shift: (2,) metres; yaw: radians; start: share of the way open, or None for the task's.
        friction, damping, mass: factors.
        places: where friction and mass lie in the asset's own ranges, 0 to 1; None for its values.
        noise: (n,) radians on the arm's joints.
        base: (4, 4) world_T_base where a robot that drives begins; None for others.
    """

    shift: np.ndarray
    yaw: float
    start: float | None
    friction: float
    damping: float
    mass: float
    noise: np.ndarray
    places: tuple[float, float] | None = None
    base: FloatArray | None = None


def draw(config: RandomisationConfig, rng: np.random.RandomState, arm: int) -> Draw:
    """Draw one episode; always the same numbers in the same order."""
    shift = rng.uniform(-1, 1, 2) * config.position
    yaw = float(np.deg2rad(rng.uniform(-1, 1) * config.yaw))
    share = rng.uniform()
    start = None
    if config.start is not None:
        start = float(config.start[0] + share * (config.start[1] - config.start[0]))
    shares = rng.uniform(size=3)
    pairs = (config.friction, config.damping, config.mass)
    friction, damping, mass = (
        float(low + share * (high - low)) for share, (low, high) in zip(shares, pairs)
    )
    noise = rng.normal(0.0, 1.0, arm) * config.robot_qpos
    places = (float(shares[0]), float(shares[2])) if config.spread else None
    return Draw(shift, yaw, start, friction, damping, mass, noise, places)


def draw_clear(
    layout: Layout,
    task: type[Task],
    config: RandomisationConfig,
    rng: np.random.RandomState,
    tries: int = 10,
) -> tuple[Draw, FloatArray]:
    """Draw an episode in which the arm at rest does not touch the object, and world_T_asset.

    A robot that drives does not touch it on its way to where it is to stand, either.

    Raises:
        PlacementError: `tries` draws in a row overlap (the randomisation is too wide).
    """
    goal, model, robot = layout.goals[0], layout.model, layout.robot
    for _ in range(tries):
        drawn = draw(config, rng, len(layout.robot.arm))
        pose = object_pose(
            layout.model, layout.placement.object_height, drawn.shift.tolist(), drawn.yaw
        )
        q = {g.joint: task.start(g, drawn.start) for g in layout.goals}
        if robot.drive is None:
            if rest_is_clear(model, robot, layout.placement.base, pose, q, drawn.noise):
                return drawn, pose
            continue
        stand = layout.stand(pose)
        handle = pose[:3, :3] @ layout.handles[0] + pose[:3, 3]
        start = begin_at(robot, stand, handle, config, rng.uniform(size=3))
        if drive_is_clear(model, robot, start, stand, pose, q, drawn.noise):
            return replace(drawn, base=start), pose
    what, smaller = "the arm at rest overlaps", "randomisation.position or yaw smaller"
    if robot.drive is not None:
        what = f"on its way to the handle a {robot.uid} with its arm at rest runs into"
        smaller += ", or randomisation.away larger"
    raise PlacementError(
        f"{model.asset.card.name}: {what} the object at {goal.joint!r}; make {smaller}", "room"
    )


class ObjectDynamics:
    """Friction, damping, masses and catches of one built object, scaled from what its asset says.

    Attributes:
        catches: (3, dof) of every active joint: the force or torque of its catch towards closed,
            with its sign; its closed value; and 1 / width, with the sign of the way that opens.
    """

    def __init__(self, articulation: Articulation, layout: Layout) -> None:
        """`articulation`: ManiSkill's, as built from the layout's asset."""
        self.articulation, self.model = articulation, layout.model
        self.joints = [g.joint for g in layout.goals]
        self.springs = {g.joint: g for g in layout.goals if g.spring}
        self.moving = {n for name in self.joints for n in layout.model.moving_links(name)}
        self.carried = {
            name
            for joint in layout.model.asset.card.joints
            if joint.balance is not None
            for name in layout.model.moving_links(joint.name)
        }
        self.catches: FloatArray = np.zeros((3, len(articulation.active_joints)))
        self._masses = {
            link.name: (float(link._objs[0].mass), np.array(link._objs[0].inertia))
            for link in articulation.links
        }

    def apply(self, drawn: Draw) -> None:
        """Set SAPIEN's joints and links: the task's joints and their links with drawn factors."""
        for joint in self.articulation.joints:
            raw = joint._objs[0]
            if raw.dof > 0:
                set_joint_friction(raw, *self._friction(joint.name, drawn))
            if joint.name in self.springs:
                self._spring(raw, self.springs[joint.name])
        for link in self.articulation.links:
            raw = link._objs[0]
            mass, inertia = self._masses[link.name]
            factor = self._mass(link.name, drawn) if link.name in self.moving else 1.0
            raw.mass, raw.inertia = mass * factor, inertia * factor
            if link.name in self.carried:  # by springs
                raw.disable_gravity = True
        self.catches = self._catches(drawn)

    def _catches(self, drawn: Draw) -> FloatArray:
        active = self.articulation.active_joints
        out = np.zeros((3, len(active)))
        for k, joint in enumerate(active):
            place = None if drawn.places is None else drawn.places[0]
            caught = self.model.catch_joint(joint.name, place)
            if caught is None or caught.catch is None or joint.name in self.springs:
                continue
            slope = opening(caught) / caught.catch.width
            out[:, k] = catch_pull(caught, caught.closed), caught.closed, slope
        return out

    def _spring(self, raw: Any, goal: JointGoal) -> None:
        """A spring in the place of friction, with as much damping as lets it come out without
        swinging; the task says where it pushes to. Its preload carries the part's weight."""
        stiffness, mass = goal.spring / abs(goal.q_goal - goal.closed), 0.0
        for link in self.articulation.links:
            if link.name in self.model.moving_links(goal.joint):
                link._objs[0].disable_gravity = True
                mass += self._masses[link.name][0]
        raw.set_drive_properties(
            stiffness, 2.0 * float(np.sqrt(stiffness * mass)), float(np.finfo(np.float32).max)
        )

    def _mass(self, name: str, drawn: Draw) -> float:
        """Factor on a moving link's mass."""
        part = next((p for p in self.model.asset.card.parts if p.link == name), None)
        if drawn.places is None or part is None or not part.mass:
            return drawn.mass
        return drawn.mass * between(part.mass_range, drawn.places[1], part.mass) / part.mass

    def _friction(self, name: str, drawn: Draw) -> tuple[str, float, float]:
        """Type, friction and damping of a joint, at the object's scale."""
        card = next((j for j in self.model.asset.card.joints if j.name == name), None)
        friction, damping, type_ = 0.05, 0.05, TURN
        if card is not None:
            # forces grow with the cube of the scale, torques with the fourth power (same density)
            slide = card.type == SLIDE
            power = self.model.scale ** (3 if slide else 4)
            friction, spread = rubbing(card)
            if drawn.places is not None:
                friction = between(spread, drawn.places[0], friction)
            friction, damping = friction * power, card.damping * power
            type_ = SLIDE if slide else TURN
        if name in self.joints:
            friction, damping = friction * drawn.friction, damping * drawn.damping
        return type_, friction, damping
