"""Settings of an environment: success, reward, randomisation and scene, with their defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mam_pipeline import config_file


@dataclass(frozen=True)
class SuccessConfig:
    """What is asked of the joint, and when it counts as done.

    Attributes:
        fraction: share of the way from closed to open that `open` and `push` ask for; `close`
            asks for at least 0.9 of its way back.
        widest: a hinge counts as open at this angle even if its range goes further, radians.
        start: share of the way open at which `close` starts.
        value: joint value that `turn_to` asks for, radians or metres; None = 45 degrees further
            for spins and half the range for others.
        tolerance: of turn_to; None = a tenth of the turn, at least 0.05 rad or 2 mm.
        still_speed: greatest joint speed at success, m/s (slides) and rad/s (others).
        driven: least share of the joint's motion that must have happened while the robot touched
            the moving part or just after: what springs open by itself is no success.
        touch_force: newtons between robot and part above which they touch.
        grace_steps: control steps (20 a second) after a touch for which motion counts as the
            robot's.
        max_steps: control steps of one episode (used by the verbs; gym.make takes its own).
    """

    fraction: float = 0.75
    widest: float = np.pi / 2
    start: float = 0.6
    value: float | None = None
    tolerance: float | None = None
    still_speed: tuple[float, float] = (0.1, 0.5)
    driven: float = 0.5
    touch_force: float = 0.1
    grace_steps: int = 5
    max_steps: int = 200


@dataclass(frozen=True)
class RewardConfig:
    """Scales of the dense reward's terms; a task may add terms in a subclass.

    Attributes:
        reach: 1 at the handle, falling with the tool's distance d in metres, 1 - tanh(5 d); stays 1
            once the joint has moved by contact, so that letting go costs nothing.
        contact: 1 while the robot touches the moving part.
        progress: share of the way from start to goal, 0..1 (negative when moved away).
        success: 1 at success.
        untouched_motion: share of the range that moved without contact in this step.
        action_rate: mean squared change of the action since the last step.
    """

    reach: float = 1.0
    contact: float = 0.5
    progress: float = 3.0
    success: float = 2.0
    untouched_motion: float = -1.0
    action_rate: float = -0.01


@dataclass(frozen=True)
class RandomisationConfig:
    """What changes from episode to episode; pairs are (low, high) factors or values.

    Attributes:
        position: object shift in the plane, metres, each way.
        yaw: object turn about its vertical middle axis, degrees, each way.
        robot_qpos: noise of the arm's start, radians (standard deviation).
        friction, damping: factors on the joint's values.
        mass: factor on the mass of the moving links.
        start: initial share of the way open; None = closed (0), or the task's own start.
        light: factor on the lights' brightness, at every reconfiguration.
        camera: shift of every camera, metres (standard deviation), at every reconfiguration.
        colour: share of random tint of the object, 0..1, at every reconfiguration.
    """

    position: float = 0.02
    yaw: float = 10.0
    robot_qpos: float = 0.01
    friction: tuple[float, float] = (1.0, 1.0)
    damping: tuple[float, float] = (1.0, 1.0)
    mass: tuple[float, float] = (1.0, 1.0)
    start: tuple[float, float] | None = None
    light: tuple[float, float] = (1.0, 1.0)
    camera: float = 0.0
    colour: float = 0.0


@dataclass(frozen=True)
class CameraSpec:
    """A camera: where it stands and looks. When `relative`, in multiples of the diagonal of object
    and robot base, from their middle, y towards the side where the arm does not hide the object;
    else in metres in the world. fov in degrees."""

    eye: tuple[float, float, float] = (-0.8, 0.85, 0.6)
    target: tuple[float, float, float] = (-0.02, 0.0, 0.02)
    width: int = 128
    height: int = 128
    fov: float = 55.0
    relative: bool = True


@dataclass(frozen=True)
class SceneConfig:
    """The world round the object.

    Attributes:
        surface: table | floor | auto (table for objects lower than 0.6 m).
        table_height: of the table above the ground, metres.
        wall: whether a wall stands behind the object.
        background: picture file shown to cameras where neither robot nor object is seen.
        cameras: observation cameras by name; render: the camera of videos.
    """

    surface: Literal["auto", "table", "floor"] = "auto"
    table_height: float = 0.75
    wall: bool = True
    background: str | None = None
    cameras: Mapping[str, CameraSpec] = field(default_factory=lambda: {"front": CameraSpec()})
    render: CameraSpec = field(default_factory=lambda: CameraSpec(width=512, height=512))


@dataclass(frozen=True)
class EnvConfig:
    """All settings of an environment; complete with its defaults.

    Attributes:
        success: what is asked, and when it counts as done.
        reward: scales of the dense reward's terms.
        randomisation: what changes from episode to episode.
        scene: floor, walls and cameras.
    """

    success: SuccessConfig = field(default_factory=SuccessConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    randomisation: RandomisationConfig = field(default_factory=RandomisationConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)

    @staticmethod
    def make(
        value: EnvConfig | Mapping[str, Any] | str | Path | None, base: EnvConfig | None = None
    ) -> EnvConfig:
        """From nothing, a mapping, or a YAML file.

        A file holds these settings themselves, or has them in a section `env` as the files for
        `mam-sim --config` do.

        Args:
            base: what is left out comes from here; a task's `defaults()`, which may extend
                success and reward by fields of its own.

        Raises:
            ConfigError: unknown key (the nearest is named) or a value of the wrong type.
        """
        start = base or EnvConfig()
        if value is None:
            return start
        source = ""
        if isinstance(value, EnvConfig):  # its parts may lack the fields that the task adds
            value = {
                name: part if isinstance(part, type(getattr(start, name))) else vars(part)
                for name, part in vars(value).items()
            }
        if isinstance(value, str | Path):
            source, value = str(value), config_file.read(value)
        inside = value.get("env", value) if isinstance(value, Mapping) else value
        return config_file.fill(start, inside, source)

    def plain(self) -> dict[str, Any]:
        """As nested plain values, to be saved beside a result."""
        return asdict(self)
