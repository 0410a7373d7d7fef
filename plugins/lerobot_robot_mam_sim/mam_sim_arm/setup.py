"""The folder of one arm before one object, before and after calibration.

robot.yaml            LeRobot's robot: its type and fields
nominal_camera.yaml   where the camera is meant to stand; camera.yaml: as calibrated
board.png, tag_*.png  to print; markers.yaml: where the tags are stuck
joint_mapping.yaml    as calibrated
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from mam_envs.robots import RobotSpec
from mam_envs.scene.layout import Layout
from mam_pipeline import folders
from mam_pipeline.claims import SETUP, claim_folder
from mam_pipeline.types import FloatArray
from mam_policies.algorithms import algorithm
from mam_policies.lerobot.export import deployment
from mam_policies.lerobot.joint_mapping import (
    SO_ARMS,
    UNITS,
    JointMapping,
    MotorMap,
    identity,
    load_mapping,
)
from mam_policies.lerobot.policy import Converter, Deployment
from mam_policies.run import EnvChoice, RunInfo
from mam_sim_arm.camera import CameraModel, look_at, pinhole
from mam_sim_arm.perception import Perceiver
from mam_sim_arm.safety import Box
from mam_sim_arm.targets import (
    board_for,
    load_markers,
    save_markers,
    suggest_markers,
)

ROBOT, NOMINAL, CAMERA = "robot.yaml", "nominal_camera.yaml", "camera.yaml"
MARKERS, MAPPING = "markers.yaml", "joint_mapping.yaml"
HEAD = """\
# A robot of LeRobot: its type, and the fields of that type. This one is simulated; a real one:
#   type: so101_follower
#   port: /dev/ttyACM0
#   id: my_arm
#   cameras: {front: {type: opencv, index_or_path: 0, width: 1280, height: 720, fps: 30}}
# Errors that the simulated one can have: calibration_error (rad), camera_error (m), joint_noise
# (rad), latency_steps.
"""


@dataclass(frozen=True)
class Twin:
    """What a run says of its robot and object, without a simulator running.

    Attributes:
        info: of the run. choice: its environment with one asset. layout: of that.
        plan: what turns motor values into the policy's inputs, by the mapping given.
    """

    run: Path
    info: RunInfo
    choice: EnvChoice
    layout: Layout
    plan: Deployment

    @staticmethod
    def load(run: Path) -> Twin:
        """Read a run and build its environment once; motors count as simulated joints.

        Raises:
            InputError, ConfigError: no run, or a policy that cannot be exported.
        """
        from mam_policies.lerobot.robot_interface import mapping_of

        info = RunInfo.load(run)
        choice = replace(info.env, assets=info.env.assets[:1])
        env = choice.make()
        try:
            base = env.unwrapped
            plan = deployment(base, info, mapping_of(base, None))
            return Twin(run, info, choice, base.layout(0), plan)
        finally:
            env.close()

    def with_mapping(self, mapping: JointMapping) -> Twin:
        """With motor values counted by another mapping."""
        scale, offset = mapping.arrays(self.plan.joints)
        return replace(self, plan=replace(self.plan, scale=scale.tolist(), offset=offset.tolist()))

    @property
    def spec(self) -> RobotSpec:
        return self.layout.robot

    @property
    def base_asset(self) -> FloatArray:
        """(4, 4) base_T_asset where the object is meant to stand."""
        return np.asarray(np.linalg.inv(self.layout.placement.base) @ self.layout.world_asset)

    def converter(self) -> Converter:
        """The policy on motor values.

        Raises:
            ConfigError: the run's algorithm acts by more than one small network.
        """
        return Converter(self.plan, algorithm(self.info.algo).network(self.run))

    def perceiver(self, setup: Path, camera: CameraModel) -> Perceiver:
        """What finds the run's handle in the pictures of a camera."""
        model, goal = self.layout.model, self.layout.goals[0]
        markers = load_markers(setup / MARKERS, model)
        level = float(self.base_asset[2, 3])
        return Perceiver(camera, markers, model, goal.joint, self.layout.handles[0], level)

    def obstacle(self, base_asset: FloatArray | None = None) -> Box:
        """The object with its parts closed; where it is meant to stand, or at a pose (4, 4)."""
        model = self.layout.model
        bounds = np.asarray(model.bounds({g.joint: g.closed for g in self.layout.goals}))
        return Box(bounds, self.base_asset if base_asset is None else base_asset)

    def extent(self) -> FloatArray:
        """(2, 3) base frame: what the object takes, its part open too."""
        model, rows = self.layout.model, []
        for goal in self.layout.goals:
            rows += [model.bounds({goal.joint: v}) for v in (goal.closed, goal.open)]
        boxes = np.concatenate(rows)
        low, high = boxes.min(axis=0), boxes.max(axis=0)
        corners = np.array(np.meshgrid(*zip(low, high))).reshape(3, -1).T
        pose = self.base_asset
        at = corners @ pose[:3, :3].T + pose[:3, 3]
        return np.stack([at.min(axis=0), at.max(axis=0)])


