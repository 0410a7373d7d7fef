"""Choosing the parts: the best set of candidates that share no primitive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.parts.groups import Masks
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class SelectionLimits:
    """What every choice of parts keeps to.

    Attributes:
        even: diagonals added to extents before they are compared.
        least_base: share of the surface that stays in the base at least; a chandelier's 0.04 is the
            least of 111 real objects.
    """

    even: float = 5e-3
    least_base: float = 0.03


SELECTION = SelectionLimits()


def select_groups(masks: Masks, value: FloatArray, threshold: float, sweeps: int = 3) -> list[int]:
    """Indices of a set of disjoint candidates with the largest total of value - threshold.

    Greedy by value, then exchanges: one chosen candidate for the free ones that its removal
    allows, or several chosen for one that overlaps them, as long as the total rises. (Weighted
    set packing is NP-hard; at these sizes the exchanges reach the optimum nearly always.)

    Args:
        masks: (C, P). value: (C,) predicted overlap with a true part, 0..1.
        threshold: value below which a candidate is worth less than leaving it in the base.
    """
    gain = value - threshold
    order = [int(c) for c in np.argsort(-gain, kind="stable") if gain[c] > 0]
    if not order:
        return []
    clash = masks.astype(np.float32) @ masks.T.astype(np.float32) > 0
    chosen = _fill([], order, clash)
    for _ in range(sweeps):
        improved = False
        for c in order:
            if c in chosen:
                trial = _fill([k for k in chosen if k != c], [k for k in order if k != c], clash)
            else:
                trial = _fill([k for k in chosen if not clash[c, k]] + [c], order, clash)
            if gain[trial].sum() > gain[chosen].sum() + 1e-9:
                chosen, improved = trial, True
        if not improved:
            break
    return sorted(chosen, key=lambda c: -value[c])


def _fill(start: list[int], order: list[int], clash: Masks) -> list[int]:
    """Add candidates in order wherever nothing clashes."""
    out = list(start)
    blocked: Masks = np.zeros(len(clash), dtype=bool)
    for c in out:
        blocked |= clash[c]
    for c in order:
        if not blocked[c]:
            out.append(c)
            blocked |= clash[c]
    return out
