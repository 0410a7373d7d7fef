"""What a PLY, OFF, STL or DAE file claims, held against what it holds before a library reads it.

The library that reads these formats trusts their headers: wrong counts make it hang, take all
memory, or answer with another surface.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.formats.soup import LIMITS
from mam_pipeline.formats.xml_file import parse_xml

HEADER_BYTES = 1 << 16
"""A PLY header is at most this long."""
_SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2,
    "int": 4, "uint": 4, "float": 4, "int32": 4, "uint32": 4, "float32": 4, "double": 8,
    "float64": 8, "int64": 8, "uint64": 8,
}  # fmt: skip


def check_header(file: Path) -> None:
    """Refuse a file whose header claims more than the file holds, or more than may be read.

    Raises:
        InputError: it does.
    """
    checks = {".ply": _check_ply, ".off": _check_off, ".dae": _check_dae, ".stl": _check_stl}
    check = checks.get(file.suffix.lower())
    if check is not None:
        check(file)


def _check_ply(file: Path) -> None:
    with file.open("rb") as stream:
        head = stream.read(HEADER_BYTES)
    end = re.search(rb"(?:^|\n)end_header[ \t\r]*\n", head)
    if not head[:3].lower() == b"ply" or end is None:
        raise InputError(f"{file} is not a PLY file: its header does not end")
    ascii_text = b"ascii" in head.split(b"\n", 2)[1]
    counts: dict[str, int] = {}
    needed, name = 0, ""
    for line in head[: end.start()].decode("utf-8", "replace").splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdigit():
                raise InputError(f"{file} is not a PLY file: {line.strip()!r} is no element")
            name, counts[words[1]] = words[1], int(words[2])
        elif words[:1] == ["property"] and len(words) > 2:
            size = 2 if ascii_text else _SIZES.get(words[2 if words[1] == "list" else 1], 1)
            needed += size * counts.get(name, 0)
    have = file.stat().st_size - end.end() + (1 if ascii_text else 0)
    if needed > have:
        said = ", ".join(f"{v} of {k}" for k, v in counts.items())
        raise InputError(f"{file} is cut short: its header counts {said}, and the data end before")
    _check_counts(file, counts.get("vertex", 0), counts.get("face", 0))
    if ascii_text:
        _check_rows(file, end.end(), sum(counts.values()))


def _check_rows(file: Path, start: int, wanted: int) -> None:
    """An ASCII PLY has a line for each of its elements."""
    with file.open("rb") as stream:
        stream.seek(start)
        found = sum(1 for line in stream if line.strip())
    if found < wanted:
        raise InputError(f"{file} is cut short: {found} of its {wanted} lines are there")


def _check_off(file: Path) -> None:
    with file.open("rb") as stream:
        head = stream.read(HEADER_BYTES).decode("utf-8", "replace")
    numbers = re.sub(r"#[^\n]*", "", head).partition("OFF")[2].split()[:2]
    if len(numbers) == 2 and all(n.isdigit() for n in numbers):
        vertices, faces = (int(n) for n in numbers)
        _check_counts(file, vertices, faces)
        if 2 * (vertices + faces) > file.stat().st_size:
            raise InputError(f"{file} is cut short: its header counts {vertices} + {faces} lines")


def _check_stl(file: Path) -> None:
    """A binary STL, which holds zeros near its start, is as long as its count of faces says; of a
    text the faces are counted."""
    with file.open("rb") as stream:
        head = stream.read(512)
        if b"\0" not in head:
            chunks = iter(lambda: stream.read(HEADER_BYTES), b"")
            _check_counts(file, 0, sum(c.lower().count(b"vertex") for c in chunks) // 3)
            return
    count = int.from_bytes(head[80:84], "little")
    _check_counts(file, 0, count)
    if file.stat().st_size != 84 + 50 * count:
        raise InputError(f"{file} is no whole STL file: its header counts {count} faces")


def _check_counts(file: Path, vertices: int, faces: int) -> None:
    for count, most, what in (
        (vertices, LIMITS.vertices, "vertices"), (faces, LIMITS.faces, "faces"),
    ):  # fmt: skip
        if count > most:
            raise InputError(f"{file} has {count} {what}; simplify it to {most} or fewer")


def _check_dae(file: Path) -> None:
    """No entities, and no more nodes than allowed once every instance of a node is drawn."""
    root = parse_xml(file, LIMITS.bytes)
    nodes = {n.get("id", ""): n for n in root.iter() if _tag(n) == "node"}
    known: dict[str, int] = {}
    drawn = sum(
        _drawn(node, nodes, known, file, ())
        for scene in root.iter()
        if _tag(scene) == "visual_scene"
        for node in scene
    )
    if drawn > LIMITS.nodes:
        raise InputError(f"{file} has {drawn} nodes; simplify it to {LIMITS.nodes} or fewer")


def _drawn(
    node: ET.Element, nodes: Mapping[str, ET.Element], known: dict[str, int], file: Path,
    above: tuple[str, ...],
) -> int:  # fmt: skip
    """How many nodes are drawn for one, its instances of others included."""
    key = node.get("id", "")
    if (key and key in above) or len(above) > LIMITS.deep:
        deep = LIMITS.deep
        raise InputError(f"{file}: node {key!r} draws itself, or is nested more than {deep} deep")
    if _tag(node) == "instance_node":
        target = nodes.get((node.get("url") or "").lstrip("#"))
        return 1 if target is None else _drawn(target, nodes, known, file, above)
    if _tag(node) != "node":
        return 0
    if not key or key not in known:
        count = 1 + sum(_drawn(child, nodes, known, file, (*above, key)) for child in node)
        if not key:
            return count
        known[key] = count
    return known[key]


def _tag(element: ET.Element) -> str:
    """The tag without its namespace."""
    return str(element.tag).rpartition("}")[2]


def collada_says(file: Path) -> tuple[str | None, float | None]:
    """Up axis and unit from a DAE's asset element (its first 64 KiB).

    Raises:
        InputError: a unit that is no positive number.
    """
    with file.open("rb") as stream:
        head = stream.read(1 << 16).decode("utf-8", "replace")
    axis = re.search(r"<up_axis>\s*([XYZ])_UP", head)
    unit = re.search(r"<unit[^>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']", head)
    up = axis.group(1).lower() if axis and axis.group(1) in "YZ" else None
    if unit is None:
        return up, None
    try:
        metres = float(unit.group(1))
    except ValueError:
        metres = math.nan
    if not 0.0 < metres < math.inf:
        raise InputError(f"{file}: its unit is {unit.group(1)!r} metres, which is no length")
    return up, metres
