"""Pictures that a model file names or holds: where they lie, and their bytes as PNG or JPEG.

Exporters write the paths of the disk that they ran on: with backslashes, percent signs, other
cases, another machine's folders. A picture is looked for where the name says, then by ever shorter
ends of the name in the folders in which pictures of models usually lie. Nothing outside the model's
own folder tree is opened: the folder of the file, or the one above it where it is that of a model,
whose `meshes/` lie beside `materials/` or `textures/`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from PIL import Image

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, Outside, is_file
from mam_pipeline.formats.soup import LIMITS, Budget
from mam_pipeline.optional import has, install_command

Kind = Literal["png", "jpeg"]


@dataclass(frozen=True)
class Search:
    """Where pictures are looked for.

    Attributes:
        meshes: names of folders that hold the meshes of a model, whose folder is the one above.
        beside: folders of pictures beside which meshes lie.
        folders: below the model's folder, and below the one above it.
        encodings: of names in files that do not say theirs.
        entries: of one folder that are looked through.
        gazebo: the folder of the pictures that Gazebo's material scripts name.
        colors: what is in the names of pictures that show a surface's colour.
    """

    meshes: tuple[str, ...] = (
        "meshes", "mesh", "visual", "visuals", "source", "geometry", "collision",
    )  # fmt: skip
    beside: tuple[str, ...] = ("materials", "textures")
    folders: tuple[str, ...] = (
        "", "textures", "materials/textures", "texture", "tex", "maps", "images", "materials",
    )  # fmt: skip
    encodings: tuple[str, ...] = ("gb18030", "shift_jis", "euc_kr", "cp1252")
    entries: int = 10_000
    gazebo: str = "materials/textures"
    colors: tuple[str, ...] = ("diffuse", "albedo", "basecolor", "base_color", "color")


SEARCH = Search()


@dataclass(frozen=True)
class Picture:
    """A picture that every reader takes."""

    data: bytes
    kind: Kind


@dataclass
class Pictures:
    """The pictures of one model file; what could not be had is noted.

    Attributes:
        by: the model file. budget: what reading it has taken.
        door: opens its folder tree.
        outside: sentences on names that lead out of it.
        missing: names under which nothing was found.
        unread: names of pictures that cannot be decoded, with the reason.
    """

    by: Path
    budget: Budget
    door: Door
    outside: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    _known: dict[str, Picture | None] = field(default_factory=dict)
    _pixels: int = LIMITS.pixels

    def named(self, name: str) -> Picture | None:
        """The picture of that name; None, and noted, where there is none."""
        if name not in self._known:
            file = find(name, self.by, self.door)
            if file is None:
                self._known[name] = None
                self._note_missing(name)
            else:
                self._known[name] = self.decoded(self.budget.read(file), _short(name))
        return self._known[name]

    def _note_missing(self, name: str) -> None:
        try:
            self.door.find(unquote(name), self.by)
        except Outside as error:
            there = is_file(self.by.parent / unquote(name))
            (self.outside if there else self.missing).append(str(error) if there else _short(name))
        except InputError as error:
            self.unread.append(f"{_short(name)} ({error})")
        else:
            self.missing.append(_short(name))

    def decoded(self, data: bytes, name: str) -> Picture | None:
        """PNG and JPEG as they are, anything else as PNG; None, and noted, where it fails."""
        kind = image_kind(data)
        if kind is not None:
            return Picture(data, kind)
        try:
            return Picture(_as_png(data, self._pixels), "png")
        except Exception as error:  # every decoder fails in its own way
            words = str(error).splitlines()
            self.unread.append(f"{name} ({words[0] if words else type(error).__name__})")
            return None

    def only_color(self) -> str | None:
        """Name of the one picture of a surface's colour in Gazebo's folder beside the model's."""
        folder = self.by.parent.resolve().parent / SEARCH.gazebo
        if not self.door.holds(folder):
            return None
        try:
            names = [entry.name for entry in islice(os.scandir(folder), SEARCH.entries)]
        except OSError:
            return None
        found = [n for n in names if any(word in n.casefold() for word in SEARCH.colors)]
        return found[0] if len(found) == 1 else None

    def notes(self) -> tuple[str, ...]:
        """What is not as the file says, a line each."""
        out = list(dict.fromkeys(self.outside))
        if self.missing:
            out.append(
                f"textures not found: {_listed(self.missing)}; put them beside {self.by.name} "
                "or into a folder textures/ there"
            )
        if self.unread:
            out.append(f"textures left out, they cannot be read: {_listed(self.unread)}")
        return tuple(out)


def model_door(file: Path, root: Path | None = None) -> Door:
    """Opens the folder tree of a model file.

    Args:
        root: a folder to which it belongs, such as that of a URDF; else its own is found.
    """
    here = file.parent.resolve()
    above = here.parent
    mesh_folder = here.name.casefold() in SEARCH.meshes
    model = mesh_folder or any((above / name).is_dir() for name in SEARCH.beside)
    if root is None and model and above != above.parent:
        return Door(above)
    return Door(root or here)


