"""The hand rules of the engine: each has a name, a sentence and a switch.

A rule is what the engine does beside its learned scores because a person wrote it down. Every one
can be turned off (`EngineConfig.rules`), and `benchmarks/rule_ablation.py` measures what each is
worth. The code of a rule lies in the room whose stage it belongs to: `segment`, `parts/rules` or
`joints`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Protocol, Self, runtime_checkable


@dataclass(frozen=True)
class Rules:
    """Which hand rules are used.

    Attributes:
        closed_fronts: (segment, fused) a flat whose handles tell that it is several fronts is cut
            between them.
        handle_on_panel: (parts, fused) what stands on a flat on two feet moves with that flat.
        two_sided_sheet: (parts, fused) the two faces of a thin sheet are one body.
        through_sheet: (parts, fused) what stands on both faces of a sheet at one place is one body.
        unsure_stays: (parts) a part of the best set stays in the base when it is too unsure.
        same_handle: (parts, fused) a front with the handle of a chosen front is chosen as well.
        completed: (parts) what is bound to a part and likely to move joins it.
        minor: (parts) what is small beside the largest part moves by itself only if its joint is
            clear.
        abstain: (parts) what is less likely a part than a calibrated bar stays still and is told.
        on_both_bodies: (joints) a hinge line gives way to a near one that stays on both bodies.
        sunken_slide: (joints, fused) no slide takes a panel into the material beside it.
        siblings: (joints) where only another part is in the way the joint's own range counts.
        plain_travel: (joints) doors and drawers of usual travel open a quarter turn and 0.8 of
            their depth.
    """

    closed_fronts: bool = True
    handle_on_panel: bool = True
    two_sided_sheet: bool = True
    through_sheet: bool = True
    unsure_stays: bool = True
    same_handle: bool = True
    completed: bool = True
    minor: bool = True
    abstain: bool = True
    on_both_bodies: bool = True
    sunken_slide: bool = True
    siblings: bool = True
    plain_travel: bool = True

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """All rules, in the order in which they act."""
        return tuple(f.name for f in fields(cls))

    def without(self, name: str) -> Self:
        """The same with one rule off."""
        return replace(self, **{name: False})


ALL_RULES = Rules()


@runtime_checkable
class Ruled(Protocol):
    """A backend that follows hand rules."""

    def with_rules(self, rules: Rules) -> Self:
        """The same backend under other rules."""
        ...
