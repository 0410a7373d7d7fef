"""A reader of `.tri` files: a triangle a line, as nine numbers."""

from pathlib import Path

import numpy as np

from mam_pipeline.errors import InputError
from mam_pipeline.formats.soup import Budget, FileContent, Piece
from mam_pipeline.types import Material


def read_tri(file: Path, root: Path | None = None) -> FileContent:
    """Every triangle of the file, in its own frame and unit."""
    budget = Budget(file)  # refuses what would take too much
    try:
        rows = np.loadtxt(file, ndmin=2)
        corners = rows.reshape(len(rows), 9).reshape(-1, 3)
    except ValueError as error:
        raise InputError(f"{file}: every line needs nine numbers; export it again") from error
    count = len(corners) // 3
    budget.triangles(len(corners), count)
    faces = np.arange(3 * count).reshape(-1, 3)
    return FileContent((Piece(corners, faces),), (Material(),), up="z", metres_per_unit=0.001)
