"""`mam-sim eval`: task success of a policy at unseen seeds, on its own or on held-out assets."""

from __future__ import annotations

import json as _json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from mam_pipeline.errors import ConfigError
from mam_sim.console import Screen
from mam_sim.verbs.train import _bar


def evaluate(
    run: Annotated[Path, tyro.conf.Positional],
    /,
    episodes: int = 20,
    asset: tuple[Path, ...] = (),
    joint: str | None = None,
    expert: bool = False,
    video: bool = False,
    trust: bool = False,
    control: str = "pd_joint_delta_pos",
    robot: str = "panda",
    json: Path | None = None,
    quiet: bool = False,
) -> int:
    """Measure how often a policy succeeds, with a Wilson 95 % interval.

    Args:
        run: a run folder of mam-sim train, or a zip of stable-baselines3 (with --trust, --asset).
        episodes: how many, per asset.
        asset: other asset folders to try it on (held-out assets); default: its own.
        joint: the joint on them.
        expert: run the scripted expert on the same seeds beside it.
        video: write a grid of episodes as run/evaluation.mp4 (needs a Vulkan driver).
        trust: let a zip of stable-baselines3 be loaded; doing so executes what is in it.
        control: control mode that such a zip was trained with.
        robot: robot that such a zip was trained with.
        json: write the result here.
        quiet: print nothing but errors.
    """
    from mam_pipeline.asset.card import Asset
    from mam_policies.evaluate import evaluate_expert, evaluate_run, evaluate_zip, plain
    from mam_policies.run import EnvChoice, RunInfo

    if episodes < 1:
        raise ConfigError("--episodes must be at least 1")
    screen = Screen(quiet)
    foreign = run.suffix == ".zip"
    if foreign and not asset:
        raise ConfigError("a zip does not say what it was trained on; add --asset")
    named = tuple(str(Asset.load(a).folder) for a in asset)
    lived = EnvChoice(named, joint, None, robot, control) if foreign else RunInfo.load(run).env
    wanted = named or lived.assets
    rows: list[dict[str, Any]] = []
    screen.say(f"{'asset':<28} {'joint':<22} {'check':<7} {'expert':<20} policy")
    for folder in wanted:
        with _bar(screen) as update:

            def tell(n: int, s: int, update: Any = update) -> None:
                update(Path(folder).name, n / episodes, f"{s} of {n}")  # noqa: B023

            film = _film(run) if video and folder == wanted[0] else None
            choice = replace(lived, assets=(folder,), joint=joint or lived.joint)
            if foreign:
                found = evaluate_zip(run, choice, episodes, trust, video=film, on_episode=tell)
            else:
                found = evaluate_run(
                    run, episodes, (folder,), choice.joint, video=film, on_episode=tell
                )
            bar = None
            if expert:
                choice = replace(choice, joint=found.joint, control_mode="pd_joint_pos")
                bar = evaluate_expert(choice, episodes)
        verdict = Asset.load(folder).card.checks.get("executability", {}).get("passed")
        said = {True: "passes", False: "fails", None: "-"}[verdict]
        best = bar.line() if bar else "-"
        screen.say(f"{found.asset:<28} {found.joint:<22} {said:<7} {best:<20} {found.line()}")
        for reason, count in found.reasons.items():
            screen.say(f"    {count} x {reason}")
        rows.append({"check": verdict, "expert": plain(bar) if bar else None, **plain(found)})
    if json is not None:
        json.write_text(_json.dumps({"run": str(run), "results": rows}, indent=1))
        screen.say(f"json:  {json}")
    if video:
        screen.say(f"video: {_film(run)}")
    return 0


def _film(run: Path) -> Path:
    return run.with_suffix(".mp4") if run.suffix == ".zip" else run / "evaluation.mp4"
