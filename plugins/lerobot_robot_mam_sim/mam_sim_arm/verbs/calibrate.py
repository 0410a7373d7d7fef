"""`mam-sim calibrate`: joint mapping and camera of a real arm, from a board in its hand."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from mam_pipeline.claims import SETUP, claim_folder
from mam_pipeline.edited import Range
from mam_sim.console import Screen
from mam_sim.options import Verb
from mam_sim_arm.safety import SafetyConfig


@dataclass(frozen=True, kw_only=True)
class Calibrate(Verb):
    """Find sign and zero of every motor, the gripper's range, and the camera's lens and place.

    The arm moves slowly through poses that show a ChArUco board in its hand to a fixed camera,
    inside the limits of `mam-sim deploy`. A real arm moves only while a key is held down; before
    all else it turns one joint after the other a little, and asks which way.
    """

    run_folder: Positional[Path]
    """A run of mam-sim train: it names the arm and the object."""
    setup: Path
    """Folder of this arm before this object; joint_mapping.yaml and camera.yaml go there."""
    init: bool = False
    """Write what is to be printed and filled in (board, tags, robot.yaml ...) and stop."""
    robot: Path | None = None
    """Robot of LeRobot (YAML: type and its fields); default: robot.yaml of the set-up."""
    mapping: Path | None = None
    """Joint mapping to begin with; signs and zeros in it may be wrong. Needed to move an arm whose
    motors count otherwise than the simulated joints."""
    poses: Annotated[int, Range(8, 100)] = 16
    """Poses of the arm."""
    share: Annotated[float, Range(0, 1, above=True)] = 0.5
    """Share of the arm's usual motion in a control step."""
    hold_key: Literal["real", "always", "never"] = "real"
    """Whether the arm moves only while a key is held down: a real one, always, or never."""
    safety: Annotated[SafetyConfig, OmitArgPrefixes] = field(default_factory=SafetyConfig)
    yes: bool = False
    """Do not ask before the arm moves."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Calibrate, or write the set-up; print residuals and what comes next."""
        from mam_sim_arm.setup import Twin, write_setup

        claim_folder(self.setup, SETUP, flag="--setup")
        screen = Screen(self.quiet or self.json)
        twin = Twin.load(self.run_folder)
        if self.init:
            made = write_setup(twin, self.setup)
            if self.json:
                screen.json({"setup": self.setup, "files": made})
            for file in made:
                screen.say(f"wrote:   {file}")
            words = f"{self.run_folder} --setup {self.setup}"
            screen.say("print board.png and the tags, stick the tags where markers.yaml says")
            screen.say(f"next:    mam-sim calibrate {words}")
            return 0
        return self._calibrate(twin, screen)

    def _calibrate(self, twin: Any, screen: Screen) -> int:
        from mam_sim.asking import ask
        from mam_sim_arm.camera import CameraModel
        from mam_sim_arm.held_key import key_for
        from mam_sim_arm.pilot import calibrate_setup
        from mam_sim_arm.robot_file import open_robot, robot_type
        from mam_sim_arm.setup import CAMERA, MAPPING, NOMINAL, ROBOT, guess_mapping

        spec, file = twin.spec, self.robot or self.setup / ROBOT
        kind = robot_type(file)
        simulated = {"board": True, "max_steps": 100_000} if kind == "mam_sim" else {}
        guess = guess_mapping(spec, self.mapping, kind)
        found = calibrate_setup(
            twin, self.setup, open_robot(file, **simulated), guess, self.poses, self.share,
            self.safety, key_for(self.hold_key, kind), lambda words: ask(words, self.yes),
            screen.say,
        )  # fmt: skip
        nominal = CameraModel.load(self.setup / NOMINAL)
        moved = float(np.linalg.norm(found.camera.pose[:3, 3] - nominal.pose[:3, 3]))
        change = found.offset - guess.arrays(spec.arm)[1]
        if self.json:
            screen.json(
                {"residual_px": found.camera.residual, "offset": dict(zip(spec.arm, found.offset)),
                 "spread": dict(zip(spec.arm, found.spread)), "camera_moved_m": moved}
            )  # fmt: skip
        for name, by, spread in zip(spec.arm, change, found.spread):
            screen.say(f"{name:<20} zero moved by {by:+.3f} rad (± {spread:.3f})")
        screen.say(f"camera moved by {100 * moved:.1f} cm; {found.camera.residual:.2f} pixels off")
        screen.say(f"mapping: {self.setup / MAPPING}")
        screen.say(f"camera:  {self.setup / CAMERA}")
        screen.say(f"next:    mam-sim perceive {self.run_folder} --setup {self.setup}")
        return 0