def find(name: str, by: Path, door: Door) -> Path | None:
    """The file that a model names, looked for in its own folder tree; None where there is none.

    Args:
        name: as it stands in the model file. by: the model file. door: opens its folder tree.
    """
    here = by.parent.resolve()
    top = door.root.resolve()
    for option in _options(name, here, here.parent if door.holds(here.parent) else here):
        file = _as_spelled(option, top if option.is_relative_to(top) else option.parent)
        if file is not None and door.holds(file):
            return file
    return None


def _options(name: str, here: Path, top: Path) -> Iterator[Path]:
    """Where a name may lead, the most literal reading first."""
    if "\0" in name or len(name) > 1024:
        return
    folders = [base / folder for base in dict.fromkeys((here, top)) for folder in SEARCH.folders]
    for spelled in _spellings(name):
        path = re.sub(r"^file:/*(?=[A-Za-z]:|/)", "", spelled.replace("\\", "/"))
        parts = [p for p in re.sub(r"^[A-Za-z]:", "", path).split("/") if p not in ("", ".")]
        if not parts:
            continue
        yield Path(os.path.normpath(here / path))
        ends = [p for p in parts if p != ".."]
        for start in range(len(ends)):
            for folder in folders if start == len(ends) - 1 else (here, top):
                yield folder.joinpath(*ends[start:])


def _spellings(name: str) -> list[str]:
    """The name, without percent signs, and as other encodings would have read it."""
    out = [name.strip(), unquote(name.strip())]
    if not name.isascii():
        out += [text for text in _readings(name.strip()) if text]
    return list(dict.fromkeys(out))


def _readings(name: str) -> Iterator[str]:
    """A name whose bytes are no UTF-8 (kept as surrogates), as other encodings read it."""
    raw = name.encode("utf-8", "surrogateescape")
    # letters of alphabets stand alone between ASCII, those of East Asia are two bytes and more
    alone = re.search(rb"[\x80-\xff][\x40-\xff]*[\x80-\xff]", raw) is None
    for encoding in reversed(SEARCH.encodings) if alone else SEARCH.encodings:
        try:
            yield raw.decode(encoding)
        except UnicodeDecodeError:
            continue


def readable(name: str) -> str:
    """A name that was read with `surrogateescape`, as text that any file can hold."""
    if name.isprintable():
        return name
    return next(_readings(name), name.encode("ascii", "replace").decode())


def _as_spelled(path: Path, top: Path) -> Path | None:
    """An ordinary file of that path below `top`, cases told apart only if need be."""
    at = top
    for part in path.relative_to(top).parts:
        following = at / part
        if not os.path.lexists(following):
            name = _alike(at, part)
            if name is None:
                return None
            following = at / name
        at = following
    return Path(os.path.realpath(at)) if is_file(at) else None


def _alike(folder: Path, name: str) -> str | None:
    """The entry of a folder that differs from the name in its cases alone."""
    try:
        with os.scandir(folder) as entries:
            for count, entry in enumerate(entries):
                if count >= SEARCH.entries:
                    break
                if entry.name.casefold() == name.casefold():
                    return entry.name
    except OSError:
        pass
    return None


def image_kind(data: bytes) -> Kind | None:
    """Tell PNG and JPEG by their first bytes; None for anything else."""
    if data.startswith(b"\x89PNG"):
        return "png"
    return "jpeg" if data.startswith(b"\xff\xd8") else None


def _as_png(data: bytes, pixels: int) -> bytes:
    """WebP, KTX2, TGA, BMP ... as PNG without loss."""
    if data.startswith(b"\xabKTX 20"):
        picture = _ktx2(data, pixels)
    else:
        picture = Image.open(BytesIO(data))
        _under(picture.width, picture.height, pixels)
    alpha = "A" in picture.mode or "transparency" in picture.info
    buffer = BytesIO()
    picture.convert("RGBA" if alpha else "RGB").save(buffer, format="PNG")
    return buffer.getvalue()


def _ktx2(data: bytes, pixels: int) -> Image.Image:
    """The largest level of a Basis Universal texture (KHR_texture_basisu)."""
    if not has("opengl_basisu"):
        raise InputError(f"KTX2 needs: {install_command('opengl_basisu')}")
    import opengl_basisu

    texture = opengl_basisu.open(data)
    _under(texture.width, texture.height, pixels)
    level = texture.transcode("rgba8")
    picture = Image.fromarray(level.data.reshape(texture.height, texture.width, 4))
    return picture if texture.has_alpha else picture.convert("RGB")


def _under(width: int, height: int, pixels: int) -> None:
    if width * height > pixels:
        raise InputError(f"{width} x {height} pixels")


def _short(name: str) -> str:
    return unquote(readable(name)).replace("\\", "/").rpartition("/")[2] or name


def _listed(names: list[str], most: int = 5) -> str:
    named = list(dict.fromkeys(names))
    more = len(named) - most
    return ", ".join(named[:most]) + (f" and {more} more" if more > 0 else "")
