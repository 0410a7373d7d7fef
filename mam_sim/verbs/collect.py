"""`mam-sim collect`: the scripted expert's demonstrations on an asset, h5 and LeRobot."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from mam_sim.console import Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Collect(Verb):
    """Let the expert operate a joint until enough episodes succeed.

    The same command goes on where a killed one was; with more --episodes it adds to the data.
    """

    asset: Positional[Path]
    """Asset folder (from mam-sim make-env or articulate)."""
    out: Path
    """Folder for demos.h5, demos.json, lerobot/ and attempts/."""
    episodes: int = 20
    """Successes wanted."""
    joint: str | None = None
    """Joint to operate; by default the surest one that the arm can do."""
    task: str | None = None
    """open, close, turn_to, push or a plug-in's; by default what the joint suggests."""
    robot: str = "panda"
    """panda, so100, fetch, xarm6_robotiq or a plug-in's."""
    seed: int = 0
    """Seed of the first attempt; the others follow."""
    noise: float = 0.0
    """Noise on the arm's targets, radians (labels stay clean)."""
    video: bool = False
    """Record camera pictures into the LeRobot dataset (needs a Vulkan driver)."""
    keep_failures: bool = False
    """Keep failed attempts in the data as well."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Collect; print how many attempts it took and where the data is."""
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
        )

        from mam_policies.collect import CollectConfig, collect

        config = CollectConfig(
            asset=str(self.asset.resolve()), episodes=self.episodes, joint=self.joint,
            task=self.task, robot=self.robot, seed=self.seed, noise=self.noise, video=self.video,
            keep_failures=self.keep_failures,
        )  # fmt: skip
        screen = Screen(quiet=self.quiet or self.json)
        columns: Any = (BarColumn(24), MofNCompleteColumn(), TimeElapsedColumn())
        text = TextColumn("{task.description}")
        with Progress(*columns, text, console=screen.err, disable=self.quiet) as bar:
            line = bar.add_task("starting the environment", total=self.episodes)

            def show(got: int, wanted: int, words: str) -> None:
                bar.update(line, completed=got, total=wanted, description=words)

            result = collect(config, self.out.resolve(), show)
        if self.json:
            screen.json(asdict(result))
            return 0
        screen.say(f"episodes: {result.episodes} of {result.attempts} attempts")
        for reason, count in sorted(result.reasons.items(), key=lambda r: -r[1]):
            screen.say(f"  failed {count}x: {reason}")
        screen.say(f"h5:       {result.h5}")
        screen.say(f"lerobot:  {result.dataset}")
        screen.say(f"next:     mam-sim train {self.asset} --algo bc --out {self.out.name}-run")
        return 0
