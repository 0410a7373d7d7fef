"""Reading the nodes of a glTF file and how its animations move them.

They are read apart from the surfaces (`gltf`), so that a file whose animation cannot be understood
is still a mesh. Only rigid motions relative to the parent node are told (glTF 2.0, sections 3.11
and 5.8).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.gltf_data import Document
from mam_pipeline.formats.nodes import NodeMotion, Scene, SceneNode
from mam_pipeline.formats.soup import LIMITS, Budget
from mam_pipeline.types import FloatArray, IntArray


def read_scene(path: Path) -> Scene | None:
    """The scene of a .glb or .gltf file; None for other formats and for what cannot be read."""
    if path.suffix.lower() not in (".glb", ".gltf"):
        return None
    try:
        return _Reader(path).scene()
    except (
        KeyError, IndexError, ValueError, TypeError, AttributeError, OSError, struct.error,
        InputError,
    ):  # fmt: skip
        return None  # the mesh's own reader tells what is wrong with a file


class _Reader:
    def __init__(self, path: Path) -> None:
        self.data = Document(path, Budget(path), Door(path.parent))
        self.doc = self.data.doc
        self.nodes: list[dict[str, Any]] = self.data.rows("nodes")

    def scene(self) -> Scene:
        parent = np.full(len(self.nodes), -1)
        for i, node in enumerate(self.nodes):
            for child in node.get("children", ()):
                parent[child] = i
        world = [self._world(i, parent) for i in range(len(self.nodes))]
        groups = self._groups(parent)
        nodes = tuple(
            SceneNode(
                str(n.get("name") or self._mesh_name(n)), int(parent[i]), groups.get(i, ""),
                int(n.get("mesh", -1)), world[i],
            )
            for i, n in enumerate(self.nodes)
        )  # fmt: skip
        motions: list[NodeMotion] = []
        notes: list[str] = []
        for k, clip in enumerate(self.doc.get("animations", ())):
            name = str(clip.get("name") or f"animation_{k}")
            try:
                motions += self._motions(clip, name)
            except (KeyError, IndexError, ValueError, TypeError, OSError, struct.error):
                notes.append(f"the animation {name!r} could not be read and was passed over")
        return Scene(nodes, tuple(motions), len(self.doc.get("skins", ())), tuple(notes))

    def _mesh_name(self, node: dict[str, Any]) -> str:
        if "mesh" not in node:
            return ""
        return str(self.doc["meshes"][node["mesh"]].get("name") or "")

    def _groups(self, parent: IntArray) -> dict[int, str]:
        """Names of faces by node, given as the mesh's reader gives them on its walk."""
        scenes = self.doc.get("scenes")
        if scenes:
            roots = scenes[self.doc.get("scene", 0)].get("nodes", [])
        else:
            roots = [i for i in range(len(self.nodes)) if parent[i] < 0]
        seen: dict[str, int] = {}
        out: dict[int, str] = {}
        stack = list(reversed(roots))
        while stack:
            i = stack.pop()
            node = self.nodes[i]
            if "mesh" in node:
                name = str(node.get("name") or self._mesh_name(node) or f"node_{i}")
                seen[name] = seen.get(name, 0) + 1
                out[i] = name if seen[name] == 1 else f"{name}.{seen[name] - 1:03d}"
            stack += reversed(node.get("children", ()))
        return out

    def _world(self, index: int, parent: IntArray) -> FloatArray:
        out, steps = _local(self.nodes[index]), 0
        while parent[index] >= 0:
            index, steps = int(parent[index]), steps + 1
            if steps > LIMITS.deep:
                raise ValueError("nodes form a loop")
            out = _local(self.nodes[index]) @ out
        return out

    def _motions(self, clip: dict[str, Any], name: str) -> list[NodeMotion]:
        """Keyframe poses of every node that a clip moves; all its channels at all their times."""
        by_node: dict[int, dict[str, tuple[FloatArray, FloatArray]]] = {}
        for channel in clip["channels"]:
            target = channel["target"]
            if "node" not in target or target["path"] not in ("translation", "rotation", "scale"):
                continue
            sampler = clip["samplers"][channel["sampler"]]
            times = self.data.accessor(sampler["input"], "SCALAR").reshape(-1)
            kind = "VEC4" if target["path"] == "rotation" else "VEC3"
            values = self.data.accessor(sampler["output"], kind, normalise=True)
            values = values.astype(np.float64)
            if sampler.get("interpolation") == "CUBICSPLINE":
                values = values.reshape(len(times), 3, -1)[:, 1]
            by_node.setdefault(target["node"], {})[target["path"]] = (times, values)
        out = []
        for index, channels in by_node.items():
            times = np.unique(np.concatenate([t for t, _ in channels.values()]))
            t, r, s = _parts(self.nodes[index])
            moved = {
                "translation": np.tile(t, (len(times), 1)), "rotation": np.tile(r, (len(times), 1)),
                "scale": np.tile(s, (len(times), 1)),
            }  # fmt: skip
            for path, (at, values) in channels.items():
                moved[path] = _at(times, at, values, path == "rotation")
            rows = zip(moved["translation"], moved["rotation"], moved["scale"])
            poses = np.stack([_compose(*row) for row in rows])
            out.append(NodeMotion(index, name, poses, _local(self.nodes[index])))
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
