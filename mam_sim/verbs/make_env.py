"""`mam-sim make-env`: a photo, mesh or URDF to an asset and a robot environment on it."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from mam_pipeline.asset.card import Asset
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.settings import given
from mam_sim.console import Screen
from mam_sim.verbs.articulate import (
    EngineFlags,
    PhotoFlags,
    ScaleFlags,
    build,
    describe,
    make_config,
    tell_cost,
)
from mam_sim.verbs.flags import ModelFlags

ENV_ID = "mam_envs:OperateJoint-v1"


def make_env(
    source: Annotated[Path, tyro.conf.Positional],
    /,
    out: Path | None = None,
    hints: Path | None = None,
    interiors: bool = True,
    robot: str = "panda",
    engine: Annotated[EngineFlags, tyro.conf.OmitArgPrefixes] = EngineFlags(),  # noqa: B008
    size: Annotated[ScaleFlags, tyro.conf.OmitArgPrefixes] = ScaleFlags(),  # noqa: B008
    photo: Annotated[PhotoFlags, tyro.conf.OmitArgPrefixes] = PhotoFlags(),  # noqa: B008
    models: Annotated[ModelFlags, tyro.conf.OmitArgPrefixes] = ModelFlags(),  # noqa: B008
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Turn a photo, a static mesh or a URDF into an environment in which a robot arm acts.

    Args:
        source: the photo (jpg, png ...), mesh (glb, gltf, obj, ply, stl, dae) or URDF.
        out: the asset folder to write; default: <name>-asset here.
        hints: YAML file with what you know about the parts.
        interiors: give drawers boxes and cut meshes caps where the source has none.
        robot: the arm of the environment that is tried.
        engine: backends.
        size: scale and up axis.
        photo: help for a photo.
        models: models outside mam-sim.
        quiet: print nothing but errors.
        json: print the asset card as JSON.
    """
    screen = Screen(quiet or json)
    target = out if out is not None else Path(f"{source.stem}-asset")
    stages = ["read", "segment", "prior", "reason", "joints", "asset", "check"]
    with screen.stages([*stages, "environment", "report"]) as bar:
        config = make_config(hints, interiors, engine, size, photo)
        with given(models.settings()), one_ledger() as ledger:
            asset = build(source, target, config, bar)
        bar("environment")
        tried = try_environment(asset, robot)
        asset = _noted(asset, {"environment": tried})
        bar("report")
        from mam_sim.report import write_report

        write_report(asset)
    if json:
        screen.json(asdict(asset.card))
    describe(screen, asset)
    tell_cost(screen, ledger)
    screen.say(f"report: {asset.folder / 'report.html'}")
    if tried["ok"]:
        screen.say(
            f'env:    gymnasium.make("{ENV_ID}", asset="{target}", joint="{tried["joint"]}", '
            f'robot_uids="{robot}")'
        )
    else:
        screen.say(f"env:    {tried['why']}")
    screen.say(f"next:   mam-sim collect {target} --episodes 20 --out {target.name}-demos")
    return 0


def try_environment(asset: Asset, robot: str, steps: int = 20) -> dict[str, Any]:
    """Make the environment on the first joint that the arm can operate; reset and step it.

    Returns:
        ok, joint, steps, and `why` where no joint is within the arm's means.
    """
    import gymnasium
    import numpy as np

    import mam_envs  # noqa: F401 - registers the environments
    from mam_pipeline.errors import MamSimError

    refusals = []
    for joint in sorted(asset.card.joints, key=lambda j: -j.confidence):
        try:
            env = gymnasium.make(
                ENV_ID, asset=str(asset.folder), joint=joint.name, robot_uids=robot
            )
        except MamSimError as error:
            refusals.append(f"{joint.name}: {error}")
            continue
        try:
            env.reset(seed=0)
            env.action_space.seed(0)
            for _ in range(steps):
                _, reward, *_ = env.step(env.action_space.sample())
                if not np.isfinite(np.asarray(reward, dtype=float)).all():
                    refusals.append(f"{joint.name}: the simulation is unstable")
                    break
            else:
                return {"ok": True, "joint": joint.name, "robot": robot, "steps": steps}
        finally:
            env.close()
    why = refusals[0] if refusals else "the asset has no joints"
    return {"ok": False, "joint": None, "robot": robot, "why": why, "refusals": refusals}


def _noted(asset: Asset, more: dict[str, Any]) -> Asset:
    """Add to the card's checks, on disk too."""
    card = replace(asset.card, checks={**asset.card.checks, **more})
    card.save(asset.folder)
    return Asset(asset.folder, card)
