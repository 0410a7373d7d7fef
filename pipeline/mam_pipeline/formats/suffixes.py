"""Suffixes of the files that can be read, by kind."""

from __future__ import annotations

MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".off")
PHOTOS = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".gif", ".heic")
