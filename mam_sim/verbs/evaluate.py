"""`mam-sim eval`: task success of a policy at unseen seeds, on its own or on held-out assets."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional

from mam_envs.config import EnvConfig
from mam_pipeline import folders
from mam_pipeline.edited import Range
from mam_pipeline.errors import ConfigError
from mam_sim.console import PhaseBar, Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Evaluate(Verb):
    """Measure how often a policy succeeds, with a Wilson 95 % interval."""

    policy: Positional[Path]
    """A run folder of mam-sim train, or a zip of stable-baselines3 (with --trust, --asset)."""
    episodes: Annotated[int, Range(1, 100_000)] = 20
    """How many, per asset."""
    asset: tuple[Path, ...] = ()
    """Other asset folders to try it on (held-out assets); default: its own."""
    joint: str | None = None
    """The joint on them."""
    expert: bool = False
    """Run the scripted expert on the same seeds beside it."""
    video: bool = False
    """Write a grid of episodes as evaluation.mp4 in the run folder (needs a Vulkan driver)."""
    trust: bool = False
    """Let a zip of stable-baselines3 be loaded; doing so executes what is in it."""
    control: str = "pd_joint_delta_pos"
    """Control mode that such a zip was trained with."""
    robot: str = "panda"
    """Robot that such a zip was trained with."""
    env: EnvConfig = field(default_factory=EnvConfig)
    json: Path | None = None
    """Write the result to this file."""

    def home(self) -> Evaluate:
        """A run is tested in the environment that it was trained in, unless told otherwise."""
        from mam_policies.run import RunInfo

        if self.policy.suffix == ".zip":
            return self
        return replace(self, env=RunInfo.load(self.policy).env.config)

    def run(self) -> int:
        """Evaluate on every asset, a line for each."""
        from mam_pipeline.asset.card import Asset
        from mam_policies.run import EnvChoice, RunInfo

        foreign = self.policy.suffix == ".zip"
        if foreign and not self.asset:
            raise ConfigError("a zip does not say what it was trained on; add --asset")
        screen = Screen(self.quiet)
        named = tuple(str(Asset.load(a).folder) for a in self.asset)
        if foreign:
            home = EnvChoice(named, self.joint, None, self.robot, self.control, config=self.env)
        else:
            home = replace(RunInfo.load(self.policy).env, config=self.env)
        screen.say(f"{'asset':<28} {'joint':<22} {'check':<7} {'expert':<20} policy")
        rows: list[dict[str, Any]] = []
        for folder in named or home.assets:
            choice = replace(home, assets=(folder,), joint=self.joint or home.joint)
            rows.append(self._row(choice, screen, film=self.video and not rows))
        if self.json is not None:
            text = json.dumps({"run": str(self.policy), "results": rows}, indent=1)
            folders.write_text(self.json, text)
            screen.say(f"json:  {self.json}")
        if self.video:
            screen.say(f"video: {_film(self.policy)}")
        return 0

    def _row(self, choice: Any, screen: Screen, film: bool) -> dict[str, Any]:
        """Evaluate on one asset and print its line."""
        from mam_pipeline.asset.card import Asset
        from mam_policies.evaluate import evaluate_expert, evaluate_run, evaluate_zip, plain

        folder = choice.assets[0]
        video = _film(self.policy) if film else None
        with PhaseBar(screen) as update:

            def tell(n: int, s: int) -> None:
                update(Path(folder).name, n / self.episodes, f"{s} of {n}")

            if self.policy.suffix == ".zip":
                found = evaluate_zip(
                    self.policy, choice, self.episodes, self.trust, video=video, on_episode=tell
                )
            else:
                found = evaluate_run(
                    self.policy, self.episodes, (folder,), choice.joint, video=video,
                    on_episode=tell, env_config=self.env,
                )  # fmt: skip
            best = None
            if self.expert:
                acting = replace(choice, joint=found.joint, control_mode="pd_joint_pos")
                best = evaluate_expert(acting, self.episodes)
        verdict = Asset.load(folder).card.executable
        said = {True: "passes", False: "fails", None: "-"}[verdict]
        bar = best.line() if best else "-"
        screen.say(f"{found.asset:<28} {found.joint:<22} {said:<7} {bar:<20} {found.line()}")
        for reason, count in found.reasons.items():
            screen.say(f"    {count} x {reason}")
        return {"check": verdict, "expert": plain(best) if best else None, **plain(found)}


def _film(run: Path) -> Path:
    return run.with_suffix(".mp4") if run.suffix == ".zip" else run / "evaluation.mp4"
