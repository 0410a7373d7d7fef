"""glTF 2.0 reading: the triangles that a scene shows at rest, with image bytes as they are.

General libraries decode and re-encode images and may reorder vertices; a part cut from an object
must keep the very texels of its source, so what a still object needs of the specification is
implemented here (Khronos glTF 2.0, section 3; EXT_mesh_gpu_instancing, KHR_texture_transform,
KHR_texture_basisu, EXT_texture_webp). Skins stand in the pose of their joints, and morph targets
at their weights. `gltf_data` unpacks the arrays, `gltf_write` writes.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.gltf_data import Document, shares
from mam_pipeline.formats.gltf_scene import scene_of
from mam_pipeline.formats.pictures import Picture, Pictures, model_door
from mam_pipeline.formats.soup import Budget, FileContent, Piece
from mam_pipeline.types import FloatArray, IntArray, Material

_COLOR = "VEC3 VEC4"
_OTHER_IMAGES = (
    "KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds",
)  # fmt: skip
_READ = {
    "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression",
    "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_texture_transform",
    "KHR_materials_pbrSpecularGlossiness", "KHR_materials_unlit", *_OTHER_IMAGES,
}  # fmt: skip
_LOOKS = {
    "normalTexture": "normal maps",
    "occlusionTexture": "occlusion maps",
    "emissiveTexture": "emissive maps",
}


def read_gltf(path: Path, root: Path | None = None) -> FileContent:
    """Read every triangle of the default scene of a .glb or .gltf file, in its world frame.

    Args:
        root: folder whose files it may name; default: its own.

    Raises:
        InputError: not glTF 2.0, truncated, packed in a way that cannot be unpacked here, or its
            data lie outside its folder.
    """
    try:
        return _Reader(path, root).content()
    except InputError:
        raise
    except RecursionError as error:
        raise InputError(f"{path} is not valid glTF: its JSON is nested too deep") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, struct.error,
            np.linalg.LinAlgError) as error:  # fmt: skip
        what = f"{type(error).__name__}: {error}"
        raise InputError(f"{path} is not valid glTF ({what}); export it again") from error


@dataclass(frozen=True)
class _Surface:
    """A primitive in its mesh's own frame: arrays by vertex, triangles, material."""

    vertices: FloatArray
    faces: IntArray
    material: int
    uv: NDArray[np.float32] | None
    colors: NDArray[np.uint8] | None