def guess_mapping(spec: RobotSpec, file: Path | None, kind: str) -> JointMapping:
    """The mapping to begin with: a file's; as simulated; or SO arms' units, mid ranges for zeros.

    Args:
        kind: of LeRobot's robot.
    """
    if file is not None:
        return load_mapping(file, [*spec.arm, spec.gripper[0]])
    movable = [j for j in spec.model.joints if j.type != "fixed"]
    if kind == "mam_sim" or spec.uid not in SO_ARMS:
        units = {j.name: "metres" if j.type == "prismatic" else "radians" for j in movable}
        return identity(spec.uid, units)
    motors = []
    for joint in movable:
        middle = 0.5 * (joint.lower + joint.upper)
        if joint.name in spec.gripper:
            scale = (joint.upper - joint.lower) / 100.0
            motors.append(MotorMap(joint.name, joint.name, "percent", scale, joint.lower))
        else:
            motors.append(MotorMap(joint.name, joint.name, "degrees", UNITS["degrees"], middle))
    return JointMapping(kind, tuple(motors))


def write_setup(twin: Twin, out: Path, size: tuple[int, int] = (1280, 720)) -> list[Path]:
    """Write what is to be printed and filled in before a calibration; what is there stays.

    Raises:
        ConfigError: `out` is a file.
    """
    claim_folder(out, SETUP, flag="--setup")
    out.mkdir(parents=True, exist_ok=True)
    out = out.resolve()
    goal, choice = twin.layout.goals[0], twin.choice
    markers = suggest_markers(twin.layout.model, goal.joint, twin.layout.handles[0])
    made = []
    robot: dict[str, Any] = {
        "type": "mam_sim", "asset": choice.assets[0], "joint": goal.joint, "robot": choice.robot,
        "max_steps": choice.max_steps + 60, "perceived": False, "camera": str(out / NOMINAL),
        "markers": str(out / MARKERS), "log": str(out / "episodes.jsonl"), "seed": 0,
        "calibration_error": 0.0, "camera_error": 0.0, "joint_noise": 0.0, "latency_steps": 0,
    }  # fmt: skip
    tags = {f"tag_{m.id}.png": np.pad(m.picture(400), 100, constant_values=255) for m in markers}
    pictures = {"board.png": board_for(twin.spec.reach).picture(), **tags}
    writes: dict[str, Callable[[Path], Any]] = {
        ROBOT: lambda f: folders.write_text(f, HEAD + yaml.safe_dump(robot, sort_keys=False)),
        NOMINAL: lambda f: nominal_camera(twin, size).save(f),
        MARKERS: lambda f: save_markers(markers, f),
    }
    for name, picture in pictures.items():
        writes[name] = partial(_picture, picture)
    for name, write in writes.items():
        if not (out / name).exists():
            write(out / name)
            made.append(out / name)
    return made


def nominal_camera(twin: Twin, size: tuple[int, int]) -> CameraModel:
    """Beside the arm, on the side where it does not hide the object, looking down at the handle and
    at the hand's way."""
    base, handle = twin.layout.placement.base, twin.layout.handles[0]
    pose = twin.base_asset
    point = pose[:3, :3] @ handle + pose[:3, 3]
    low, high = twin.extent()
    _, _, side = twin.layout.view()
    front = base[:3, :3].T @ np.array([1.0, 0.0, 0.0])  # the object's front looks towards -x
    left = base[:3, :3].T @ np.array([0.0, 1.0, 0.0])
    arm = twin.spec.reach  # from far away, the small board of a small arm is too few pixels
    reach = float(np.clip(np.linalg.norm(high - low), 1.3 * arm, 2.0 * arm))
    top = np.array([0.0, 0.0, max(high[2], point[2]) + 0.7 * reach])
    middle = 0.5 * (point + 0.5 * (low + high))
    eye = middle * [1, 1, 0] - 0.5 * reach * front + 0.65 * side * reach * left + top
    return pinhole("front", size, 42.0, look_at(eye, middle))


def _picture(picture: np.ndarray, file: Path) -> None:
    ok, data = cv2.imencode(".png", picture)
    assert ok
    with folders.new_file(file) as part:
        part.write_bytes(data.tobytes())
