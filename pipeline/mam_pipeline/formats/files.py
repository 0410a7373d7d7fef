"""Which files belong to a model: itself, and those in its folder that it names."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, named_by
from mam_pipeline.formats.mjcf_files import files_of_mjcf, is_mjcf

MESH_OF = re.compile(rb"""filename\s*=\s*["']([^"']+)""")
"""How a URDF names its meshes."""


def files_of(path: Path, root: Path | None = None) -> list[Path]:
    """A file, and those in the folder `root` that it names, directly or by way of another one.

    Args:
        root: default: the file's own folder.
    """
    if path.suffix.lower() == ".xml" and is_mjcf(path):
        with contextlib.suppress(InputError):
            return files_of_mjcf(path)
        return [path]
    door, waiting, found = Door(root or path.parent), [path], dict[Path, None]()
    while waiting:
        file = waiting.pop(0)
        if file in found:
            continue
        found[file] = None
        for name in _named(file):
            with contextlib.suppress(InputError):  # the reader will refuse it, and say why
                named = door.find(name, file)
                waiting += [] if named is None else [named]
    return list(found)


def _named(file: Path) -> list[str]:
    if file.suffix.lower() in (".urdf", ".xml"):
        return [m.decode("utf-8", "replace") for m in MESH_OF.findall(file.read_bytes())]
    return named_by(file)
