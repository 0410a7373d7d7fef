"""The robot type `mam_sim`: LeRobot's record, replay and rollout run on it without hardware."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.robots.robot import Robot
from numpy.typing import NDArray

from lerobot_robot_mam_sim.config_mam_sim_robot import MamSimRobotConfig
from lerobot_robot_mam_sim.simulated_camera import SimulatedCamera
from mam_pipeline.claims import EPISODES, claim_file, not_a_link
from mam_policies.lerobot.policy import PERCEIVED
from mam_policies.lerobot.robot_interface import Faults, RobotInterface
from mam_policies.run import EnvChoice


class MamSimRobot(Robot):
    """A simulated arm; one sent action is one control step (1/20 s of simulated time).

    Reading twice without a command in between means that the operator is resetting the scene:
    the next episode (its seed one higher) begins then.
    """

    config_class = MamSimRobotConfig
    name = "mam_sim"

    def __init__(self, config: MamSimRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self._connected = False
        self._next_seed = config.seed
        self._state: NDArray[np.float32] = np.zeros(0, dtype=np.float32)
        self._read = False
        self.cameras: dict[str, Any] = {}  # LeRobot counts them

    @cached_property
    def interface(self) -> RobotInterface:
        """The simulator, started when it is first needed."""
        c = self.config
        faults = Faults(
            c.latency_steps, c.joint_noise, c.handle_noise, c.calibration_error, c.eye_in_hand
        )
        choice = EnvChoice((c.asset,), c.joint, robot=c.robot, max_steps=c.max_steps)
        more = {"obs_mode": "rgb+state"} if c.pictures else {}
        return RobotInterface(choice, c.mapping, faults, c.seed, **more)

    @cached_property
    def eye(self) -> SimulatedCamera | None:
        """The camera that sees tags and board, if there is one."""
        c = self.config
        if c.camera is None:
            return None
        base = self.interface.env.unwrapped
        return SimulatedCamera(
            base, Path(c.camera), None if c.markers is None else Path(c.markers), c.board,
            c.camera_error, c.seed,
        )  # fmt: skip

    @property
    def observation_features(self) -> dict[str, Any]:
        """Motors, then what perception gives; pictures by camera."""
        out: dict[str, Any] = {name: float for name in self._named(self.interface.state_names)}
        if self.config.pictures:
            for name, spec in self.interface.env.unwrapped.config.scene.cameras.items():
                out[name] = (spec.height, spec.width, 3)
        if self.eye is not None:
            out[self.eye.nominal.name] = (*self.eye.nominal.size[::-1], 3)
        return out

    @property
    def action_features(self) -> dict[str, Any]:
        """Absolute targets of arm and gripper."""
        return {name: float for name in self.interface.action_names}

    @property
    def is_connected(self) -> bool:
        """Whether connect() was called."""
        return self._connected

    @property
    def is_calibrated(self) -> bool:
        """Always: its error is a setting."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Start the first episode.

        Raises:
            ConfigError: the log is a file of somebody else.
        """
        if self.config.log:
            claim_file(not_a_link(Path(self.config.log)), EPISODES, flag="the robot's log")
        self._connected = True
        self._begin()

    def calibrate(self) -> None:
        """Nothing to do."""

    def configure(self) -> None:
        """Nothing to do."""

    def get_observation(self) -> dict[str, Any]:
        """Motor values and perceived values by name."""
        if self._read and self.interface.outcome.steps:
            self._finish()
            self._begin()
        self._read = True
        state = dict(zip(self.interface.state_names, map(float, self._state)))
        named: dict[str, Any] = {k: state[k] for k in self._named(self.interface.state_names)}
        seen = {} if self.eye is None else {self.eye.nominal.name: self.eye.shoot()}
        return {**named, **self.interface.pictures(), **seen}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """One control step; returns the targets that were sent, which may have been clipped."""
        names = self.interface.action_names
        target = np.array([float(action[k]) for k in names])
        limit = self.config.max_relative_target
        if limit is not None:
            present = dict(zip(self.interface.state_names, self._state))
            now = np.array([present[k] for k in names])
            target = now + np.clip(target - now, -limit, limit)
        if not self.interface.outcome.truncated:
            self._state = self.interface.step(target)
        self._read = False
        return {k: float(v) for k, v in zip(names, target)}

    def disconnect(self) -> None:
        """Note the episode's outcome and free the simulator."""
        if self._connected:
            self._finish()
            self.interface.close()
            self._connected = False

    def _named(self, names: list[str]) -> list[str]:
        return names if self.config.perceived else names[: -len(PERCEIVED)]

    def _begin(self) -> None:
        self._state = self.interface.reset(self._next_seed)
        self._next_seed += 1
        self._read = False

    def _finish(self) -> None:
        if self.config.log and self.interface.outcome.steps:
            with not_a_link(Path(self.config.log)).open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(self.interface.outcome)) + "\n")
