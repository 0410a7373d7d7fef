"""`mam-sim perceive`: where object and handle are, by tags in the camera's picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tyro.conf import Positional

from mam_sim.console import Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Perceive(Verb):
    """Look at the object once: its pose, its joint's value, its handle, and a picture of that.

    Nothing is sent to the arm.
    """

    run_folder: Positional[Path]
    """A run of mam-sim train: it names the object."""
    setup: Path
    """Folder that mam-sim calibrate has filled."""
    robot: Path | None = None
    """Robot of LeRobot (YAML); default: robot.yaml of the set-up."""
    nominal: bool = False
    """Take the camera and the mapping as they are meant, not as calibrated."""
    out: Path | None = None
    """The picture with what is believed drawn in; default: perceived.png of the set-up."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Look; print what is believed."""
        from PIL import Image

        from mam_pipeline import folders
        from mam_pipeline.claims import PICTURE, claim_file, png_mark
        from mam_sim_arm.pilot import open_pilot

        screen = Screen(self.quiet or self.json)
        out = self.out or self.setup / "perceived.png"
        claim_file(out, PICTURE)
        with open_pilot(self.run_folder, self.setup, self.robot, nominal=self.nominal) as pilot:
            try:
                seen = pilot.find()
            finally:  # what was not found is best seen in the picture
                picture = pilot.perceiver.overlay(pilot.picture())
                with folders.new_file(out) as part:
                    Image.fromarray(picture).save(part, format="PNG", pnginfo=png_mark())
        assert seen.handle is not None
        pose = seen.object_pose
        yaw = float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0])))
        if self.json:
            screen.json(
                {"handle": seen.handle.tolist(), "value": seen.value, "tags": sorted(seen.tags),
                 "object": {"position": pose[:3, 3].tolist(), "yaw_degrees": yaw},
                 "source": seen.source, "picture": out}
            )  # fmt: skip
        screen.say(f"object:  {_metres(pose[:3, 3])} m in the robot's base frame, yaw {yaw:.1f}°")
        screen.say(f"handle:  {_metres(seen.handle)} m")
        screen.say(f"joint:   {seen.value:.3f} (by {seen.source})")
        screen.say(f"picture: {out}")
        screen.say(f"next:    mam-sim deploy {self.run_folder} --setup {self.setup} --dry-run")
        return 0


def _metres(point: np.ndarray) -> str:
    return ", ".join(f"{v:.3f}" for v in point)
