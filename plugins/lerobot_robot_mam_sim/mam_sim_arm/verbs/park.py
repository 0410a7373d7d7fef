"""`mam-sim park`: an arm that holds somewhere comes to rest, or is let go."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional

from mam_sim.asking import ask
from mam_sim.console import Screen
from mam_sim.options import Verb
from mam_sim_arm.safety import SafetyConfig


@dataclass(frozen=True, kw_only=True)
class Park(Verb):
    """Bring an arm from where it holds to its pose of rest, slowly, or switch its torque off.

    It lets go of what it holds, backs off, and goes to rest while r is held down; t switches torque
    off. Without a key it goes to rest and holds.
    """

    run_folder: Positional[Path]
    """A run of mam-sim train: it names the arm."""
    setup: Path
    """Folder that mam-sim calibrate has filled."""
    robot: Path | None = None
    """Robot of LeRobot (YAML); default: robot.yaml of the set-up."""
    nominal: bool = False
    """Take the mapping as it is meant, not as calibrated."""
    hold_key: Literal["real", "always", "never"] = "real"
    """Whether the arm moves only while a key is held down: a real one, always, or never."""
    safety: Annotated[SafetyConfig, OmitArgPrefixes] = field(default_factory=SafetyConfig)
    yes: bool = False
    """Do not ask before the arm moves."""

    def run(self) -> int:
        """Park the arm."""
        from mam_sim_arm.guarded_arm import connected
        from mam_sim_arm.held_key import key_for
        from mam_sim_arm.robot_file import open_robot, robot_type
        from mam_sim_arm.setup import MAPPING, ROBOT, Twin, guess_mapping

        screen, file = Screen(self.quiet), self.robot or self.setup / ROBOT
        kind, spec = robot_type(file), Twin.load(self.run_folder).spec
        key = key_for(self.hold_key, kind)
        mapping = guess_mapping(spec, None if self.nominal else self.setup / MAPPING, kind)
        with connected(open_robot(file), spec, mapping, self.safety, key, screen.say) as arm:
            ask("The arm is going to rest. Is its space free?", self.yes)
            arm.engage()
            if not key.person:
                arm.rest()
        return 0
