"""Tasks: what is asked of the robot, when it is done, and what is rewarded.

`TASKS` names them; other packages add theirs by an entry point (docs/extend/task.md).
"""

from __future__ import annotations

from collections.abc import Sequence

from mam_envs.robots import robot_spec
from mam_envs.tasks.base import JointGoal, OtherTaskError, Task, TaskState
from mam_pipeline.errors import ConfigError
from mam_pipeline.registry import Registry

__all__ = [
    "TASKS", "JointGoal", "OtherTaskError", "Task", "TaskState", "episode_steps", "several",
    "task_class",
]  # fmt: skip

OPERATE_JOINT = "mam_envs.tasks.operate_joint:OperateJoint"
TASKS = Registry(
    "task",
    {
        **dict.fromkeys(("open", "close", "turn_to", "push"), OPERATE_JOINT),
        "press": "mam_envs.tasks.press_button:PressButton",
        "take_out": "mam_envs.tasks.carry:TakeOut",
        "put_in": "mam_envs.tasks.carry:PutIn",
    },
)


def several(names: str | Sequence[str] | None) -> tuple[str | None, ...]:
    """One name or several as a tuple; None stays one name that is left open."""
    return (names,) if names is None or isinstance(names, str) else tuple(names)


def episode_steps(
    task: str | Sequence[str] | None, joint: str | Sequence[str] | None = None,
    robot: str = "panda",
) -> int:  # fmt: skip
    """Control steps of an episode unless told otherwise: the task's, for each joint in sequence,
    and those of the way to the object of a robot that drives.

    Raises:
        ConfigError, BackendError: as `task_class`, or no such robot.
    """
    tasks, joints, drive = several(task), several(joint), robot_spec(robot).drive
    way = 0 if drive is None else drive.steps
    return way + task_class(tasks).steps * max(len(tasks), len(joints))


def task_class(names: Sequence[str | None]) -> type[Task]:
    """The class behind the task names of a sequence; None is OperateJoint's own choice.

    Raises:
        ConfigError: an unknown name, or names of different classes.
        BackendError: a third party's task that cannot be imported.
    """
    found = {TASKS.load(name or "open") for name in names}
    if len(found) > 1:
        told = ", ".join(str(name) for name in names)
        raise ConfigError(f"the tasks {told} cannot follow each other in one sequence")
    cls = found.pop()
    if not (isinstance(cls, type) and issubclass(cls, Task)):
        raise ConfigError(f"task {names[0]!r} is registered as {cls!r}, which is no Task")
    return cls
