"""Suffixes of the files that can be read, by kind."""

from __future__ import annotations

USD = (".usd", ".usda", ".usdc", ".usdz")
STEP = (".step", ".stp", ".iges", ".igs")
MESHES = (
    ".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".off", ".3mf", ".fbx", *USD, *STEP,
)  # fmt: skip
PHOTOS = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".gif", ".heic")
