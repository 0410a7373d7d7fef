"""`mam-sim collect`: the scripted expert's demonstrations on an asset, h5 and LeRobot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional

from mam_envs.config import EnvConfig
from mam_policies.collection import CollectConfig
from mam_policies.run import task_settings
from mam_sim.console import PhaseBar, Screen
from mam_sim.options import Verb, carried, defaults, differing, last_value


@dataclass(frozen=True, kw_only=True)
class Collect(Verb):
    """Let the expert operate a joint until enough episodes succeed.

    The same command goes on where a killed one was; with more --episodes it adds to the data.
    """

    asset: Positional[Path]
    """Asset folder (from mam-sim make-env or articulate)."""
    out: Path
    """Folder for demos.h5, demos.json, lerobot/ and attempts/."""
    collect: Annotated[CollectConfig, OmitArgPrefixes] = field(default_factory=CollectConfig)
    randomise: Path | None = None
    """YAML file with the randomisation, or the name of a preset that has one (randomised); the
    flags --env.randomisation... go over it."""
    env: EnvConfig = field(default_factory=EnvConfig)
    json: bool = False
    """Print the result as JSON."""

    @classmethod
    def start(cls, args: Sequence[str], values: Mapping[str, Any]) -> Verb:
        """Defaults with the settings of the task that flags or the file name."""
        section = values.get("collect")
        named = section.get("task") if isinstance(section, Mapping) else None
        return replace(defaults(cls), env=task_settings(last_value(args, "--task") or named))

    def run(self) -> int:
        """Collect; print how many attempts it took and where the data is."""
        from mam_envs.robots import ROBOTS
        from mam_pipeline.asset.card import Asset

        ROBOTS.check(self.collect.robot)
        draft = Asset.load(self.asset).card.draft  # what is wrong is said before all else
        from mam_policies.collect import collect

        screen = Screen(quiet=self.quiet or self.json)
        if draft:
            screen.say(draft)
        with PhaseBar(screen) as update:

            def show(got: int, wanted: int, words: str) -> None:
                update("episodes", got / wanted, f"{got} of {wanted}, {words}")

            update("episodes", 0.0, "starting the environment")
            result = collect(self.asset, self.collect, self.out.absolute(), show, self.env)
        if self.json:
            screen.json(asdict(result))
            return 0
        screen.say(f"episodes: {result.episodes} of {result.attempts} attempts")
        for reason, count in sorted(result.reasons.items(), key=lambda r: -r[1]):
            screen.say(f"  failed {count}x: {reason}")
        screen.say(f"h5:       {result.h5}")
        screen.say(f"lerobot:  {result.dataset}")
        screen.next(*self._training())
        return 0

    def _training(self) -> list[str]:
        """The verb and words that train on what was collected."""
        chosen = ("joint", "task", "robot", "max_steps")
        task = [] if self.collect.task is None else ["--task", self.collect.task]
        return [
            "train", str(self.asset), "--algo", "bc", "--out", f"{self.out.name}-run",
            *differing(self.collect, CollectConfig(), only=chosen), *carried(self, task),
        ]  # fmt: skip
