"""The door for trimesh: what a mesh file names is opened through it."""

from __future__ import annotations

from pathlib import Path

import trimesh

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door


class DoorResolver(trimesh.resolvers.FilePathResolver):
    """Opens for trimesh what a mesh file names, through the door."""

    def __init__(self, file: Path, root: Path | None = None) -> None:
        super().__init__(str(file))
        self.door, self.file = Door(root or file.parent), file
        self.left_out: list[str] = []

    def get(self, name: str) -> bytes:
        """Bytes of a file of that name, or else of one beside the mesh.

        Raises:
            FileNotFoundError: there is none that may be opened; trimesh leaves it out then.
        """
        before = len(self.left_out)
        for option in (name.strip(), name.strip().replace("\\", "/").rpartition("/")[2]):
            try:
                found = self.door.find(option, self.file) if option else None
            except InputError as error:
                self.left_out.append(str(error))
                continue
            if found is not None:
                return found.read_bytes()
        if len(self.left_out) == before:
            self.left_out.append(f"{self.file.name} names {name.strip()!r}, which was not found")
        raise FileNotFoundError(name)
