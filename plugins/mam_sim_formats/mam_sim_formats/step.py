"""STEP and IGES reading through OpenCASCADE: solids become triangles by part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from mam_pipeline.errors import InputError
from mam_pipeline.folders import Scratch
from mam_pipeline.formats.gltf import read_gltf
from mam_pipeline.formats.soup import FileContent


@dataclass(frozen=True)
class Tessellation:
    """How finely curved faces are cut.

    Attributes:
        angle: between neighbouring facets, radians.
        share: distance from the true surface, of an edge's length.
    """

    angle: float = 0.35
    share: float = 0.02


TESSELLATION = Tessellation()


def read_step(path: Path, root: Path | None = None) -> FileContent:
    """Read the solids of a STEP or IGES file, Z up, metres.

    Args:
        path: the file. root: is not used, since it names no other.

    Raises:
        InputError: it cannot be read.
    """
    import cascadio

    kind: Literal["step", "iges"] = "iges" if path.suffix.lower() in (".igs", ".iges") else "step"
    try:
        data = cascadio.load(
            path.read_bytes(), kind, tol_linear=TESSELLATION.share,
            tol_angular=TESSELLATION.angle, tol_relative=True,
        )  # fmt: skip
    except Exception as error:
        raise InputError(f"{path} cannot be read as {kind.upper()} ({error})") from error
    if not data:
        raise InputError(f"{path} cannot be read as {kind.upper()}; export it again, as AP214")
    with Scratch() as folder:
        between = Path(folder) / f"{path.stem}.glb"
        between.write_bytes(data)
        content = read_gltf(between)
    # the GLB in between keeps the axes of the CAD file, which points Z upwards
    return replace(content, up="z", metres_per_unit=1.0)
