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
        self._commands = 0
        self._stood: NDArray[np.float64] | None = None
        self._last: dict[str, Any] | None = None

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
        self._note("connect")
        self.configure()

    def calibrate(self) -> None:
        """Nothing to do."""

    def configure(self) -> None:
        """A real arm's motors would be set up and powered now; a line of `wire` says so."""
        self._note("configure")

    def get_observation(self) -> dict[str, Any]:
        """Motor values and perceived values by name.

        Raises:
            ConnectionError, TimeoutError: the fault is a lost arm or camera.
        """
        if self._fails("lost_arm"):
            raise ConnectionError("no motor answers")
        if self._fails("lost_camera"):
            raise TimeoutError("no picture from the camera for 500 ms")
        if self._read and self.interface.outcome.steps:
            self._finish()
            self._begin()
        self._read = True
        state = dict(zip(self.interface.state_names, map(float, self._state)))
        if self.config.fault == "wrong_sign":
            state[self._faulty] *= -1
        named: dict[str, Any] = {k: state[k] for k in self._named(self.interface.state_names)}
        seen: dict[str, Any] = {}
        if self._last is not None and self._fails("frozen_camera"):
            seen = self._last
        elif self.eye is not None:
            if self._fails("hidden_tag"):
                self.eye.hide_part()
            seen = {self.eye.nominal.name: self.eye.shoot()}
        self._last = seen
        return {**named, **self.interface.pictures(), **seen}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """One control step; returns the targets that were sent, which may have been clipped.

        Raises:
            ConnectionError: the fault is a lost arm.
        """
        names = self.interface.action_names
        self._note("action", targets={k: float(action[k]) for k in names})
        if self._fails("lost_arm"):
            raise ConnectionError("no motor answers")
        target = self._faulted(np.array([float(action[k]) for k in names]), names)
        self._commands += 1
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
            self._note("disconnect", torque=not self.config.disable_torque_on_disconnect)

    @cached_property
    def _faulty(self) -> str:
        """The motor with the fault."""
        joint = self.config.fault_joint or self.interface.spec.arm[1]
        return self.interface.mapping.names([joint])[0]

    def _fails(self, fault: str) -> bool:
        return self.config.fault == fault and self._commands >= self.config.fault_step

    def _faulted(self, target: NDArray[Any], names: list[str]) -> NDArray[Any]:
        """What arrives of a target (m,), and what happens meanwhile, by the fault."""
        late = self._commands - self.config.fault_step
        if self.config.fault == "wrong_sign":
            target[names.index(self._faulty)] *= -1
        elif self._fails("dead_motor"):
            k = names.index(self._faulty)
            if self._stood is None:
                self._stood = target.copy()
            target[k] = self._stood[k]
        elif self._fails("slipped_gripper") and late < 10:
            if self.eye is not None:
                self.eye.seat = None  # the board falls
            spec = self.interface.spec
            target[-1] = self.interface.mapping.to_real([spec.gripper[0]], np.array([spec.opened]))[
                0
            ]
        elif self.config.fault == "moved_object" and late == 0:
            self.interface.shift_object([0.0, 0.06, 0.0])
        return target

    def _note(self, kind: str, **more: Any) -> None:
        """Put down in the file of the wire what goes to the arm."""
        if self.config.wire:
            with not_a_link(Path(self.config.wire)).open("a", encoding="utf-8") as file:
                file.write(json.dumps({"kind": kind, **more}) + "\n")

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
