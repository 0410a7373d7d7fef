"""A procedural world of articulated objects with exact truth."""

from mam_pipeline.world.kit import Builder
from mam_pipeline.world.object import WorldObject, make_object
from mam_pipeline.world.registry import CATEGORIES, Category
from mam_pipeline.world.splits import benchmark, iterate, split_of
from mam_pipeline.world.style import Style, draw_style

__all__ = [
    "CATEGORIES", "Builder", "Category", "Style", "WorldObject", "benchmark", "draw_style",
    "iterate", "make_object", "split_of",
]  # fmt: skip
