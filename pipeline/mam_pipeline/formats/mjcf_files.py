"""Which files belong to an MJCF file, as far as they lie in its folder."""

from __future__ import annotations

from pathlib import Path

from mam_pipeline.formats.door import Door
from mam_pipeline.formats.xml_file import parse_xml

DIRECTORIES = ("meshdir", "texturedir", "assetdir")


def is_mjcf(path: Path) -> bool:
    """Whether a file's root element is <mujoco>, as far as its first bytes tell."""
    with path.open("rb") as stream:
        return path.is_file() and b"<mujoco" in stream.read(1 << 14)


def files_of_mjcf(path: Path) -> list[Path]:
    """An MJCF file and all files that it names.

    Raises:
        InputError: it cannot be read as XML, or names a file outside its folder.
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
        for compiler in root.iter("compiler"):
            folders += [path.parent / compiler.get(k, "") for k in DIRECTORIES if compiler.get(k)]
        for element in root.iter():
            names = [v for k, v in element.attrib.items() if k.startswith("file")]
            for name in names:
                options = [door.find(name, file, folder) for folder in folders]
                waiting += [next((o for o in options if o is not None), file)]
    return list(found)
