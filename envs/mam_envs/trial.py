"""Try an asset's environment: the surest joint that an arm can operate, a reset and some steps."""

from __future__ import annotations

from typing import Any

import numpy as np

import mam_envs
from mam_envs.config import EnvConfig
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import MamSimError


def try_environment(
    asset: Asset, robot: str = "panda", config: EnvConfig | None = None, steps: int = 20
) -> dict[str, Any]:
    """Make the environment on the surest joint that the arm can operate; reset and step it.

    Args:
        asset: its joints are tried in the order of their confidence.
        robot: name of the arm.
        config: settings of the environment.
        steps: control steps with random actions.

    Returns:
        `ok`, `joint`, `robot` and `steps`; or, where no joint is within the arm's means, `ok`
        False with `why` and all `refusals`.
    """
    refusals = []
    for joint in sorted(asset.card.joints, key=lambda j: -j.confidence):
        try:
            env = mam_envs.make(
                str(asset.folder), joint=joint.name, robot_uids=robot, config=config
            )
        except MamSimError as error:
            refusals.append(f"{joint.name}: {error}")
            continue
        try:
            if _stable(env, steps):
                return {"ok": True, "joint": joint.name, "robot": robot, "steps": steps}
            refusals.append(f"{joint.name}: the simulation is unstable")
        finally:
            env.close()
    why = refusals[0] if refusals else "the asset has no joints"
    return {"ok": False, "joint": None, "robot": robot, "why": why, "refusals": refusals}


def _stable(env: Any, steps: int) -> bool:
    """Whether all rewards of an episode with random actions are finite."""
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(steps):
        _, reward, *_ = env.step(env.action_space.sample())
        if not np.isfinite(np.asarray(reward, dtype=float)).all():
            return False
    return True
