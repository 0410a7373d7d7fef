"""How a simulated joint's value and a real motor's value belong together, as an editable file.

A real arm's zero, sign and unit come from its own calibration, so they cannot be known here: for
such arms a template is written and its gaps are to be filled in by measuring.

    sim [rad or m] = sign * real [in radians or metres] + offset        degrees, radians, metres
    sim [rad or m] = closed + real / 100 * (open - closed)              percent (grippers)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from mam_pipeline import folders
from mam_pipeline.edited import read_yaml
from mam_pipeline.errors import ConfigError, HintNeeded, unknown_name

UNITS = {"degrees": np.pi / 180.0, "radians": 1.0, "metres": 1.0}
NUMBERS = ("sign", "offset", "closed", "open")
SO_ARMS = {"so100": "so101_follower", "so101": "so101_follower"}
"""Simulated robots with a driver in LeRobot, and its type (so100_follower has the same motors)."""

HEADER = """\
# Joint mapping between the simulated {robot} and the real one.
#   sim = sign * real + offset            (real in radians; offset in radians)
#   sim = closed + real / 100 * (open - closed)   (gripper; closed and open in radians)
# LeRobot's degrees are centred on the middle of the range that your calibration recorded, so no
# number below can be known without your arm. How to find them: bring each motor to the pose that
# the simulated robot has at a known angle (`mam-sim export` draws it), and read the motor.
#   sign: 1 or -1, whether both count up in the same direction
#   offset: sim angle at real 0;  closed, open: sim angle of the jaw at 0 and at 100
"""


@dataclass(frozen=True)
class MotorMap:
    """One motor: its name on the real arm, the simulated joint, and sim = scale * real + offset."""

    motor: str
    joint: str
    unit: str
    scale: float
    offset: float


@dataclass(frozen=True)
class JointMapping:
    """All motors of a robot, in the order of its state vector.

    Attributes:
        robot: LeRobot's robot type, or the simulated robot's name where it has none.
    """

    robot: str
    motors: tuple[MotorMap, ...]

    def names(self, joints: Sequence[str]) -> list[str]:
        """LeRobot's keys of simulated joints: <motor>.pos."""
        return [f"{self._of(j).motor}.pos" for j in joints]

    def arrays(self, joints: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(scale, offset), (n,) each, with sim = scale * real + offset, for simulated joints."""
        rows = [self._of(j) for j in joints]
        return np.array([r.scale for r in rows]), np.array([r.offset for r in rows])

    def to_sim(self, joints: Sequence[str], real: NDArray[Any]) -> NDArray[np.float64]:
        """Real motor values (..., n) as simulated joint values, radians or metres."""
        scale, offset = self.arrays(joints)
        return np.asarray(real, dtype=float) * scale + offset

    def to_real(self, joints: Sequence[str], sim: NDArray[Any]) -> NDArray[np.float64]:
        """Simulated joint values (..., n) in the real arm's units."""
        scale, offset = self.arrays(joints)
        return (np.asarray(sim, dtype=float) - offset) / scale

    def _of(self, joint: str) -> MotorMap:
        for row in self.motors:
            if row.joint == joint:
                return row
        raise unknown_name("joint in the mapping", joint, [r.joint for r in self.motors])

    def plain(self) -> dict[str, Any]:
        """As the content of a mapping file."""
        joints: dict[str, Any] = {}
        for m in self.motors:
            row: dict[str, Any] = {"sim": m.joint, "unit": m.unit}
            if m.unit == "percent":
                row |= {"closed": m.offset, "open": m.offset + 100.0 * m.scale}
            else:
                row |= {"sign": int(np.sign(m.scale)), "offset": m.offset}
            joints[m.motor] = row
        return {"robot": self.robot, "joints": joints}

    def save(self, file: Path, spread: Mapping[str, float] | None = None) -> None:
        """Write the mapping as YAML that `load_mapping` reads; `spread`: standard errors of
        offsets, radians, by simulated joint, as remarks."""
        head = "# Joint mapping: sim = sign * real + offset; percent: closed at 0, open at 100.\n"
        for name, value in (spread or {}).items():
            head += f"# {name}: offset known to +- {value:.4f} rad\n"
        folders.write_text(file, head + yaml.safe_dump(self.plain(), sort_keys=False))


def identity(robot: str, joints: Mapping[str, str]) -> JointMapping:
    """Real values equal simulated ones; `joints`: name to "radians" or "metres"."""
    return JointMapping(robot, tuple(MotorMap(j, j, unit, 1.0, 0.0) for j, unit in joints.items()))


def template(robot: str, arm: Sequence[str], gripper: str) -> str:
    """A mapping file for a real SO arm whose numbers are all still to be filled in."""
    joints: dict[str, Any] = {
        j: {"sim": j, "unit": "degrees", "sign": None, "offset": None} for j in arm
    }
    joints[gripper] = {"sim": gripper, "unit": "percent", "closed": None, "open": None}
    body = yaml.safe_dump({"robot": SO_ARMS.get(robot, robot), "joints": joints}, sort_keys=False)
    return HEADER.format(robot=robot) + body


def load_mapping(file: str | Path, joints: Sequence[str]) -> JointMapping:
    """Read a mapping file and check that it covers the simulated `joints`.

    Raises:
        ConfigError: missing file, unknown unit or key, a sign that is neither 1 nor -1, a joint
            that is not covered, a gripper without range.
        HintNeeded: numbers are still empty; they are named.
    """
    path = Path(file)
    if not path.is_file():
        raise ConfigError(f"no joint mapping {path}")
    try:
        data = read_yaml(path).values
        listed = {motor: dict(row) for motor, row in data["joints"].items()}
        robot = str(data["robot"])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path} is no joint mapping (robot, joints): {error}") from None
    empty = [
        f"{motor}.{key}"
        for motor, row in listed.items()
        for key in NUMBERS
        if key in row and row[key] is None
    ]
    if empty:
        raise HintNeeded(f"{path} still needs {', '.join(empty)}; measure them on your arm")
    motors = tuple(_motor(path, str(motor), row) for motor, row in listed.items())
    missing = [j for j in joints if j not in {m.joint for m in motors}]
    if missing:
        raise ConfigError(f"{path} does not say which motor is {', '.join(missing)}")
    return JointMapping(robot, motors)


def _motor(path: Path, motor: str, row: Any) -> MotorMap:
    try:
        unit, joint = str(row["unit"]), str(row.get("sim", motor))
        if unit == "percent":
            closed, opened = float(row["closed"]), float(row["open"])
            if not abs(opened - closed) >= 1e-6 or not np.isfinite(opened - closed):
                raise ConfigError(f"{path}: {motor} is closed and open at the same value")
            return MotorMap(motor, joint, unit, (opened - closed) / 100.0, closed)
        if unit not in UNITS:
            raise unknown_name("unit of a motor", unit, [*UNITS, "percent"])
        sign, offset = float(row["sign"]), float(row["offset"])
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {motor} has no usable {error}") from None
    if not np.isfinite(offset):
        raise ConfigError(f"{path}: the offset of {motor} must be a finite number, not {offset}")
    if sign not in (1.0, -1.0):
        raise ConfigError(f"{path}: the sign of {motor} is 1 or -1, not {sign:g}")
    return MotorMap(motor, joint, unit, sign * UNITS[unit], offset)
