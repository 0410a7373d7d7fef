"""Wavefront OBJ and MTL writing that keeps objects, texture files and coordinates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.formats.pictures import image_kind
from mam_pipeline.types import FloatArray, Material, Mesh


def write_obj(mesh: Mesh, path: Path) -> None:
    """Write a mesh as OBJ with an MTL and its texture files beside it; image bytes untouched.

    Numbers are printed with the digits that give the same float32 (UV) or float64 back.
    """
    stem = path.stem
    lines = [f"mtllib {stem}.mtl"]
    color: FloatArray = np.zeros((len(mesh.vertices), 0))
    if mesh.colors is not None:
        color = mesh.colors[:, :3] / 255.0
    for point, extra in zip(mesh.vertices.tolist(), color.tolist()):
        lines.append("v " + " ".join(map(repr, [*point, *extra])))
    if mesh.uv is not None:
        flipped = np.stack([mesh.uv[:, 0].astype(float), 1.0 - mesh.uv[:, 1].astype(float)], axis=1)
        lines += [f"vt {u!r} {v!r}" for u, v in flipped.tolist()]
    assert mesh.face_group is not None and mesh.face_material is not None
    last: tuple[int, int] | None = None
    corner = "{0}/{0}" if mesh.uv is not None else "{0}"
    keys = zip(mesh.face_group.tolist(), mesh.face_material.tolist())
    for (group, material), face in zip(keys, (mesh.faces + 1).tolist()):
        if last is None or last[0] != group:
            lines.append(f"o {mesh.group_names[group]}")
        if last is None or last[1] != material:
            lines.append(f"usemtl m{material}")
        last = (group, material)
        lines.append("f " + " ".join(corner.format(i) for i in face))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    _write_mtl(mesh, path)


def write_obj_part(
    mesh: Mesh, path: Path, picture: str = "", *, textured: bool = False,
    normals: FloatArray | None = None,
) -> None:  # fmt: skip
    """Write a mesh of one material as one OBJ object with an MTL of the same name beside it.

    Positions have the nine digits that give the same float32 back; texture coordinates have those
    that give the same float32 back after V was turned over. Vertex colours are not written.

    Args:
        mesh: `materials[0]` is that of every face.
        path: of the OBJ; its stem names the object and the material.
        picture: the texture's file name, in the same folder; "" for none.
        textured: whether to write texture coordinates.
        normals: (F, 3, 3) of every corner; None writes none.
    """
    stem = path.stem
    text = [f"mtllib {stem}.mtl\no {stem}\n", _rows("v %.9g %.9g %.9g\n", mesh.vertices)]
    triangles = mesh.faces + 1
    columns, pattern = [triangles], "%d"
    if textured and mesh.uv is not None:
        flipped = 1.0 - mesh.uv[:, 1].astype(float)
        pairs = zip(mesh.uv[:, 0].tolist(), flipped.tolist())
        text += [f"vt {u:.9g} {v!r}\n" for u, v in pairs]
        columns, pattern = [triangles, triangles], "%d/%d"
    if normals is not None:
        rows, index = np.unique(normals.reshape(-1, 3).round(6), axis=0, return_inverse=True)
        text.append(_rows("vn %.6g %.6g %.6g\n", rows))
        columns.append(index.reshape(-1, 3) + 1)
        pattern += "/%d" if len(columns) == 3 else "//%d"
    line = f"f {pattern} {pattern} {pattern}\n"
    corners = _rows(line, np.stack(columns, axis=2).reshape(len(triangles), -1))
    text += [f"usemtl {stem}\n", corners]
    path.write_text("".join(text), encoding="ascii")
    lines = [f"newmtl {stem}", *_mtl_numbers(mesh.materials[0])]
    if picture:
        lines.append(f"map_Kd {picture}")
    path.with_suffix(".mtl").write_text("\n".join(lines) + "\n", encoding="ascii")


def _rows(pattern: str, table: NDArray[Any]) -> str:
    """A line for every row of a table; in one go, since a large visual has a million of them."""
    return (pattern * len(table)) % tuple(table.reshape(-1).tolist())


def _mtl_numbers(material: Material) -> list[str]:
    """MTL lines of a material without its texture.

    Pm and Pr are the common extension for metallic and roughness; readers without it take the
    specular exponent Ns, for which 2 / roughness^4 - 2 is the usual equivalent.
    """
    r, g, b, a = material.base_color
    shine = min(2.0 / max(material.roughness, 0.05) ** 4 - 2.0, 1000.0)
    gloss = 0.04 + 0.5 * material.metallic
    return [
        f"Kd {r:.6g} {g:.6g} {b:.6g}",
        f"Ks {gloss:.6g} {gloss:.6g} {gloss:.6g}",
        f"Ns {max(shine, 0.0):.6g}",
        f"d {a:.6g}",
        f"Pm {material.metallic:.6g}",
        f"Pr {material.roughness:.6g}",
    ]


def _write_mtl(mesh: Mesh, path: Path) -> None:
    lines = []
    files: dict[bytes, str] = {}
    for i, material in enumerate(mesh.materials):
        lines += [f"newmtl m{i}", *_mtl_numbers(material)]
        if material.image is not None:
            if material.image not in files:
                kind = material.image_format or image_kind(material.image) or "png"
                files[material.image] = f"{path.stem}_{i}.{'jpg' if kind == 'jpeg' else kind}"
                (path.parent / files[material.image]).write_bytes(material.image)
            lines.append(f"map_Kd {files[material.image]}")
    path.with_suffix(".mtl").write_text("\n".join(lines) + "\n", encoding="utf-8")
