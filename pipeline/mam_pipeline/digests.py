"""Digests of files, texts, arrays and meshes: what tells whether anything has changed."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.types import Mesh


def file_digest(path: Path) -> str:
    """SHA-256 of a file, hex."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def bytes_digest(content: bytes) -> str:
    """SHA-256 of bytes, hex."""
    return hashlib.sha256(content).hexdigest()


def text_digest(text: str) -> str:
    """SHA-256 of a text, hex."""
    return bytes_digest(text.encode())


def array_digest(array: NDArray[Any]) -> str:
    """SHA-256 of an array's numbers, hex."""
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def mesh_digest(mesh: Mesh) -> str:
    """SHA-256 of a mesh's geometry, hex; appearance does not enter."""
    digest = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update("|".join(mesh.group_names).encode())
    return digest.hexdigest()
