"""Wavefront OBJ and MTL reading and writing that keeps objects, texture files and coordinates."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.pictures import (
    Picture,
    Pictures,
    find,
    image_kind,
    model_door,
    readable,
)
from mam_pipeline.formats.soup import LIMITS, Budget, FileContent, Piece
from mam_pipeline.types import FloatArray, Material, Mesh

_NO_SURFACE = {
    "p": "points", "l": "lines", "curv": "curves", "curv2": "curves", "surf": "curved surfaces",
}  # fmt: skip


def read_obj(path: Path, root: Path | None = None) -> FileContent:
    """Read the polygons of an OBJ file, fans of triangles, with the materials of its MTL files.

    A vertex is made for every distinct pair of position and texture coordinate; V is flipped to
    the glTF convention. Names may be of any encoding and hold spaces.

    Args:
        path: the file. root: folder whose files it may name; default: its own.

    Raises:
        InputError: a line is malformed or a face names a vertex that does not exist.
    """
    state = _State(path, Budget(path), model_door(path, root))
    for number, line in _lines(path):
        words = line.split()
        if not words or words[0][0] == "#":
            continue
        try:
            state.line(words, line)
        except (ValueError, IndexError) as error:
            shown = line.strip() if len(line) < 80 else f"{line.strip()[:77]}..."
            raise InputError(f"{path}, line {number}: not valid OBJ ({shown!r})") from error
    return state.content()


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a text file with their numbers, one at a time; a backslash at the end joins two."""
    held = ""
    with path.open(encoding=_encoding(path), errors="surrogateescape") as file:
        for number, line in enumerate(file, start=1):
            if len(held) + len(line) > LIMITS.line:
                raise InputError(f"{path}, line {number}: longer than {LIMITS.line >> 20} MiB")
            if line.endswith("\\\n"):
                held += line[:-2] + " "
                continue
            yield number, held + line
            held = ""
    if held:
        yield number, held


def _encoding(path: Path) -> str:
    """UTF-16 says so by its first bytes; all else is ASCII with names in some encoding."""
    with path.open("rb") as file:
        head = file.read(2)
    return "utf-16" if head in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"


