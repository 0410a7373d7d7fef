"""Suffixes of the files that can be read, by kind."""

from __future__ import annotations

from mam_pipeline.registry import installed

USD = (".usd", ".usda", ".usdc", ".usdz")
STEP = (".step", ".stp", ".iges", ".igs")
BUILTIN = (
    ".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".off", ".3mf", ".fbx", *USD, *STEP,
)  # fmt: skip
PHOTOS = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".gif", ".heic")
READER = "mam_sim.reader"
"""Entry-point group in which other packages add readers, by suffix without its dot."""


def mesh_suffixes() -> tuple[str, ...]:
    """Of mesh files: those of our own readers, then those of other packages."""
    added = (f".{entry.name.lower()}" for entry in installed(READER))
    return tuple(dict.fromkeys((*BUILTIN, *added)))
