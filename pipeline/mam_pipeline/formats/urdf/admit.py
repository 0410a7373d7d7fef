"""Whether a URDF may be read: its XML, and all files that it and its meshes name."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door, Survey, is_file
from mam_pipeline.formats.urdf.bounds import check_bounds
from mam_pipeline.formats.xml_file import parse_xml


def admitted(urdf: Path) -> ET.Element:
    """The root element of a URDF that names nothing outside its folder.

    Raises:
        InputError: no such file, no URDF, a document type or entity, or a name that leads out of
            the folder (`mam_pipeline.formats.door`).
    """
    if not is_file(urdf):
        raise InputError(f"no URDF at {urdf}")
    root = parse_xml(urdf)
    if root.tag != "robot":
        raise InputError(f"{urdf} is not a URDF: its root element is <{root.tag}>, not <robot>")
    check_bounds(root, urdf)
    for error in refused(urdf, root):
        raise error
    return root


def refused(urdf: Path, root: ET.Element) -> Iterator[InputError]:
    """An error for every name in a URDF, or in a mesh of it, that may not be opened."""
    door = Door(urdf.parent)
    survey = Survey(door)
    names = [e.get("filename") or "" for tag in ("mesh", "texture") for e in root.iter(tag)]
    for name in dict.fromkeys(names):
        try:
            file = door.find(name, urdf)
            if file is not None:
                survey.mesh(file)
        except InputError as error:
            yield error
    beside = urdf.with_suffix(".srdf")  # SAPIEN reads it where it is
    try:
        if door.find(beside.name, urdf) is not None:
            parse_xml(beside)
    except InputError as error:
        yield error


def through_door(link: Any, folder: Path) -> None:
    """Give a link of another URDF parser, in place, the files that the door opens for its names.

    By themselves loaders look for a package's files in all folders above.

    Args:
        link: with `visuals` and `collisions` of `geometry` and `material`, as SAPIEN's has.

    Raises:
        InputError: a name that leads out of the folder, or to nothing.
    """
    named = [shape.geometry.mesh for shape in (*link.visuals, *link.collisions)]
    named += [v.material.texture for v in link.visuals if v.material is not None]
    for item in named:
        if item is not None:
            found = Door(folder).find(item.filename, folder, folder)
            if found is None:
                raise InputError(f"{folder} lacks {item.filename}, which its URDF names")
            item.filename = str(found.absolute())
