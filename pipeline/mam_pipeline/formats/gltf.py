"""glTF 2.0 reading and writing that keeps image bytes and texture coordinates as they are.

General libraries decode and re-encode images and may reorder vertices; a part cut from an object
must keep the very texels of its source, so the few pages of the specification that static meshes
need are implemented here (Khronos glTF 2.0, sections 3.6 to 3.9; KHR_texture_transform).
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.soup import Budget, FileContent, Piece
from mam_pipeline.types import FloatArray, IntArray, Material, Mesh

_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_PACKED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization"}
_MAGIC = b"glTF"
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def read_gltf(path: Path, root: Path | None = None) -> FileContent:
    """Read every triangle of the default scene of a .glb or .gltf file, in its world frame.

    Raises:
        InputError: not glTF 2.0, truncated, compressed, or it reaches outside its folder.
    """
    try:
        return _Reader(path, Door(root or path.parent)).content()
    except InputError:
        raise
    except RecursionError as error:
        raise InputError(f"{path} is not valid glTF: its JSON is nested too deep") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, struct.error,
            np.linalg.LinAlgError) as error:  # fmt: skip
        what = f"{type(error).__name__}: {error}"
        raise InputError(f"{path} is not valid glTF ({what}); export it again") from error


class _Reader:
    """One file: its JSON, its buffers, and the pieces found on a walk over its nodes.

    Every buffer and image is read once, every node is visited once, and what all nodes draw
    together is bounded: the work is that of a file of the allowed size, however it is woven.
    """

    def __init__(self, path: Path, door: Door) -> None:
        self.path, self.door = path, door
        self.doc, self.binary = _split(path)
        packed = _PACKED & set(self.doc.get("extensionsRequired", ()))
        packed -= {"KHR_mesh_quantization"}
        if packed:
            raise InputError(
                f"{path} uses {sorted(packed)[0]}, which is not supported; "
                "export it again without compression"
            )
        self.buffers: dict[int, memoryview] = {}
        self.images: dict[int, bytes] = {}
        self.resources: dict[str, bytes] = {}
        self.budget = Budget(path)
        self.materials = [self._material(m) for m in self.doc.get("materials", ())]
        self.default_material = len(self.materials)
        self.pieces: list[Piece] = []
        self.names: dict[str, int] = {}

    def content(self) -> FileContent:
        nodes = self.doc.get("nodes", [])
        self.budget.nodes(len(nodes))
        scenes = self.doc.get("scenes")
        if scenes:
            roots = _at(scenes, self.doc.get("scene", 0)).get("nodes", [])
        else:
            children = {c for n in nodes for c in n.get("children", ())}
            roots = [i for i in range(len(nodes)) if i not in children]
        left = [(root, np.eye(4)) for root in reversed(roots)]
        seen: set[int] = set()
        while left:
            index, parent = left.pop()
            node = _at(nodes, index)
            if index in seen:
                raise InputError(
                    f"{self.path} is not valid glTF: node {index} is reached twice (a node has "
                    "one parent); export it again"
                )
            seen.add(index)
            world = parent @ _local(node)
            self._draw(node, index, world)
            left += [(child, world) for child in reversed(node.get("children", ()))]
        materials = [*self.materials, Material()]
        # the specification fixes both: +Y is up, the unit is the metre
        return FileContent(tuple(self.pieces), tuple(materials), "y", 1.0)

    def _draw(self, node: dict[str, Any], index: int, world: FloatArray) -> None:
        """Add the triangles of a node's own mesh."""
        if "mesh" not in node:
            return
        mesh = _at(self.doc["meshes"], node["mesh"])
        name = self._unique(str(node.get("name") or mesh.get("name") or f"node_{index}"))
        for primitive in mesh["primitives"]:
            self._primitive(primitive, world, name)

    def _unique(self, name: str) -> str:
        self.names[name] = self.names.get(name, 0) + 1
        return name if self.names[name] == 1 else f"{name}.{self.names[name] - 1:03d}"

    def _primitive(self, primitive: dict[str, Any], world: FloatArray, group: str) -> None:
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6):  # points and lines have no surface
            return
        attributes = primitive["attributes"]
        vertices = self._accessor(attributes["POSITION"], "VEC3").astype(np.float64)
        if "indices" in primitive:
            found = self._accessor(primitive["indices"], "SCALAR")
            if found.dtype.kind not in "iu":
                raise InputError(f"{self.path} is not valid glTF: its indices are no integers")
            indices = found.reshape(-1).astype(np.int64)
        else:
            indices = np.arange(len(vertices))
        faces = _triangles(indices, mode)
        self.budget.triangles(len(vertices), len(faces))
        if np.linalg.det(world[:3, :3]) < 0:
            faces = faces[:, ::-1]
        material = primitive.get("material", self.default_material)
        colors = None
        if "COLOR_0" in attributes:
            colors = _bytes_rgba(self._accessor(attributes["COLOR_0"], "VEC3 VEC4", True))
        self.pieces.append(
            Piece(
                vertices @ world[:3, :3].T + world[:3, 3],
                faces,
                group,
                material,
                self._uv(attributes, material),
                colors,
            )
        )

    def _uv(self, attributes: dict[str, int], material: int) -> NDArray[np.float32] | None:
        texture: dict[str, Any] = {}
        if material < self.default_material:
            texture = _color_texture(_at(self.doc["materials"], material))
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        channel = transform.get("texCoord", texture.get("texCoord", 0))
        if f"TEXCOORD_{channel}" not in attributes:
            return None
        found = self._accessor(attributes[f"TEXCOORD_{channel}"], "VEC2", True)
        uv = found.astype(np.float32)
        if transform:
            turn, scale = transform.get("rotation", 0.0), transform.get("scale", [1, 1])
            c, s = np.cos(turn), np.sin(turn)
            matrix = np.array([[c, s], [-s, c]]) * np.asarray(scale, float)
            uv = (uv @ matrix.T + transform.get("offset", [0, 0])).astype(np.float32)
        return uv

    def _material(self, raw: dict[str, Any]) -> Material:
        pbr = raw.get("pbrMetallicRoughness", {})
        gloss = raw.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
        color = pbr.get("baseColorFactor") or gloss.get("diffuseFactor") or (1, 1, 1, 1)
        image = None
        texture = _color_texture(raw)
        if texture:
            image = self._image(texture["index"])
        return Material(
            name=str(raw.get("name") or "material"),
            base_color=tuple(float(c) for c in color),  # type: ignore[arg-type]
            image=image,
            image_format=None if image is None else image_kind(image),
            metallic=float(pbr.get("metallicFactor", 0.0 if gloss else 1.0)),
            roughness=float(pbr.get("roughnessFactor", 1.0)),
        )

    def _image(self, texture: int) -> bytes | None:
        source = _at(self.doc["textures"], texture).get("source")
        if source is None:  # only an extension's format (WebP, KTX2) is offered
            return None
        if source not in self.images:
            image = _at(self.doc["images"], source)
            if "bufferView" in image:
                self.images[source] = bytes(self._view(image["bufferView"]))
            else:
                self.images[source] = self._resource(image["uri"])
        return self.images[source]

    def _resource(self, uri: str) -> bytes:
        """Bytes behind a data: URI or a file that the door opens; each is read once."""
        if uri not in self.resources:
            self.resources[uri] = _resource(self.path, uri, self.budget, self.door)
        return self.resources[uri]

    def _view(self, index: int) -> memoryview:
        view = _at(self.doc["bufferViews"], index)
        buffer, start, length = view["buffer"], view.get("byteOffset", 0), view["byteLength"]
        if buffer not in self.buffers:
            uri = _at(self.doc["buffers"], buffer).get("uri")
            data = self.binary if uri is None else self._resource(uri)
            self.buffers[buffer] = memoryview(data)
        if start < 0 or length < 0 or start + length > len(self.buffers[buffer]):
            raise InputError(f"{self.path} is cut short: its buffer ends before its data")
        return self.buffers[buffer][start : start + length]

    def _accessor(self, index: int, kinds: str, normalise: bool = False) -> NDArray[Any]:
        """An array (count, width), checked against its buffer before anything is allocated.

        Args:
            index: of the accessor. kinds: the types that make sense here, separated by spaces.
            normalise: integers as shares of their largest value.
        """
        accessor = _at(self.doc["accessors"], index)
        if "sparse" in accessor:
            raise InputError(f"{self.path} uses sparse accessors, which are not supported")
        kind, count = accessor["type"], accessor["count"]
        if kind not in kinds.split():
            raise InputError(
                f"{self.path} is not valid glTF: accessor {index} is of type {kind!r}, not {kinds}"
            )
        dtype, width = np.dtype(_DTYPES[accessor["componentType"]]), _WIDTHS[kind]
        if "bufferView" not in accessor:
            raise InputError(f"{self.path} is not valid glTF: accessor {index} has no data")
        data = self._view(accessor["bufferView"])
        stride = self.doc["bufferViews"][accessor["bufferView"]].get("byteStride", 0)
        stride = stride or width * dtype.itemsize
        start = accessor.get("byteOffset", 0)
        if start < 0 or stride < dtype.itemsize or count < 0:
            raise InputError(f"{self.path} is not valid glTF: accessor {index} is out of place")
        if count and start + (count - 1) * stride + width * dtype.itemsize > len(data):
            raise InputError(f"{self.path} is cut short: an array ends before its data")
        out: NDArray[Any] = np.ndarray(
            (count, width), dtype, data, start, (stride, dtype.itemsize)
        ).copy()
        if (normalise or accessor.get("normalized")) and dtype.kind in "iu":
            return np.maximum(out / np.iinfo(dtype).max, -1.0)
        return out


