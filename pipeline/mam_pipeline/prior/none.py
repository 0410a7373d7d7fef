"""The prior that says nothing: the paper's ablation "without kinematic priors"."""

from __future__ import annotations

import numpy as np

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.types import Mesh, Primitives


class NoPrior:
    """Even odds for every primitive and every pair; the engine skips it altogether."""

    @classmethod
    def available(cls) -> Availability:
        """Always available."""
        return Availability(True, "says nothing")

    def observe(self, mesh: Mesh, primitives: Primitives, seed: int = 0) -> KinematicPrior:
        """Return 0.5 everywhere."""
        count = primitives.count
        return KinematicPrior(
            mobility=np.full(count, 0.5), affinity=np.full((count, count), 0.5), source="none"
        )
