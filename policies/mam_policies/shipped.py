"""Policies that come with mam-sim: run folders in the package, made by `mam_training.policies`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from mam_pipeline.errors import ConfigError, NotPhysicalError
from mam_pipeline.weights import MANIFEST

if TYPE_CHECKING:
    from mam_policies.run import EnvChoice

SHIPPED = Path(__file__).parent / "weights"
"""Run folders that come with mam-sim."""


def run_folder(policy: Path) -> Path:
    """A policy's folder: as it is named, or of the name of one that comes with mam-sim."""
    shipped = SHIPPED / policy
    known = len(policy.parts) == 1 and (shipped / "run.json").is_file()
    return shipped if known and not policy.exists() else policy


def joint_for(policy: Path, choice: EnvChoice) -> str:
    """The joint of an asset that such a policy is for: of its kind of part, the likeliest one that
    the arm can operate.

    Args:
        policy: the run folder. choice: the environment; its first asset counts.

    Raises:
        ConfigError: the asset has no such part. NotPhysicalError: the arm can operate none.
    """
    from mam_envs.robots import robot_spec
    from mam_envs.scene.layout import arrange, likely
    from mam_pipeline.asset.card import Asset

    kind = json.loads((policy / MANIFEST).read_text(encoding="utf-8"))["config"]["kind"]
    asset = Asset.load(choice.assets[0])
    links = {part.link for part in asset.card.parts if part.kind == kind}
    child = {joint.name: joint.child for joint in asset.card.joints}
    names = [n for n in likely(asset, len(child)) if child[n] in links]
    if not names:
        raise ConfigError(f"{asset.card.name} has no {kind} that moves, which {policy.name} is for")
    first: NotPhysicalError | None = None
    for name in names:
        try:
            arrange(asset, name, choice.task, robot_spec(choice.robot), "auto", choice.config)
            return name
        except NotPhysicalError as error:
            first = first or error
    assert first is not None
    raise first
