"""Does the measure measure? A policy on other assets of its category, and on wrong joints.

    python benchmarks/held_out.py RUN category@seed --joint NAME --others 7002 7003 --json FILE

RUN was trained on the generated object category@seed. It is tried on other seeds of the category,
and on the same object with its joint's axis tilted, or its hinge on the other side; arm and object
stand where they stood in training, so that the joint is all that differs. The expert, which knows
the wrong joint, is the control.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.errors import MamSimError
from mam_pipeline.types import Articulation
from mam_pipeline.world import make_object
from mam_policies.evaluate import HELD_OUT, evaluate, evaluate_expert, plain
from mam_policies.run import Actor, EnvChoice, MlpPolicy, RunInfo


@dataclass
class Settings:
    """What is tried.

    Attributes:
        others: seeds of held-out objects. tilts: degrees. mirror: try the hinge on the other side.
        episodes: of the policy; expert: of the expert (0: not tried).
    """

    joint: str
    others: tuple[int, ...] = ()
    tilts: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0)
    mirror: bool = False
    episodes: int = 20
    expert: int = 5
    out: Path = Path("held_out")
    json: Path = Path("held_out.json")


@dataclass(frozen=True)
class Placed(EnvChoice):
    """An environment whose arm stands where it stands for `as_for`'s asset."""

    as_for: EnvChoice | None = None

    def make(self, **more: Any) -> Any:
        """See EnvChoice."""
        env = super().make(**more)
        if self.as_for is not None:
            right = self.as_for.make()
            place = right.unwrapped.layout(0).placement
            right.close()
            base = env.unwrapped
            base.layouts = [replace(item, placement=place) for item in base.layouts]
        return env


def tilted(truth: Articulation, joint: str, degrees: float) -> Articulation:
    """The joint's axis turned: a slide sideways, a hinge in the plane of a front (about x)."""
    joints = []
    for j in truth.joints:
        if j.name == joint:
            about = [0, 0, 1] if j.subtype == "slide" else [1, 0, 0]
            turn = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(about))
            j = replace(j, axis=turn.apply(j.axis))
        joints.append(j)
    return replace(truth, joints=tuple(joints))


def mirrored(truth: Articulation, joint: str) -> Articulation:
    """The hinge at the other side of its part."""
    joints = []
    for j in truth.joints:
        if j.name == joint:
            faces = truth.links[j.child].faces
            points = truth.mesh.vertices[truth.mesh.faces[faces].reshape(-1)]
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            origin = np.array(j.origin)
            origin[1] = 2 * middle[1] - origin[1]
            j = replace(j, axis=-np.array(j.axis), origin=origin)
        joints.append(j)
    return replace(truth, joints=tuple(joints))


def try_on(run: Path, choice: EnvChoice, settings: Settings, name: str) -> dict[str, Any]:
    """One row: check, expert, policy on one asset."""
    row: dict[str, Any] = {"asset": name, "check": check_asset(Path(choice.assets[0])).passed}
    actor = Actor(MlpPolicy.load(run))

    def begin(_env: Any) -> Any:
        actor.reset()
        return actor.act

    try:
        if settings.expert:
            expert = replace(choice, control_mode="pd_joint_pos")
            row["expert"] = plain(evaluate_expert(expert, settings.expert))
        found = evaluate(choice, begin, settings.episodes, HELD_OUT)
        row["policy"] = plain(found)
        print(f"{name:<32} check {row['check']}  policy {found.line()} {found.reasons}", flush=True)
    except MamSimError as error:
        row["why"] = str(error)
        print(f"{name:<32} {error}", flush=True)
    return row


def main(
    run: tyro.conf.Positional[Path], wish: tyro.conf.Positional[str], /, settings: Settings
) -> None:
    """Try the run on everything and write the rows."""
    torch.set_num_threads(1)
    category, _, seed = wish.partition("@")
    truth = make_object(category, int(seed))
    env = RunInfo.load(run).env
    rows: list[dict[str, Any]] = []
    cases: list[tuple[str, Articulation]] = [
        (f"axis {d:g} degrees off", tilted(truth.articulation, settings.joint, d))
        for d in settings.tilts
    ]
    if settings.mirror:
        cases.append(("hinge on the other side", mirrored(truth.articulation, settings.joint)))
    for name, wrong in cases:
        folder = settings.out / f"{category}_{seed}-{name.replace(' ', '_')}"
        write_asset(wrong, folder, name=folder.name, collision=truth.collision)
        choice = Placed(
            **{**vars(env), "assets": (str(folder),), "joint": settings.joint}, as_for=env
        )
        rows.append(try_on(run, choice, settings, name))
        settings.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    for other in settings.others:
        made = make_object(category, other)
        folder = settings.out / f"{category}_{other}"
        write_asset(made.articulation, folder, name=folder.name, collision=made.collision)
        choice = replace(env, assets=(str(folder),), joint=None)
        rows.append(try_on(run, choice, settings, f"held out: {folder.name}"))
        settings.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