def write_glb(mesh: Mesh, path: Path, up: Literal["y", "z"] = "y") -> None:
    """Write a mesh as binary glTF: a node per group, image bytes and float32 UVs untouched.

    Args:
        mesh: metres, Z up.
        path: file to write.
        up: "y" follows the specification (x, z, -y); "z" stores the coordinates as they are,
            which is what URDF loaders expect of a visual mesh.
    """
    writer = _Writer(mesh, up)
    path.write_bytes(writer.glb())


class _Writer:
    """Collects buffer views and accessors while the groups of a mesh are written."""

    def __init__(self, mesh: Mesh, up: str) -> None:
        self.mesh, self.up = mesh, up
        self.blob = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.images: dict[bytes, int] = {}
        self.doc: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "mam-sim"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
        }
        self.doc["materials"] = [self._material(m) for m in mesh.materials]

    def glb(self) -> bytes:
        mesh = self.mesh
        assert mesh.face_group is not None and mesh.face_material is not None
        for group in np.unique(mesh.face_group):
            name = mesh.group_names[group]
            primitives = []
            inside = mesh.face_group == group
            for material in np.unique(mesh.face_material[inside]):
                part = mesh.submesh(inside & (mesh.face_material == material))
                primitives.append(self._primitive(part, int(material)))
            self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]))
            self.doc["nodes"].append({"name": name, "mesh": len(self.doc["meshes"])})
            self.doc["meshes"].append({"name": name, "primitives": primitives})
        self.doc["bufferViews"], self.doc["accessors"] = self.views, self.accessors
        self.doc["buffers"] = [{"byteLength": len(self.blob)}]
        if self.images:
            self.doc["textures"] = [{"source": i} for i in range(len(self.images))]
        text = json.dumps(self.doc, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(self.blob)
        head = struct.pack("<4sII", _MAGIC, 2, total)
        chunk = struct.pack("<II", len(text), _JSON) + text
        return head + chunk + struct.pack("<II", len(self.blob), _BIN) + bytes(self.blob)

    def _primitive(self, part: Mesh, material: int) -> dict[str, Any]:
        v = part.vertices
        if self.up == "y":
            v = np.stack([v[:, 0], v[:, 2], -v[:, 1]], axis=1)
        attributes = {"POSITION": self._array(v.astype("<f4"), "VEC3", 34962, bounds=True)}
        if part.uv is not None:
            attributes["TEXCOORD_0"] = self._array(part.uv.astype("<f4"), "VEC2", 34962)
        if part.colors is not None:
            attributes["COLOR_0"] = self._array(part.colors, "VEC4", 34962, normalized=True)
        indices = self._array(part.faces.reshape(-1, 1).astype("<u4"), "SCALAR", 34963)
        return {"attributes": attributes, "indices": indices, "material": material}

    def _array(self, array: NDArray[Any], kind: str, target: int, **extra: Any) -> int:
        code = {"f4": 5126, "u4": 5125, "u1": 5121}[array.dtype.str[1:]]
        accessor: dict[str, Any] = {
            "bufferView": self._add(array.tobytes(), target),
            "componentType": code,
            "count": len(array),
            "type": kind,
        }
        if extra.pop("bounds", False):
            accessor["min"] = array.min(axis=0).tolist()
            accessor["max"] = array.max(axis=0).tolist()
        self.accessors.append({**accessor, **extra})
        return len(self.accessors) - 1

    def _add(self, data: bytes, target: int | None = None) -> int:
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self.views.append(view)
        self.blob += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def _material(self, material: Material) -> dict[str, Any]:
        pbr: dict[str, Any] = {
            "baseColorFactor": list(material.base_color),
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        }
        if material.image is not None:
            if material.image not in self.images:
                self.images[material.image] = len(self.images)
                kind = material.image_format or image_kind(material.image) or "png"
                entry = {"bufferView": self._add(material.image), "mimeType": f"image/{kind}"}
                self.doc.setdefault("images", []).append(entry)
            pbr["baseColorTexture"] = {"index": self.images[material.image]}
        out: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": pbr}
        out["doubleSided"] = True  # open shells and zero-thickness sheets stay visible
        if material.base_color[3] < 1.0:
            out["alphaMode"] = "BLEND"
        return out


def image_kind(data: bytes) -> Literal["png", "jpeg"] | None:
    """Tell PNG and JPEG by their first bytes; None for anything else."""
    if data.startswith(b"\x89PNG"):
        return "png"
    return "jpeg" if data.startswith(b"\xff\xd8") else None


def _split(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON document and the binary chunk of a .glb or .gltf file."""
    data = path.read_bytes()
    binary = b""
    if data[:4] == _MAGIC:
        version, total = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise InputError(f"{path} is glTF version {version}; version 2 is supported")
        if total > len(data):
            raise InputError(f"{path} is cut short: {len(data)} of {total} bytes are there")
        offset, text = 12, b""
        while offset + 8 <= total:
            length, kind = struct.unpack_from("<II", data, offset)
            chunk = data[offset + 8 : offset + 8 + length]
            if kind == _JSON:
                text = chunk
            elif kind == _BIN:
                binary = chunk
            offset += 8 + length
    elif data.lstrip()[:1] == b"{":
        text = data
    else:
        raise InputError(f"{path} is not a glTF file: it begins with {data[:12]!r}")
    try:
        doc = json.loads(text)
    except ValueError as error:  # no JSON, or no text
        raise InputError(f"{path} is not valid glTF: its JSON cannot be read ({error})") from error
    if not isinstance(doc, dict) or "asset" not in doc:
        raise InputError(f"{path} is not a glTF file: it has no asset entry")
    return doc, binary


def _resource(path: Path, uri: str, budget: Budget, door: Door) -> bytes:
    """Bytes behind a data: URI or a file that the door opens."""
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    file = door.find(unquote(uri), path)
    if file is None:
        raise InputError(f"{path} needs {uri!r}, which is missing")
    return budget.read(file)


def _at(rows: Any, index: Any) -> Any:
    """Entry of a list of the document; a negative index counts from no end here."""
    if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(rows):
        raise IndexError(f"there is no entry {index!r}")
    return rows[index]


def _color_texture(material: dict[str, Any]) -> dict[str, Any]:
    pbr = material.get("pbrMetallicRoughness", {})
    gloss = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    return pbr.get("baseColorTexture") or gloss.get("diffuseTexture") or {}


def _local(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    out = np.eye(4)
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
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
    n = np.arange(max(len(indices) - 2, 0))
    if mode == 6:
        return np.stack([np.full(len(n), indices[0]), indices[n + 1], indices[n + 2]], axis=1)
    odd = n % 2 == 1  # every second triangle of a strip is wound the other way
    first, second = np.where(odd, n + 1, n), np.where(odd, n, n + 1)
    return np.stack([indices[first], indices[second], indices[n + 2]], axis=1)


def _bytes_rgba(color: NDArray[Any]) -> NDArray[np.uint8]:
    out = np.full((len(color), 4), 255, np.uint8)
    out[:, : color.shape[1]] = np.clip(np.round(color * 255.0), 0, 255).astype(np.uint8)
    return out
