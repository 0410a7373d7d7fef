"""The assets that every simulator must open, and where they come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.evidence.read import named_size
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import make_asset
from mam_pipeline.types import Articulation, Joint, Link, Material, Mesh
from mam_world import make_object

PHOTO = Path(__file__).parents[2] / "examples" / "nightstand.jpg"


def photo_twin(folder: Path) -> Asset:
    """The digital twin of examples/nightstand.jpg: JPEG textures, flat pieces."""
    return make_asset(PHOTO, folder / "photo_twin", MakeConfig())


def many_materials(folder: Path) -> Asset:
    """A GLB with a PNG, a JPEG and a plain colour on one node, through the engine."""
    file = folder / "source.glb"
    save_glb(painted(make_object("nightstand", 3).articulation).mesh, file)
    return make_asset(file, folder / "many_materials", MakeConfig())


def fused(folder: Path) -> Asset:
    """One watertight surface with vertex colours, through the engine."""
    file = folder / "fused.glb"
    mesh = make_object("nightstand", 3).articulation.mesh
    save_glb(fuse_mesh(mesh, resolution=96, faces=20_000), file)
    return make_asset(file, folder / "fused", MakeConfig(accept=("all",)))


def generated(folder: Path) -> Asset:
    """An object of the procedural world with its exact joints and collision pieces."""
    made = make_object("sideboard", 5)
    return write_asset(
        made.articulation, folder / "generated", name="generated", collision=made.collision
    )


def household(category: str, seed: int) -> Callable[[Path], Asset]:
    """An object of the procedural world whose masses and friction are those of its kind."""

    def make(folder: Path) -> Asset:
        made = make_object(category, seed)
        thing = named_size(category.replace("_", " "))[0]
        return write_asset(
            made.articulation, folder / category, name=category, collision=made.collision,
            thing=thing,
        )  # fmt: skip

    return make


def nested(folder: Path) -> Asset:
    """A knob that spins on a lid with a tilted hinge, beside a tray; three materials a link."""
    solids = [
        trimesh.creation.box(bounds=[[0, -0.3, 0], [0.5, 0.3, 0.4]]),
        trimesh.creation.box(bounds=[[0, -0.3, 0.41], [0.5, 0.3, 0.43]]),
        trimesh.creation.box(bounds=[[-0.03, -0.2, 0.1], [-0.01, 0.2, 0.3]]),
        trimesh.creation.cylinder(0.02, sections=24, segment=[[0.1, 0, 0.431], [0.1, 0, 0.461]]),
    ]  # fmt: skip
    vertices = np.concatenate([s.vertices for s in solids])
    starts = np.cumsum([0] + [len(s.vertices) for s in solids])
    faces = np.concatenate([s.faces + k for s, k in zip(solids, starts)])
    label = np.repeat(np.arange(4), [len(s.faces) for s in solids])
    names = ("base", "lid", "tray", "knob")
    links = tuple(Link(n, n, np.flatnonzero(label == i)) for i, n in enumerate(names))
    tilted = np.array([0.1, 1.0, 0.05]) / np.linalg.norm([0.1, 1.0, 0.05])
    hinge_at, knob_at = np.array([0.5, 0, 0.42]), np.array([0.1, 0, 0.44])
    x, z, inf = np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.inf
    joints = (
        Joint("hinge", "revolute", "hinge", 0, 1, tilted, hinge_at, -0.1, 1.4, 0, 1.4),
        Joint("slide", "prismatic", "slide", 0, 2, -x, np.zeros(3), 0, 0.3, 0, 0.3),
        Joint("spin", "continuous", "spin", 1, 3, z, knob_at, -inf, inf),
    )
    whole = painted(Articulation(Mesh(vertices, faces), links, joints))
    return write_asset(whole, folder / "nested", name="nested")


def painted(articulation: Articulation) -> Articulation:
    """The same surface with a PNG, a JPEG and a plain colour, taking turns from face to face."""
    picture = np.zeros((32, 32, 3), np.uint8)
    picture[:16, :, 0], picture[:, 16:, 1], picture[16:, :16, 2] = 220, 180, 240
    data = []
    for kind in ("PNG", "JPEG"):
        buffer = BytesIO()
        Image.fromarray(picture).save(buffer, format=kind)
        data.append(buffer.getvalue())
    mesh = articulation.mesh
    uv = ((mesh.vertices[:, 1:] - mesh.bounds[0][1:]) / mesh.diagonal).astype(np.float32)
    materials = (
        Material("png", (1, 1, 1, 1), data[0], "png"),
        Material("jpeg", (1, 1, 1, 1), data[1], "jpeg"),
        Material("plain", (0.2, 0.6, 0.3, 1.0)),
    )
    which = np.arange(len(mesh.faces)) // 2 % 3
    made = Mesh(mesh.vertices, mesh.faces, materials, which, uv=uv)
    return replace(articulation, mesh=made)


ASSETS: dict[str, Callable[[Path], Asset]] = {
    "photo's twin": photo_twin,
    "GLB of three materials": many_materials,
    "fused mesh": fused,
    "generated": generated,
    "part on part": nested,
    "nightstand": household("nightstand", 3),
    "fridge": household("fridge", 2),
    "oven": household("oven", 1),
    "washer": household("washer_front", 0),
}
