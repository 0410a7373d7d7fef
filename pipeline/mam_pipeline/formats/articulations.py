"""Articulated assets in other formats than URDF, each written as a URDF before it is looked at.

MJCF is ours; other packages add formats by suffix, as plugins/mam_sim_formats adds USD.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mam_pipeline.formats.apart import apart
from mam_pipeline.formats.mjcf import urdf_of_mjcf
from mam_pipeline.formats.mjcf_files import is_mjcf
from mam_pipeline.formats.suffixes import USD
from mam_pipeline.optional import not_installed
from mam_pipeline.registry import Registry

KINDS = "a URDF, an MJCF or a USD file"
SUFFIXES = (".urdf", ".xml", ".mjcf", *USD)


@dataclass(frozen=True)
class Converted:
    """A URDF that was made of another file.

    Attributes:
        urdf: the file. kind: of the other, in a word. how: it was read.
        left: what was not taken over, in words.
    """

    urdf: Path
    kind: str
    how: str
    left: tuple[str, ...] = ()


def converted(path: Path, out: Path) -> Converted | None:
    """Write a file of another format as a URDF into the folder `out`; None where it needs none.

    Raises:
        InputError: it cannot be read, or not within limits, or it names files outside its folder.
        BackendError: the package that reads such files is not installed, or broken.
    """
    if is_mjcf(path):
        return Converted(urdf_of_mjcf(path, out), "MJCF", "compiled by MuJoCo")
    suffix = path.suffix.lower()
    table, name = Registry("articulation", {}), suffix[1:]
    if name in table.targets():
        write = table.load(name)
        urdf, left = apart(partial(write, path, out), path, suffix[1:].upper(), "give a URDF")
        kind = "USD" if suffix in USD else name.upper()
        return Converted(urdf, kind, f"composed by {kind}", left)
    if suffix in USD:
        raise not_installed(f"{path.name}: the reader of USD")
    return None
