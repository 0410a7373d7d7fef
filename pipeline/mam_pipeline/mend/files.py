"""Repairs of files: meshes and pictures that are not found, or that simulators refuse."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from mam_pipeline.asset.visuals import Pictures, by_material, free_name
from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.formats.door import Door, lost_names
from mam_pipeline.formats.files import files_of
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.obj_write import write_obj_part
from mam_pipeline.formats.pictures import SEARCH, find
from mam_pipeline.formats.soup import FileContent, Piece, join
from mam_pipeline.formats.suffixes import mesh_suffixes
from mam_pipeline.geometry.surface import triangle_areas
from mam_pipeline.mend.joints import finite as finite_joints
from mam_pipeline.mend.work import SHAPES, Work


def bring_along(work: Work) -> None:
    """Copy what the source names inside its folder, to the same places beside the copy."""
    base = work.source.parent.resolve()
    beside = work.source.with_suffix(".srdf")
    found = [_exact(work, e.get("filename") or "") for e in _named(work)]
    found += [beside if beside.is_file() and work.door.holds(beside) else None]
    for file in found:
        if file is not None and file.resolve().is_relative_to(base):
            work.bring(file)


def _named(work: Work) -> Iterator[ET.Element]:
    yield from (e for tag in ("mesh", "texture") for e in work.root.iter(tag))


def _exact(work: Work, name: str) -> Path | None:
    try:
        return work.door.find(name, work.source)
    except InputError:  # the check says why
        return None


def missing(work: Work, reason: str = "mesh_missing") -> None:
    """Meshes that are spelled otherwise, lie elsewhere below the folder, or have another suffix.

    Where nothing is found, and the link has shapes of the other kind, these stand for the mesh.
    """
    for link, kind, element, mesh in list(work.meshes()):
        name = mesh.get("filename") or ""
        try:
            if Door(work.folder).find(name, work.urdf) is not None:
                continue
        except InputError:
            continue
        found = _alike(work, name)
        if found is not None:
            place = work.bring(found)
            mesh.set("filename", place)
            same = found.suffix.lower() == Path(name).suffix.lower()
            why = "the file that is there" if same else "the same name in another format"
            work.change(reason, f"{link.get('name')}, {kind}", name, place, why)
            continue
        others = link.findall(SHAPES[1 - SHAPES.index(kind)])
        there = [o for o in others if _whole(work, o)]
        if there:
            link.remove(element)
            if link.find(kind) is None:
                for other in there:
                    own = ET.SubElement(link, kind)
                    own.extend([e for e in other if e.tag in ("origin", "geometry")])
            after = f"its {SHAPES[1 - SHAPES.index(kind)]} shapes"
            why = "the file is nowhere below the folder, and a name of nothing is refused"
            work.change(reason, f"{link.get('name')}, {kind}", name, after, why)


def _whole(work: Work, element: ET.Element) -> bool:
    mesh = element.find("geometry/mesh")
    return mesh is None or (work.folder / (mesh.get("filename") or "")).is_file()


def _alike(work: Work, name: str) -> Path | None:
    """A file of the name by ever shorter ends of its path, in other cases, of other suffixes."""
    bare = name.partition("://")[2] or name
    stems = [bare, *(str(Path(bare).with_suffix(s)) for s in mesh_suffixes())] if bare else []
    stems += [f"{folder}/{Path(stem).name}" for stem in stems for folder in SEARCH.meshes]
    for stem in stems:
        found = find(stem, work.source, work.door)
        if found is not None:
            return found
    return None


def relative(work: Work, reason: str = "mesh_path") -> None:
    """Names relative to the URDF in place of package://, file:// and absolute ones."""
    why = "the folder can be moved, and a simulator without ROS finds it"
    _brought(work, reason, why, lambda name, _: "://" in name or name.startswith("/"))


def inside(work: Work, reason: str = "mesh_outside") -> None:
    """Files outside the folder, copied into it; only what `--allow-outside` lets in."""
    base = work.source.parent.resolve()
    why = "copied into the folder; nothing outside it is read"
    _brought(work, reason, why, lambda _, file: not file.resolve().is_relative_to(base))


def _brought(work: Work, reason: str, why: str, wanted: Callable[[str, Path], bool]) -> None:
    """Copy the files that are found and wanted, by their names, and name the copies."""
    for element in _named(work):
        name = element.get("filename") or ""
        found = _exact(work, name)
        if found is not None and wanted(name, found):
            place = work.bring(found)
            element.set("filename", place)
            work.change(reason, element.tag, name, place, why)


def pictures(work: Work, reason: str = "texture_missing") -> None:
    """Pictures and material files that are spelled otherwise or lie elsewhere."""
    base = work.source.parent.resolve()
    for file in files_of(work.urdf)[1:]:
        for name in lost_names(file):
            origin = base / file.resolve().relative_to(work.folder.resolve())
            by = origin if origin.is_file() else work.source
            found = find(name, by, work.door)
            if found is None or not _renamed(file, name, found.name):
                continue
            (file.parent / found.name).write_bytes(found.read_bytes())
            why = "the file of that name that is there"
            work.change(reason, file.name, name, found.name, why)


