"""What an environment is told: the task on a joint, and the settings of scene and chance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mam_pipeline import config_file
from mam_pipeline.errors import InputError, NotPhysicalError, unknown_name

if TYPE_CHECKING:
    from mam_envs.object_model import ObjectModel

TaskName = Literal["open", "close", "turn_to", "push"]
TASKS: tuple[TaskName, ...] = ("open", "close", "turn_to", "push")


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
            the moving part (or at most 0.25 s after): what springs open by itself is no success.
        max_steps: control steps of one episode (used by the verbs; gym.make takes its own).
    """

    fraction: float = 0.75
    widest: float = np.pi / 2
    start: float = 0.6
    value: float | None = None
    tolerance: float | None = None
    still_speed: tuple[float, float] = (0.1, 0.5)
    driven: float = 0.5
    max_steps: int = 200


@dataclass(frozen=True)
class RewardConfig:
    """Scales of the dense reward's terms (mam_envs.tasks.rewards says what each measures)."""

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
        wall: whether a wall stands behind the object.
        background: picture file shown to cameras where neither robot nor object is seen.
        cameras: observation cameras by name; render: the camera of videos.
    """

    surface: Literal["auto", "table", "floor"] = "auto"
    wall: bool = True
    background: str | None = None
    cameras: Mapping[str, CameraSpec] = field(default_factory=lambda: {"front": CameraSpec()})
    render: CameraSpec = field(default_factory=lambda: CameraSpec(width=512, height=512))


@dataclass(frozen=True)
class EnvConfig:
    """All settings of an OperateJoint environment; complete with its defaults."""

    success: SuccessConfig = field(default_factory=SuccessConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    randomisation: RandomisationConfig = field(default_factory=RandomisationConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)

    @staticmethod
    def make(value: EnvConfig | Mapping[str, Any] | str | Path | None) -> EnvConfig:
        """From nothing, a mapping, or a YAML file.

        A file holds these settings themselves, or has them in a section `env` as the files for
        `mam-sim --config` do.

        Raises:
            ConfigError: unknown key (the nearest is named) or a value of the wrong type.
        """
        if value is None:
            return EnvConfig()
        if isinstance(value, EnvConfig):
            return value
        source = ""
        if isinstance(value, str | Path):
            source, value = str(value), config_file.read(value)
        inside = value.get("env", value) if isinstance(value, Mapping) else value
        return config_file.fill(EnvConfig(), inside, source)

    def plain(self) -> dict[str, Any]:
        """As nested plain values, to be saved beside a result."""
        return asdict(self)


@dataclass(frozen=True)
class JointGoal:
    """One joint to be moved, in the model's units (radians or metres, after scaling).

    Attributes:
        q_start: where the episode starts (before randomisation); q_goal: where success begins.
        tolerance: 0 for "at least this far", else how near to q_goal is near enough.
        closed, open: the joint's range in the sense of the task (a wide hinge is cut).
        still_speed: greatest speed at success.
    """

    joint: str
    task: TaskName
    subtype: str
    q_start: float
    q_goal: float
    tolerance: float
    closed: float
    open: float
    lower: float
    upper: float
    still_speed: float

    @property
    def range(self) -> float:
        return abs(self.open - self.closed)

    @property
    def direction(self) -> float:
        return float(np.sign(self.q_goal - self.q_start))


def default_task(model: ObjectModel, joint: str) -> TaskName:
    """The task that a joint suggests: push for buttons, turn_to for spins, else open."""
    card = model.card_joint(joint)
    kinds = {g.kind for g in model.asset.card.grasps if g.joint == joint}
    closed, open_ = model.span(card)
    if card.subtype == "slide" and kinds == {"push"} and abs(open_ - closed) < 0.05:
        return "push"
    return "turn_to" if card.subtype == "spin" else "open"


def joint_goal(
    model: ObjectModel, joint: str | None, task: str | None, config: SuccessConfig
) -> JointGoal:
    """Resolve joint and task names into numbers.

    Raises:
        ConfigError: unknown joint or task.
        NotPhysicalError: the joint has no range to move through.
    """
    name = joint or model.default_joint()
    card = model.card_joint(name)
    if task is not None and task not in TASKS:
        raise unknown_name("task", task, TASKS)
    kind: TaskName = task or default_task(model, name)  # type: ignore[assignment]
    closed, open_ = model.span(card)
    lower, upper = model.limits(card)
    slide = card.subtype == "slide" or card.type == "prismatic"
    span = open_ - closed
    if not slide and abs(span) > config.widest:
        span = float(np.sign(span)) * config.widest
    if abs(span) < (2e-4 if slide else 5e-3):
        raise NotPhysicalError(f"joint {name!r} of {model.asset.card.name} has no range to move in")
    tolerance = 0.0
    start, goal = closed, closed + config.fraction * span
    if kind == "close":
        start = closed + config.start * span
        goal = start + max(config.fraction, 0.9) * (closed - start)
    elif kind == "turn_to":
        start = float(np.clip(0.0, min(lower, upper), max(lower, upper)))
        step = np.pi / 4 if card.subtype == "spin" and not slide else 0.5 * span
        goal = start + step if config.value is None else config.value * model.unit(card)
        goal = float(np.clip(goal, lower, upper))
        if abs(goal - start) < 1e-6:
            raise InputError(f"joint {name!r} is already at the asked value {goal:.3g}")
        least = 0.002 if slide else 0.05
        tolerance = config.tolerance or max(least, 0.1 * abs(goal - start))
    return JointGoal(
        joint=name,
        task=kind,
        subtype=card.subtype,
        q_start=float(start),
        q_goal=float(goal),
        tolerance=float(tolerance),
        closed=float(closed),
        open=float(closed + span),
        lower=float(lower),
        upper=float(upper),
        still_speed=config.still_speed[0 if slide else 1],
    )
