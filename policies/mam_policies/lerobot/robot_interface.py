"""A simulated arm that speaks a real arm's language: motor names, motor units, absolute targets.

The LeRobot robot, the environment of lerobot-eval and the open-loop replay all go through it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_policies.lerobot.joint_mapping import JointMapping, identity, load_mapping
from mam_policies.lerobot.policy import PERCEIVED
from mam_policies.run import EnvChoice, flat


@dataclass(frozen=True)
class Faults:
    """What a real arm does worse than the simulated one.

    Attributes:
        latency: control steps until a command arrives.
        joint_noise: standard deviation of read joint values, radians or metres.
        handle_noise: of the perceived handle position, metres.
        calibration: of every joint's constant zero error, radians or metres, drawn once by seed.
        eye_in_hand: whether a camera on the hand perceives the handle: its place is then put
            together with what the motors say, and shares their error.
    """

    latency: int = 0
    joint_noise: float = 0.0
    handle_noise: float = 0.0
    calibration: float = 0.0
    eye_in_hand: bool = False


@dataclass(frozen=True)
class Outcome:
    """How the running episode stands; `truncated`: out of time; `failed`: by too much force."""

    seed: int
    steps: int = 0
    success: bool = False
    open_fraction: float = 0.0
    reward: float = 0.0
    truncated: bool = False
    failed: bool = False


class RobotInterface:
    """One environment in motor units.

    Attributes:
        joints: simulated joints of the state; state_names: <motor>.pos and PERCEIVED;
            action_names: <motor>.pos of the arm and of the gripper.
    """

    def __init__(
        self,
        choice: EnvChoice,
        mapping: str | JointMapping | None = None,
        faults: Faults | None = None,
        seed: int = 0,
        **more: Any,
    ) -> None:
        """Build the environment.

        Args:
            mapping: a mapping file or its content; None: radians and metres as they are.
            seed: of the faults. more: further arguments of the environment.

        Raises:
            InputError, ConfigError, PlacementError, HintNeeded: see EnvChoice and load_mapping.
        """
        choice = replace(choice, control_mode="pd_joint_pos")
        self.env = choice.make(reward_mode="normalized_dense", **more)
        base = self.env.unwrapped
        self.spec, self.faults = base.robot_spec, faults or Faults()
        self.joints = [j.name for j in base.agent.robot.active_joints]
        self.moved = [*self.spec.arm, self.spec.gripper[0]]
        self.mapping = mapping_of(base, mapping)
        self.state_names = [*self.mapping.names(self.joints), *PERCEIVED]
        self.action_names = self.mapping.names(self.moved)
        self._rng = np.random.default_rng([seed, 1])  # not the zero errors' numbers again
        self.miscalibrate(seed)
        self._moved = [self.joints.index(n) for n in self.moved]
        self._hidden = sum(b - a for _, a, b, secret in base.observation_layout() if secret)

    def miscalibrate(self, seed: int) -> None:
        """Draw the joints' zero errors anew, as another calibration of the arm would."""
        drawn = np.random.default_rng(seed).normal(0.0, 1.0, len(self.joints))
        self._zero = drawn * self.faults.calibration

    def reset(self, seed: int) -> NDArray[np.float32]:
        """Start an episode; returns its first state (n,)."""
        self.seen, _ = self.env.reset(seed=seed)
        self.outcome = Outcome(seed)
        self._waiting: deque[NDArray[np.float64]] = deque()
        self._held = self._q()[self._moved]
        return self.state()

    def place(self, world_asset: NDArray[Any], arm: NDArray[Any]) -> NDArray[np.float32]:
        """Put the object (4, 4) and the arm's joints (n,) elsewhere in a fresh episode."""
        base = self.env.unwrapped
        q = self._q()
        q[[self.joints.index(n) for n in self.spec.arm]] = arm
        base.agent.reset(q[None].astype(np.float32))
        base.put_object(np.asarray(world_asset, dtype=float))
        self._held = self._q()[self._moved]
        return self.state()

    def shift_object(self, by: Sequence[float]) -> None:
        """Move the object by (3,) metres, as somebody who bumps into it does."""
        base = self.env.unwrapped
        pose = np.array(base.planner_state().world_asset)
        pose[:3, 3] += by
        base.put_object(pose)

    def state(self) -> NDArray[np.float32]:
        """(n,) what motors and perception say now, in motor units."""
        base = self.env.unwrapped
        noise = self._rng.normal(0.0, 1.0, len(self.joints)) * self.faults.joint_noise
        told = self._q() + self._zero + noise
        motors = self.mapping.to_real(self.joints, told)
        world = np.asarray(base.handle_position(), dtype=float)[0]
        pose = np.asarray(base.layout(0).placement.base, dtype=float)
        handle = pose[:3, :3].T @ (world - pose[:3, 3])
        if self.faults.eye_in_hand:
            handle = self._by_hand(handle, told)
        handle = handle + self._rng.normal(0.0, 1.0, 3) * self.faults.handle_noise
        value = float(base.joint_value()[0])
        force = float(base.get_info()["contact_force"][0])
        touch = float(force > base.config.success.touch_force)
        return np.concatenate([motors, handle, [value, touch]]).astype(np.float32)

    def step(self, target: NDArray[Any]) -> NDArray[np.float32]:
        """One control step towards motor targets (m,); returns the state (n,) after it."""
        sim = self.mapping.to_sim(self.moved, np.asarray(target)) - self._zero[self._moved]
        self._waiting.append(sim)
        if len(self._waiting) > self.faults.latency:
            self._held = self._waiting.popleft()
        action = self.spec.action(self._held[:-1], float(self._held[-1]))
        self.seen, reward, _, truncated, info = self.env.step(action)
        now = self.outcome
        self.outcome = replace(
            now,
            steps=now.steps + 1,
            success=now.success or _flag(info["success"]),
            open_fraction=float(np.asarray(info["open_fraction"]).reshape(-1)[0]),
            reward=float(np.asarray(reward).reshape(-1)[0]),
            truncated=_flag(truncated),
            failed=now.failed or _flag(info.get("fail", False)),
        )
        return self.state()

    def hidden(self) -> NDArray[np.float32]:
        """(k,) what only the simulator knows now, as datasets have it in environment_state."""
        state = flat(self.seen["state"] if isinstance(self.seen, dict) else self.seen)
        return state[len(state) - self._hidden :]

    def pictures(self) -> dict[str, NDArray[np.uint8]]:
        """(h, w, 3) of every camera now, by name; none unless obs_mode has rgb."""
        sensors = self.seen.get("sensor_data", {}) if isinstance(self.seen, dict) else {}
        return {
            name: np.asarray(data["rgb"].cpu())[0].astype(np.uint8)
            for name, data in sensors.items()
            if "rgb" in data
        }

    def close(self) -> None:
        """Free the simulator."""
        self.env.close()

    def _by_hand(self, handle: NDArray[Any], told: NDArray[Any]) -> NDArray[np.float64]:
        """(3,) the handle in the base frame as seen from the hand, which is where `told` says."""
        arm = [self.joints.index(n) for n in self.spec.arm]
        turn, place, _ = self.spec.chain.forward(np.stack([self._q()[arm], told[arm]]))
        return np.asarray(turn[1] @ turn[0].T @ (handle - place[0]) + place[1])

    def _q(self) -> NDArray[np.float64]:
        return np.asarray(self.env.unwrapped.agent.robot.get_qpos(), dtype=float)[0]


def mapping_of(base: Any, mapping: str | JointMapping | None) -> JointMapping:
    """The mapping of an environment's robot; identity in radians and metres for None."""
    active = base.agent.robot.active_joints
    if isinstance(mapping, JointMapping):
        return mapping
    if mapping:
        return load_mapping(mapping, [j.name for j in active])
    units = {j.name: "metres" if j.type[0] == "prismatic" else "radians" for j in active}
    return identity(base.robot_spec.uid, units)


def _flag(value: Any) -> bool:
    return bool(np.asarray(value).reshape(-1)[0])
