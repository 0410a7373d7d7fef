"""The embedded kinematic prior: which primitives may move, and which only move together.

The counterpart of SP4D's masks in the paper's 3.2, from physics instead of a diffusion model:
every primitive is pushed along six directions, and what blocks it is noted. What was found is also
drawn as multi-view masks, the form in which SP4D answers.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.prior.masks import with_masks
from mam_pipeline.prior.probe import NEAR, Probe, probe
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.types import FloatArray, Mesh, Primitives


class EmbeddedPrior:
    """Motion probing with one bundle of rays per surface sample; no weights, no GPU."""

    @classmethod
    def available(cls) -> Availability:
        """Always available."""
        return Availability(True, "motion probing on the CPU", version="1")

    def observe(self, mesh: Mesh, primitives: Primitives, seed: int = 0) -> KinematicPrior:
        """Probe every primitive; `probe` keeps the crossings for whole groups."""
        sampled = probe(*without_repeats(mesh, primitives), seed)
        return with_masks(prior_of(sampled), mesh, primitives, sampled.area)


def prior_of(sampled: Probe) -> KinematicPrior:
    """What one probing says, without the masks."""
    return KinematicPrior(
        mobility=mobility(sampled),
        affinity=affinity(sampled.cover(NEAR)),
        source="embedded",
        probe=sampled,
    )


def mobility(sampled: Probe) -> FloatArray:
    """(P,) how freely a primitive moves alone: its freest direction, less what blocks all others.

    A direction counts as free by the share of the surface that meets nothing within the
    primitive's own length; a part is guided when few directions are free, loose when all are.
    """
    out = np.zeros(sampled.count)
    starts = np.searchsorted(sampled.owner, np.arange(sampled.count + 1))
    for k in range(sampled.count):
        own = sampled.points[starts[k] : starts[k + 1]]
        if len(own) == 0:
            continue
        member = np.zeros(sampled.count, dtype=bool)
        member[k] = True
        length = max(float((own.max(axis=0) - own.min(axis=0)).max()), 1e-3)
        free = (sampled.clearance(member) > length).mean(axis=0)
        guided = 1.0 - np.median(free)
        out[k] = free.max() * (0.5 + 0.5 * guided)
    return out


def affinity(near: np.ndarray) -> FloatArray:
    """(P, P) how surely two primitives move together: each push of one meets the other.

    Args:
        near: (P, P, 6) share of i's surface that has j right ahead, per direction. Being caged
            (blocked both ways along several axes) counts most; lying side by side counts little.
    """
    blocked = np.minimum(near / 0.25, 1.0).astype(np.float64)
    both = np.minimum(blocked[..., 0::2], blocked[..., 1::2]).sum(axis=2) / 3.0
    single = blocked.sum(axis=2) / 6.0
    one = 0.6 * both + 0.4 * single
    out = np.maximum(one, one.T)
    np.fill_diagonal(out, 1.0)
    return out