def _renamed(file: Path, old: str, new: str) -> bool:
    """Name another file where a mesh or material file names one; whether it does so."""
    told, suffix = re.escape(old.encode("utf-8", "surrogateescape")), file.suffix.lower()
    around = _AROUND.get(suffix)
    if around is None:  # packed
        return False
    data = file.read_bytes()
    changed = re.sub(
        around[0] + told + around[1], lambda m: m[1] + os.fsencode(new) + m[2], data, flags=re.M
    )
    if changed != data:
        file.write_bytes(changed)
    return changed != data


_LINE = (
    rb"^([ \t]*(?:mtllib|map_\w+|bump|disp|decal|refl|norm|comment[ \t]+TextureFile)[ \t]+"
    rb"(?:\S.*[ \t])?)",
    rb"([ \t\r]*)$",
)
_AROUND = {
    ".obj": _LINE, ".mtl": _LINE, ".ply": _LINE, ".dae": (rb"(>\s*)", rb"(\s*<)"),
    ".gltf": (rb'(")', rb'(")'),
}  # fmt: skip
"""What stands before and after the name of a picture or material file, by suffix."""


def finite(work: Work, reason: str = "not_finite") -> None:
    """Meshes and numbers of joints without NaN and without what has no end."""
    readable(work, reason)
    finite_joints(work, reason)


def readable(work: Work, reason: str) -> None:
    """Meshes written anew as OBJ, which all read: without faces that are no surface, in one scale.

    Args:
        reason: decides which are: those with points that are not finite, with faces of no area, of
            other formats, of several objects, or mirrored.
    """
    wanted = _WANTED[reason]
    taken: set[str] = {p.stem.lower() for p in work.folder.rglob("*.obj")}
    store = Pictures(work.folder / "meshes")
    for link, kind, element, mesh in list(work.meshes()):
        file = work.folder / (mesh.get("filename") or "")
        scale = _scale(mesh)
        content = _content(file, work.folder)
        if scale is None or content is None or not wanted(file, content, scale):
            continue
        pieces = [q for p in content.pieces if len((q := _sound(p, scale)).faces)]
        if not pieces:
            continue
        (work.folder / "meshes").mkdir(exist_ok=True)
        made = []
        whole = join(pieces, content.materials)
        parts = by_material(whole) if kind == "visual" else [whole]
        at = list(link).index(element)
        for k, part in enumerate(parts):
            name = free_name(file.stem if k == 0 else f"{file.stem}_{k}", taken)
            picture = store.file_of(part.materials[0]) if kind == "visual" else ""
            write_obj_part(part, work.folder / "meshes" / f"{name}.obj", picture,
                           textured=bool(picture))  # fmt: skip
            own = ET.fromstring(ET.tostring(element))
            shape = own.find("geometry/mesh")
            assert shape is not None
            shape.set("filename", f"meshes/{name}.obj")
            shape.attrib.pop("scale", None)
            link.insert(at + k, own)
            made.append(f"{name}.obj")
        link.remove(element)
        lost = sum(len(p.faces) for p in content.pieces) - sum(len(p.faces) for p in pieces)
        why = _WHY[reason] + (f"; {lost} faces that are no surface went" if lost else "")
        before = file.name if np.allclose(scale, 1.0) else f"{file.name}, scale {mesh.get('scale')}"
        work.change(reason, f"{link.get('name')}, {kind}", before, ", ".join(made), why)


def _scale(mesh: ET.Element) -> np.ndarray | None:
    try:
        values = np.array([float(w) for w in (mesh.get("scale") or "1").split()])
    except ValueError:
        return None
    return np.broadcast_to(values, (3,)) if len(values) in (1, 3) else None


def _content(file: Path, root: Path) -> FileContent | None:
    try:
        return read_file(file, root)
    except MamSimError:
        return None


def _sound(piece: Piece, scale: np.ndarray) -> Piece:
    """A piece at its size, without faces that have no finite corners or no area."""
    good = np.asarray(np.isfinite(piece.vertices).all(axis=1))
    vertices = np.where(good[:, None], piece.vertices, 0.0) * scale
    faces = piece.faces[:, ::-1] if np.prod(scale) < 0 else piece.faces
    keep = good[faces].all(axis=1) & (triangle_areas(vertices[faces]) > 0.0)
    return replace(piece, vertices=vertices, faces=faces[keep])


def _not_finite(_file: Path, content: FileContent, _scale: np.ndarray) -> bool:
    return not all(np.isfinite(p.vertices).all() for p in content.pieces)


def _mirrored(_file: Path, _content: FileContent, scale: np.ndarray) -> bool:
    return bool(min(scale) < 0)


def _foreign(file: Path, _content: FileContent, _scale: np.ndarray) -> bool:
    return file.suffix.lower() != ".obj"


def _several(file: Path, content: FileContent, _scale: np.ndarray) -> bool:
    return file.suffix.lower() == ".obj" and len({p.group for p in content.pieces}) > 1


_WANTED = {"not_finite": _not_finite, "negative_scale": _mirrored, "mesh_format": _foreign,
           "several_objects": _several}  # fmt: skip
_WHY = {
    "not_finite": "every corner is a number",
    "negative_scale": "mirrored in the file, since simulators refuse or ignore a mirrored scale",
    "mesh_format": "a format that every simulator reads",
    "several_objects": "one object a file: some read the first alone",
}
