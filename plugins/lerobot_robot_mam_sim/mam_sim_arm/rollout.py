"""A policy on a real arm: read, perceive, act, hold against the limits, send."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import HintNeeded
from mam_pipeline.types import FloatArray
from mam_policies.lerobot.policy import Converter
from mam_sim_arm.perception import Perceiver, Seen
from mam_sim_arm.recording import Arm
from mam_sim_arm.safety import Guard, StoppedForSafety
from mam_sim_arm.targets import Picture


@dataclass(frozen=True)
class Attempt:
    """One episode on the arm.

    Attributes:
        opened: greatest share of the way to the goal, as perceived; success: whether it was
            reached. steps: control steps. cut: steps whose speed was cut. late: steps that took
            longer than the rate allows.
    """

    opened: float
    success: bool
    steps: int
    cut: int
    late: int


class Pilot:
    """What runs an episode: a connected arm, a policy, and what perceives for it."""

    def __init__(self, arm: Arm, converter: Converter, perceiver: Perceiver, guard: Guard) -> None:
        self.arm, self.converter = arm, converter
        self.perceiver, self.guard = perceiver, guard
        self.names = arm.mapping.names(converter.plan.joints)

    def look(self) -> Seen | None:
        """Read motors and picture, and say what is believed."""
        tool = np.eye(4)
        rotation, position, _ = self.arm.spec.chain.forward(self.joints()[None])
        tool[:3, :3], tool[:3, 3] = rotation[0], position[0]
        return self.perceiver.update(self.picture(), tool)

    def picture(self) -> Picture:
        """(H, W, 3) of the camera, the last one."""
        return np.asarray(self.arm.seen[self.perceiver.camera.name])

    def joints(self) -> FloatArray:
        """(n,) arm joints as the motors say."""
        spec = self.arm.spec
        real = self.arm.read(self.arm.mapping.names(spec.arm))
        return self.arm.mapping.to_sim(spec.arm, real)

    def find(self, tries: int = 20) -> Seen:
        """Look until the object is seen, the arm at rest.

        Raises:
            HintNeeded: it is not.
        """
        self.perceiver.reset()
        seen = None
        for _ in range(tries):
            seen = self.look()
            if seen is not None and len(self.perceiver.poses) >= self.perceiver.memory:
                return seen
            self.arm.send(self.arm.command)
        if seen is None:
            raise HintNeeded(
                "the camera does not see the tag on the object's body; turn it, light the scene, "
                "or say in markers.yaml where the tag is"
            )
        return seen

    def run(
        self,
        steps: int,
        on_step: Callable[[int, Seen], bool] = lambda _step, _seen: False,
        allowed: Callable[[], bool] = lambda: True,
    ) -> Attempt:
        """One episode; ends early when the joint stays at its goal, or `on_step` says so.

        Args:
            allowed: asked before every command; where it says no, the arm stops.

        Raises:
            HintNeeded, StoppedForSafety: see find, and Guard; or it is not allowed.
        """
        plan = self.converter.plan
        seen = self.find()
        self.converter.reset()
        self.guard.reset()
        begin, best, at_goal, late, k = seen.value, 0.0, 0, 0, 0
        for k in range(1, steps + 1):
            started = time.perf_counter()
            state = np.concatenate([self.arm.read(self.names), seen.handle, [seen.value, 0.0]])
            target = self.converter.act(state[None])[0]
            wanted = self.arm.mapping.to_sim(self.arm.joints, target)
            wanted[:-1] = self.guard.pass_on(wanted[:-1], self.joints())
            if not allowed():
                raise StoppedForSafety("the key was let go; the arm was stopped")
            self.arm.send(self.arm.mapping.to_real(self.arm.joints, wanted))
            seen = self.look() or seen
            share = (seen.value - begin) / (plan.goal - begin)
            best, at_goal = max(best, share), at_goal + 1 if share >= 1.0 else 0
            if on_step(k, seen) or at_goal >= 10:
                break
            late += self.arm.wait(started)
        return Attempt(best, best >= 1.0, k, self.guard.cut, late)


def rehearse(run: Path, seen: Seen, arm: FloatArray, strip: Path | None = None) -> dict[str, Any]:
    """The policy in the twin, from where the real arm and object are: what it is going to do.

    Args:
        arm: (n,) joints of the real arm. strip: where four pictures of it go.

    Returns:
        success, steps, `open_fraction`, `hand` (2, 3) box that the hand went through, base frame,
        and `speed`, the greatest joint motion in a control step, radians.
    """
    from mam_envs.scene.video import Camera, write_strip
    from mam_policies.algorithms import algorithm
    from mam_policies.lerobot.export import deployment
    from mam_policies.lerobot.robot_interface import RobotInterface, mapping_of
    from mam_policies.run import RunInfo

    info = RunInfo.load(run)
    interface = RobotInterface(replace(info.env, assets=info.env.assets[:1]))
    try:
        base = interface.env.unwrapped
        plan = deployment(base, info, mapping_of(base, None))
        converter = Converter(plan, algorithm(info.algo).network(run))
        interface.reset(0)
        pose = np.asarray(base.layout(0).placement.base, dtype=float) @ seen.object_pose
        state = interface.place(pose, arm)
        camera, frames, rows = Camera(interface.env), [], []
        while not (interface.outcome.success or interface.outcome.truncated):
            state = interface.step(converter.act(state[None].astype(float))[0])
            rows.append(base.planner_state().arm)
            if strip is not None and interface.outcome.steps % 15 == 1:
                frames.append(camera.shoot())
    finally:
        interface.close()
    _, position, _ = base.robot_spec.chain.forward(np.stack(rows))
    if strip is not None and frames:
        write_strip(frames, strip)
    now = interface.outcome
    return {
        "success": now.success, "steps": now.steps, "open_fraction": now.open_fraction,
        "hand": [position.min(axis=0).round(3).tolist(), position.max(axis=0).round(3).tolist()],
        "speed": float(np.abs(np.diff(rows, axis=0)).max()),
    }  # fmt: skip
