"""Writes small glTF files by hand, feature by feature, for tests of the reader."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A document under construction: `doc` is its JSON, `add` puts an array into its buffer."""

    def __init__(self) -> None:
        self.blob = bytearray()
        self.doc: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [],
            "meshes": [], "accessors": [], "bufferViews": [],
        }  # fmt: skip

    def view(self, data: bytes, **more: Any) -> int:
        self.blob += b"\0" * (-len(self.blob) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more}
        self.blob += data
        self.doc["bufferViews"].append(entry)
        return len(self.doc["bufferViews"]) - 1

    def accessor(self, array: np.ndarray, view: int | None, **more: Any) -> int:
        width = 1 if array.ndim == 1 else array.shape[1]
        entry = {
            "componentType": CODES[array.dtype.str[1:]], "count": len(array), "type": KINDS[width],
            **({} if view is None else {"bufferView": view}), **more,
        }  # fmt: skip
        self.doc["accessors"].append(entry)
        return len(self.doc["accessors"]) - 1

    def add(self, array: np.ndarray, **more: Any) -> int:
        """Put an array into the buffer; its accessor."""
        return self.accessor(array, self.view(array.tobytes()), **more)

    def mesh(self, primitive: dict[str, Any], **more: Any) -> int:
        self.doc["meshes"].append({"primitives": [primitive], **more})
        return len(self.doc["meshes"]) - 1

    def node(self, root: bool = True, **fields: Any) -> int:
        self.doc["nodes"].append(fields)
        index = len(self.doc["nodes"]) - 1
        if root:
            self.doc["scenes"][0]["nodes"].append(index)
        return index

    def save(self, path: Path) -> Path:
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
        self.doc["buffers"] = [{"byteLength": len(self.blob), "uri": uri}]
        path.write_text(json.dumps(self.doc))
        return path
