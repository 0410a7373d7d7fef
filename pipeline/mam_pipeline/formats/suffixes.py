"""Suffixes of the files that can be read, by kind."""

from __future__ import annotations

from mam_pipeline.registry import installed

_CAD = (
    '; or convert it in FreeCAD: freecadcmd -c "import Part, Mesh, MeshPart; '
    "s = Part.read('{file}'); "
    "MeshPart.meshFromShape(Shape=s, LinearDeflection=0.1).write('{stem}.stl')\""
)
_BLENDER = (
    "; or convert it in Blender: blender -b --python-expr "
    "\"import bpy; bpy.ops.import_scene.fbx(filepath='{file}'); "
    "bpy.ops.export_scene.gltf(filepath='{stem}.glb')\""
)
USD = (".usd", ".usda", ".usdc", ".usdz")
ELSEWHERE = {
    **dict.fromkeys(USD, ""),
    **dict.fromkeys((".step", ".stp", ".iges", ".igs"), _CAD),
    ".fbx": _BLENDER,
    ".3mf": "",
}
"""What plugins/mam_sim_formats reads, and what else one can do about such a file without it."""
BUILTIN = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".off")
PHOTOS = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".gif", ".heic")
READER = "mam_sim.reader"
"""Entry-point group in which other packages add readers, by suffix without its dot."""


def mesh_suffixes() -> tuple[str, ...]:
    """Of mesh files: those of our own readers, installed or not, then those of other packages."""
    added = (f".{entry.name.lower()}" for entry in installed(READER))
    return tuple(dict.fromkeys((*BUILTIN, *ELSEWHERE, *added)))
