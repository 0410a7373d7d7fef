"""Generated objects as assets, their masses and friction those of their kind."""

from __future__ import annotations

from pathlib import Path

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.evidence.read import named_size
from mam_world import make_object


def thing_of(category: str) -> str:
    """The kind of object of a category of the world, by the table of kinds."""
    return named_size(category.replace("_", " "))[0]


def world_asset(category: str, seed: int, folder: Path) -> Path:
    """Write the object of a seed with its exact joints and collision pieces; returns `folder`."""
    made = make_object(category, seed)
    write_asset(
        made.articulation, folder, name=folder.name, collision=made.collision,
        thing=thing_of(category),
    )  # fmt: skip
    return folder
