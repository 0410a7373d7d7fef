"""`mam-sim make-env`: a photo, mesh or URDF to an asset and a robot environment on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional

from mam_envs import ENV_ID
from mam_envs.config import EnvConfig
from mam_pipeline.errors import HintNeeded
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models.settings import given
from mam_sim.asking import ask_upload, with_model
from mam_sim.console import Screen
from mam_sim.options import Verb, carried
from mam_sim.verbs.articulate import (
    cost_told,
    describe,
    made_with_model,
    tell_cost,
    tell_draft,
    tell_still,
)


@dataclass(frozen=True, kw_only=True)
class MakeEnv(Verb):
    """Turn a photo, a static mesh or a URDF into an environment in which a robot arm acts.

    Exit status 1 when the asset, which is kept, fails its check, or when the arm can operate none
    of its joints.
    """

    source: Positional[Path]
    """The photo (jpg, png ...), mesh (glb, obj, stl, dae, usd, step ...) or URDF."""
    out: Path | None = None
    """The asset folder to write; default: <name>-asset here."""
    robot: str = "panda"
    """The arm of the environment that is tried."""
    pipeline: Annotated[MakeConfig, OmitArgPrefixes] = field(default_factory=MakeConfig)
    env: EnvConfig = field(default_factory=EnvConfig)
    asset_ok: bool = False
    """Be content with an asset that passes its check, whether or not the arm can operate it."""
    json: bool = False
    """Print the asset card as JSON."""

    def run(self) -> int:
        """Write the asset, try its environment, draw the report; print what was found."""
        from mam_envs.robots import ROBOTS

        ROBOTS.check(self.robot)
        screen = Screen(self.quiet or self.json)
        out = self.out if self.out is not None else Path(f"{self.source.stem}-asset")
        with given(self.pipeline.models.settings()):
            ask_upload(self.source, self.pipeline.reconstructor)
            config = with_model(self.source, self.pipeline)
        stages = ["read", "segment", "prior", "reason", "joints", "asset", "check"]
        with screen.stages([*stages, "environment", "report"]) as bar:
            with given(self.pipeline.models.settings()), cost_told(screen) as ledger:
                asset = made_with_model(self.source, out, self.pipeline, config, bar)
            bar("environment")
            from mam_envs.trial import try_environment

            tried = try_environment(asset, self.robot, self.env)
            asset = asset.noted(environment=tried)
            bar("report")
            from mam_sim.report import write_report

            write_report(asset)
        if self.json:
            screen.json(asdict(asset.card))
        describe(screen, asset)
        tell_cost(screen, ledger)
        screen.say(f"report: {asset.folder / 'report.html'}")
        if tell_draft(asset, self.pipeline.photo.accept_low_confidence):
            return HintNeeded.exit_code
        if tell_still(asset, self.source, out, carried(self, sections=("pipeline",))):
            return 1
        _tell_reach(screen, tried)
        if tried["ok"]:
            screen.say(
                f'env:    gymnasium.make("{ENV_ID}", asset="{out}", joint="{tried["joint"]}", '
                f'robot_uids="{self.robot}")'
            )
            words = ["collect", str(out), "--joint", str(tried["joint"]), "--episodes", "20"]
            words += ["--out", f"{out.name}-demos"]
            words += ["--robot", self.robot] if self.robot != MakeEnv.robot else []
            screen.next(*words, *carried(self))
        else:
            screen.say(f"env:    none: {tried['why']}")
            screen.next("view", str(out))
        done = asset.card.checks["executability"]["passed"] and (tried["ok"] or self.asset_ok)
        return 0 if done else 1


def _tell_reach(screen: Screen, tried: Mapping[str, Any]) -> None:
    """A line per joint: whether the arm can operate it, and why not."""
    for i, row in enumerate(tried["joints"]):
        said = "can operate it" if row["ok"] else f"cannot ({row['cause']}): {row['why']}"
        head = "" if i else f"{tried['robot']}:"
        screen.say(f"{head:<7} {row['joint']:<24} {said}")
