"""What is true of a photographed object: the nouns of the photo benchmark.

Front coordinates (u, v) run 0..1 over the front face, u to the viewer's right, v downwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.score import Rect


@dataclass(frozen=True)
class PanelTruth:
    """One movable panel: drawer or door, its rectangle and handles in front coordinates."""

    kind: str
    rect: Rect
    hinge_side: str | None = None
    handles: tuple[Rect, ...] = ()


@dataclass(frozen=True)
class PhotoTruth:
    """Everything exact about one synthetic photo.

    Attributes:
        category: cabinet, nightstand, fridge ...
        size: (width, depth, height) metres of the closed body without legs.
        front: (4, 2) pixels of the front face's corners TL, TR, BR, BL (without legs).
        focal: pixels.
    """

    category: str
    size: tuple[float, float, float]
    front: NDArray[np.float64]
    panels: tuple[PanelTruth, ...]
    focal: float
    level: str = "clean"
    depth_visible: bool = True
