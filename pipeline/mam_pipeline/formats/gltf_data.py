"""The data of a glTF 2.0 file: its JSON, buffers, views and accessors, packed ones unpacked.

Khronos glTF 2.0, sections 3.5 and 3.6; EXT_meshopt_compression, KHR_draco_mesh_compression,
KHR_mesh_quantization. Every buffer and view is read once, and nothing is allocated before it was
held against what the file holds.
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.soup import LIMITS, Budget
from mam_pipeline.optional import has, install_command
from mam_pipeline.types import IntArray

_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_MAGIC = b"glTF"
_JSON, _BIN = 0x4E4F534A, 0x004E4942


class Document:
    """One file: its JSON in `doc`, and the arrays that it describes."""

    def __init__(self, path: Path, budget: Budget, door: Door) -> None:
        self.path, self.budget, self.door = path, budget, door
        self.doc, self._binary = _split(path)
        self._buffers: dict[int, memoryview] = {}
        self._views: dict[int, memoryview] = {}
        self._resources: dict[str, bytes] = {}
        self._draco: dict[int, Any] = {}

    def rows(self, name: str) -> list[Any]:
        """A list of the document; empty where it has none."""
        found = self.doc.get(name) or []
        if not isinstance(found, list):
            raise InputError(f"{self.path} is not valid glTF: {name!r} is no list")
        return found

    def at(self, name: str, index: Any) -> dict[str, Any]:
        """Entry of a list of the document; a negative index counts from no end here."""
        rows = self.rows(name)
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(rows):
            raise IndexError(f"there is no entry {index!r} in {name}")
        entry: dict[str, Any] = rows[index]
        return entry

    def resource(self, uri: str) -> bytes:
        """Bytes behind a data: URI or a file that the door opens; each is read once."""
        if uri not in self._resources:
            self._resources[uri] = _resource(self.path, uri, self.budget, self.door)
        return self._resources[uri]

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view, unpacked where they are packed."""
        if index not in self._views:
            view = self.at("bufferViews", index)
            packed = _extension(view, *_MESHOPT)
            if packed is None:
                self._views[index] = self._slice(view)
            elif has("meshopt"):
                self._views[index] = self._unpacked(packed)
            elif "fallback" in self._uriless(view):
                raise InputError(
                    f"{self.path} is packed with {_MESHOPT[0]}; to read it: "
                    f"{install_command('meshopt')}"
                )
            else:
                self._views[index] = self._slice(view)
        return self._views[index]

    def _uriless(self, view: dict[str, Any]) -> str:
        """ "fallback" for a buffer that holds no bytes, since all its views are packed."""
        buffer = self.at("buffers", view["buffer"])
        own = _extension(buffer, *_MESHOPT) or {}
        empty = "uri" not in buffer and (view["buffer"] != 0 or not self._binary)
        return "fallback" if own.get("fallback") or empty else ""

    def _slice(self, view: dict[str, Any]) -> memoryview:
        buffer, start, length = view["buffer"], view.get("byteOffset", 0), view["byteLength"]
        if buffer not in self._buffers:
            uri = self.at("buffers", buffer).get("uri")
            self._buffers[buffer] = memoryview(self._binary if uri is None else self.resource(uri))
        if start < 0 or length < 0 or start + length > len(self._buffers[buffer]):
            raise InputError(f"{self.path} is cut short: its buffer ends before its data")
        return self._buffers[buffer][start : start + length]

    def _unpacked(self, packed: dict[str, Any]) -> memoryview:
        """EXT_meshopt_compression: `count` rows of `byteStride` bytes."""
        import meshopt

        count, stride = packed["count"], packed["byteStride"]
        if count < 0 or stride <= 0 or count * stride > LIMITS.bytes:
            raise InputError(f"{self.path} unpacks to {count} x {stride} bytes; simplify it")
        data = bytes(self._slice(packed))
        try:
            rows = meshopt.decode_gltf_buffer(
                data, count, stride, packed["mode"], packed.get("filter", "NONE")
            )
        except Exception as error:
            raise InputError(
                f"{self.path}: its {_MESHOPT[0]} cannot be unpacked ({error}); export it again"
            ) from error
        return memoryview(np.ascontiguousarray(rows).tobytes())

    def accessor(self, index: int, kinds: str, normalise: bool = False) -> NDArray[Any]:
        """An array (count, width), checked against its buffer before anything is allocated.

        Args:
            index: of the accessor. kinds: the types that make sense here, separated by spaces.
            normalise: integers as shares of their largest value, also if the file does not say so.
        """
        accessor = self.at("accessors", index)
        kind, count = accessor["type"], accessor["count"]
        if kind not in kinds.split():
            raise InputError(
                f"{self.path} is not valid glTF: accessor {index} is of type {kind!r}, not {kinds}"
            )
        dtype, width = np.dtype(_DTYPES[accessor["componentType"]]), _WIDTHS[kind]
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            out = self._array(accessor, accessor["componentType"], width, count)
        elif sparse is not None and 0 <= count <= LIMITS.vertices:
            out = np.zeros((count, width), dtype)
        else:
            raise InputError(f"{self.path} is not valid glTF: accessor {index} has no data")
        if sparse is not None:
            told = sparse["indices"]
            where = self._array(told, told["componentType"], 1, sparse["count"]).reshape(-1)
            if len(where) and (where.dtype.kind not in "iu" or where.max() >= count):
                raise InputError(f"{self.path} is not valid glTF: accessor {index} is out of place")
            out[where] = self._array(
                sparse["values"], accessor["componentType"], width, sparse["count"]
            )
        return shares(out) if normalise or accessor.get("normalized") else out

    def _array(self, told: dict[str, Any], component: int, width: int, count: int) -> NDArray[Any]:
        """A copy of `count` rows that lie in a buffer view."""
        dtype = np.dtype(_DTYPES[component])
        data = self.view(told["bufferView"])
        view = self.at("bufferViews", told["bufferView"])
        packed = _extension(view, *_MESHOPT) if has("meshopt") else None
        stride = (packed or view).get("byteStride", 0) or width * dtype.itemsize
        start = told.get("byteOffset", 0)
        if start < 0 or stride < dtype.itemsize or count < 0:
            raise InputError(f"{self.path} is not valid glTF: an array is out of place")
        if count and start + (count - 1) * stride + width * dtype.itemsize > len(data):
            raise InputError(f"{self.path} is cut short: an array ends before its data")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize)).copy()

    def draco(self, primitive: dict[str, Any]) -> tuple[IntArray, dict[str, NDArray[Any]]] | None:
        """Corner indices and attributes of a primitive with KHR_draco_mesh_compression.

        Returns:
            None where it is not packed.
        """
        packed = _extension(primitive, "KHR_draco_mesh_compression")
        if packed is None:
            return None
        view = packed["bufferView"]
        if view not in self._draco:
            self._draco[view] = self._decoded(bytes(self.view(view)))
        mesh = self._draco[view]
        known = {a["unique_id"]: np.asarray(a["data"]) for a in mesh.attributes}
        count = len(mesh.points)
        found = {}
        for name, identity in packed["attributes"].items():
            data = known.get(identity)
            if data is None or len(data) != count:
                continue
            accessor = self.at("accessors", primitive["attributes"][name])
            data = data.reshape(count, -1)
            if accessor.get("normalized") or name.startswith(("COLOR", "TEXCOORD")):
                data = shares(data)
            found[name] = data
        faces: IntArray = np.asarray(getattr(mesh, "faces", ()), dtype=np.int64).reshape(-1)
        return faces, found

    def _decoded(self, data: bytes) -> Any:
        import DracoPy

        try:
            return DracoPy.decode(data)
        except Exception as error:
            raise InputError(
                f"{self.path}: its Draco data cannot be unpacked ({error}); export it again"
            ) from error