@dataclass
class _State:
    """What has been read so far of one OBJ file."""

    path: Path
    budget: Budget
    door: Door
    v: list[list[float]] = field(default_factory=list)
    rgb: list[list[float]] = field(default_factory=list)
    vt: list[list[float]] = field(default_factory=list)
    group: str = "mesh"
    material: int = 0
    materials: list[Material] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)
    library: dict[str, Material] = field(default_factory=dict)
    libraries: set[str] = field(default_factory=set)
    missing: list[str] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    pictures: Pictures = field(init=False)
    runs: dict[tuple[str, int], list[list[tuple[int, int]]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.pictures = Pictures(self.path, self.budget, self.door)

    def line(self, words: list[str], raw: str) -> None:
        key = words[0]
        if key == "v":
            numbers = [float(w) for w in words[1:]]
            if len(numbers) < 3:
                raise ValueError("a vertex has three numbers")
            self.budget.triangles(1, 0)
            self.v.append(numbers[:3])
            if len(numbers) >= 6:
                self.rgb.append(numbers[3:6])
        elif key == "vt":
            u, v = (float(w) for w in (*words[1:3], "0")[:2])  # a strip of texture has no v
            self.budget.triangles(1, 0)
            self.vt.append([u, v])
        elif key == "f":
            self.face(words[1:])
        elif key in ("o", "g"):
            self.group = readable(" ".join(words[1:])) or "mesh"
        elif key == "usemtl":
            self.material = self.named(" ".join(words[1:]))
        elif key == "mtllib":
            self.read_libraries(raw.split(None, 1)[1].strip())
        elif key in _NO_SURFACE:
            self.dropped[_NO_SURFACE[key]] += 1

    def read_libraries(self, told: str) -> None:
        """One library whose name may hold spaces, or several."""
        names = [told] if find(told, self.path, self.door) is not None else told.split()
        for name in names:
            if name in self.libraries:
                continue
            self.libraries.add(name)
            file = find(name, self.path, self.door)
            if file is None:
                self.missing.append(readable(name))
            else:
                self.library.update(_read_mtl(file, self.pictures))

    def named(self, name: str) -> int:
        if name not in self.names:
            self.names[name] = len(self.materials)
            self.materials.append(
                self.library.get(name, Material(name=readable(name) or "default"))
            )
        return self.names[name]

    def face(self, corners: list[str]) -> None:
        if not self.materials:
            self.material = self.named("default")
        ring = []
        for corner in corners:
            fields = corner.split("/")
            p = int(fields[0])
            t = int(fields[1]) if len(fields) > 1 and fields[1] else 0
            p = p - 1 if p > 0 else len(self.v) + p
            t = t - 1 if t > 0 else (len(self.vt) + t if t < 0 else -1)
            if not (0 <= p < len(self.v) and -1 <= t < len(self.vt)):
                raise IndexError(corner)
            ring.append((p, t))
        if len(ring) < 3:
            return
        self.budget.triangles(0, len(ring) - 2)
        fan = [[ring[0], ring[i], ring[i + 1]] for i in range(1, len(ring) - 1)]
        run = self.runs.setdefault((self.group, self.material), [])
        run.extend(fan)

    def content(self) -> FileContent:
        points = np.array(self.v, dtype=np.float64).reshape(-1, 3)
        uvs = np.array(self.vt, dtype=np.float64).reshape(-1, 2)
        colored = len(self.rgb) == len(self.v) > 0
        pieces = []
        for (group, material), triangles in self.runs.items():
            corners = np.array(triangles, dtype=np.int64).reshape(-1, 2)
            pairs, inverse = np.unique(corners, axis=0, return_inverse=True)
            uv = colors = None
            if len(uvs) and (pairs[:, 1] >= 0).any():
                uv = _flip(np.vstack([uvs, [0.0, 1.0]])[pairs[:, 1]])  # the last for those without
            if colored:
                colors = _rgba(np.array(self.rgb)[pairs[:, 0]])
            faces = inverse.reshape(-1, 3)
            pieces.append(Piece(points[pairs[:, 0]], faces, group, material, uv, colors))
        notes = self.pictures.notes()
        if self.missing:
            notes += (f"material files not found: {', '.join(self.missing)}; the colours are lost",)
        if self.dropped:
            notes += (f"not taken over: {', '.join(sorted(self.dropped))}",)
        return FileContent(tuple(pieces), tuple(self.materials) or (Material(),), notes=notes)


def _rest(line: str) -> str:
    """A line without its first word."""
    words = line.split(None, 1)
    return words[1].strip() if len(words) > 1 else ""


def _read_mtl(file: Path, pictures: Pictures) -> dict[str, Material]:
    """Materials of a library by name."""
    out: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    data = pictures.budget.read(file)
    text = data.decode(_encoding(file), "surrogateescape")
    for line in text.splitlines():
        key, _, _ = line.strip().partition(" ")
        key = key.split("\t")[0].lower()
        if key == "newmtl":
            current = out.setdefault(" ".join(line.split()[1:]), {})
        elif key in ("kd", "d", "tr", "pm", "pr", "map_kd"):
            current[key] = _rest(line)
    return {name: _material(name, raw, file, pictures) for name, raw in out.items()}


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


def write_obj_part(mesh: Mesh, path: Path, picture: str = "", *, textured: bool = False) -> None:
    """Write a mesh of one material as one OBJ object with an MTL of the same name beside it.

    Positions have the nine digits that give the same float32 back; texture coordinates have those
    that give the same float32 back after V was turned over. Vertex colours are not written.

    Args:
        mesh: `materials[0]` is that of every face.
        path: of the OBJ; its stem names the object and the material.
        picture: the texture's file name, in the same folder; "" for none.
        textured: whether to write texture coordinates.
    """
    stem = path.stem
    lines = [f"mtllib {stem}.mtl", f"o {stem}"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    triangles = (mesh.faces + 1).tolist()
    if textured and mesh.uv is not None:
        flipped = 1.0 - mesh.uv[:, 1].astype(float)
        lines += [f"vt {u:.9g} {v!r}" for u, v in zip(mesh.uv[:, 0].tolist(), flipped.tolist())]
        faces = [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in triangles]
    else:
        faces = [f"f {a} {b} {c}" for a, b, c in triangles]
    lines += [f"usemtl {stem}", *faces]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    text = [f"newmtl {stem}", *_mtl_numbers(mesh.materials[0])]
    if picture:
        text.append(f"map_Kd {picture}")
    path.with_suffix(".mtl").write_text("\n".join(text) + "\n", encoding="ascii")


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


def _material(name: str, raw: dict[str, str], file: Path, pictures: Pictures) -> Material:
    def numbers(key: str, *default: float) -> list[float]:
        try:
            found = [float(w) for w in raw[key].split()[: len(default)]]
        except (KeyError, ValueError):
            found = []
        return found if len(found) == len(default) else list(default)

    (alpha,) = numbers("d", 1.0 - numbers("tr", 0.0)[0])
    r, g, b = numbers("kd", *([1.0] * 3 if "kd" not in raw else [0.7] * 3))
    picture = _picture(raw["map_kd"], file, pictures) if "map_kd" in raw else None
    if picture is not None and max(r, g, b) == 0.0:  # exporters write black under a texture
        r = g = b = 1.0
    return Material(
        readable(name) or "default",
        (r, g, b, alpha),
        None if picture is None else picture.data,
        None if picture is None else picture.kind,
        numbers("pm", 0.0)[0],
        numbers("pr", 0.8)[0],
    )


def _picture(told: str, file: Path, pictures: Pictures) -> Picture | None:
    """The texture of a map_Kd line; options such as "-s 1 1 1" come before its name."""
    words = told.split()
    names = [" ".join(words[i:]) for i in range(len(words))] if told[:1] == "-" else [told]
    for name in names:
        beside = os.path.join(os.path.relpath(file.parent, pictures.by.parent), name)
        for option in (name, beside):
            if find(option, pictures.by, pictures.door) is not None:
                return pictures.named(option)
    return pictures.named(names[-1]) if names else None


def _flip(uv: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1).astype(np.float32)


def _rgba(rgb: NDArray[np.float64]) -> NDArray[np.uint8]:
    scale = 255.0 if rgb.max() <= 1.0 else 1.0
    out = np.full((len(rgb), 4), 255, np.uint8)
    out[:, :3] = np.clip(np.round(rgb * scale), 0, 255)
    return out
