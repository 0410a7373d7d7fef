"""The file under repair: its XML, its folder, and every change in words."""

from __future__ import annotations

import copy
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mam_pipeline.check.lint import MOVING
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.report import CheckReport
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.files import files_of
from mam_pipeline.formats.urdf.write import numbers
from mam_pipeline.types import FloatArray

SHAPES = ("visual", "collision")
State = tuple[ET.Element, list["Change"], CheckReport | None, bytes | None]
"""The XML, the changes so far, the last report, and the SRDF if there is one."""


@dataclass(frozen=True)
class Change:
    """One repair.

    Attributes:
        reason: code of the check that asked for it. where: link, joint or file.
        before, after: what stood there, and what stands there now. why: that it is no guess.
    """

    reason: str
    where: str
    before: str
    after: str
    why: str


@dataclass
class Work:
    """A copy of a URDF that is being mended.

    Attributes:
        source: the file as it came; what is looked for is looked for beside it.
        urdf: the copy, in a folder of its own. root: its <robot>, comments kept.
        report: of the last check. changes: so far. edited: whether the XML was touched.
    """

    source: Path
    urdf: Path
    root: ET.Element = field(init=False)
    report: CheckReport | None = None
    changes: list[Change] = field(default_factory=list)
    edited: bool = False
    _model: CheckModel | None = None

    def __post_init__(self) -> None:
        if self.urdf != self.source:
            self.urdf.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.source, self.urdf)
        self.read()

    @property
    def folder(self) -> Path:
        """Where the copy lies, with all files that it names."""
        return self.urdf.parent

    @property
    def door(self) -> Door:
        """Opens the files that lie beside the source."""
        return Door(self.source.parent)

    def read(self) -> None:
        """Take the XML from the file."""
        keeping = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
        self.root = ET.fromstring(self.urdf.read_bytes(), keeping)
        self._model = None

    def change(self, reason: str, where: str, before: object, after: object, why: str) -> None:
        """Write a change down."""
        self.changes.append(Change(reason, where, str(before), str(after), why))
        self.touch()

    def touch(self) -> None:
        """The XML is another one than that in the file."""
        self.edited, self._model = True, None

    def save(self) -> None:
        """Write the XML; a file without a change keeps its bytes."""
        if self.edited:
            text = '<?xml version="1.0"?>\n' + ET.tostring(self.root, encoding="unicode") + "\n"
            self.urdf.write_text(text, encoding="utf-8")

    @property
    def srdf(self) -> Path:
        """Where loaders look for pairs that do not collide; it need not be there."""
        return self.urdf.with_suffix(".srdf")

    def state(self) -> State:
        """What `restore` goes back to."""
        pairs = self.srdf.read_bytes() if self.srdf.is_file() else None
        return copy.deepcopy(self.root), list(self.changes), self.report, pairs

    def restore(self, state: State) -> None:
        """Go back; files that nothing names any more stay until `finish`."""
        self.root, self.changes, self.report = state[0], list(state[1]), state[2]
        if state[3] is not None:
            self.srdf.write_bytes(state[3])
        else:
            self.srdf.unlink(missing_ok=True)
        self.touch()
        if self.changes:
            self.save()
        else:
            shutil.copyfile(self.source, self.urdf)
            self.edited = False

    def finish(self) -> None:
        """Write the last state, and remove files that it does not name."""
        if self.changes:
            self.save()
        elif self.edited:  # something was tried, and taken back
            shutil.copyfile(self.source, self.urdf)
        kept = {*files_of(self.urdf), self.srdf}
        for file in sorted(self.folder.rglob("*"), reverse=True):
            if file.is_file() and file not in kept:
                file.unlink()
            elif file.is_dir() and not any(file.iterdir()):
                file.rmdir()

    def bring(self, file: Path) -> str:
        """Copy a file of the source, and those that it names; its name in the folder.

        What lies below the source's folder keeps its place; anything else goes to `meshes/`.
        """
        base = self.source.parent.resolve()
        own = file.resolve()
        below = own.is_relative_to(base)
        for part in map(Path.resolve, files_of(file, base)):
            if part.is_relative_to(base):
                place = self.folder / part.relative_to(base)
            elif part.is_relative_to(own.parent):
                place = self.folder / "meshes" / part.relative_to(own.parent)
            else:
                place = self.folder / "meshes" / part.name
            place.parent.mkdir(parents=True, exist_ok=True)
            if place.resolve() != part:
                shutil.copyfile(part, place)
        return own.relative_to(base).as_posix() if below else f"meshes/{own.name}"

    @property
    def links(self) -> dict[str, ET.Element]:
        """Links by name; the first of several of one name."""
        return {str(e.get("name")): e for e in reversed(self.root.findall("link"))}

    @property
    def joints(self) -> dict[str, ET.Element]:
        """Joints by name; the first of several of one name."""
        return {str(e.get("name")): e for e in reversed(self.root.findall("joint"))}

    def moving(self) -> Iterator[tuple[str, ET.Element]]:
        """Joints that are neither fixed nor of an unknown type."""
        yield from ((n, e) for n, e in self.joints.items() if e.get("type") in MOVING)

    def meshes(self) -> Iterator[tuple[ET.Element, str, ET.Element, ET.Element]]:
        """(link, visual | collision, its element, the <mesh> in it) of every mesh."""
        for link in self.root.findall("link"):
            for kind in SHAPES:
                for element in link.findall(kind):
                    mesh = element.find("geometry/mesh")
                    if mesh is not None:
                        yield link, kind, element, mesh

    def model(self) -> CheckModel | None:
        """Surfaces, joints and collision pieces as they are now; None where they cannot be read."""
        if self._model is None:
            self.save()
            try:
                self._model = CheckModel.read(self.urdf)
            except MamSimError:  # the check says why
                return None
        return self._model


def child(element: ET.Element, tag: str) -> ET.Element:
    """The first child of a tag, made where there is none."""
    found = element.find(tag)
    return ET.SubElement(element, tag) if found is None else found


def attribute(element: ET.Element, tag: str, key: str) -> str:
    """An attribute of a child, "" where either is missing."""
    found = element.find(tag)
    return "" if found is None else found.get(key) or ""


def pose_of(element: ET.Element) -> FloatArray:
    """(4, 4) of the `origin` of a shape, inertial or joint element."""
    pose = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        pose[:3, 3] = [float(w) for w in (origin.get("xyz") or "0 0 0").split()]
        angles = [float(w) for w in (origin.get("rpy") or "0 0 0").split()]
        pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    return pose


def set_pose(element: ET.Element, pose: FloatArray) -> None:
    """Write the `origin` of an element."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.Element("origin")
        element.insert(0, origin)
    origin.set("xyz", numbers(pose[:3, 3]))
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True)
    origin.set("rpy", numbers(angles))


def number(text: str | None) -> float | None:
    """A finite number, None for anything else."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if abs(value) < float("inf") else None


def short(values: NDArray[Any] | Sequence[float]) -> str:
    """Numbers with four digits, for a line."""
    return " ".join(f"{float(v):.4g}" for v in values)


def counted(number: int, what: str) -> str:
    """ "1 piece", "3 pieces", "no piece"."""
    return f"{number or 'no'} {what}{'s' if number > 1 else ''}"
