"""What holds a joint besides friction: a catch that keeps it closed, and springs that carry it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol


@dataclass(frozen=True)
class Catch:
    """What keeps a joint closed besides friction: a gasket, a latch, a magnet, a sprung hinge.

    It pulls from open towards closed: with all its force at the closed value, less in proportion
    on the way, and not at all from `width` on.

    Attributes:
        name: what it is, in words. source: where its force comes from; "" where a person says it.
        force: at the closed value, N of a slide and N m of a hinge; 0 for none.
        force_range: from the weakest such thing to the strongest; (0, 0) where nobody knows.
        width: of the way on which it pulls, m or rad.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}
    name: str = ""
    force: float = 0.0
    force_range: tuple[float, float] = (0.0, 0.0)
    width: float = 0.02
    source: str = ""

    @property
    def wrong(self) -> tuple[str, str] | None:
        """Which value nothing can have, and what it must be; None where all can be."""
        for name, least in (("force", self.force), ("force_range", min(self.force_range))):
            if least < 0.0:
                return name, f"must be at least 0, not {least:g}"
        return None if self.width > 0.0 else ("width", f"must be above 0, not {self.width:g}")


@dataclass(frozen=True)
class Balance:
    """Springs or weights that carry what a joint moves, so that it stays where it is left.

    Attributes:
        name: what they are, in words. source: who says that such a part has them; "" where a
            person says it.
        friction: how much of the joint's friction stands for them in a simulator that has no such
            thing, N of a slide and N m of a hinge; where they are simulated it is not there.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}
    name: str = ""
    friction: float = 0.0
    source: str = ""


class Held(Protocol):
    """What is asked of a joint about what holds it: one of the engine's, or one of a card."""

    @property
    def friction(self) -> float: ...
    @property
    def friction_range(self) -> tuple[float, float]: ...
    @property
    def catch(self) -> Catch | None: ...
    @property
    def balance(self) -> Balance | None: ...


def wrong_of(joint: Held) -> tuple[tuple[str, str], str] | None:
    """Which value of a joint's catch or balance nothing can have, and what it must be."""
    bad = None if joint.catch is None else joint.catch.wrong
    if bad is not None:
        return ("catch", bad[0]), bad[1]
    if joint.balance is not None and not 0.0 <= joint.balance.friction <= joint.friction:
        between = f"must be between 0 and the joint's friction, not {joint.balance.friction:g}"
        return ("balance", "friction"), between
    return None
