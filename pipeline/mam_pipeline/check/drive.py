"""Driving every joint in SAPIEN: freezing, drift, explosions, holding under gravity, return.

Gravity is compensated while joints are driven (a controller's task), and left to act alone while
a pose must hold; then joint friction is all that holds it. Works without a graphics driver.
What is left of the budget measures how each joint handles: the force that starts it and the tilt at
which it no longer stays. Friction has closed forms; contacts between parts, which have none, count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.dynamics import DYNAMICS, carry, set_joint_friction
from mam_pipeline.check.simulate import load_physics, physics_scene
from mam_pipeline.thresholds import HANDLING, MAX_DRIVE, THRESHOLDS, Thresholds
from mam_pipeline.types import Coupling, FloatArray, coupled

STEP = 1.0 / 200.0
RAMP_SECONDS = 1.5
SETTLE_SECONDS = 0.5
DRIVE_ITERATIONS, HOLD_ITERATIONS = 64, 255
"""Of the solver for a step: friction in a chain of links holds only where it has converged; a
drive needs less, and steps with many contacts cost as much as they have iterations."""
_OMEGA = 30.0
_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Handling:
    """How a joint handles.

    Attributes:
        breakaway: least force along a slide (N) or torque about a hinge (N m) that starts it from
            closed towards open, gravity included; None where nothing that was tried did.
        tilt_closed, tilt_half: up to which tilt of the whole object, to the worst of four sides,
            the closed and the half-open part stay where they are; degrees.
        let_go: top speed of the part that is let go half-open, m/s or rad/s; 0 if it stays.
    """

    breakaway: float | None
    tilt_closed: float
    tilt_half: float
    let_go: float


@dataclass(frozen=True)
class JointDrive:
    """What driving one joint showed: shares of its range, and its top speed (rad/s or m/s)."""

    reached: float
    return_error: float
    hold_drift: float
    top_speed: float
    let_go: float = 0.0
    handling: Handling | None = None


@dataclass(frozen=True)
class DriveResult:
    """The whole object: base drift in metres; `failure` names why loading or running failed.

    `unfinished`: the budget was spent before every joint was driven.
    """

    joints: Mapping[str, JointDrive]
    base_drift: float = 0.0
    failure: str = ""
    exploded: bool = False
    unfinished: bool = False


def drive_urdf(
    urdf: Path,
    frictions: Mapping[str, tuple[float, float]],
    thresholds: Thresholds = THRESHOLDS,
    budget: int = MAX_DRIVE,
    poses: Mapping[str, Mapping[str, float]] | None = None,
    couplings: Mapping[str, Coupling] | None = None,
    catches: Mapping[str, Callable[[float], float]] | None = None,
    balanced: Collection[str] = (),
) -> DriveResult:
    """Load a URDF with a fixed base and drive its joints one after another.

    Args:
        urdf: the file.
        frictions: joint name -> (Coulomb friction in N m or N, damping); SAPIEN reads only the
            damping of a URDF.
        thresholds: how long to hold.
        budget: simulated steps times joints.
        poses: joint name -> values of the joints while it is driven; where none is given they are
            at zero, or at the limit nearest to it. A joint's own value is where it starts and
            must return to.
        couplings: joint name -> what it follows: joints that are coupled are driven together.
        catches: joint name -> force or torque by the joint's value of what keeps it closed besides
            friction; it acts wherever friction does.
        balanced: joints whose parts springs carry.
    """
    try:
        scene = physics_scene(STEP)
        robot = load_physics(scene, urdf)
    except Exception as error:  # SAPIEN raises RuntimeError, AssertionError, ValueError ...
        return DriveResult({}, failure=f"{type(error).__name__}: {error}".splitlines()[0])
    if robot is None:
        return DriveResult({}, failure="the loader returned nothing")
    carry(robot.links, balanced)
    follow = couplings or {}
    driver = _Driver(
        scene, robot, frictions, thresholds, budget, poses or {}, follow, catches or {}
    )
    return driver.run()


class _Driver:
    """One articulation in one scene, its rest pose and its ranges."""

    def __init__(
        self,
        scene: Any,
        robot: Any,
        frictions: Mapping[str, tuple[float, float]],
        thresholds: Thresholds,
        budget: int,
        poses: Mapping[str, Mapping[str, float]],
        couplings: Mapping[str, Coupling],
        catches: Mapping[str, Callable[[float], float]],
    ) -> None:
        self.scene, self.robot, self.couplings = scene, robot, couplings
        self.frictions, self.thresholds, self.budget = frictions, thresholds, budget
        self.joints = list(robot.active_joints)
        names = [j.name for j in self.joints]
        self.catches = {names.index(k): pull for k, pull in catches.items() if k in names}
        self.carried = np.array([joint.child_link.disable_gravity for joint in self.joints], bool)
        bounds = np.asarray(robot.get_qlimits(), dtype=float).reshape(-1, 2)
        self.slide = np.array([j.type == "prismatic" for j in self.joints])
        free = ~np.isfinite(bounds).all(axis=1) | (np.ptp(bounds, axis=1) > 100 * _TURN)
        self.bounds = np.where(free[:, None], [-np.inf, np.inf], bounds)
        self.poses = poses
        self.low = np.where(free, -0.5 * _TURN, bounds[:, 0])
        self.high = np.where(free, 0.5 * _TURN, bounds[:, 1])
        self.span = np.maximum(self.high - self.low, 1e-9)
        fastest = np.where(self.slide, thresholds.max_slide_speed, thresholds.max_turn_speed)
        self.fastest: list[float] = fastest.tolist()
        self.top = [0.0] * len(self.joints)
        self.exploded = False
        self.drift = 0.0
        self.base: list[float] = robot.get_root_pose().p.tolist()

    def run(self) -> DriveResult:
        out: dict[str, JointDrive] = {}
        unfinished = False
        for i, joint in enumerate(self.joints):
            if self.budget <= 0:
                unfinished = True
                break
            self.rest = self._pose(joint.name)
            reached, back = self._reach(i)
            held, let_go = self._hold(i)
            out[joint.name] = JointDrive(reached, back, held, self.top[i], let_go)
            if self.exploded:
                break
        for i, joint in enumerate(self.joints):
            if self.exploded or self.budget <= 0:
                break
            handling = self._handling(i, out[joint.name].let_go)
            out[joint.name] = replace(out[joint.name], handling=handling)
        return DriveResult(out, self.drift, exploded=self.exploded, unfinished=unfinished)

    def _pose(self, name: str) -> FloatArray:
        """Joint values while the named joint is tested."""
        values = self.poses.get(name, {})
        wanted = [values.get(j.name, 0.0) for j in self.joints]
        return np.asarray(np.clip(wanted, self.bounds[:, 0], self.bounds[:, 1]), dtype=np.float64)

    def _bearing(self, moving: bool = False) -> FloatArray:
        """Forces that keep the joints where gravity would take them; SAPIEN counts links without
        gravity as well.

        Args:
            moving: also those of the joints' own speeds.
        """
        weight = np.asarray(self.robot.compute_passive_force(True, False))
        forces = np.asarray(self.robot.compute_passive_force(True, True)) if moving else weight
        return np.asarray(forces - np.where(self.carried, weight, 0.0), dtype=np.float32)

    def _with(self, index: int, value: float) -> FloatArray:
        """The rest pose with one joint elsewhere, and those that are coupled to it."""
        named = {self.joints[index].name: value}
        moved = coupled(named, self.couplings) if self.couplings else named
        q = np.array([moved.get(j.name, r) for j, r in zip(self.joints, self.rest)], dtype=float)
        q = np.clip(q, self.bounds[:, 0], self.bounds[:, 1])
        q[index] = value
        return np.asarray(q, dtype=np.float64)

    def _reset(self, q: FloatArray) -> None:
        self.robot.set_qpos(q.astype(np.float32))
        self.robot.set_qvel(np.zeros(len(q), dtype=np.float32))
        self.robot.set_qf(np.zeros(len(q), dtype=np.float32))

    def _reach(self, index: int) -> tuple[float, float]:
        """Drive one joint to both ends and home: share of its range seen, error at home."""
        self._reset(self.rest)
        self.robot.set_solver_position_iterations(DRIVE_ITERATIONS)
        for k, joint in enumerate(self.joints):
            # acceleration drives need no tuning by mass; the others hold their rest pose
            stiffness = _OMEGA**2
            joint.set_friction(0.0)
            joint.set_drive_properties(
                stiffness, 2.0 * _OMEGA, float(np.finfo(np.float32).max), "acceleration"
            )
            joint.set_drive_target(float(self.rest[k]))
            joint.set_drive_velocity_target(0.0)
        home = float(self.rest[index])
        seen = [home]
        for goal in (float(self.high[index]), float(self.low[index]), home):
            seen.append(self._ramp(index, goal))
            if self.exploded:
                return 0.0, 1.0
        reached = (max(seen) - min(seen)) / self.span[index]
        return float(min(reached, 1.0)), abs(seen[-1] - home) / float(self.span[index])

    def _ramp(self, index: int, goal: float) -> float:
        start = float(self.robot.get_qpos()[index])
        steps = int(RAMP_SECONDS / STEP)
        for k in range(steps + int(SETTLE_SECONDS / STEP)):
            share = min((k + 1) / steps, 1.0)
            smooth = share * share * (3.0 - 2.0 * share)
            targets = self._with(index, start + (goal - start) * smooth)
            for joint, target, rest in zip(self.joints, targets, self.rest):
                if target != rest or joint is self.joints[index]:
                    joint.set_drive_target(float(target))
            self.robot.set_qf(self._bearing(moving=True))
            if not self._step():
                break
        return float(self.robot.get_qpos()[index])

    def _hold(self, index: int) -> tuple[float, float]:
        """Largest drift of the joint, from its rest pose and from half-way, under gravity alone,
        and its top speed from half-way, 0 where friction holds it."""
        worst = top = 0.0
        self.robot.set_solver_position_iterations(HOLD_ITERATIONS)
        for value in (self.rest[index], 0.5 * (self.low[index] + self.high[index])):
            if self.exploded:
                break
            q, top = self._with(index, float(value)), 0.0
            self._rub()
            self._reset(q)
            for _ in range(int(self.thresholds.hold_seconds / STEP)):
                self._catch()
                if not self._step():
                    break
                top = max(top, abs(float(self.robot.get_qvel()[index])))
            moved = abs(float(self.robot.get_qpos()[index]) - float(value))
            worst = max(worst, moved / float(self.span[index]))
        return worst, top if top > self._creep(index) else 0.0

    def _rub(self) -> None:
        """Nothing but friction, and catches where there are any, holds the joints."""
        for joint, slides in zip(self.joints, self.slide):
            friction, damping = self.frictions.get(joint.name, (0.0, 0.0))
            kind = "prismatic" if slides else "revolute"
            set_joint_friction(joint, kind, friction, damping)

    def _catch(self, index: int = 0, force: float = 0.0) -> None:
        """Apply what the catches pull where the joints are, and a force at one joint."""
        if not self.catches and not force:
            return
        forces = np.zeros(len(self.joints), dtype=np.float32)
        forces[index] = force
        if self.catches:
            q = self.robot.get_qpos().tolist()
            for k, pull in self.catches.items():
                forces[k] += pull(q[k])
        self.robot.set_qf(forces)

    def _creep(self, index: int) -> float:
        """Speed beyond which a joint moves, and does not merely creep as drives do."""
        return HANDLING.moves * DYNAMICS.creep["prismatic" if self.slide[index] else "revolute"]

    def _handling(self, index: int, let_go: float) -> Handling:
        self.rest = self._pose(self.joints[index].name)
        self._rub()
        half = self._with(index, 0.5 * float(self.low[index] + self.high[index]))
        tilts = [self._tilt(index, q) for q in (self.rest, half)]
        return Handling(self._breakaway(index), tilts[0], tilts[1], let_go)

    def _breakaway(self, index: int) -> float | None:
        """Force towards the farther end of the range that starts the joint from its rest pose."""
        self._reset(self.rest)
        load = abs(float(self._bearing()[index]))
        friction = self.frictions.get(self.joints[index].name, (0.0, 0.0))[0]
        home = self.rest[index]
        if index in self.catches:
            load += abs(self.catches[index](float(home)))
        way = 1.0 if self.high[index] - home >= home - self.low[index] else -1.0
        if self._moves(index, self.rest, way * HANDLING.least):
            return 0.0
        most = HANDLING.beyond * (friction + load + HANDLING.least)
        found = _least(most, lambda force: self._moves(index, self.rest, way * force))
        return found if found < most else None

    def _tilt(self, index: int, q: FloatArray) -> float:
        """Tilt to the side to which gravity pulls most at the joint, which starts it from `q`."""
        pose, pulls = self.robot.get_root_pose(), list[tuple[float, FloatArray]]()
        room = (q[index] - self.bounds[index, 0], self.bounds[index, 1] - q[index])
        for line in np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]]):
            self._lean(pose, 0.5 * HANDLING.tilt, line)
            self._reset(q)
            pull = -float(self._bearing()[index])
            free = room[pull > 0] > 1e-6 * self.span[index]
            pulls.append((abs(pull) if free else 0.0, line))
        side = max(pulls, key=lambda row: row[0])[1]

        def falls(degrees: float) -> bool:
            self._lean(pose, degrees, side)
            return self._moves(index, q, 0.0)

        found = _least(HANDLING.tilt, falls)
        self.robot.set_root_pose(pose)
        return found

    def _lean(self, pose: Any, degrees: float, side: FloatArray) -> None:
        """Tilt the whole object about a horizontal line."""
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * side).as_matrix()
        self.robot.set_root_pose(type(pose)(turn) * pose)

    def _moves(self, index: int, q: FloatArray, force: float) -> bool:
        """Whether a joint starts to move from `q` under gravity and a force of its own."""
        self._reset(q)
        for k in range(HANDLING.steps):
            if k == 0 or self.catches:
                self._catch(index, force)
            self.budget -= len(self.joints)
            self.scene.step()
            if not abs(float(self.robot.get_qvel()[index])) <= self._creep(index):
                return True
        return False

    def _step(self) -> bool:
        """One step; False once the state is no longer sane."""
        self.budget -= len(self.joints)
        self.scene.step()
        speeds = self.robot.get_qvel().tolist()  # of few joints, 200 times a second: no arrays
        if not all(map(math.isfinite, [*self.robot.get_qpos().tolist(), *speeds])):
            self.exploded = True
            return False
        self.top = [max(top, abs(speed)) for top, speed in zip(self.top, speeds)]
        if any(abs(speed) > most for speed, most in zip(speeds, self.fastest)):
            self.exploded = True
            return False
        self.drift = max(self.drift, math.dist(self.robot.get_root_pose().p.tolist(), self.base))
        return True


def _least(most: float, moves: Callable[[float], bool]) -> float:
    """The least value up to `most` at which something moves, by halving; `most` if none does."""
    low, high = 0.0, most
    if not moves(most):
        return most
    for _ in range(HANDLING.rounds):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if moves(middle) else (middle, high)
    return 0.5 * (low + high)
