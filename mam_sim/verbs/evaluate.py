"""`mam-sim eval`: task success of a policy at unseen seeds, on its own or on held-out assets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional

from mam_envs.config import EnvConfig
from mam_pipeline import folders
from mam_pipeline.claims import EVALUATION, FILM, claim_file
from mam_pipeline.edited import Range
from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.folders import Scratch
from mam_pipeline.formats.door import Door
from mam_sim.console import PhaseBar, Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Evaluate(Verb):
    """Measure how often a policy, or the scripted expert, succeeds, with Wilson 95 % intervals."""

    policy: Positional[Path | None] = None
    """A run folder of mam-sim train; with --asset also generalist-drawer or generalist-door, which
    come with mam-sim, a policy folder of LeRobot, or a zip of stable-baselines3 (--trust); without
    one, --expert and --asset measure the expert alone."""
    episodes: Annotated[int, Range(1, 100_000)] = 20
    """How many, per asset."""
    asset: tuple[Path, ...] = ()
    """Other asset folders to try it on, or folders that hold some; default: its own. What cannot
    be tried is a row that says why."""
    held_out: bool = False
    """Try it on the assets that mam-sim train --split held out."""
    joint: str | None = None
    """The joint on them."""
    task: str | None = None
    """What to do with it, where no run says so: open, close, turn_to, push, press,
    take_out, put_in, or a plug-in's task."""
    expert: bool = False
    """Run the scripted expert on the same seeds beside it."""
    truth: Path | None = None
    """URDF of the true object, standing as `rank --truth` wants it; it is
    simulated in the asset's place."""
    video: bool = False
    """Write a grid of episodes as evaluation.mp4 in the run folder (needs a Vulkan driver)."""
    trust: bool = False
    """Let a zip of stable-baselines3 be loaded; doing so executes what is in it."""
    control: str = "pd_joint_delta_pos"
    """Control mode that such a zip was trained with."""
    robot: str = "panda"
    """Robot that such a zip or folder was trained with, or that the expert alone drives."""
    mapping: Path | None = None
    """Joint mapping that such a folder was trained with (YAML); default: the one in it."""
    randomise: Path | None = None
    """YAML file with the randomisation, or the name of a preset that has one (randomised); the
    flags --env.randomisation... go over it."""
    env: EnvConfig = field(default_factory=EnvConfig)
    out: Path | None = None
    """JSON file for the result."""
    json: bool = False
    """Print the result as JSON instead of the table."""

    def __post_init__(self) -> None:
        from mam_policies.shipped import run_folder

        if self.policy is not None:
            object.__setattr__(self, "policy", run_folder(self.policy))

    @property
    def shipped(self) -> bool:
        """Whether the policy came with mam-sim."""
        from mam_policies.shipped import SHIPPED

        return self.policy is not None and self.policy.parent == SHIPPED

    @property
    def foreign(self) -> bool:
        """Whether the policy is no run: a zip of stable-baselines3, or a folder of LeRobot."""
        return self.zipped or self.of_lerobot

    @property
    def zipped(self) -> bool:
        """Whether the policy is a zip of stable-baselines3."""
        return self.policy is not None and self.policy.suffix == ".zip"

    @property
    def of_lerobot(self) -> bool:
        """Whether the policy is a folder as LeRobot loads by --policy.path."""
        if self.policy is None or (self.policy / "run.json").is_file():
            return False
        return (self.policy / "config.json").is_file()

    def home(self) -> Evaluate:
        """A run is tested in the environment that it was trained in, unless told otherwise."""
        from mam_policies.run import RunInfo

        if self.policy is None or self.foreign:
            return self
        return replace(self, env=RunInfo.load(self.policy).env.config)

    def run(self) -> int:
        """Evaluate on every asset, a line for each."""
        from mam_policies.shipped import joint_for

        claim_file(self.out, EVALUATION)
        if self.video:
            claim_file(self._film(), FILM, flag="")
        screen = Screen(self.quiet or self.json)
        home, named = self._choice()
        if self.truth is not None and len(named) != 1:
            raise ConfigError(f"--truth is of one asset; {len(named)} are to be tried")
        if self.mapping is not None and not self.of_lerobot:
            raise ConfigError("--mapping belongs to a policy folder of LeRobot")
        if self.task is not None and self.policy is not None and not self.foreign:
            raise ConfigError(
                f"--task: {self.policy} is a run, which says itself what is to be done"
            )
        screen.say(f"{'asset':<28} {'joint':<22} {'check':<7} {'expert':<20} policy")
        rows: list[dict[str, Any]] = []
        errors: list[MamSimError] = []
        for folder in named:
            choice = replace(home, assets=(folder,), joint=self.joint or home.joint)
            try:
                if self.policy is not None and self.shipped and self.joint is None:
                    choice = replace(choice, joint=joint_for(self.policy, choice))
                rows.append(self._row(choice, screen, film=self.video and not rows))
            except MamSimError as error:
                errors.append(error)
                rows.append({"asset": Path(folder).name, "refused": str(error)})
                if len(named) > 1:
                    screen.say(f"{Path(folder).name:<28} refused: {error}")
        if len(errors) == len(named):
            raise errors[0]
        total = _total(rows)
        run = (
            None if self.policy is None else self.policy.name if self.shipped else str(self.policy)
        )
        result = {"run": run, "results": rows, "total": total}
        if len(rows) > 1:
            screen.say(f"{'total':<28} {total['line']}")
        if self.out is not None:
            folders.write_text(self.out, json.dumps(result, indent=1))
            screen.say(f"result: {self.out}")
        if self.json:
            screen.json(result)
        if self.video:
            screen.say(f"video: {self._film()}")
        if self.policy is None:
            screen.next("collect", named[0], "--out", f"{Path(named[0]).name}-demos")
        elif not self.foreign and not self.shipped:
            more = ("--to", "lerobot", "--out", f"{self.policy.name}-lerobot")
            screen.next("export", str(self.policy), *more)
        return 0

    def _choice(self) -> tuple[Any, tuple[str, ...]]:
        """The environment, and the assets to try."""
        from mam_pipeline.asset.listing import asset_folders
        from mam_pipeline.folder_data import policy_folder
        from mam_policies.run import EnvChoice, RunInfo, held_out

        named = tuple(map(str, asset_folders(self.asset)))
        if self.policy is None and not self.expert:
            raise ConfigError("name a run folder, or measure the expert alone with --expert")
        if self.policy is None or self.foreign:
            if not named:
                who = "a zip" if self.zipped else "a folder of LeRobot"
                who = "the expert" if self.policy is None else who
                raise ConfigError(f"{who} does not say what it is to be tried on; add --asset")
            if self.of_lerobot:  # what it wishes is looked at before any episode
                policy_folder(Path(str(self.policy)))
            control = self.control if self.zipped else "pd_joint_pos"
            asked = (self.joint, self.task, self.robot, control)
            return EnvChoice(named, *asked, config=self.env), named
        home = replace(RunInfo.load(self.policy).env, config=self.env)
        if (self.policy / "policy").is_dir():  # what it wishes is looked at before any episode
            policy_folder(self.policy / "policy")
        if self.shipped and not named:
            raise ConfigError(f"{self.policy.name} has no asset of its own; add --asset")
        if self.held_out:
            named += held_out(self.policy)
        return home, named or home.assets

    def _row(self, choice: Any, screen: Screen, film: bool) -> dict[str, Any]:
        """Evaluate on one asset and print its line."""
        from mam_pipeline.asset.card import Asset

        asset = Asset.load(choice.assets[0])
        scratch = nullcontext("") if self.truth is None else Scratch()
        with scratch as folder:
            found, best = self._measure(choice, screen, self._truth(asset, folder), film)
        verdict = asset.card.executable
        said = {True: "passes", False: "fails", None: "-"}[verdict]
        bar, line = best.line() if best else "-", found.line() if found else "-"
        shown = found or best
        screen.say(f"{shown.asset:<28} {shown.joint:<22} {said:<7} {bar:<20} {line}")
        for reason, count in shown.reasons.items():
            screen.say(f"    {count} x {reason}")
        from mam_policies.evaluate import plain

        rest = plain(shown)
        if found is None:
            rest = {"asset": shown.asset, "joint": shown.joint}
        return {"check": verdict, "expert": plain(best) if best else None, **rest}

    def _truth(self, asset: Any, folder: str) -> Path | None:
        if self.truth is None:
            return None
        from mam_pipeline.asset.foreign import true_asset

        return true_asset(self.truth, asset, Path(folder) / "truth").folder

    def _measure(self, choice: Any, screen: Screen, truth: Path | None, film: bool) -> Any:
        """The evaluations of the policy and of the expert; None for what is not asked for."""
        from mam_policies.evaluate import (
            evaluate_expert,
            evaluate_lerobot,
            evaluate_run,
            evaluate_zip,
        )

        found = best = None
        more: dict[str, Any] = {"truth": truth, "video": self._film() if film else None}
        with PhaseBar(screen) as update:

            def tell(n: int, s: int) -> None:
                update(Path(choice.assets[0]).name, n / self.episodes, f"{s} of {n}")

            if self.policy is None:
                return None, evaluate_expert(choice, self.episodes, on_episode=tell, **more)
            if self.of_lerobot:
                found = evaluate_lerobot(
                    self.policy, choice, self.episodes, self.mapping, on_episode=tell, **more
                )
            elif self.zipped:
                found = evaluate_zip(
                    self.policy, choice, self.episodes, self.trust, on_episode=tell, **more
                )
            else:
                found = evaluate_run(
                    self.policy, self.episodes, choice.assets, choice.joint, on_episode=tell,
                    env_config=self.env, **more,
                )  # fmt: skip
            if self.expert:
                # the true joint may have another name than the asset's
                joint = found.joint if truth is None else choice.joint
                acting = replace(choice, joint=joint, control_mode="pd_joint_pos")
                best = evaluate_expert(acting, self.episodes, truth=truth)
        return found, best

    def _film(self) -> Path:
        run = self.policy
        if run is None or self.shipped:
            return Path("evaluation.mp4")
        film = run.with_suffix(".mp4") if self.zipped else run / "evaluation.mp4"
        return Door(film.parent).may_write(film)


def _total(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Successes over all assets that could be tried, of the policy or else of the expert."""
    from mam_policies.wilson import wilson

    tried = [r if "successes" in r else r["expert"] for r in rows if "refused" not in r]
    good, count = (sum(r[key] for r in tried) for key in ("successes", "episodes"))
    low, high = wilson(good, count)
    refused = len(rows) - len(tried)
    line = f"{good}/{count} = {100 * good / count:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"
    return {
        "successes": good, "episodes": count, "low": low, "high": high, "assets": len(rows),
        "refused": refused, "line": line + (f"; {refused} refused" if refused else ""),
    }  # fmt: skip
