"""One candidate part with its motion, as one source proposes it.

Sources propose independently of each other; the judge weighs them with what physics says. Nothing
here forbids anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.types import FloatArray, JointSubtype, readonly

Source = Literal["structure", "kind", "geometry", "network", "language model", "user"]


@dataclass(frozen=True)
class Hypothesis:
    """A part that may move, and how.

    Attributes:
        faces: (F,) mask of its faces. subtype: how it moves. source: who proposes it.
        probability: that this part moves by itself, by this source alone, 0..1.
        detail: what the source goes by: a node's name, a word, a file.
        kind: of part, in the table of kinds; "" where nobody says.
        axis, origin: (3,) of the line, in the mesh's frame; None where the source does not know it.
        limits: (lower, upper) from the pose of the file, rad or m, infinite for endless.
        line: "upright" or "level" where lines of such parts usually lie so; "" else.
        side: sides on which the hinge of such a part usually sits, or to which it slides.
        travel: how far such a part usually goes: degrees, or share of the body's depth.
    """

    faces: NDArray[np.bool_]
    subtype: JointSubtype
    source: Source
    probability: float
    detail: str = ""
    kind: str = ""
    axis: FloatArray | None = None
    origin: FloatArray | None = None
    limits: tuple[float, float] | None = None
    line: str = ""
    side: tuple[str, ...] = ()
    travel: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", readonly(self.faces, np.bool_, (None,)))
        for name in ("axis", "origin"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, readonly(value, np.float64, (3,)))
        if not 0.0 <= self.probability <= 1.0:
            raise ValueError(f"a probability is 0 to 1, not {self.probability}")
