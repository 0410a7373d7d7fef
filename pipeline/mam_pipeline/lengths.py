"""Lengths as people write them, 55cm or 22in, and whether an object of such a size is usual."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mam_pipeline.errors import ConfigError


@dataclass(frozen=True)
class LengthRules:
    """What lengths are read as, and which sizes are asked about.

    Attributes:
        units: metres in each unit.
        asked: factor beyond a kind's usual range from which a size is asked about.
        any_kind: smallest and largest side of a thing of no known kind, metres; beyond, it is
            asked about.
        tried: units in which a size that is too large may have been meant.
    """

    units: Mapping[str, float] = field(default_factory=lambda: {
        "": 1.0, "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "cm": 0.01,
        "mm": 0.001, "in": 0.0254, "inch": 0.0254, "inches": 0.0254, '"': 0.0254, "ft": 0.3048,
        "foot": 0.3048, "feet": 0.3048, "'": 0.3048,
    })  # fmt: skip
    asked: float = 3.0
    any_kind: tuple[float, float] = (0.005, 6.0)
    tried: tuple[str, ...] = ("cm", "mm", "in", "m")


LENGTHS = LengthRules()


class UnusualSize(ConfigError):
    """An object would be far larger or smaller than such things are; --yes takes it as it is."""


def metres(value: Any) -> Any:
    """Metres of a length in text; what is no text is left as it is.

    Example:
        >>> metres("55 cm")
        0.55

    Raises:
        ValueError: the text is no length.
    """
    if not isinstance(value, str):
        return value
    found = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*", value)
    unit = None if found is None else LENGTHS.units.get(found[2].lower())
    if found is None or unit is None:
        said = value if len(value) <= 40 else f"{value[:37]}..."
        raise ValueError(
            f"must be a length such as 0.55 (metres), 1.2m, 55cm, 550mm or 22in, not {said!r}"
        )
    return float(f"{float(found[1]) * unit:.12g}")


def ask_unusual(
    size: float, said: Mapping[str, float], name: str = "", usual: Sequence[float] | None = None
) -> None:
    """Refuse a size that is far from what such things have.

    Args:
        size: largest side of the object, metres.
        said: flags that decide it, with their values (height: 55).
        name, usual: of its kind, and the lowest and highest largest side of such things, metres;
            where nobody knows the kind, it is held against `LENGTHS.any_kind`.

    Raises:
        UnusualSize: it is beyond the usual range by `LENGTHS.asked`.
    """
    low, high = LENGTHS.any_kind if usual is None else (usual[0], usual[-1])
    beyond = 1.0 if usual is None else LENGTHS.asked
    if low / beyond <= size <= high * beyond:
        return
    name = name if name and usual is not None else "object"
    article = "an" if name[:1] in "aeiou" else "a"
    flag, value = next(iter(said.items()))
    units = [u for u in LENGTHS.tried if low <= size * LENGTHS.units[u] <= high]
    way = f"--{flag} {value:g}{units[0]}" if units and flag != "scale" else f"correct --{flag}"
    raise UnusualSize(
        f"{article} {name} of {size:.3g} m at its longest? usual is {low:.3g} to {high:.3g} m; "
        f"{way}, or add --yes"
    )
