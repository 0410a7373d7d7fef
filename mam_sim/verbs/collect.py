"""`mam-sim collect`: the scripted expert's demonstrations on an asset, h5 and LeRobot."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import tyro

from mam_sim.console import Screen


def collect(
    asset: Annotated[Path, tyro.conf.Positional],
    /,
    out: Path,
    episodes: int = 20,
    joint: str | None = None,
    task: Literal["open", "close", "turn_to", "push"] | None = None,
    robot: str = "panda",
    seed: int = 0,
    noise: float = 0.0,
    video: bool = False,
    keep_failures: bool = False,
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Let the expert operate a joint until enough episodes succeed; run again to resume or extend.

    Args:
        asset: asset folder (from mam-sim make-env or articulate).
        out: folder for demos.h5, demos.json, lerobot/ and attempts/.
        episodes: successes wanted.
        joint: joint to operate; by default the surest one that the arm can do.
        task: what to do with it; by default what the joint suggests.
        robot: panda, so100, fetch, xarm6_robotiq.
        seed: of the first attempt; the others follow.
        noise: on the arm's targets, radians (labels stay clean).
        video: record camera pictures into the LeRobot dataset (needs a Vulkan driver).
        keep_failures: keep failed attempts in the data as well.
        quiet: only errors.
        json: print the result as JSON.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from mam_policies.collect import CollectConfig
    from mam_policies.collect import collect as run

    config = CollectConfig(
        asset=str(asset.resolve()), episodes=episodes, joint=joint, task=task, robot=robot,
        seed=seed, noise=noise, video=video, keep_failures=keep_failures,
    )  # fmt: skip
    screen = Screen(quiet=quiet or json)
    columns = (BarColumn(24), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(
        *columns, TextColumn("{task.description}"), console=screen.err, disable=quiet
    ) as bar:
        line = bar.add_task("starting the environment", total=episodes)

        def show(got: int, wanted: int, text: str) -> None:
            bar.update(line, completed=got, total=wanted, description=text)

        result = run(config, out.resolve(), show)
    if json:
        screen.json(asdict(result))
        return 0
    screen.say(f"episodes: {result.episodes} of {result.attempts} attempts")
    for reason, count in sorted(result.reasons.items(), key=lambda r: -r[1]):
        screen.say(f"  failed {count}x: {reason}")
    screen.say(f"h5:       {result.h5}")
    screen.say(f"lerobot:  {result.dataset}")
    screen.say(f"next:     mam-sim train {out} --algo bc --out {out.name}-run")
    return 0
