"""Try an asset's environment: which joints an arm can operate, and some steps on one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import mam_envs
from mam_envs.config import EnvConfig
from mam_envs.grasping.candidates import PlacementError
from mam_envs.robots import robot_spec
from mam_envs.scene.layout import arrange
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import MamSimError


@dataclass(frozen=True)
class Reach:
    """Whether an arm can operate a joint.

    Attributes:
        cause: why not, in a word (mam_envs.grasping.candidates.Cause; "asset" where the asset
            itself is at fault). why: in a sentence.
    """

    joint: str
    ok: bool
    cause: str = ""
    why: str = ""


def reachable(asset: Asset, robot: str = "panda", config: EnvConfig | None = None) -> list[Reach]:
    """Look for a place of the arm for every movable joint, the surest first.

    Args:
        robot: name of the arm. config: settings of the environment.
    """
    spec, settings, out = robot_spec(robot), config or EnvConfig(), []
    movable = asset.card.movable
    for joint in sorted(movable, key=lambda j: -j.confidence):
        try:
            arrange(asset, joint.name, None, spec, "auto", settings)
        except MamSimError as error:
            cause = error.cause if isinstance(error, PlacementError) else "asset"
            why = str(error).removeprefix(f"{asset.card.name}: ")
            out.append(Reach(joint.name, False, cause, why))
        else:
            out.append(Reach(joint.name, True))
    return out


def try_environment(
    asset: Asset, robot: str = "panda", config: EnvConfig | None = None, steps: int = 20
) -> dict[str, Any]:
    """Look at every joint, and reset and step the environment of the surest that works.

    Args:
        asset: its joints are tried in the order of their confidence.
        robot: name of the arm.
        config: settings of the environment.
        steps: control steps with random actions.

    Returns:
        `ok`, `robot`, `joints` (a row of `Reach` for each), and `joint` and `steps`; or, where no
        joint is within the arm's means, `ok` False with `why`.
    """
    found = reachable(asset, robot, config)
    for i, row in enumerate(found):
        if not row.ok:
            continue
        env = mam_envs.make(str(asset.folder), joint=row.joint, robot_uids=robot, config=config)
        try:
            if _stable(env, steps):
                return {"ok": True, "joint": row.joint, "steps": steps, **_plain(robot, found)}
        finally:
            env.close()
        found[i] = Reach(row.joint, False, "asset", "the simulation is unstable")
    why = f"{found[0].joint}: {found[0].why}" if found else "the asset has no joints"
    return {"ok": False, "joint": None, "why": why, **_plain(robot, found)}


def _plain(robot: str, found: Sequence[Reach]) -> dict[str, Any]:
    return {"robot": robot, "joints": [asdict(row) for row in found]}


def _stable(env: Any, steps: int) -> bool:
    """Whether all rewards of an episode with random actions are finite."""
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(steps):
        _, reward, *_ = env.step(env.action_space.sample())
        if not np.isfinite(np.asarray(reward, dtype=float)).all():
            return False
    return True
