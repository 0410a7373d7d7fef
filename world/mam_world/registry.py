"""The table of categories: each family module names its builders; adding one takes one line."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from mam_pipeline.errors import unknown_name

if TYPE_CHECKING:
    from mam_world.kit import Builder

# each module holds CATEGORIES: dict[str, Callable[[Builder], None]]
FAMILIES: tuple[str, ...] = (
    "storage",
    "tables",
    "kitchen",
    "counter",
    "laundry",
    "openings",
    "household",
    "electronics",
    "vessels",
    "bins",
    "controls",
    "plumbing",
    "panels",
    "desk",
    "instruments",
    "boxes",
    "luggage",
    "vehicles",
    "carts",
    "seats",
    "tools",
    "pocket",
    "machines",
    "stations",
    "primitive",
    "units",
    "gadgets",
    "hangings",
    "cooking",
    "workshop",
    "transport",
    "aircraft",
    "furnishing",
    "building",
    "devices",
    "handheld",
    "park",
)
MOTIONLESS_FAMILY = "motionless"  # objects without a joint, kept apart from the others


@dataclass(frozen=True)
class Category:
    """One kind of object: `family` is the module in mam_world that builds it."""

    name: str
    family: str

    def builder(self) -> Callable[[Builder], None]:
        """The function that fills a builder with one random object of this kind."""
        module = importlib.import_module(f"mam_world.{self.family}")
        return module.CATEGORIES[self.name]


@lru_cache(maxsize=1)
def categories() -> dict[str, Category]:
    """Name -> category, in the order of the families."""
    out: dict[str, Category] = {}
    for family in FAMILIES:
        module = importlib.import_module(f"mam_world.{family}")
        for name in module.CATEGORIES:
            if name in out:
                raise ValueError(f"two families name a category {name!r}")
            out[name] = Category(name, family)
    return out


@lru_cache(maxsize=1)
def motionless() -> dict[str, Category]:
    """Name -> category of objects in which nothing moves; no family has one of the same name."""
    module = importlib.import_module(f"mam_world.{MOTIONLESS_FAMILY}")
    return {name: Category(name, MOTIONLESS_FAMILY) for name in module.CATEGORIES}


def category(name: str) -> Category:
    """The category of this name, motionless ones included.

    Raises:
        ConfigError: no such category; the message names the nearest.
    """
    table = {**motionless(), **categories()}
    if name not in table:
        raise unknown_name("category", name, table)
    return table[name]


class _Table(Mapping[str, Category]):
    """`categories()` as a mapping that imports the families on first use."""

    def __getitem__(self, name: str) -> Category:
        return categories()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(categories())

    def __len__(self) -> int:
        return len(categories())


CATEGORIES: Mapping[str, Category] = _Table()
