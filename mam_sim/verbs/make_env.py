"""`mam-sim make-env`: a photo, mesh or URDF to an asset and a robot environment on it."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional

from mam_envs import ENV_ID
from mam_envs.config import EnvConfig
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.settings import given
from mam_pipeline.run import MakeConfig
from mam_sim.console import Screen
from mam_sim.options import Verb, carried
from mam_sim.verbs.articulate import describe, make, tell_cost


@dataclass(frozen=True, kw_only=True)
class MakeEnv(Verb):
    """Turn a photo, a static mesh or a URDF into an environment in which a robot arm acts.

    Exit status 1 when the asset was made but the arm can operate none of its joints.
    """

    source: Positional[Path]
    """The photo (jpg, png ...), mesh (glb, obj, stl, dae, usd, step ...) or URDF."""
    out: Path | None = None
    """The asset folder to write; default: <name>-asset here."""
    robot: str = "panda"
    """The arm of the environment that is tried."""
    pipeline: Annotated[MakeConfig, OmitArgPrefixes] = field(default_factory=MakeConfig)
    env: EnvConfig = field(default_factory=EnvConfig)
    json: bool = False
    """Print the asset card as JSON."""

    def run(self) -> int:
        """Write the asset, try its environment, draw the report; print what was found."""
        from mam_envs.robots import ROBOTS

        ROBOTS.check(self.robot)
        screen = Screen(self.quiet or self.json)
        out = self.out if self.out is not None else Path(f"{self.source.stem}-asset")
        stages = ["read", "segment", "prior", "reason", "joints", "asset", "check"]
        with screen.stages([*stages, "environment", "report"]) as bar:
            with given(self.pipeline.models.settings()), one_ledger() as ledger:
                asset = make(self.source, out, self.pipeline, bar)
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
        if tried["ok"]:
            screen.say(
                f'env:    gymnasium.make("{ENV_ID}", asset="{out}", joint="{tried["joint"]}", '
                f'robot_uids="{self.robot}")'
            )
            words = ["collect", str(out), "--episodes", "20", "--out", f"{out.name}-demos"]
            words += ["--robot", self.robot] if self.robot != MakeEnv.robot else []
            screen.say(f"next:   mam-sim {shlex.join([*words, *carried(self)])}")
            return 0
        screen.say(f"env:    none: {tried['why']}")
        screen.say(f"next:   mam-sim view {out}")
        return 1
