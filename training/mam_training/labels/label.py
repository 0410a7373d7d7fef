"""One label by eye: which faces of an object form parts that move, and how. Its JSON file."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mam_pipeline import folders
from mam_pipeline.errors import InputError
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint, Link, Mesh

SCHEMA = 1
Motion = Literal["hinge", "spin", "slide"]


@dataclass(frozen=True)
class LabelPart:
    """A part that moves; lengths in metres and angles in radians, in the label's asset frame.

    Attributes:
        parent: name of the part that it moves against.
        axis, origin: of its line; positive motion opens.
        lower, upper: range from the pose of the file; both None: it turns without end.
        faces: the part's faces as runs, see `runs_of`.
    """

    name: str
    kind: str
    parent: str
    motion: Motion
    axis: tuple[float, float, float]
    origin: tuple[float, float, float]
    lower: float | None
    upper: float | None
    faces: str
    confidence: float


@dataclass(frozen=True)
class Label:
    """What one pair of eyes saw of one object.

    Attributes:
        id, repository: of the corpus's manifest. file_digest: SHA-256 of the object's file.
        faces: how many the mesh has as it is read.
        by: who or what answered. date: of the last answer.
        source_to_asset: 4 x 4, row by row: from the file's world to the frame of this label.
        base: name of what stands still.
        nothing_moves: true where no part moves. out_of_scope: why no label is possible, or None.
    """

    id: str
    repository: str
    category: str
    file_digest: str
    faces: int
    by: str
    date: str
    source_to_asset: tuple[float, ...]
    base: str
    parts: tuple[LabelPart, ...]
    nothing_moves: bool
    out_of_scope: str | None = None
    notes: str = ""
    schema: int = SCHEMA

    def save(self, path: Path) -> None:
        """Write the label, one part a line."""
        rows = asdict(self)
        parts = rows.pop("parts")
        head = "{\n " + ",\n ".join(f'"{k}": {json.dumps(v)}' for k, v in rows.items())
        lines = ",\n  ".join(json.dumps(part) for part in parts)
        body = (
            f'{head},\n "parts": [\n  {lines}\n ]\n}}\n'
            if parts
            else f'{head},\n "parts": []\n}}\n'
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        folders.write_text(path, body)

    @staticmethod
    def load(path: Path) -> Label:
        """Read a label.

        Raises:
            InputError: no such file, or it is none of ours.
        """
        if not path.is_file():
            raise InputError(f"no label at {path}")
        try:
            row = json.loads(path.read_text(encoding="utf-8"))
            if row["schema"] != SCHEMA:
                raise InputError(f"{path} has schema {row['schema']}; this version reads {SCHEMA}")
            parts = tuple(
                LabelPart(**{**p, "axis": tuple(p["axis"]), "origin": tuple(p["origin"])})
                for p in row.pop("parts")
            )
            place = tuple(row.pop("source_to_asset"))
            return Label(**row, source_to_asset=place, parts=parts)
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path} is no label by eye: {error}") from error

    def articulation(self, mesh: Mesh, source_to_asset: FloatArray) -> Articulation:
        """The label on the object's mesh as it is read today, in the frame of that mesh.

        Args:
            source_to_asset: (4, 4) of that mesh; the reader may place it otherwise than it did.

        Raises:
            InputError: the mesh has another number of faces.
        """
        if len(mesh.faces) != self.faces:
            raise InputError(
                f"{self.id}: the label is of a mesh of {self.faces} faces, this one has "
                f"{len(mesh.faces)}; label it again"
            )
        moved = source_to_asset @ np.linalg.inv(np.reshape(self.source_to_asset, (4, 4)))
        scale = float(np.cbrt(np.linalg.det(moved[:3, :3])))
        names = [self.base, *(part.name for part in self.parts)]
        owner = np.zeros(self.faces, dtype=np.int64)
        for i, part in enumerate(self.parts, start=1):
            owner[faces_of(part.faces)] = i
        kinds = ["body", *(part.kind for part in self.parts)]
        links = tuple(
            Link(name, kind, np.flatnonzero(owner == i))
            for i, (name, kind) in enumerate(zip(names, kinds))
        )
        joints = [_joint(p, i, names, moved, scale) for i, p in enumerate(self.parts, start=1)]
        order = _parents_first(joints)
        return Articulation(mesh, links, tuple(order))


def _joint(part: LabelPart, index: int, names: list[str], moved: FloatArray, scale: float) -> Joint:
    axis = moved[:3, :3] @ np.asarray(part.axis) / scale
    origin = moved[:3, :3] @ np.asarray(part.origin) + moved[:3, 3]
    slide, endless = part.motion == "slide", part.lower is None or part.upper is None
    unit = scale if slide else 1.0
    lower = -np.inf if part.lower is None else part.lower * unit
    upper = np.inf if part.upper is None else part.upper * unit
    far = 0.0 if endless else upper if abs(upper) >= abs(lower) else lower
    return Joint(
        f"{part.name}_joint", "prismatic" if slide else "continuous" if endless else "revolute",
        part.motion, names.index(part.parent), index, axis, origin, lower, upper,
        0.0 if endless else lower + upper - far, far, confidence=part.confidence,
        provenance="user",
    )  # fmt: skip


def _parents_first(joints: list[Joint]) -> list[Joint]:
    known, out, left = {0}, list[Joint](), list(joints)
    while left:
        ready = [j for j in left if j.parent in known]
        if not ready:
            raise InputError("the parts of a label form a loop")
        out += ready
        known |= {j.child for j in ready}
        left = [j for j in left if j.child not in known]
    return out


def label_parts(articulation: Articulation) -> tuple[LabelPart, ...]:
    """The parts of an articulation that move; what is fixed belongs to what it is fixed to."""
    links, fixed = articulation.links, {j.child: j.parent for j in articulation.joints
                                        if j.type == "fixed"}  # fmt: skip

    def carrier(link: int) -> int:
        while link in fixed:
            link = fixed[link]
        return link

    owner = np.array([carrier(i) for i in range(len(links))])[articulation.face_link]
    out = []
    for joint in articulation.joints:
        if joint.type == "fixed":
            continue
        link, endless = links[joint.child], joint.type == "continuous"
        out.append(
            LabelPart(
                link.name, link.kind, links[carrier(joint.parent)].name,
                joint.subtype, _rounded(joint.axis), _rounded(joint.origin),  # type: ignore[arg-type]
                None if endless else round(float(joint.lower), 5),
                None if endless else round(float(joint.upper), 5),
                runs_of(np.flatnonzero(owner == joint.child)), round(joint.confidence, 3),
            )
        )  # fmt: skip
    return tuple(out)


def _rounded(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 5) + 0.0 for v in vector)
    return x, y, z


def runs_of(faces: IntArray) -> str:
    """Sorted face indices as runs "skip+take skip+take ...", where a take of 1 is left out."""
    if not len(faces):
        return ""
    cuts = np.flatnonzero(np.diff(faces) > 1)
    starts = faces[np.concatenate([[0], cuts + 1])]
    ends = faces[np.concatenate([cuts, [len(faces) - 1]])] + 1
    skips = starts - np.concatenate([[0], ends[:-1]])
    return " ".join(f"{s}+{n}" if n > 1 else f"{s}" for s, n in zip(skips, ends - starts))


def faces_of(runs: str) -> IntArray:
    """The face indices of `runs_of`."""
    out, at = list[IntArray](), 0
    for run in runs.split():
        if not re.fullmatch(r"\d+(\+\d+)?", run):
            raise ValueError(f"no run of faces: {run!r}")
        skip, _, take = run.partition("+")
        begin = at + int(skip)
        at = begin + int(take or 1)
        out.append(np.arange(begin, at, dtype=np.int64))
    return np.concatenate(out) if out else np.zeros(0, dtype=np.int64)


def notes_of(folder: Path) -> dict[str, Any]:
    """What a labeller wrote beside the answers in notes.json: out_of_scope, notes, split."""
    file = folder / "notes.json"
    if not file.is_file():
        return {}
    try:
        row = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{file} is no JSON: {error}") from error
    if not isinstance(row, dict) or set(row) - {"out_of_scope", "notes", "split"}:
        raise InputError(f"{file} may hold out_of_scope, notes and split, nothing else")
    split = row.get("split", [])
    if not isinstance(split, list) or not all(type(k) is int and k >= 0 for k in split):
        raise InputError(f"{file}: split must be a list of piece numbers")
    return row
