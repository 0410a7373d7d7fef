"""Which files belong to an MJCF file, as far as they lie in its folder."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, is_file
from mam_pipeline.formats.soup import LIMITS
from mam_pipeline.formats.xml_file import parse_xml

DIRECTORIES = ("meshdir", "texturedir", "assetdir")


def is_mjcf(path: Path) -> bool:
    """Whether a file's root element is <mujoco>, as far as its first bytes tell."""
    if not is_file(path):
        return False
    with path.open("rb") as stream:
        return b"<mujoco" in stream.read(1 << 14)


def files_of_mjcf(path: Path) -> list[Path]:
    """An MJCF file and all files that it names.

    Raises:
        InputError: it cannot be read as XML, names a file outside its folder, or counts more
            bodies or pixels than may be read.
    """
    door, found, waiting = Door(path.parent), dict[Path, None](), [path]
    folders = [path.parent]
    while waiting:
        file = waiting.pop(0)
        if file in found:
            continue
        found[file] = None
        if file.suffix.lower() != ".xml" and file != path:
            continue
        root = parse_xml(file)
        check_counts(root, file)
        for compiler in root.iter("compiler"):
            folders += [path.parent / compiler.get(k, "") for k in DIRECTORIES if compiler.get(k)]
        for element in root.iter():
            names = [v for k, v in element.attrib.items() if k.startswith("file")]
            for name in names:
                options = [door.find(name, file, folder) for folder in folders]
                waiting += [next((o for o in options if o is not None), file)]
    return list(found)


def check_counts(root: ET.Element, file: Path) -> None:
    """Refuse counts of an MJCF that MuJoCo would work through without an end.

    Raises:
        InputError: more elements are made, or more pixels painted, than may be read.
    """
    made = _made(root, file, 0)
    if made > LIMITS.nodes:
        raise InputError(f"{file} makes {made:.6g} elements; the most is {LIMITS.nodes}")
    for tag, keys in (("texture", ("width", "height")), ("hfield", ("nrow", "ncol"))):
        for element in root.iter(tag):
            pixels = math.prod(_count(element.get(key, "1"), file) for key in keys)
            if pixels > LIMITS.pixels:
                text = f"a {tag} of {pixels:.6g} pixels; the most is {LIMITS.pixels}"
                raise InputError(f"{file} has {text}")


def _made(element: ET.Element, file: Path, deep: int) -> float:
    """How many elements one becomes: those in <replicate> once a copy, a <composite> a grid."""
    if deep > LIMITS.deep:
        raise InputError(f"{file} is nested more than {LIMITS.deep} deep")
    times = 1.0
    if element.tag in ("replicate", "composite", "flexcomp"):
        times = math.prod(_count(word, file) for word in element.get("count", "1").split())
    return max(times, 1.0) * (1 + sum(_made(child, file, deep + 1) for child in element))


def _count(word: str, file: Path) -> float:
    try:
        return max(float(word), 0.0)
    except ValueError:
        raise InputError(f"{file}: {word[:40]!r} is no count") from None