def shares(array: NDArray[Any]) -> NDArray[Any]:
    """Integers as shares of their largest value, not below -1 (glTF 2.0, 3.6.2.2)."""
    if array.dtype.kind not in "iu":
        return array
    return np.maximum(array / np.iinfo(array.dtype).max, -1.0)


def _extension(entry: dict[str, Any], *names: str) -> dict[str, Any] | None:
    found = entry.get("extensions") or {}
    return next((found[n] for n in names if n in found), None)


def _split(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON document and the binary chunk of a .glb or .gltf file."""
    data = path.read_bytes()
    binary = b""
    if data[:4] == _MAGIC:
        version, total = struct.unpack_from("<II", data, 4)
        _check_version(path, str(version))
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
    elif data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{":
        text = data
    else:
        raise InputError(f"{path} is not a glTF file: it begins with {_words(data[:12])}")
    try:
        doc = json.loads(text.decode("utf-8-sig"))
    except ValueError as error:  # no JSON, or no text
        raise InputError(f"{path} is not valid glTF: its JSON cannot be read ({error})") from error
    if not isinstance(doc, dict):
        raise InputError(f"{path} is not a glTF file: it has no asset entry")
    if isinstance(doc.get("meshes"), dict):  # glTF 1.0 may leave its version out
        _check_version(path, "1.0")
    if "asset" not in doc:
        raise InputError(f"{path} is not a glTF file: it has no asset entry")
    _check_version(path, str(doc["asset"].get("version", "2.0")))
    return doc, binary


def _words(data: bytes) -> str:
    """The first bytes of a file, as text where they are some."""
    text = data.decode("ascii", "replace").strip()
    return f"the text {text!r}" if text.isprintable() and "\ufffd" not in text else repr(data)


def _check_version(path: Path, version: str) -> None:
    if not version.startswith("2"):
        raise InputError(
            f"{path} is glTF {version}, and 2.0 is read; convert it, for example: "
            f"npx gltf-pipeline -i {path.name} -o {path.stem}-2.glb"
        )


def _resource(path: Path, uri: str, budget: Budget, door: Door) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    file = door.find(unquote(uri), path)
    if file is None:
        raise InputError(f"{path} needs {uri!r}, which is missing")
    return budget.read(file)
