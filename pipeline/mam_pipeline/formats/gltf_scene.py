"""The nodes of a glTF file and how its animations move them.

Only rigid motions relative to the parent node are told (glTF 2.0, sections 3.11 and 5.8).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.gltf_data import Document
from mam_pipeline.formats.nodes import NodeMotion, Scene, SceneNode
from mam_pipeline.types import FloatArray


def scene_of(
    data: Document, worlds: Sequence[FloatArray], groups: Mapping[int, str]
) -> Scene | None:
    """The nodes of a glTF document and their motions; None where they cannot be understood.

    Args:
        worlds: (4, 4) of every node in the file's frame. groups: name of its faces, by node.
    """
    try:
        rows = data.rows("nodes")
        parent = np.full(len(rows), -1)
        for i, node in enumerate(rows):
            for child in node.get("children", ()):
                parent[child] = i
        nodes = tuple(
            SceneNode(
                _name(data, n), int(parent[i]), groups.get(i, ""), int(n.get("mesh", -1)), worlds[i]
            )
            for i, n in enumerate(rows)
        )
        motions: list[NodeMotion] = []
        notes: list[str] = []
        for k, clip in enumerate(data.rows("animations")):
            name = str(clip.get("name") or f"animation_{k}")
            try:
                motions += _motions(data, clip, name)
            except (KeyError, IndexError, ValueError, TypeError, OSError, struct.error):
                notes.append(f"the animation {name!r} could not be read and was passed over")
        return Scene(nodes, tuple(motions), len(data.rows("skins")), tuple(notes))
    except (
        KeyError, IndexError, ValueError, TypeError, AttributeError, OSError, struct.error,
        InputError,
    ):  # fmt: skip
        return None  # a file whose animation cannot be understood is still a mesh


def _name(data: Document, node: dict[str, Any]) -> str:
    """A node's own name, or its mesh's."""
    mesh = data.at("meshes", node["mesh"]) if "mesh" in node else {}
    return str(node.get("name") or mesh.get("name") or "")


def _motions(data: Document, clip: dict[str, Any], name: str) -> list[NodeMotion]:
    """Keyframe poses of every node that a clip moves; all its channels at all their times."""
    by_node: dict[int, dict[str, tuple[FloatArray, FloatArray]]] = {}
    for channel in clip["channels"]:
        target = channel["target"]
        if "node" not in target or target["path"] not in ("translation", "rotation", "scale"):
            continue
        sampler = clip["samplers"][channel["sampler"]]
        times = data.accessor(sampler["input"], "SCALAR").reshape(-1)
        kind = "VEC4" if target["path"] == "rotation" else "VEC3"
        values = data.accessor(sampler["output"], kind, normalise=True)
        values = values.astype(np.float64)
        if sampler.get("interpolation") == "CUBICSPLINE":
            values = values.reshape(len(times), 3, -1)[:, 1]
        by_node.setdefault(target["node"], {})[target["path"]] = (times, values)
    out = []
    for index, channels in by_node.items():
        times = np.unique(np.concatenate([t for t, _ in channels.values()]))
        t, r, s = _parts(data.at("nodes", index))
        moved = {
            "translation": np.tile(t, (len(times), 1)), "rotation": np.tile(r, (len(times), 1)),
            "scale": np.tile(s, (len(times), 1)),
        }  # fmt: skip
        for path, (at, values) in channels.items():
            moved[path] = _at(times, at, values, path == "rotation")
        rows = zip(moved["translation"], moved["rotation"], moved["scale"])
        poses = np.stack([_compose(*row) for row in rows])
        out.append(NodeMotion(index, name, poses, _local(data.at("nodes", index))))
    return out


def _parts(node: dict[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Translation, rotation (x, y, z, w) and scale of a node."""
    if "matrix" in node:
        m = np.asarray(node["matrix"], float).reshape(4, 4).T
        scale = np.linalg.norm(m[:3, :3], axis=0)
        turn = Rotation.from_matrix(m[:3, :3] / np.maximum(scale, 1e-12)).as_quat()
        return m[:3, 3], turn, scale
    return (
        np.asarray(node.get("translation", (0, 0, 0)), float),
        np.asarray(node.get("rotation", (0, 0, 0, 1)), float),
        np.asarray(node.get("scale", (1, 1, 1)), float),
    )


def _compose(t: FloatArray, r: FloatArray, s: FloatArray) -> FloatArray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat(r).as_matrix() * s
    out[:3, 3] = t
    return out


def _local(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        return np.asarray(node["matrix"], float).reshape(4, 4).T
    return _compose(*_parts(node))


def _at(times: FloatArray, known: FloatArray, values: FloatArray, turn: bool) -> FloatArray:
    """Values at more times, between keyframes; quaternions along the shorter arc."""
    if turn:
        signs = np.ones(len(values))
        for k in range(1, len(values)):
            signs[k] = signs[k - 1] * (1.0 if values[k] @ values[k - 1] >= 0 else -1.0)
        values = values * signs[:, None]
    out = np.stack([np.interp(times, known, values[:, i]) for i in range(values.shape[1])], axis=1)
    if turn:
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
    return out
