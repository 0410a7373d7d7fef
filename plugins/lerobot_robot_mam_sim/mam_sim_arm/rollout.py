"""A policy on a real arm: read, perceive, act, send through the guarded arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import HintNeeded
from mam_pipeline.types import FloatArray
from mam_policies.lerobot.policy import Converter
from mam_sim_arm.guarded_arm import GuardedArm
from mam_sim_arm.perception import Perceiver, Seen
from mam_sim_arm.safety import StoppedForSafety
from mam_sim_arm.targets import Picture

STILL, SQUEEZE = 0.03, 0.05
"""Shares of the gripper's range: what it moves in a step while it stands still; and how much wider
than its target it stays when something is between its fingers."""


@dataclass(frozen=True)
class Attempt:
    """One episode on the arm.

    Attributes:
        opened: greatest share of the way to the goal that was seen; success: whether it was
            reached. unseen: whether the part was out of sight at the end, so that it may be
            further. steps: control steps. cut: steps whose speed was cut. late: commands that came
            later than the rate allows. stopped: why the arm was stopped, in a sentence.
    """

    opened: float
    success: bool
    unseen: bool
    steps: int
    cut: int
    late: int
    stopped: str | None = None


class Pilot:
    """What runs an episode: a guarded arm, a policy, and what perceives for it."""

    def __init__(self, arm: GuardedArm, converter: Converter, perceiver: Perceiver) -> None:
        self.arm, self.converter, self.perceiver = arm, converter, perceiver
        self.names = arm.mapping.names(converter.plan.joints)
        arm.watched, self.width = perceiver.camera.name, 0.0

    def look(self) -> Seen | None:
        """What is believed by the motors and the picture that were read last."""
        spec, now = self.arm.spec, self.arm.now()
        tool = np.eye(4)
        rotation, position, _ = spec.chain.forward(now[None, :-1])
        tool[:3, :3], tool[:3, 3] = rotation[0], position[0]
        return self.perceiver.update(self.picture(), tool, self._grip())

    def _grip(self) -> float | None:
        """How far the hand is open, 0 shut to 1, where it holds something: it stands still, wider
        than it should be."""
        spec, arm = self.arm.spec, self.arm
        sent = arm.now() if arm.target is None else arm.target
        now, aim = ((g[-1] - spec.shut) / (spec.opened - spec.shut) for g in (arm.now(), sent))
        still, self.width = abs(now - self.width) < STILL, float(now)
        return self.width if still and now - aim > SQUEEZE else None

    def picture(self) -> Picture:
        """(H, W, 3) of the camera, the last one."""
        return np.asarray(self.arm.seen[self.perceiver.camera.name])

    def find(self, tries: int = 20) -> Seen:
        """Look until the object and its part are seen; nothing is sent.

        Raises:
            HintNeeded: they are not.
        """
        self.perceiver.reset()
        seen = None
        for _ in range(tries):
            seen = self.look()
            sure = len(self.perceiver.poses) >= self.perceiver.memory
            if sure and seen is not None and seen.value is not None:
                return seen
            self.arm.look()
        which = "part that moves" if seen is not None else "body"
        ids = self.perceiver.on_part if seen is not None else self.perceiver.on_body
        raise HintNeeded(
            f"the camera does not see the tag on the {which} of the object ("
            f"{', '.join(f'tag_{m.id}' for m in ids)}); turn the object, light the scene, take "
            "the arm out of the way, or say in markers.yaml where the tag is"
        )

    def run(
        self, seen: Seen, steps: int,
        on_step: Callable[[int, Seen], bool] = lambda _step, _seen: False,
    ) -> Attempt:  # fmt: skip
        """One episode; ends early when the joint stays at its goal, or `on_step` says so.

        Args:
            seen: from `find`.
        """
        arm, plan = self.arm, self.converter.plan
        self.converter.reset()
        arm.guard.reset()
        assert seen.value is not None
        begin, best, at_goal, k = seen.value, 0.0, 0, 0
        believed, unseen, stopped = seen, 0, None
        try:
            for k in range(1, steps + 1):
                assert believed.handle is not None
                more = [*believed.handle, believed.value, 0.0]
                state = np.concatenate([arm.read(self.names), more])
                target = self.converter.act(state[None])[0]
                arm.send(arm.mapping.to_sim(arm.joints, target))
                now = self.look()
                assert now is not None
                self._unmoved(seen, now)
                unseen = unseen + 1 if now.value is None else 0
                if unseen >= arm.config.patience:
                    raise StoppedForSafety(
                        "the part's tag is not seen and the hand does not hold the handle: how far "
                        "the part is open is not known. See whether the handle slipped, take the "
                        "arm out of the camera's way, put the part back and run it again"
                    )
                believed = believed if now.value is None else now
                assert believed.value is not None
                share = (believed.value - begin) / (plan.goal - begin)
                reached = share >= 1.0 and not unseen
                best, at_goal = max(best, share), at_goal + 1 if reached else 0
                if on_step(k, believed) or at_goal >= 10:
                    break
        except StoppedForSafety as error:
            stopped = str(error)
            arm.hold()
        done = best >= 1.0 and stopped is None
        if not done and stopped is None:
            stopped = arm.guard.unmoved()
        return Attempt(best, done, unseen > 0, k, arm.guard.cut, arm.late, stopped)

    def _unmoved(self, before: Seen, now: Seen) -> None:
        """Stop where the object is no longer where it was found."""
        off = float(np.linalg.norm((now.object_pose - before.object_pose)[:3, 3]))
        if off > self.arm.config.moved:
            raise StoppedForSafety(
                f"the object has moved by {100 * off:.0f} cm: fix it to the table, put it back, "
                "and run it again"
            )


def rehearse(
    run: Path, seen: Seen, arm: FloatArray, strip: Path | None = None
) -> tuple[dict[str, Any], FloatArray]:
    """The policy in the twin, from where the real arm and object are: what it is going to do.

    Args:
        arm: (n,) joints of the real arm. strip: where four pictures of it go.

    Returns:
        success, steps, `open_fraction`, `hand` (2, 3) box that the hand went through, base frame,
        and `speed`, the greatest joint motion in a control step, radians; and the way itself,
        (N, n) arm joints.
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
    found = {
        "success": now.success, "steps": now.steps, "open_fraction": now.open_fraction,
        "hand": [position.min(axis=0).round(3).tolist(), position.max(axis=0).round(3).tolist()],
        "speed": float(np.abs(np.diff(rows, axis=0)).max()),
    }  # fmt: skip
    return found, np.stack(rows)
