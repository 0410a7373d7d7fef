"""Places for robots that were found before, kept on disk by everything that they depend on.

An entry holds numbers only, no names or paths of a machine. One that is damaged, or cannot be
written, is as if there were none.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import mam_envs
from mam_envs.config import RandomisationConfig
from mam_envs.grasping.candidates import Grasp, PlacementError
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import ArmPath
from mam_envs.placement.base import Placement, place
from mam_envs.robots import RobotSpec
from mam_envs.tasks.base import JointGoal
from mam_pipeline import folders
from mam_pipeline.asset.card import CardGrasp
from mam_pipeline.digests import file_digest, text_digest
from mam_pipeline.formats.urdf.geometry import existing

VARIABLE = "MAM_SIM_PLACEMENTS"
"""Environment variable that names the folder; "off" remembers nothing."""
DEFAULT = "~/.cache/mam-sim/placements"
SOURCES = (
    "placement/*.py",
    "grasping/*.py",
    "robots/base.py",
    "robots/self_collision.py",
    "kinematics.py",
    "convex.py",
    "object_model.py",
)


def remembered_place(
    model: ObjectModel,
    goals: Sequence[JointGoal],
    robot: RobotSpec,
    chance: RandomisationConfig,
) -> Placement:
    """`place`, or what it found (or refused) when the same was asked before.

    Raises:
        PlacementError: as `place` does.
    """
    folder = _folder()
    if folder is None:
        return place(model, goals, robot, chance)
    key = _key(model, goals, robot, chance)
    file = folder / key[:2] / f"{key}.json"
    found = _read(file)
    if found is None:
        try:
            found = place(model, goals, robot, chance)
        except PlacementError as error:
            found = error
        _write(file, found)
    if isinstance(found, PlacementError):
        raise found
    return found


def _folder() -> Path | None:
    said = os.environ.get(VARIABLE, "").strip() or DEFAULT
    return None if said == "off" else Path(said).expanduser()


def _key(
    model: ObjectModel, goals: Sequence[JointGoal], robot: RobotSpec, chance: RandomisationConfig
) -> str:
    """SHA-256 of the object, what is asked of it, the robot, and the code that searches."""
    card, urdf = model.asset.card, model.asset.urdf_path
    shapes = (c.geometry.mesh for link in model.kinematics.robot.links for c in link.collisions)
    meshes = sorted({existing(mesh.filename, urdf) for mesh in shapes if mesh is not None})
    body = {f.name: getattr(robot, f.name) for f in fields(robot) if f.name != "urdf"}
    question = {
        "object": [file_digest(urdf), *(file_digest(mesh) for mesh in meshes)],
        "card": [card.name, list(map(asdict, card.joints)), list(map(asdict, card.grasps))],
        "scale": model.scale,
        "goals": list(map(asdict, goals)),
        "robot": [body, file_digest(robot.path)],
        "shift": [chance.position, chance.yaw],
        "code": _code_digest(),
    }
    return text_digest(json.dumps(question, sort_keys=True, default=_plain))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return dict(value) if hasattr(value, "keys") else np.asarray(value).tolist()


@cache
def _code_digest() -> str:
    """Of the sources that a place depends on: other code may find other places."""
    root = Path(mam_envs.__file__).parent
    digest = hashlib.sha256()
    files = [file for name in SOURCES for file in root.glob(name)]
    for file in sorted(files):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def _write(file: Path, found: Placement | PlacementError) -> None:
    """A line with the digest of what follows, which tells a damaged file from a whole one."""
    if isinstance(found, PlacementError):
        body: dict[str, Any] = {"refusal": str(found), "cause": found.cause}
    else:
        body = asdict(found)
    text = json.dumps(body, default=_plain)
    with suppress(OSError):  # a full disk, or a folder that is not ours, stops nobody
        file.parent.mkdir(parents=True, exist_ok=True)
        folders.write_text(file, f"{text_digest(text)}\n{text}\n")


def _read(file: Path) -> Placement | PlacementError | None:
    try:
        digest, text = file.read_text(encoding="utf-8").splitlines()
        if text_digest(text) != digest:
            return None
        body = json.loads(text)
        if "refusal" in body:
            return PlacementError(body["refusal"], body["cause"])
        return _placement(body)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _placement(body: dict[str, Any]) -> Placement:
    path: dict[str, Any] = body["path"]
    held: dict[str, Any] = path["grasp"]
    card = CardGrasp(**held["card"])
    tool, lags = np.array(held["tool"]), tuple(held["lags"])
    path["grasp"] = Grasp(**{**held, "card": card, "tool": tool, "lags": lags})
    for name in ("base", "approach", "follow", "q"):
        path[name] = np.array(path[name])
    return Placement(**{**body, "base": np.array(body["base"]), "path": ArmPath(**path)})
