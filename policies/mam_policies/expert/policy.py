"""The expert as a policy: one action per step, watching the joint and trying again if it slips."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_envs.env import OperateJointEnv
from mam_envs.grasping.candidates import Grasp
from mam_envs.planner_state import PlannerState
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray
from mam_policies.expert.carry import Leg, goal_of, next_leg, pick, put
from mam_policies.expert.compliance import Compliance
from mam_policies.expert.config import ExpertConfig
from mam_policies.expert.drive import Driver
from mam_policies.expert.plan import Plan, PlanningError, correction, hand_travel, plan

MODES = ("pd_joint_pos", "pd_joint_delta_pos", "pd_joint_target_delta_pos", "pd_ee_delta_pose")


@dataclass(frozen=True)
class Episode:
    """How one episode went.

    Attributes:
        success: of the environment; steps: control steps taken; plans: how many were tried.
        reason: why not, or "".
        open_fraction: of the joint at the end.
        records: observations and actions if they were asked for.
    """

    success: bool
    steps: int
    plans: int
    reason: str
    open_fraction: float
    mode: str = ""
    records: dict[str, list[Any]] = field(default_factory=dict)


class Expert:
    """Drives one environment (num_envs=1) in one of the control modes `MODES`.

    Usage: `expert.reset()` after `env.reset(...)`, then `env.step(expert.act())`.

    Attributes:
        phase: name of what it does now (drive, move, approach, close, follow, settle,
            release, lift, hold, carry, lower, leave, retreat, done).
        target: (n,) arm joint target of the last action, radians.
    """

    def __init__(
        self,
        env: Any,
        noise: float = 0.0,
        seed: int = 0,
        attempts: int = 3,
        config: ExpertConfig | None = None,
    ) -> None:
        """Bind to an environment.

        Args:
            env: gym environment on OperateJoint-v1.
            noise: standard deviation of noise on the arm targets, radians; the plan is kept.
            seed: of that noise.
            attempts: plans per joint before it gives up.
            config: speeds, waits and tolerances.

        Raises:
            ConfigError: a control mode that takes no joint targets, or more than one sub-scene.
        """
        self.env: OperateJointEnv = env.unwrapped
        if not isinstance(self.env, OperateJointEnv):
            raise ConfigError(f"the expert works on OperateJoint-v1, not {type(self.env).__name__}")
        if self.env.num_envs != 1:
            raise ConfigError("the expert drives one environment; use num_envs=1")
        self.mode = self.env.control_mode
        if self.mode not in MODES:
            raise ConfigError(
                f"the expert needs control_mode {' or '.join(MODES)}, not {self.mode!r}"
            )
        self.noise, self.attempts = noise, attempts
        self.config = config or ExpertConfig()
        self.rng = np.random.default_rng(seed)
        self.plans: list[Plan] = []
        self.driver: Driver | None = None
        self.speeds = (0.0, 0.0)
        self.reason = ""
        self.phase = "done"

    def reset(self) -> None:
        """Plan from the state after a reset.

        Raises:
            PlanningError: there is no motion; the message says why.
        """
        self.skip: list[Grasp] = []
        self.plans, self.reason = [], ""
        self.stage, self.before = int(self.env.stage[0]), 0
        self.leg: Leg = "joint"
        self.driver, self.driven = None, 0
        self.speeds = (0.0, 0.0)
        now = self.env.planner_state()
        if now.robot.drive is None:
            self._begin(now)
            return
        # planned as if it stood there, so that what cannot be done is refused before it drives
        stand = now.layout.stand(now.world_asset)
        self._begin(replace(now, base=stand))
        self.driver = Driver(stand, self.config, self.env.control_timestep)
        self.phase = "drive"

    def _begin(self, now: PlannerState) -> None:
        leg = next_leg(now)
        if leg != self.leg:
            self.leg, self.skip, self.before = leg, [], len(self.plans)
        now = replace(now, goal=goal_of(leg, now.goal))
        if leg in ("pick", "put"):
            self.plan = (pick if leg == "pick" else put)(now, self.config)
        else:
            self.plan = plan(now, self.skip, self.config)
        self.plans.append(self.plan)
        self.at = self.corrections = self.waited = self.strained = self.held = 0
        self.compliance = Compliance(self.config)
        self.retreat: list[FloatArray] = []
        self.leaving = False
        self.gripper = float(self.plan.gripper[0])
        self.phase = self.plan.phase[0]
        self.target = now.arm

    def act(self) -> FloatArray:
        """The next action (the environment's action vector)."""
        now = self.env.planner_state()
        if self.driver is not None and self._drives(now):
            return self._action(now)
        begun = next_leg(now)
        now = replace(now, goal=goal_of(self.leg, now.goal))
        if int(self.env.stage[0]) != self.stage:
            self.stage, self.skip = int(self.env.stage[0]), []
            self._let_go(now)
        if self.retreat:
            self.phase = "retreat"
            self.target = self.retreat.pop(0)
            self.gripper = self.env.robot_spec.opened
            if not self.retreat and (not self.leaving or self._may_retry()):
                self._again()
            return self._action(now)
        if self.at >= len(self.plan) and begun != self.leg and not self.leaving:
            self._let_go(now)  # this leg is done
            return self.act()
        on_joint = self.leg not in ("pick", "put")
        if self.at >= len(self.plan) and on_joint and self.corrections < self.config.corrections:
            further = correction(now, self.plan, self.config)
            self.corrections += 1
            if further is not None:
                self.plan, self.at = further, 0
        over = self.at >= len(self.plan) or now.goal.thing is not None
        if over and self._should_leave(now):
            self.leaving = True
            self._let_go(now)
            self.retreat += [self.retreat[-1]] * self.config.settle_steps
            return self.act()
        if self.at >= len(self.plan):
            if not self._may_retry():
                self.phase = "done"
                self.reason = self.reason or self._why(now)
                return self._action(now)
            self._give_up(now)
            return self.act()
        if self._lags(now):
            self.waited += 1
            return self._action(now)
        if self._behind(now):
            self.held += 1
            return self._action(now)
        self.held = 0
        self.target = self.plan.arm[self.at]
        self.gripper = float(self.plan.gripper[self.at])
        self.phase = self.plan.phase[self.at]
        if self.phase in ("follow", "settle"):
            if self._slipped(now) and self._may_retry():
                self._give_up(now)
                return self.act()
            value = float(self.plan.expected[self.at])
            self.target = self.compliance.target(now, self.plan.path, self.target, value)
            if self._strained(now.robot.force):
                self.strained += 1
                return self._action(now)
        self.at += 1
        return self._action(now)

    def _drives(self, now: PlannerState) -> bool:
        """Choose the base's speeds while it is on its way; once it stands, plan from there."""
        assert self.driver is not None
        speeds = self.driver.speeds(now.base)
        self.driven += 1
        if speeds is not None and self.driven <= self.config.longest_drive:
            self.speeds = speeds
            return True
        self.driver, self.speeds, self.plans = None, (0.0, 0.0), []
        self._again()
        return False

    def _should_leave(self, now: PlannerState) -> bool:
        """Whether the joint has got there, and the task asks the hand to leave it then."""
        wanted = now.goal.let_go and not self.leaving
        return wanted and float(self.env.get_info()["progress"][0]) >= 1.0

    def _strained(self, trusted: float) -> bool:
        """Whether the hand pulls so hard across the motion that it waits for its compliance."""
        hard = self.compliance.across > self.config.strained * trusted
        return hard and self.strained < self.config.catch_up

    def _lags(self, now: PlannerState) -> bool:
        """Whether the arm is still on its way where the hand is to close next."""
        phases = self.plan.phase[max(self.at - 1, 0) : self.at + 1]
        off = float(np.abs(now.arm - self.target).max())
        ready = off <= self.config.lag or self.waited >= self.config.catch_up
        return phases == ("approach", "close") and not ready

    def _behind(self, now: PlannerState) -> bool:
        """Whether the target is farther than changes of measured joints can ask for in one step."""
        far = float(np.abs(now.arm - self.target).max()) > now.robot.delta
        return self.mode == "pd_joint_delta_pos" and far and self.held < self.config.catch_up

    def _slipped(self, now: PlannerState) -> bool:
        way = now.goal.q_goal - self.plan.path.q[0]
        lag = self.plan.expected[self.at] - now.q
        behind = lag / (way if abs(way) > 1e-9 else 1e-9)
        length = abs(lag) * hand_travel(now, self.plan.path)
        return bool(behind > self.config.slip) and length > self.config.slip_length

    def _may_retry(self) -> bool:
        return len(self.plans) - self.before < self.attempts

    def _why(self, now: PlannerState) -> str:
        info = self.env.get_info()
        if self.leg in ("pick", "put"):
            return "the cube was not grasped, or slipped from the hand"
        done, touched = float(info["progress"][0]), bool(info["by_contact"][0])
        if done < 0.05:
            return "the grasp slipped before the joint moved" if touched else "no contact was made"
        if done < 1.0:
            return f"the joint stopped at {100 * done:.0f} % of the way"
        if not touched:
            return "the joint moved without contact"
        return "the joint went far enough, but was not still, or the task asks for more"

    def _give_up(self, now: PlannerState) -> None:
        self.skip.append(self.plan.path.grasp)
        self.reason = self._why(now)
        self._let_go(now)

    def _let_go(self, now: PlannerState) -> None:
        """Open the hand and back off the way it came, then plan anew."""
        robot, path = now.robot, self.plan.path
        chain = robot.chain
        rotation, position, _ = chain.forward(now.arm[None])
        goal = np.eye(4)[None].copy()
        goal[0, :3, :3], goal[0, :3, 3] = rotation[0], position[0]
        goal[0, :3, 3] -= self.config.retreat_length * rotation[0, :, 2]
        back = chain.solve(goal, now.arm[None], robot.rotation_weight, 20).q[0]
        shares = np.linspace(0, 1, self.config.retreat_steps - 3)
        wait = [now.arm.copy() for _ in range(4)] if path.grasp.mode == "grip" else []
        self.retreat = [*wait, *((1 - s) * now.arm + s * back for s in shares)]

    def _again(self) -> None:
        try:
            self._begin(self.env.planner_state())
        except PlanningError as error:
            self.reason = f"{self.reason}; then: {error}" if self.reason else str(error)
            self.at = len(self.plan)
            self.plans += [self.plan] * self.attempts  # no further tries

    def clean_action(self) -> FloatArray:
        """The last action without noise: what a learner should do in its place."""
        return self._command(self.env.planner_state(), self.target)

    def _action(self, now: PlannerState) -> FloatArray:
        noise = self.rng.normal(0, self.noise, len(self.target)) if self.noise else 0.0
        return self._command(now, self.target + noise)

    def _command(self, now: PlannerState, target: FloatArray) -> FloatArray:
        """The environment's action towards an arm joint target."""
        robot = now.robot
        base = robot.base_action(now.held, *self.speeds)
        if self.mode == "pd_joint_pos":
            limits = robot.chain.limits
            return robot.action(np.clip(target, limits[:, 0], limits[:, 1]), self.gripper, base)
        if self.mode == "pd_ee_delta_pose":
            return self._hand_command(now, target)
        begin = now.arm
        if self.mode == "pd_joint_target_delta_pos":  # changes add up on the last target
            arm = self.env.agent.controller.controllers["arm"]
            begin = arm.get_state()["target_qpos"][0].cpu().numpy()
        return np.clip(robot.action((target - begin) / robot.delta, self.gripper, base), -1, 1)

    def _hand_command(self, now: PlannerState, target: FloatArray) -> FloatArray:
        """The same as a change of the hand's pose: six entries in -1..1, then the gripper's.

        ManiSkill's controller turns by XYZ angles in the base's frame, in units of its rot_lower,
        which is negative, and cuts the rotation by its length.
        """
        robot, limits = now.robot, self.env.agent.controller.controllers["arm"].config
        rotation, position, _ = robot.chain.forward(np.stack([now.arm, target]))
        back = np.linalg.inv(robot.chain.tool)[:3, 3]
        position = position + rotation @ back  # of the link that the controller moves
        turned = Rotation.from_matrix(rotation[1] @ rotation[0].T).as_euler("XYZ")
        move = np.clip((position[1] - position[0]) / limits.pos_upper, -1, 1)
        turn = turned / limits.rot_lower
        turn = turn / max(1.0, float(np.linalg.norm(turn)))
        base = robot.base_action(now.held, *self.speeds)
        whole = robot.action(np.concatenate([move, turn]), self.gripper, base)
        return np.clip(whole, -1, 1)


def run_episode(
    env: Any, expert: Expert, seed: int | None = None, record: bool = False, extra_steps: int = 0
) -> Episode:
    """Reset, let the expert act until success, too much force or the time limit, and report.

    Args:
        record: keep observations, actions, rewards and infos (lists; one more observation than
            actions).
        extra_steps: control steps to go on for after success (the arm holds still).
    """
    obs, info = env.reset(seed=seed)
    records: dict[str, list[Any]] = {"obs": [obs]} if record else {}
    for key in ("action", "reward", "info", "phase") if record else ():
        records[key] = []
    try:
        expert.reset()
    except PlanningError as error:
        return Episode(False, 0, 0, str(error), float(info["open_fraction"][0]), "", records)
    success, failed, steps, left = False, False, 0, extra_steps
    while True:
        action = expert.act()
        if expert.phase == "done" and not success:
            break
        obs, reward, _terminated, truncated, info = env.step(action)
        steps += 1
        if record:
            for key, value in zip(
                ("obs", "action", "reward", "info", "phase"),
                (obs, action, reward, info, expert.phase),
            ):
                records[key].append(value)
        success = success or bool(info["success"].reshape(-1)[0])
        failed = not success and bool(info["fail"].reshape(-1)[0])
        if failed or bool(np.asarray(truncated).reshape(-1)[0]):
            break
        if success:
            if left <= 0:
                break
            left -= 1
    why = "too much force" if failed else expert.reason or "out of time"
    reason = "" if success else why
    fraction = float(info["open_fraction"].reshape(-1)[0])
    mode = expert.plan.path.grasp.mode
    return Episode(success, steps, len(expert.plans), reason, fraction, mode, records)
