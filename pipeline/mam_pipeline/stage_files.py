"""How each stage's result is kept on disk: arrays as .npz, what a person may edit as YAML."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import (
    Articulation,
    Joint,
    JointCandidate,
    KinematicTree,
    Link,
    Mesh,
    PartNode,
    Primitives,
    RangeBasis,
    UsualTravel,
)


@dataclass(frozen=True)
class Codec:
    """A file name and the pair of functions that write and read it."""

    filename: str
    save: Callable[[Any, Path], None]
    load: Callable[[Path], Any]


def text_digest(text: str) -> str:
    """SHA-256 of a text, hex."""
    return hashlib.sha256(text.encode()).hexdigest()


def mesh_digest(mesh: Mesh) -> str:
    """SHA-256 of a mesh's geometry, hex; appearance does not enter."""
    digest = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update("|".join(mesh.group_names).encode())
    return digest.hexdigest()


def save_geometry(mesh: Mesh, folder: Path) -> None:
    """Keep the engine's input as <folder>/mesh.npz, for looking at later stages."""
    folder.mkdir(exist_ok=True)
    np.savez_compressed(
        folder / "mesh.npz",
        vertices=mesh.vertices.astype(np.float32),
        faces=mesh.faces.astype(np.int32),
    )


def load_geometry(folder: Path) -> Mesh:
    """Read back what `save_geometry` kept."""
    with np.load(folder / "mesh.npz") as data:
        return Mesh(data["vertices"], data["faces"])


def _save_primitives(value: Primitives, path: Path) -> None:
    kept = {name: getattr(value, name) for name in ("labels", "merges", "method", "fronts")}
    np.savez_compressed(path, **kept)


def _load_primitives(path: Path) -> Primitives:
    with np.load(path) as data:
        fronts = data["fronts"] if "fronts" in data else np.zeros((0, 0), dtype=bool)
        return Primitives(data["labels"], data["merges"], str(data["method"]), fronts)


def _save_prior(value: KinematicPrior | None, path: Path) -> None:
    if value is None:
        np.savez_compressed(path, source="none")
        return
    np.savez_compressed(
        path,
        mobility=value.mobility,
        affinity=value.affinity,
        masks=value.masks.astype(np.int16),
        views=value.views,
        source=value.source,
        labels=value.labels,
        fov=value.fov,
    )


def _load_prior(path: Path) -> KinematicPrior | None:
    with np.load(path) as data:
        if "mobility" not in data:
            return None
        return KinematicPrior(
            data["mobility"],
            data["affinity"],
            data["masks"].astype(np.int64),
            data["views"],
            str(data["source"]),
            labels=data["labels"],
            fov=float(data["fov"]),
        )


def _save_tree(tree: KinematicTree, path: Path) -> None:
    rows = []
    for node in tree.nodes:
        row: dict[str, Any] = {
            "name": node.name,
            "kind": node.kind,
            "primitives": [int(p) for p in node.primitives],
            "parent": int(node.parent),
            "subtype": node.subtype,
            "confidence": round(float(node.confidence), 4),
            "runner_up": node.runner_up,
            "provenance": node.provenance,
        }
        if node.limits is not None:
            row["limits"] = [float(v) for v in node.limits]
        row["candidates"] = [
            {
                "subtype": c.subtype,
                "axis": [float(v) for v in c.axis],
                "origin": [float(v) for v in c.origin],
                "score": float(c.score),
                "evidence": {k: plain(v) for k, v in c.evidence.items()},
                **_ranked(c),
            }
            for c in node.candidates
        ]
        row["evidence"] = plain(dict(node.evidence))
        rows.append(row)
    header = "# Parts and joint types. Edit and run again: only what follows is computed anew.\n"
    path.write_text(header + yaml.safe_dump(rows, sort_keys=False, default_flow_style=None))


def _load_tree(path: Path) -> KinematicTree:
    rows = _yaml(path)
    try:
        nodes = []
        for row in rows:
            row = dict(row)
            row["primitives"] = tuple(row["primitives"])
            row["candidates"] = tuple(_candidate(c) for c in row.get("candidates", ()))
            if row.get("limits") is not None:
                row["limits"] = tuple(row["limits"])
            nodes.append(PartNode(**row))
        return KinematicTree(tuple(nodes))
    except (TypeError, ValueError, KeyError) as error:
        raise ConfigError(f"{path} was edited into something that is no tree: {error}") from error


def _ranked(candidate: JointCandidate) -> dict[str, Any]:
    """What the ranking said of a candidate, as far as it was ranked."""
    row: dict[str, Any] = {
        name: float(value) for name in ("kind_probability", "within_kind")
        if (value := getattr(candidate, name)) is not None
    }  # fmt: skip
    if candidate.travel is not None:
        row["travel"] = asdict(candidate.travel)
    return row


def _candidate(row: dict[str, Any]) -> JointCandidate:
    travel = row.get("travel")
    return JointCandidate(**{**row, "travel": None if travel is None else UsualTravel(**travel)})


def articulation_codec(mesh: Mesh, primitives: Primitives, tree: KinematicTree) -> Codec:
    """Joints as YAML; the links follow from the primitives and the tree."""

    def save(value: Articulation, path: Path) -> None:
        rows = []
        for joint in value.joints:
            row = {k: plain(getattr(joint, k)) for k in _JOINT_KEYS}
            row["basis"] = asdict(joint.basis)
            row["parent"], row["child"] = (
                value.links[joint.parent].name,
                value.links[joint.child].name,
            )
            rows.append(row)
        np.savez_compressed(path.with_name("links.npz"), face_link=value.face_link)
        links = [
            {"name": l.name, "kind": l.kind, "primitives": [int(p) for p in l.primitives]}
            for l in value.links
        ]
        text = yaml.safe_dump(
            {"links": links, "joints": rows}, sort_keys=False, default_flow_style=None
        )
        path.write_text("# Joints in the engine's frame (metres, radians). Edit freely.\n" + text)

    def load(path: Path) -> Articulation:
        data = _yaml(path)
        with np.load(path.with_name("links.npz")) as kept:
            face_link = kept["face_link"]
        try:
            links = tuple(
                Link(r["name"], r["kind"], np.flatnonzero(face_link == i), tuple(r["primitives"]))
                for i, r in enumerate(data["links"])
            )
            index = {link.name: i for i, link in enumerate(links)}
            joints = []
            for row in data["joints"]:
                row = dict(row, parent=index[row["parent"]], child=index[row["child"]])
                row["basis"] = RangeBasis(**row.get("basis", {}))
                joints.append(Joint(**{k: _finite(v) for k, v in row.items()}))
            return Articulation(mesh, links, tuple(joints))
        except (TypeError, ValueError, KeyError) as error:
            raise ConfigError(f"{path} was edited into something unusable: {error!r}") from error

    return Codec("joints.yaml", save, load)


_JOINT_KEYS = (
    *("name", "type", "subtype", "parent", "child", "axis", "origin", "lower", "upper"),
    *("closed", "open", "damping", "friction", "effort", "velocity", "confidence", "evidence"),
    "provenance",
)


def plain(value: Any) -> Any:
    """Numpy values and tuples as what YAML and JSON hold; infinities become strings."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)


def _finite(value: Any) -> Any:
    return float(value) if value in ("inf", "-inf", "nan") else value


def _yaml(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is not YAML any more: {str(error).splitlines()[0]}") from error


PRIMITIVES = Codec("primitives.npz", _save_primitives, _load_primitives)
PRIOR = Codec("prior.npz", _save_prior, _load_prior)
TREE = Codec("parts.yaml", _save_tree, _load_tree)
