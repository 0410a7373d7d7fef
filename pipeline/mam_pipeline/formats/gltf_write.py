"""Binary glTF 2.0 writing that keeps image bytes and texture coordinates as they are."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.formats.pictures import image_kind
from mam_pipeline.types import Material, Mesh

_MAGIC = b"glTF"
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def write_glb(mesh: Mesh, path: Path, up: Literal["y", "z"] = "y") -> None:
    """Write a mesh as binary glTF: a node per group, image bytes and float32 UVs untouched.

    Args:
        mesh: metres, Z up.
        path: file to write.
        up: "y" follows the specification (x, z, -y); "z" stores the coordinates as they are,
            which is what URDF loaders expect of a visual mesh.
    """
    path.write_bytes(glb_bytes(mesh, up))


def glb_bytes(mesh: Mesh, up: Literal["y", "z"] = "y") -> bytes:
    """What `write_glb` writes."""
    return _Writer(mesh, up).glb()


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
