"""The scores the reasoner goes by: learned models from package data, or the hand-set rules."""

from __future__ import annotations

from typing import Protocol

from mam_pipeline.reason import rules
from mam_pipeline.reason.features import Table
from mam_pipeline.types import FloatArray


class Scores(Protocol):
    """Everything that may be learned."""

    threshold: float

    def same(self, pairs: Table) -> FloatArray:
        """(E,) probability that a pair is one rigid body."""

    def move(self, unary: Table) -> FloatArray:
        """(P,) probability that a primitive belongs to a moving part."""

    def value(self, groups: Table) -> FloatArray:
        """(C,) expected overlap of a candidate with a true part."""

    def subtype(self, groups: Table) -> FloatArray:
        """(C, 3) probabilities of hinge, spin, slide."""

    def confidence(self, value: FloatArray) -> FloatArray:
        """(C,) calibrated probability that a chosen candidate is a true part."""


class RuleScores:
    """The hand-set rules as scores."""

    threshold = 0.55

    def same(self, pairs: Table) -> FloatArray:
        """See `rules.same_part`."""
        return rules.same_part(pairs)

    def move(self, unary: Table) -> FloatArray:
        """See `rules.may_move`."""
        return rules.may_move(unary)

    def value(self, groups: Table) -> FloatArray:
        """See `rules.part_value`."""
        return rules.part_value(groups)

    def subtype(self, groups: Table) -> FloatArray:
        """See `rules.subtype_odds`."""
        return rules.subtype_odds(groups)

    def confidence(self, value: FloatArray) -> FloatArray:
        """Rules know no calibration: never above one half."""
        out: FloatArray = 0.5 * value
        return out


def load_scores() -> Scores:
    """The best scores there are."""
    return RuleScores()
