"""Visual meshes of an asset: one object and one material a file, in formats that simulators read.

OBJ with MTL and PNG or JPEG is the one format that SAPIEN, MuJoCo, PyBullet, Gazebo and the
converters to USD all take; several of them read only the first object or the first material of a
file, so a link gets one file per material. GLB keeps a link in one file and is written on request.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image

from mam_pipeline.asset.grasps import handle_faces
from mam_pipeline.formats.gltf_write import write_glb
from mam_pipeline.formats.obj_write import write_obj_part
from mam_pipeline.formats.pictures import image_kind
from mam_pipeline.formats.urdf.write import link_origins
from mam_pipeline.types import Articulation, Material, Mesh

VisualFormat = Literal["obj", "glb"]


@dataclass
class Visuals:
    """What was written for the links of one asset.

    Attributes:
        files: per link name, (visual name, path relative to the asset folder).
        handles: per link name, the visual names that show its handle.
        notes: what a format could not keep, in words, for the card.
    """

    files: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    handles: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def write_visuals(articulation: Articulation, folder: Path, format: VisualFormat) -> Visuals:
    """Write `folder`/visual; vertices are in the link frame, metres, Z up.

    A handle has files of its own, named `handle_*`. Face order is the source's within a file;
    texture files hold the source's bytes, each once, and texture coordinates are kept.

    Args:
        articulation: asset frame, link names that are valid and unique.
        folder: the asset folder under construction.
        format: "obj" (one file per material) or "glb" (one file per link and handle).
    """
    out = Visuals()
    origins = link_origins(articulation)
    pictures = Pictures(folder / "visual")
    taken: set[str] = set()
    for i, link in enumerate(articulation.links):
        out.files[link.name], out.handles[link.name] = [], []
        grip = handle_faces(articulation, i)
        rest = np.setdiff1d(link.faces, grip, assume_unique=True)
        # setdiff1d sorts; sorted indices keep the source's face order
        for label, faces in ((link.name, rest), (f"handle_{link.name}", np.sort(grip))):
            if not len(faces):
                continue
            shift = np.eye(4)
            shift[:3, 3] = -origins[i]
            whole = articulation.mesh.submesh(faces).transformed(shift)
            parts = [whole] if format == "glb" else list(by_material(whole, out.notes))
            for k, part in enumerate(parts):
                name = free_name(label if len(parts) == 1 else f"{label}_m{k}", taken)
                file = f"visual/{name}.{format}"
                if format == "glb":
                    write_glb(part, folder / file, up="z")
                else:
                    picture = pictures.file_of(part.materials[0])
                    write_obj_part(part, folder / file, picture, textured=bool(picture))
                out.files[link.name].append((name, file))
                if label != link.name:
                    out.handles[link.name].append(name)
    out.notes = list(dict.fromkeys(out.notes))
    return out


class Pictures:
    """Texture files of one folder; the same bytes are written once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: dict[bytes, str] = {}

    def file_of(self, material: Material) -> str:
        """Name of the material's texture file, "" if it has none."""
        if material.image is None:
            return ""
        if material.image not in self.names:
            kind = material.image_format or image_kind(material.image) or "png"
            name = f"texture_{len(self.names):02d}.{'jpg' if kind == 'jpeg' else kind}"
            (self.folder / name).write_bytes(material.image)
            self.names[material.image] = name
        return self.names[material.image]


def by_material(mesh: Mesh, notes: list[str] | None = None) -> Iterable[Mesh]:
    """The mesh cut into pieces of one material each, in the order of their first face.

    Vertex colours become a picture where there is none; `notes` is told of those that are lost.
    """
    assert mesh.face_material is not None
    known: dict[Material, int] = {}
    same = [known.setdefault(replace(m, name=""), len(known)) for m in mesh.materials]
    appearance = np.asarray(same)[mesh.face_material]
    _, first = np.unique(appearance, return_index=True)
    for which in appearance[np.sort(first)]:
        part = mesh.submesh(appearance == which)
        assert part.face_material is not None
        material = mesh.materials[int(part.face_material[0])]
        if material.image is None or part.uv is None:
            material = replace(material, image=None, image_format=None)
        one = replace(part, materials=(material,), face_material=None)
        if one.colors is not None and not (one.colors == 255).all():
            if material.image is None:
                one = baked(one)
            elif notes is not None:
                notes.append("vertex colours under a texture are dropped: OBJ cannot hold both")
        yield replace(one, colors=None)


def baked(mesh: Mesh) -> Mesh:
    """A mesh whose vertex colours are a texture, since most readers of OBJ ignore the former.

    Corners of faces no longer share vertices. A colour that is the same everywhere becomes the
    material's colour. Otherwise every pair of faces shares a cell of 5 x 5 texels; corners lie on
    texel centres two texels apart, so bilinear sampling reproduces the colours' interpolation.

    Args:
        mesh: one material, `colors` not None.
    """
    assert mesh.colors is not None
    corner = mesh.colors[mesh.faces].astype(float)  # (F, 3, 4)
    material = mesh.materials[0]
    if (corner == corner[0, 0]).all():
        r, g, b, a = np.asarray(material.base_color) * corner[0, 0] / 255.0
        plain = replace(material, base_color=(float(r), float(g), float(b), float(a)))
        return replace(mesh, materials=(plain,), colors=None, uv=None)
    side, count = 5, len(corner)
    columns = int(np.ceil(np.sqrt((count + 1) // 2)))
    rows = -(-((count + 1) // 2) // columns)
    cell = np.arange(count) // 2
    row, column = cell // columns, cell % columns
    flip = np.arange(count) % 2 == 1
    picture = np.zeros((rows * side, columns * side, 4), np.uint8)
    for y in range(side):
        for x in range(side):
            upper = x + y >= side
            mine = flip == upper
            s, t = ((4 - x) / 2, (4 - y) / 2) if upper else (x / 2, y / 2)
            c = corner[mine]
            value = c[:, 0] + s * (c[:, 1] - c[:, 0]) + t * (c[:, 2] - c[:, 0])
            value = np.clip(np.round(value), 0, 255).astype(np.uint8)
            picture[row[mine] * side + y, column[mine] * side + x] = value
    texel = np.array([[0, 0], [2, 0], [0, 2]])
    at = np.where(flip[:, None, None], 4 - texel, texel) + 0.5  # (F, 3, 2)
    at = at + side * np.stack([column, row], axis=1)[:, None, :]
    uv = (at / [columns * side, rows * side]).reshape(-1, 2)
    opaque = bool((corner[..., 3] == 255).all())
    buffer = BytesIO()
    Image.fromarray(picture[..., :3] if opaque else picture).save(buffer, format="PNG")
    return replace(
        mesh,
        vertices=mesh.vertices[mesh.faces.reshape(-1)],
        faces=np.arange(3 * count).reshape(-1, 3),
        materials=(replace(material, image=buffer.getvalue(), image_format="png"),),
        uv=uv.astype(np.float32),
        colors=None,
    )


def free_name(name: str, taken: set[str]) -> str:
    """The name, or the name with a number that no other file has (cases are not told apart)."""
    candidate, k = name, 1
    while candidate.lower() in taken:
        candidate, k = f"{name}_{k}", k + 1
    taken.add(candidate.lower())
    return candidate
