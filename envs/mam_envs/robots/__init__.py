"""Robot arms: one file each; `ROBOTS` names them, and other packages add theirs by an entry point.

A robot is a `RobotSpec` (docs/extend/robot.md).
"""

from __future__ import annotations

from mam_envs.robots.base import Drive, RobotSpec
from mam_pipeline.errors import ConfigError
from mam_pipeline.registry import Registry

__all__ = ["ROBOTS", "Drive", "RobotSpec", "robot_spec"]

ROBOTS = Registry(
    "robot",
    {
        "panda": "mam_envs.robots.panda:PANDA",
        "panda_wristcam": "mam_envs.robots.panda:WRISTCAM",
        "so100": "mam_envs.robots.so100:SO100",
        "so101": "mam_envs.robots.so101:SO101",
        "fetch": "mam_envs.robots.fetch:FETCH",
        "xarm6_robotiq": "mam_envs.robots.xarm6_robotiq:XARM6",
        "xarm6": "mam_envs.robots.xarm6_robotiq:XARM6",
    },
)


def robot_spec(name: str) -> RobotSpec:
    """The robot of a name in `ROBOTS`; importing a third party's registers its ManiSkill agent.

    Raises:
        ConfigError: no such robot, its files are not installed, or its specification is wrong.
        BackendError: its module cannot be imported.
    """
    spec = ROBOTS.load(name)
    if not isinstance(spec, RobotSpec):
        raise ConfigError(f"robot {name!r} is registered as {ROBOTS.targets()[name]}, no RobotSpec")
    spec.check()
    return spec
