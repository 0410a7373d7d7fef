"""A procedural world of articulated objects with exact truth."""

from mam_world.kit import Builder
from mam_world.object import WorldObject, make_object
from mam_world.registry import CATEGORIES, Category
from mam_world.splits import benchmark, iterate, split_of
from mam_world.style import Style, draw_style

__all__ = [
    "CATEGORIES", "Builder", "Category", "Style", "WorldObject", "benchmark", "draw_style",
    "iterate", "make_object", "split_of",
]  # fmt: skip