class _Reader:
    """One file: its data, and the pieces found on a walk over its nodes.

    Every buffer and image is read once, every node is visited once, and what all nodes draw
    together is bounded: the work is that of a file of the allowed size, however it is woven.
    """

    def __init__(self, path: Path, root: Path | None) -> None:
        self.path = path
        self.budget = Budget(path)
        self.data = Document(path, self.budget, Door(root or path.parent))
        self.doc = self.data.doc
        self.pictures = Pictures(path, self.budget, model_door(path, root))
        self.dropped: Counter[str] = Counter()
        self.images: dict[int, Picture | None] = {}
        self.materials = [self._material(m) for m in self.data.rows("materials")]
        self.default_material = len(self.materials)
        self.pieces: list[Piece] = []
        self.names: dict[str, int] = {}
        self.groups: dict[int, str] = {}
        self.drawn = 0

    def content(self) -> FileContent:
        nodes = self.data.rows("nodes")
        self.budget.nodes(len(nodes))
        roots, notes = self._scene(nodes)
        worlds = self._worlds(nodes)
        for index in self._below(roots, nodes):
            self._draw(nodes[index], index, worlds)
        materials = [*self.materials, Material()]
        notes += self.pictures.notes()
        if self.dropped:
            notes += ("not taken over: " + ", ".join(sorted(self.dropped)),)
        unknown = sorted(set(self.data.rows("extensionsRequired")) - _READ)
        if unknown:
            notes += (f"the file needs {', '.join(unknown)}, which is not read: compare the look",)
        # the specification fixes both: +Y is up, the unit is the metre
        scene = scene_of(self.data, worlds, self.groups)
        return FileContent(tuple(self.pieces), tuple(materials), "y", 1.0, notes, scene)

    def _scene(self, nodes: list[Any]) -> tuple[list[int], tuple[str, ...]]:
        """Root nodes of the scene that is read, and what is said where there are several."""
        scenes = self.data.rows("scenes")
        if not scenes:
            children = {c for n in nodes for c in n.get("children", ())}
            return [i for i in range(len(nodes)) if i not in children], ()
        chosen = self.doc.get("scene", 0)
        roots: list[int] = self.data.at("scenes", chosen).get("nodes", [])
        others = [s for i, s in enumerate(scenes) if i != chosen and s.get("nodes")]
        if not others:
            return roots, ()
        names = ", ".join(str(s.get("name") or "unnamed") for s in others[:5])
        own = scenes[chosen].get("name") or f"number {chosen}"
        return roots, (f"of {len(others) + 1} scenes {own} is read, not: {names}",)

    def _worlds(self, nodes: list[Any]) -> list[FloatArray]:
        """(4, 4) of every node in the world frame; a node that is reached twice is refused."""
        children = {c for n in nodes for c in n.get("children", ())}
        out: list[FloatArray | None] = [None] * len(nodes)
        left = [(i, np.eye(4)) for i in range(len(nodes)) if i not in children]
        while left:
            index, parent = left.pop()
            node = self.data.at("nodes", index)
            if out[index] is not None:
                raise InputError(
                    f"{self.path} is not valid glTF: node {index} is reached twice (a node has "
                    "one parent); export it again"
                )
            world = parent @ _local(node)
            out[index] = world
            left += [(child, world) for child in node.get("children", ())]
        if any(world is None for world in out):
            raise InputError(
                f"{self.path} is not valid glTF: its nodes form a loop, one is reached twice; "
                "export it again"
            )
        return [world for world in out if world is not None]

    def _below(self, roots: list[int], nodes: list[Any]) -> Iterable[int]:
        """Nodes of a scene, parents first, children in their order."""
        left = list(reversed(roots))
        seen: set[int] = set()
        while left:
            index = left.pop()
            self.data.at("nodes", index)
            if index in seen:
                raise InputError(
                    f"{self.path} is not valid glTF: node {index} is reached twice; export it again"
                )
            seen.add(index)
            yield index
            left += reversed(nodes[index].get("children", ()))

    def _draw(self, node: dict[str, Any], index: int, worlds: list[FloatArray]) -> None:
        """Add the triangles of a node's own mesh, once for each of its instances."""
        if "mesh" not in node:
            return
        mesh = self.data.at("meshes", node["mesh"])
        weights = node.get("weights", mesh.get("weights", ()))
        base = str(node.get("name") or mesh.get("name") or f"node_{index}")
        places = self._instances(node, worlds[index])
        surfaces = [self._surface(p, weights) for p in mesh["primitives"]]
        for place in places:
            self.drawn += 1
            self.budget.nodes(self.drawn)
            name = self._unique(base)
            self.groups.setdefault(index, name)
            for primitive, surface in zip(mesh["primitives"], surfaces):
                if surface is None:
                    continue
                self.budget.triangles(len(surface.vertices), len(surface.faces))
                vertices, mirrored = surface.vertices, np.linalg.det(place[:3, :3]) < 0
                if "skin" in node:
                    vertices, mirrored = self._posed(primitive, vertices, node["skin"], worlds)
                else:
                    vertices = vertices @ place[:3, :3].T + place[:3, 3]
                faces = surface.faces[:, ::-1] if mirrored else surface.faces
                self.pieces.append(
                    Piece(vertices, faces, name, surface.material, surface.uv, surface.colors)
                )

    def _instances(self, node: dict[str, Any], world: FloatArray) -> list[FloatArray]:
        """(4, 4) of every place where a node's mesh stands (EXT_mesh_gpu_instancing)."""
        told = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes")
        if not told:
            return [world]
        kinds = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
        found = {
            k: self.data.accessor(told[k], kind).astype(np.float64)
            for k, kind in kinds.items() if k in told
        }  # fmt: skip
        count = min((len(v) for v in found.values()), default=0)
        self.budget.nodes(self.drawn + count)
        return [world @ _local({k.lower(): v[i] for k, v in found.items()}) for i in range(count)]

    def _unique(self, name: str) -> str:
        self.names[name] = self.names.get(name, 0) + 1
        return name if self.names[name] == 1 else f"{name}.{self.names[name] - 1:03d}"

    def _surface(self, primitive: dict[str, Any], weights: Iterable[float]) -> _Surface | None:
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6):  # points and lines have no surface
            self.dropped["points and lines"] += 1
            return None
        unpacked = self.data.draco(primitive)
        corners, arrays = (None, {}) if unpacked is None else unpacked
        attributes = primitive["attributes"]

        def array(name: str, kinds: str, normalise: bool = False) -> NDArray[Any]:
            if name in arrays:
                return arrays[name]
            return self.data.accessor(attributes[name], kinds, normalise)

        vertices = array("POSITION", "VEC3").astype(np.float64)
        if corners is not None:
            indices = corners
            mode = 4  # Draco holds triangles, whatever they were packed from
        elif "indices" in primitive:
            found = self.data.accessor(primitive["indices"], "SCALAR")
            if found.dtype.kind not in "iu":
                raise InputError(f"{self.path} is not valid glTF: its indices are no integers")
            indices = found.reshape(-1).astype(np.int64)
        else:
            indices = np.arange(len(vertices))
        for weight, target in zip(weights, primitive.get("targets", ())):
            if weight and "POSITION" in target:
                self.budget.triangles(len(vertices), 0)
                vertices = vertices + float(weight) * self.data.accessor(target["POSITION"], "VEC3")
        material = primitive.get("material", self.default_material)
        colors = None
        if "COLOR_0" in attributes:
            colors = _bytes_rgba(array("COLOR_0", _COLOR, True))
        uv = None
        channel, transform = self._mapping(material)
        if channel in attributes:
            uv = _moved(array(channel, "VEC2", True), transform)
        return _Surface(vertices, _triangles(indices, mode), material, uv, colors)

    def _posed(
        self, primitive: dict[str, Any], points: FloatArray, skin: int, worlds: list[FloatArray]
    ) -> tuple[FloatArray, bool]:
        """Points in the world frame as the joints of their skin stand, and whether mirrored.

        The node's own transform does not count (glTF 2.0, 3.7.3.3).
        """
        told = self.data.at("skins", skin)
        joints = [worlds[j] for j in told["joints"]]
        if "inverseBindMatrices" in told:
            inverse = self.data.accessor(told["inverseBindMatrices"], "MAT4")
            inverse = inverse.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
            joints = [j @ b for j, b in zip(joints, inverse)]
        bones = np.stack(joints)
        out, total = np.zeros((len(points), 3)), np.zeros(len(points))
        for k in range(8):
            if f"JOINTS_{k}" not in primitive["attributes"]:
                break
            which = self._skin_array(primitive, f"JOINTS_{k}", False)
            share = self._skin_array(primitive, f"WEIGHTS_{k}", True)
            if which.max(initial=0) >= len(bones) or len(which) != len(points):
                raise InputError(f"{self.path} is not valid glTF: a skin names no such joint")
            for joint, weight in zip(which.T.astype(np.int64), share.T):
                used = weight > 0
                m = bones[joint[used]]
                moved = np.einsum("nij,nj->ni", m[:, :3, :3], points[used]) + m[:, :3, 3]
                out[used] += weight[used, None] * moved
                total[used] += weight[used]
        free = total <= 0
        out[~free] /= total[~free, None]
        out[free] = points[free] @ bones[0][:3, :3].T + bones[0][:3, 3]
        return out, bool(np.median(np.linalg.det(bones[:, :3, :3])) < 0)

    def _skin_array(self, primitive: dict[str, Any], name: str, share: bool) -> NDArray[Any]:
        unpacked = self.data.draco(primitive)
        if unpacked is not None and name in unpacked[1]:
            return shares(unpacked[1][name]) if share else unpacked[1][name]
        return self.data.accessor(primitive["attributes"][name], "VEC4", share)

    def _mapping(self, material: int) -> tuple[str, dict[str, Any]]:
        """Name of the texture coordinates that a material uses, and their transform."""
        texture: dict[str, Any] = {}
        if material < self.default_material:
            texture = _color_texture(self.data.at("materials", material))
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        return f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}", transform

    def _material(self, raw: dict[str, Any]) -> Material:
        pbr = raw.get("pbrMetallicRoughness", {})
        gloss = raw.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
        color = pbr.get("baseColorFactor") or gloss.get("diffuseFactor") or (1, 1, 1, 1)
        r, g, b, a = (float(c) for c in color)
        if raw.get("alphaMode", "OPAQUE") == "OPAQUE":
            a = 1.0  # the specification ignores it then
        texture = _color_texture(raw)
        picture = self._image(texture["index"]) if texture else None
        for key, what in _LOOKS.items():
            self.dropped.update([what] if key in raw else [])
        self.dropped.update(["roughness maps"] if "metallicRoughnessTexture" in pbr else [])
        return Material(
            name=str(raw.get("name") or "material"),
            base_color=(r, g, b, a),
            image=None if picture is None else picture.data,
            image_format=None if picture is None else picture.kind,
            metallic=float(pbr.get("metallicFactor", 0.0 if gloss else 1.0)),
            roughness=float(pbr.get("roughnessFactor", 1.0)),
        )

    def _image(self, texture: int) -> Picture | None:
        """The picture of a texture: PNG or JPEG where there is one, else what extensions offer."""
        told = self.data.at("textures", texture)
        more = told.get("extensions", {})
        sources = [told.get("source"), *(more.get(e, {}).get("source") for e in _OTHER_IMAGES)]
        for source in sources:
            if source is None:
                continue
            if source not in self.images:
                self.images[source] = self._read_image(source)
            if self.images[source] is not None:
                return self.images[source]
        return None

    def _read_image(self, index: int) -> Picture | None:
        image = self.data.at("images", index)
        name = str(image.get("name") or f"image {index}")
        if "bufferView" in image:
            return self.pictures.decoded(bytes(self.data.view(image["bufferView"])), name)
        if image["uri"].startswith("data:"):
            return self.pictures.decoded(self.data.resource(image["uri"]), name)
        return self.pictures.named(image["uri"])


