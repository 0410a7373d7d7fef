"""`mam-sim deploy`: a policy on a calibrated arm, inside limits."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import OmitArgPrefixes, Positional

from mam_pipeline.claims import PICTURE, claim_file
from mam_pipeline.edited import Range
from mam_pipeline.errors import NotPhysicalError
from mam_sim.asking import ask
from mam_sim.console import Screen
from mam_sim.options import Verb
from mam_sim_arm.safety import SafetyConfig

if TYPE_CHECKING:
    from mam_sim_arm.rollout import Pilot


@dataclass(frozen=True, kw_only=True)
class Deploy(Verb):
    """Rehearse the policy in the twin from where arm and object are, then run it on the arm.

    Workspace, speed and pressing are limited. A real arm moves only while a key is held down;
    letting it go, or Ctrl-C, stops the arm where it is, and it holds with torque on. Then r brings
    it to rest, and t switches torque off.
    """

    run_folder: Positional[Path]
    """A run of mam-sim train --deployable."""
    setup: Path
    """Folder that mam-sim calibrate has filled."""
    robot: Path | None = None
    """Robot of LeRobot (YAML); default: robot.yaml of the set-up."""
    nominal: bool = False
    """Take the camera and the mapping as they are meant, not as calibrated."""
    dry_run: bool = False
    """Look, rehearse in the twin, and stop; nothing is sent to the arm."""
    episodes: Annotated[int, Range(1, 1000)] = 1
    """How many; the object is put back between them."""
    steps: Annotated[int, Range(1, 100_000)] = 200
    """Control steps of one, 20 a second."""
    hold_key: Literal["real", "always", "never"] = "real"
    """Whether the arm moves only while a key is held down: a real one, always, or never."""
    safety: Annotated[SafetyConfig, OmitArgPrefixes] = field(default_factory=SafetyConfig)
    yes: bool = False
    """Do not ask before the arm moves, nor for the object to be put back."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Rehearse, run, and say how far the joint went."""
        from mam_sim_arm.held_key import NoKey, key_for
        from mam_sim_arm.pilot import open_pilot, plan_space
        from mam_sim_arm.robot_file import robot_type
        from mam_sim_arm.rollout import rehearse
        from mam_sim_arm.safety import StoppedForSafety
        from mam_sim_arm.setup import ROBOT, Twin

        strip = self.setup / "rehearsal.png"
        claim_file(strip, PICTURE, flag="")
        kind = robot_type(self.robot or self.setup / ROBOT)
        key = NoKey() if self.dry_run else key_for(self.hold_key, kind)
        screen = Screen(self.quiet or self.json)
        attempts: list[Any] = []
        with open_pilot(
            self.run_folder, self.setup, self.robot, self.safety, self.nominal, key, screen.say
        ) as pilot:
            seen = pilot.find()
            plan, way = rehearse(self.run_folder, seen, pilot.arm.now()[:-1], strip)
            low, high = plan["hand"]
            ends = "succeeds" if plan["success"] else "fails"
            screen.say(f"in the twin: {ends} after {plan['steps']} steps")
            screen.say(f"its hand:    from {low} to {high} m in the robot's base frame")
            screen.say(f"pictures:    {strip}")
            if not plan["success"]:
                raise NotPhysicalError(
                    f"the policy fails in the twin from here: it opens {plan['open_fraction']:.2f} "
                    "of the way. Nothing was moved. Is the object where the policy knows it?"
                )
            twin = Twin.load(self.run_folder)
            for k in range(0 if self.dry_run else self.episodes):
                if k and not self._put_back(pilot):
                    break
                seen = pilot.find() if k else seen
                plan_space(pilot, twin, seen, way)
                ask("The policy is going to move the arm.", self.yes)
                with pilot.arm.moving():
                    a = pilot.run(seen, self.steps)
                attempts.append(a)
                screen.say(
                    f"episode {k}: {'success' if a.success else 'no success'}, opened "
                    f"{'at least ' if a.unseen else ''}{100 * a.opened:.0f} % of the way in "
                    f"{a.steps} steps; speed cut in {a.cut}"
                )
                if a.stopped:
                    break
        if self.json:
            screen.json({"rehearsal": plan, "episodes": [asdict(a) for a in attempts]})
        if attempts and attempts[-1].stopped:
            raise StoppedForSafety(attempts[-1].stopped)
        return 0

    def _put_back(self, pilot: Pilot) -> bool:
        """Let somebody put arm and object back; whether the arm is still there."""
        if pilot.arm.key.person and not pilot.arm.attend("go on"):
            return False
        ask(
            "Put the object back." if pilot.arm.key.person else "Put arm and object back.", self.yes
        )
        pilot.arm.begin()
        return True
