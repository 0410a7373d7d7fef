"""Does the measure measure? A policy on other assets of its category, and on wrong joints.

    python benchmarks/held_out.py RUN --others ASSET ASSET --mirror --out FILE

RUN is tried on held-out assets, and on copies of its own whose axis is tilted or whose hinge
sits on the other side. Arm and object stand where they stood in training, so that the joint is all
that differs. The expert, which knows the wrong joint, is the control.
"""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from common import save
from scipy.spatial.transform import Rotation

from mam_envs.object_model import ObjectModel
from mam_pipeline.asset.card import Asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.errors import MamSimError
from mam_policies.evaluate import HELD_OUT, evaluate, evaluate_expert, plain
from mam_policies.mlp import MlpActor, MlpPolicy
from mam_policies.run import EnvChoice, RunInfo


@dataclass
class Settings:
    """What is tried.

    Attributes:
        others: held-out assets. tilts: degrees. mirror: try the hinge on the other side.
        episodes: of the policy; expert: of the expert (0: not tried).
        copies: folder for the spoiled assets. out: JSON file for the rows.
    """

    others: tuple[Path, ...] = ()
    tilts: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0)
    mirror: bool = False
    episodes: int = 20
    expert: int = 5
    copies: Path = Path("held_out")
    out: Path | None = None


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


def wrong_copy(asset: Path, joint: str, out: Path, degrees: float, mirror: bool = False) -> None:
    """Copy an asset with its joint spoiled.

    Args:
        degrees: of the axis: a slide's sideways (about z), a hinge's in its front's plane (x).
        mirror: the hinge at the other side of its part, turning the other way.
    """
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(asset, out)
    model = ObjectModel.load(Asset.load(asset))
    file = out / Asset.load(asset).urdf_path.name
    tree = ElementTree.parse(file)
    found = next(j for j in tree.iter("joint") if j.get("name") == joint)
    axis_tag, origin_tag = found.find("axis"), found.find("origin")
    assert axis_tag is not None and origin_tag is not None
    axis, origin = _numbers(axis_tag.get("xyz")), _numbers(origin_tag.get("xyz"))
    about = [0, 0, 1] if found.get("type") == "prismatic" else [1, 0, 0]
    axis = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(about)).apply(axis)
    if mirror:
        link = model.kinematics.joint(joint).child
        boxes = model.boxes[link]
        away = np.array([0.0, boxes[:, 0, 1].min() + boxes[:, 1, 1].max(), 0.0])
        axis, origin = -axis, origin + away
        child = next(x for x in tree.iter("link") if x.get("name") == link)
        carried = [j for j in tree.iter("joint") if _parent(j) == link]
        for holder in (*child, *carried):  # the part itself stays where it is
            tag = holder.find("origin")
            if tag is None:
                tag = ElementTree.SubElement(holder, "origin", {"xyz": "0 0 0"})
            tag.set("xyz", _text(_numbers(tag.get("xyz")) - away))
    axis_tag.set("xyz", _text(axis))
    origin_tag.set("xyz", _text(origin))
    tree.write(file)


def _parent(joint: ElementTree.Element) -> str | None:
    tag = joint.find("parent")
    return None if tag is None else tag.get("link")


def _numbers(text: str | None) -> np.ndarray:
    return np.array([float(v) for v in (text or "0 0 0").split()])


def _text(values: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def try_on(run: Path, choice: EnvChoice, settings: Settings, name: str) -> dict[str, Any]:
    """One row: check, expert, policy on one asset."""
    row: dict[str, Any] = {"asset": name, "check": check_asset(Path(choice.assets[0])).passed}
    actor = MlpActor(MlpPolicy.load(run))

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


def main(run: tyro.conf.Positional[Path], /, settings: Settings) -> None:
    """Try the run on everything and write the rows."""
    torch.set_num_threads(1)
    env = RunInfo.load(run).env
    asset = Path(env.assets[0])
    right = env.make()
    joint = right.unwrapped.layout(0).goals[0].joint
    right.close()
    cases = [(f"axis {d:g} degrees off", d, False) for d in settings.tilts]
    cases += [("hinge on the other side", 0.0, True)] * settings.mirror
    rows: list[dict[str, Any]] = []
    for name, degrees, mirror in cases:
        folder = settings.copies / f"{asset.name}-{name.replace(' ', '_')}"
        wrong_copy(asset, joint, folder, degrees, mirror)
        mine = {**vars(env), "assets": (str(folder),), "joint": joint}
        rows.append(try_on(run, Placed(**mine, as_for=env), settings, name))
        save(settings.out, rows)
    for other in settings.others:
        choice = replace(env, assets=(str(other),), joint=None)
        rows.append(try_on(run, choice, settings, f"held out: {other.name}"))
        save(settings.out, rows)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