def _color_texture(material: dict[str, Any]) -> dict[str, Any]:
    pbr = material.get("pbrMetallicRoughness", {})
    gloss = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    return pbr.get("baseColorTexture") or gloss.get("diffuseTexture") or {}


def _moved(uv: NDArray[Any], transform: dict[str, Any]) -> NDArray[np.float32]:
    """Texture coordinates after KHR_texture_transform; v points down, so a turn looks reversed."""
    if transform:
        turn, scale = transform.get("rotation", 0.0), transform.get("scale", [1, 1])
        c, s = np.cos(turn), np.sin(turn)
        matrix = np.array([[c, s], [-s, c]]) * np.asarray(scale, float)
        uv = uv @ matrix.T + transform.get("offset", [0, 0])
    return uv.astype(np.float32)


def _local(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    out = np.eye(4)
    quaternion = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    length = float(np.linalg.norm(quaternion))
    x, y, z, w = quaternion / length if length > 0 else (0.0, 0.0, 0.0, 1.0)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    out[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    out[:3, 3] = node.get("translation", (0, 0, 0))
    return out


def _triangles(indices: IntArray, mode: int) -> IntArray:
    if mode == 4:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if len(indices) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    n = np.arange(len(indices) - 2)
    if mode == 6:
        return np.stack([np.full(len(n), indices[0]), indices[n + 1], indices[n + 2]], axis=1)
    odd = n % 2 == 1  # every second triangle of a strip is wound the other way
    first, second = np.where(odd, n + 1, n), np.where(odd, n, n + 1)
    return np.stack([indices[first], indices[second], indices[n + 2]], axis=1)


def _bytes_rgba(color: NDArray[Any]) -> NDArray[np.uint8]:
    out = np.full((len(color), 4), 255, np.uint8)
    out[:, : color.shape[1]] = np.clip(np.round(color * 255.0), 0, 255).astype(np.uint8)
    return out
