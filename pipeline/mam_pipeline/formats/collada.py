"""Collada (DAE) reading: a scene's triangles by node, with the pictures that its effects name.

The XML is read by pycollada; what it shows at rest is put together here, since a general loader
names pieces by their geometry instead of their node and decodes pictures. Skins stand in the pose
of their joints (Collada 1.4.1, "Skinning a skeleton").
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.formats.headers import check_header, collada_says
from mam_pipeline.formats.nodes import Scene, SceneNode
from mam_pipeline.formats.pictures import Picture, Pictures, model_door
from mam_pipeline.formats.soup import Budget, FileContent, Piece, paired
from mam_pipeline.types import FloatArray, IntArray, Material


def read_collada(path: Path, root: Path | None = None) -> FileContent:
    """Read every triangle of a DAE's scene in its own frame and unit.

    Args:
        path: the file. root: folder whose files it may name; default: its own.

    Raises:
        InputError: it cannot be read, or is larger than what is read.
    """
    check_header(path)
    try:
        return _Reader(path, root).content()
    except InputError:
        raise
    except Exception as error:  # the library fails in many ways
        words = str(error).splitlines()
        what = words[0] if words else type(error).__name__
        raise InputError(f"{path} cannot be read as DAE ({what}); export it again") from error


class _Reader:
    """The pieces found on a walk over the nodes of one file."""

    def __init__(self, path: Path, root: Path | None) -> None:
        import collada

        self.collada = collada
        self.path = path
        self.budget = Budget(path)
        self.pictures = Pictures(path, self.budget, model_door(path, root))
        self.doc = collada.Collada(str(path), ignore=[collada.common.DaeError])
        self.dropped: Counter[str] = Counter()
        self.pieces: list[Piece] = []
        self.materials: list[Material] = [Material()]
        self.known: dict[int, int] = {}
        self.names: dict[str, int] = {}
        self.joints: dict[str, FloatArray] = {}
        self.nodes: list[SceneNode] = []
        self.meshes: dict[str, int] = {}

    def content(self) -> FileContent:
        up, unit = collada_says(self.path)
        roots = list(self.doc.scene.nodes) if self.doc.scene is not None else []
        self._walk(roots, self._note_joint)
        self._walk(roots, self._note_node)
        notes: tuple[str, ...] = ()
        if not any(m.image for m in self.materials) and not self.pictures.missing:
            notes = self._gazebo()
        notes += self.pictures.notes()
        if self.dropped:
            notes += (f"not taken over: {', '.join(sorted(self.dropped))}",)
        scene = Scene(tuple(self.nodes), skins=len(self.doc.controllers))
        return FileContent(tuple(self.pieces), tuple(self.materials), up, unit, notes, scene)

    def _walk(self, nodes: list[Any], visit: Callable[[Any, FloatArray, str, int], None]) -> None:
        """Visit everything below some nodes, with its frame, and name and number of the one above.

        Numbers count the visits.
        """
        left = [(node, np.eye(4), "", -1) for node in reversed(nodes)]
        count = 0
        while left:
            node, frame, name, above = left.pop()
            visit(node, frame, name, above)
            if isinstance(node, self.collada.scene.Node):  # one that stands for another too
                frame = frame @ np.asarray(node.matrix, dtype=np.float64)
                own = getattr(node, "name", None) or getattr(node, "id", None) or name
                below = reversed(node.children or ())
                left += [(child, frame, str(own), count) for child in below]
            count += 1

    def _note_node(self, node: Any, frame: FloatArray, name: str, above: int) -> None:
        """Draw what is drawn there, and keep the node; what is drawn is a nameless child of it."""
        before = len(self.pieces)
        self._draw(node, frame, name)
        own, mesh = "", -1
        if isinstance(node, self.collada.scene.Node):
            own = str(getattr(node, "name", None) or getattr(node, "id", None) or "")
            frame = frame @ np.asarray(node.matrix, dtype=np.float64)
        elif isinstance(node, self.collada.scene.GeometryNode):
            mesh = self.meshes.setdefault(str(node.geometry.id), len(self.meshes))
        group = self.pieces[before].group if len(self.pieces) > before else ""
        self.nodes.append(SceneNode(own, above, group, mesh, frame))

    def _note_joint(self, node: Any, frame: FloatArray, name: str, above: int) -> None:
        if isinstance(node, self.collada.scene.Node) and node.xmlnode is not None:
            world = frame @ np.asarray(node.matrix, dtype=np.float64)
            for key in ("sid", "id", "name"):
                if node.xmlnode.get(key):
                    self.joints.setdefault(node.xmlnode.get(key), world)

    def _draw(self, node: Any, frame: FloatArray, name: str) -> None:
        scene, controller = self.collada.scene, self.collada.controller
        if isinstance(node, scene.GeometryNode):
            self._geometry(node.geometry, node, frame, name, None)
        elif isinstance(node, scene.ControllerNode):
            told = node.controller
            if isinstance(told, controller.Skin):
                self._geometry(told.geometry, node, frame, name, self._posed(told))
            else:
                self.dropped["morph targets"] += 1
                self._geometry(told.source_geometry, node, frame, name, None)

    def _geometry(
        self, geometry: Any, node: Any, frame: FloatArray, name: str, posed: FloatArray | None
    ) -> None:
        """Add the primitives of one geometry; `posed` holds the vertices of a skin."""
        bound = {m.symbol: m for m in node.materials}
        group = self._unique(name or geometry.name or geometry.id or "mesh")
        for told in geometry.primitives:
            primitive = told.triangleset() if hasattr(told, "triangleset") else told
            if not isinstance(primitive, self.collada.triangleset.TriangleSet):
                self.dropped["lines"] += 1
                continue
            if primitive.vertex is None or not len(primitive.index):
                continue
            material, channel = self._material(bound.get(primitive.material))
            corners = primitive.vertex_index.reshape(-1)
            points = np.asarray(primitive.vertex, dtype=np.float64)
            if posed is not None and len(posed) == len(points):
                points, place = posed, np.eye(4)
            else:
                place = frame
            self.budget.triangles(len(corners), len(corners) // 3)
            self.pieces.append(
                self._piece(primitive, points, place, corners, channel, group, material)
            )

    def _piece(
        self, primitive: Any, points: FloatArray, place: FloatArray, corners: IntArray,
        channel: int | None, group: str, material: int,
    ) -> Piece:  # fmt: skip
        keys, arrays = [corners], []
        sets = primitive.sources.get("TEXCOORD", ())
        if len(primitive.texcoordset):
            which = next((i for i, s in enumerate(sets) if s[3] and s[3] == str(channel)), 0)
            keys.append(primitive.texcoord_indexset[which].reshape(-1))
            arrays.append(np.asarray(primitive.texcoordset[which], dtype=np.float64)[:, :2])
        painted = primitive.sources.get("COLOR", ())
        if painted:
            keys.append(primitive.index[:, :, painted[0][0]].reshape(-1))
        rows, faces = paired(np.stack(keys, axis=1))
        uv = colors = None
        if arrays:
            found = arrays[0][rows[:, 1]]
            uv = np.stack([found[:, 0], 1.0 - found[:, 1]], axis=1).astype(np.float32)
        if painted:
            colors = _rgba(np.asarray(painted[0][4].data)[rows[:, -1]])
        if np.linalg.det(place[:3, :3]) < 0:
            faces = faces[:, ::-1]
        vertices = points[rows[:, 0]] @ place[:3, :3].T + place[:3, 3]
        return Piece(vertices, faces, group, material, uv, colors)

    def _posed(self, skin: Any) -> FloatArray | None:
        """(V, 3) vertices of a skin in the world frame; None where its joints are not known."""
        names = list(skin.weight_joints)
        if not all(n in self.joints and n in skin.joint_matrices for n in names):
            self.dropped["a skin whose joints are not in the scene"] += 1
            return None
        shape = np.asarray(skin.bind_shape_matrix, dtype=np.float64)
        bones = np.stack([self.joints[n] @ skin.joint_matrices[n] @ shape for n in names])
        source = skin.geometry.primitives[0].vertex
        points = np.asarray(source, dtype=np.float64)
        counts = [len(j) for j in skin.joint_index]
        if len(counts) != len(points):
            return None
        vertex = np.repeat(np.arange(len(points)), counts)
        which = np.concatenate(skin.joint_index).astype(np.int64)
        share = np.asarray(skin.weights.data).reshape(-1)[np.concatenate(skin.weight_index)]
        bones_of = bones[np.maximum(which, 0)]
        moved = np.einsum("nij,nj->ni", bones_of[:, :3, :3], points[vertex]) + bones_of[:, :3, 3]
        out = np.zeros_like(points)
        np.add.at(out, vertex, share[:, None] * moved)
        total = np.bincount(vertex, share, minlength=len(points))
        free = total <= 0
        out[~free] /= total[~free, None]
        out[free] = points[free] @ shape[:3, :3].T + shape[:3, 3]
        return out

    def _material(self, bound: Any) -> tuple[int, int | None]:
        """Index of the material that a primitive is bound to, and its set of coordinates."""
        if bound is None or bound.target is None or bound.target.effect is None:
            return 0, None
        effect = bound.target.effect
        diffuse = effect.diffuse
        picture: Picture | None = None
        channel = None
        color = (1.0, 1.0, 1.0)
        if isinstance(diffuse, self.collada.material.Map):
            picture = self.pictures.named(str(diffuse.sampler.surface.image.path))
            channel = next(
                (s for semantic, _, s in bound.inputs if semantic == diffuse.texcoord), None
            )
            if picture is None:
                color = (0.7, 0.7, 0.7)
        elif diffuse is not None:
            color = tuple(float(c) for c in diffuse[:3])  # type: ignore[assignment]
        key = id(bound.target)
        if key not in self.known:
            self.known[key] = len(self.materials)
            self.materials.append(
                Material(
                    str(bound.target.name or bound.target.id or "material"),
                    (*color, self._alpha(effect)),
                    None if picture is None else picture.data,
                    None if picture is None else picture.kind,
                )
            )
        return self.known[key], channel

    def _alpha(self, effect: Any) -> float:
        """Opacity of an effect; one that would be invisible is an exporter's misreading."""
        told, share = effect.transparent, effect.transparency
        share = float(share) if isinstance(share, int | float) else 1.0
        if told is None or isinstance(told, self.collada.material.Map):
            return 1.0
        if effect.opaque_mode == self.collada.material.OPAQUE_MODE.RGB_ZERO:
            alpha = 1.0 - share * float(np.dot(told[:3], (0.2126, 0.7152, 0.0722)))
        else:
            alpha = share * float(told[3])
        return alpha if 0.0 < alpha <= 1.0 else 1.0

    def _gazebo(self) -> tuple[str, ...]:
        """Give all the one picture of colour in Gazebo's folder: its scripts bind it by name."""
        if not any(p.uv is not None for p in self.pieces):
            return ()
        name = self.pictures.only_color()
        picture = None if name is None else self.pictures.named(name)
        if picture is None:
            return ()
        self.materials = [
            Material(m.name, (1.0, 1.0, 1.0, m.base_color[3]), picture.data, picture.kind)
            for m in self.materials
        ]
        return (f"the file names no texture; {name} beside it is taken",)

    def _unique(self, name: str) -> str:
        self.names[name] = self.names.get(name, 0) + 1
        return name if self.names[name] == 1 else f"{name}.{self.names[name] - 1:03d}"


def _rgba(color: NDArray[Any]) -> NDArray[np.uint8]:
    out = np.full((len(color), 4), 255, np.uint8)
    width = min(color.shape[1], 4)
    out[:, :width] = np.clip(np.round(color[:, :width] * 255.0), 0, 255)
    return out
