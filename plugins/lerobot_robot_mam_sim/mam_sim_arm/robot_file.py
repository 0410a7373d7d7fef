"""A robot of LeRobot from a YAML file: its `type`, and the fields of that type's configuration.

type: so101_follower
port: /dev/ttyACM0
cameras: {front: {type: opencv, index_or_path: 0, width: 1280, height: 720, fps: 30}}
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mam_pipeline.edited import read_yaml
from mam_pipeline.errors import ConfigError
from mam_pipeline.optional import require


def open_robot(file: Path, **changes: Any) -> Any:
    """LeRobot's robot, not yet connected; `changes` go over the file's fields.

    Raises:
        ConfigError: no such file, no such type, or a field that the type does not have.
    """
    require("a robot of LeRobot", "lerobot")
    import draccus
    from lerobot.robots import RobotConfig, make_robot_from_config
    from lerobot.utils.import_utils import register_third_party_plugins

    if not file.is_file():
        raise ConfigError(f"no robot file {file}; mam-sim calibrate --init makes one")
    data = read_yaml(file).values
    if not isinstance(data, dict) or "type" not in data:
        raise ConfigError(f"{file} does not say the robot's type (so101_follower, mam_sim ...)")
    register_third_party_plugins()
    _driver(str(data["type"]))
    try:
        config = draccus.decode(RobotConfig, {**data, **changes})
    except Exception as error:  # draccus raises kinds of its own
        raise ConfigError(f"{file}: {str(error).splitlines()[0]}") from None
    try:
        return make_robot_from_config(config)
    except ImportError as error:
        raise ConfigError(
            f"LeRobot's driver of {data['type']} needs {error.name}, which is not installed; for "
            "SO arms: pip install 'lerobot[feetech]'"
        ) from None


def robot_type(file: Path) -> str:
    """The type that a robot file names."""
    data = read_yaml(file).values if file.is_file() else None
    return str(data.get("type", "")) if isinstance(data, dict) else ""


def _driver(name: str) -> None:
    """Import LeRobot's own drivers, which register their configurations as they are imported."""
    import importlib
    import pkgutil

    from lerobot import robots

    known = {m.name for m in pkgutil.iter_modules(robots.__path__)}
    for module in {name, name.replace("so100", "so").replace("so101", "so")} & known:
        importlib.import_module(f"lerobot.robots.{module}")
