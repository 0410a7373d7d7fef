"""Settings of an environment: success, reward, randomisation and scene, with their defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from mam_pipeline import config_file
from mam_pipeline.edited import (
    Finite,
    NotNegative,
    Positive,
    Range,
    Share,
    Vector,
    check_ranges,
)

Factor = Annotated[float, Range(0, 1000)]


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
        part_force: newtons with which the robot may pull or push the part, as the joints of its
            fingers feel them, mean over a control step; what two fingers squeeze between them
            cancels out. More is a failure for good; None = no limit.
        link_force: the same for each link of the robot against anything, by its contacts; friction
            is not in them (the simulator reports normal impulses).
        grace_steps: control steps (20 a second) after a touch for which motion counts as the
            robot's.
    """

    fraction: Annotated[float, Range(0, 1, above=True)] = 0.75
    widest: Annotated[float, Range(0, 100, above=True)] = np.pi / 2
    start: Share = 0.6
    value: Annotated[float, Range(-1000, 1000)] | None = None
    tolerance: Positive | None = None
    still_speed: tuple[Positive, Positive] = (0.1, 0.5)
    driven: Share = 0.5
    touch_force: NotNegative = 0.1
    part_force: Positive | None = 60.0
    link_force: Positive | None = 150.0
    grace_steps: Annotated[int, Range(0, 1000)] = 5


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

    reach: Finite = 1.0
    contact: Finite = 0.5
    progress: Finite = 3.0
    success: Finite = 2.0
    untouched_motion: Finite = -1.0
    action_rate: Finite = -0.01


@dataclass(frozen=True)
class RandomisationConfig:
    """What changes from episode to episode; pairs are (low, high) factors or values.

    Attributes:
        position: object shift in the plane, metres, each way.
        yaw: object turn about its vertical middle axis, degrees, each way.
        robot_qpos: noise of the arm's start, radians (standard deviation).
        away: metres from the handle at which a robot that drives begins; away_angle: degrees to
            either side of where it is to stand, seen from the handle; away_turn: degrees by which
            it does not face the handle, each way.
        friction, damping: factors on the joint's values.
        mass: factor on the mass of the moving links.
        spread: draw friction and mass from the ranges that the asset states, before the factors.
        start: initial share of the way open; None = closed (0), or the task's own start.
        light: factor on the lights' brightness; light_colour: share of it by which each of red,
            green and blue differs; light_turn: of their directions, degrees (standard deviation).
        camera, camera_turn: shift and turn of every camera, metres and degrees (standard
            deviations); fov: its field of view, degrees each way.
        colour, scenery: share of random tint, 0..1, of the object, and of floor, table and walls.
        backgrounds: chance that a random pattern hides all but robot and object from the cameras.
        noise, blur: of the pictures, at most (standard deviations, of 255 and in pixels).
    """

    position: Annotated[float, Range(0, 1)] = 0.02
    yaw: Annotated[float, Range(0, 180)] = 10.0
    robot_qpos: Annotated[float, Range(0, 1)] = 0.01
    away: tuple[Annotated[float, Range(0, 10)], Annotated[float, Range(0, 10)]] = (1.0, 1.5)
    away_angle: Annotated[float, Range(0, 90)] = 30.0
    away_turn: Annotated[float, Range(0, 180)] = 20.0
    friction: tuple[Factor, Factor] = (1.0, 1.0)
    damping: tuple[Factor, Factor] = (1.0, 1.0)
    mass: tuple[Factor, Factor] = (1.0, 1.0)
    spread: bool = False
    start: tuple[Share, Share] | None = None
    light: tuple[Factor, Factor] = (1.0, 1.0)
    light_colour: Share = 0.0
    light_turn: Annotated[float, Range(0, 90)] = 0.0
    camera: Annotated[float, Range(0, 1)] = 0.0
    camera_turn: Annotated[float, Range(0, 45)] = 0.0
    fov: Annotated[float, Range(0, 45)] = 0.0
    colour: Share = 0.0
    scenery: Share = 0.0
    backgrounds: Share = 0.0
    noise: Annotated[float, Range(0, 255)] = 0.0
    blur: Annotated[float, Range(0, 50)] = 0.0

    @property
    def seen(self) -> bool:
        """Whether anything changes that only cameras see."""
        amounts = (
            self.light_colour, self.light_turn, self.camera, self.camera_turn, self.fov,
            self.colour, self.scenery, self.backgrounds, self.noise, self.blur,
        )  # fmt: skip
        return self.light != (1.0, 1.0) or any(amounts)


@dataclass(frozen=True)
class CameraSpec:
    """A camera: where it stands and looks. When `relative`, in multiples of the diagonal of object
    and robot base, from their middle, y towards the side where the arm does not hide the object;
    else in metres in the world. fov in degrees."""

    eye: Vector = (-0.8, 0.85, 0.6)
    target: Vector = (-0.02, 0.0, 0.02)
    width: Annotated[int, Range(1, 8192)] = 128
    height: Annotated[int, Range(1, 8192)] = 128
    fov: Annotated[float, Range(1, 170)] = 55.0
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
    table_height: Annotated[float, Range(0, 10)] = 0.75
    wall: bool = True
    background: str | None = None
    cameras: Mapping[str, CameraSpec] = field(default_factory=lambda: {"front": CameraSpec()})
    render: CameraSpec = field(default_factory=lambda: CameraSpec(width=512, height=512))


@dataclass(frozen=True)
class ObservationConfig:
    """What the state observation holds besides the task's own.

    Attributes:
        articulation: joint and planned grasp as a policy over many objects needs them, in the
            robot's base frame (mam_envs.articulations).
    """

    articulation: bool = False


@dataclass(frozen=True)
class EnvConfig:
    """All settings of an environment; complete with its defaults.

    Attributes:
        success: what is asked, and when it counts as done.
        reward: scales of the dense reward's terms.
        randomisation: what changes from episode to episode.
        scene: floor, walls and cameras.
        observation: what the state holds.
    """

    success: SuccessConfig = field(default_factory=SuccessConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    randomisation: RandomisationConfig = field(default_factory=RandomisationConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)
    observation: ObservationConfig = field(default_factory=ObservationConfig)

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
        made = config_file.fill(start, inside, source)
        check_ranges(made)
        return made

    def plain(self) -> dict[str, Any]:
        """As nested plain values, to be saved beside a result."""
        return asdict(self)
