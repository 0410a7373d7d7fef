"""One cell of a front as it was read: a drawer, a door, an open or a fixed part."""

from __future__ import annotations

from dataclasses import dataclass

from mam_pipeline.photo.handles import Blob


@dataclass(frozen=True)
class Panel:
    """One cell of the front.

    Attributes:
        box: (x0, y0, x1, y1) front pixels.
        kind: drawer | door | open | fixed.
        hinge_side: left | right | top | bottom for doors, as seen from the front.
        handles: those that belong to it, observed or inferred.
        confidence: 0..1 that the rectangle is right; `kind_confidence` that the kind is.
        provenance: observed; user or model where these say the hinge of a door, too.
        told: whether somebody says the kind, a person or a language model.
    """

    box: tuple[float, float, float, float]
    kind: str
    hinge_side: str | None = None
    handles: tuple[Blob, ...] = ()
    confidence: float = 0.5
    kind_confidence: float = 0.5
    provenance: str = "observed"
    told: bool = False

    @property
    def movable(self) -> bool:
        """Whether the cell opens."""
        return self.kind in ("drawer", "door")
