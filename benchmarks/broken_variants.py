"""How many faults that were put in on purpose `mam-sim check` catches.

    python benchmarks/broken_variants.py DATASET generated:test --limit 12 --out FILE.json

The true joints of every object are written with collision pieces of ours, as a file's own pieces
may be at fault; what the check says of the files as they are is listed apart. Every joint that is
accepted is then broken in several ways, one at a time. Nothing is driven, so the figures are those
of the static check and the sweep.

A true joint is sound unless its surfaces cross within its range by more than DEEP, or its file
collides far from where it is seen; a doubled limit is a fault only where they cross so on the added
way. Crossings are found by edges and triangles, not by the check. The test was settled on objects
outside this bench, those of scene_synthesizer_dataset.py.
"""

from __future__ import annotations

import json
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from common import commit, save
from mam_sim_bench.runner import find_tasks
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from tyro.conf import Positional

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.check.model import CheckModel
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.geometry.motion import Motion, motion_points
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint, Mesh

TILT = np.radians(5.0)
SHIFT = 0.05
"""Share of the diagonal by which a pivot is moved."""
EXCHANGED = "parent and child exchanged"
WHOLE = (EXCHANGED, "block over the cavity")
"""Faults that all joints of the object have; they are looked for in all of it."""
DEEP = 0.005
"""Share of the diagonal from which on surfaces that cross are no tolerance."""
CROSSING, SOUND = "*true joints that cross something*", "*sound joints that are accepted*"


@dataclass
class Count:
    """Figures of one dataset.

    Attributes:
        kinds: by kind of fault: caught, free to move, all.
        joints, crossing, crossing_refused, sound, accepted: numbers of true joints; the last is
            that of sound ones.
        reasons: why sound ones are refused. in_files: why joints of the files as they are, are.
        files_accepted: joints of the files as they are.
    """

    kinds: dict[str, list[int]] = field(default_factory=dict)
    joints: int = 0
    crossing: int = 0
    crossing_refused: int = 0
    sound: int = 0
    accepted: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    files_accepted: int = 0
    in_files: Counter[str] = field(default_factory=Counter)


def main(
    datasets: Positional[tuple[str, ...]],
    /,
    limit: int | None = None,
    only: tuple[str, ...] = (),
    out: Path | None = None,
    table: Path | None = None,
) -> None:
    """Print a line per joint, then the share caught by kind.

    Args:
        datasets: folders of folders with a URDF each, or generated:test.
        limit: generated objects at most. only: these objects.
        out: JSON file. table: JSON file of the results page, as docs/results/broken_variants.json.
    """
    counts = {}
    for dataset in datasets:
        count = counts[dataset] = Count()
        made = dataset.startswith("generated:")
        for task in find_tasks(dataset, only, limit if made else None):
            with tempfile.TemporaryDirectory() as scratch:
                apart = not made and _as_it_is(Path(task.source), count)
                truth = task.load().truth_articulation()
                file = write_asset(truth, Path(scratch) / "a", name="a").urdf_path
                _object(task.id, file, apart, count)
        print(f"{dataset}: {count.accepted} of {count.sound} sound joints are accepted,")
        print(f"  {count.crossing_refused} of {count.crossing} that cross something are refused")
        print(f"  sound ones are refused for {dict(count.reasons.most_common())}")
        print(f"  files as they are: {count.files_accepted} of {count.joints} joints accepted, "
              f"others {dict(count.in_files.most_common())}")  # fmt: skip
        for kind, (hit, free, every) in count.kinds.items():
            print(f"  {kind:27s} {hit} of {every - free}, {free} free to move")
    save(out, {name: vars(count) for name, count in counts.items()})
    if table is not None:
        _write_table(table, list(counts.values()), datasets, limit)


def _as_it_is(urdf: Path, count: Count) -> bool:
    """Count what the check says of a file; whether a body of it collides far from where it is."""
    report = check_asset(urdf, drive=False)
    lint = [f.code for f in report.findings if not f.warning]
    for joint in report.joints:
        count.files_accepted += not (lint or joint.reasons)
        count.in_files.update(lint or joint.reasons)
    return "collision_off" in lint


def _object(name: str, file: Path, apart: bool, count: Count) -> None:
    text = file.read_text(encoding="utf-8")
    (file.parent / "asset.json").unlink()  # a card would vouch for the old limits
    base = check_asset(file, drive=False)
    lint = [f.code for f in base.findings if not f.warning]
    model, tree = CheckModel.read(file), UrdfTree.read(file)
    joints = {j.name: j for j in model.articulation.joints}
    for report in base.joints:
        joint, reasons = joints[report.name], lint or report.reasons
        crossing = _crosses(model.articulation, joint, _range(joint))
        count.joints += 1
        count.crossing += crossing
        count.crossing_refused += crossing and bool(reasons)
        if not crossing and not apart:
            count.sound += 1
            count.accepted += not reasons
            count.reasons.update(reasons)
        if crossing or reasons:
            said = "crosses" if crossing else "lies apart in its file" if apart else "sound"
            print(name, joint.name, said, *reasons, flush=True)
        if not reasons:
            _broken(name, file, text, joint, model, tree, count)
    file.write_text(text, encoding="utf-8")


def _broken(
    name: str, file: Path, text: str, joint: Joint, model: CheckModel, tree: UrdfTree, count: Count
) -> None:
    said = []
    for kind, change in KINDS.items():
        root = ET.fromstring(text)
        (element,) = [e for e in root.findall("joint") if e.get("name") == joint.name]
        if not change(root, element, model, tree):
            continue
        file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
        hit = not check_asset(file, drive=False, only=() if kind in WHOLE else (joint.name,)).passed
        free = kind in LIMITS and not hit
        free = free and not _crosses(model.articulation, joint, _added(joint, LIMITS[kind]))
        row = count.kinds.setdefault(kind, [0, 0, 0])
        row[:] = row[0] + hit, row[1] + free, row[2] + 1
        said.append(f"{kind} {'yes' if hit else 'free' if free else 'NO'}")
    print(name, joint.name, ", ".join(said), flush=True)


def _range(joint: Joint) -> FloatArray:
    """Values from end to end; a full turn where there is none."""
    low, high = joint.lower, joint.upper
    if not np.isfinite(high - low):
        low, high = -np.pi, np.pi
    return np.linspace(low, high, 15, dtype=np.float64)


def _added(joint: Joint, sign: int) -> FloatArray:
    """The values that a doubled limit adds."""
    end = joint.upper if sign > 0 else joint.lower
    way = sign * (joint.upper - joint.lower) * np.linspace(0.1, 1.0, 10)
    return np.asarray(end + way, dtype=np.float64)


def _crosses(articulation: Articulation, joint: Joint, values: FloatArray) -> bool:
    """Whether surfaces of the part and of what stands still cross deeply at one of the values.

    Deeply: where an edge of one crosses a triangle of the other, farther than DEEP from the part's
    surface at rest, edges still do, within twice DEEP, after a shift by DEEP along each of x, y
    and z, either way. What another joint can take out of the way does not count.
    """
    mesh, deep = articulation.mesh, DEEP * articulation.mesh.diagonal
    part = _carried(articulation, [joint])
    away = _carried(
        articulation, [j for j in articulation.joints if _aside(articulation, j, joint)]
    )
    static = np.setdiff1d(np.arange(len(mesh.faces)), np.union1d(part, away))
    bodies = [_Body(mesh, part), _Body(mesh, static)]
    motion: Motion = "prismatic" if joint.type == "prismatic" else "revolute"

    def moved(points: FloatArray, by: float) -> FloatArray:
        return motion_points(motion, joint.axis, joint.origin, np.array([by]), points)[0]

    def crossings(value: float, step: FloatArray) -> FloatArray:
        """(n, 3) points where an edge crosses a triangle and the part was not at rest."""
        rest, out = bodies[0].scene, []
        for own in (0, 1):
            body, sign = bodies[own], 1.0 - 2.0 * own
            there = moved(body.points - own * step, sign * value) + (1 - own) * step
            start, way = there[body.edges[:, 0]], there[body.edges[:, 1]] - there[body.edges[:, 0]]
            found = bodies[1 - own].scene.first_hits(start, way).t
            met = found <= 1.0
            place = start[met] + found[met, None] * way[met]
            out.append(moved(place, value) + step if own == 1 else place)
        place = np.concatenate(out)
        return place[(rest.distance(place) > deep) & ~rest.encloses(place)]

    for value in values:
        places = crossings(value, np.zeros(3))
        for step in deep * np.concatenate([np.eye(3), -np.eye(3)]):
            if not len(places):
                break
            still = crossings(value, step)
            near = cKDTree(still).query(places)[0] if len(still) else np.full(len(places), np.inf)
            places = places[near <= 2.0 * deep]
        if len(places):
            return True
    return False


def _aside(articulation: Articulation, other: Joint, joint: Joint) -> bool:
    """Whether a joint moves neither the part of `joint` nor anything on it."""
    part = articulation.carried_links(joint)
    return other.child not in part and joint.child not in articulation.carried_links(other)


class _Body:
    """Faces of an object as vertices (n, 3), edges (m, 2) and a scene."""

    def __init__(self, mesh: Mesh, faces: IntArray) -> None:
        used, corners = np.unique(mesh.faces[faces], return_inverse=True)
        corners = corners.reshape(-1, 3)
        self.points = mesh.vertices[used]
        edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        self.edges = np.unique(edges, axis=0)
        self.scene = RayScene(self.points, corners)


def _carried(articulation: Articulation, joints: list[Joint]) -> IntArray:
    """Faces of all links that joints move."""
    links = {i for j in joints for i in articulation.carried_links(j)}
    faces = [articulation.links[i].faces for i in sorted(links)]
    return np.concatenate(faces) if faces else np.zeros(0, dtype=np.int64)


def _write_table(
    table: Path, counts: list[Count], datasets: tuple[str, ...], limit: int | None
) -> None:
    """Rows of kinds, four columns a dataset."""
    said = ["bench" if not d.startswith("generated:") else "generated" for d in datasets]
    columns: dict[str, str] = {}
    for name in said:
        columns |= {f"{name}: caught": "d", f"{name}: of": "d", f"{name}: free": "d"}
        columns[f"{name}: share"] = ".1%"
    rows = []
    for kind in [*KINDS, CROSSING, SOUND]:
        values: dict[str, float] = {}
        for name, count in zip(said, counts):
            hit, free, every = count.kinds.get(kind, [0, 0, 0])
            if kind == SOUND:
                hit, free, every = count.accepted, 0, count.sound
            elif kind == CROSSING:
                hit, free, every = count.crossing_refused, 0, count.crossing
            found = {"caught": hit, "of": every - free, "free": free}
            values |= {f"{name}: {k}": v for k, v in found.items()}
            values[f"{name}: share"] = hit / max(every - free, 1)
        given = " ".join(d if d.startswith("generated:") else "DEV" for d in datasets)
        command = f"python benchmarks/broken_variants.py {given}"
        command += "" if limit is None else f" --limit {limit}"
        rows.append({
            "id": kind.strip("*").replace(" ", "_"), "name": kind, "values": values,
            "command": command, "commit": commit(), "machine": "2 cores, no GPU",
        })  # fmt: skip
    title = "Faults put in on purpose that `mam-sim check --no-drive` catches"
    page = {"title": title, "columns": columns, "rows": rows}
    table.write_text(json.dumps(page, indent=1) + "\n", encoding="utf-8")


def _tilted(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    element = joint.find("axis")
    if element is None:
        element = ET.SubElement(joint, "axis", xyz="1 0 0")
    axis = np.array([float(w) for w in (element.get("xyz") or "1 0 0").split()])
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    element.set("xyz", _words(Rotation.from_rotvec(TILT * across).apply(axis)))
    return True


def _pivot(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    """Shift the hinge line sideways; the geometry stays where it is at rest."""
    if joint.get("type") == "prismatic":
        return False
    element = joint.find("axis")
    axis = np.array([float(w) for w in (_get(element, "xyz") or "1 0 0").split()])
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across *= SHIFT * model.articulation.mesh.diagonal / np.linalg.norm(across)
    turn = Rotation.from_euler("xyz", _three(joint, "rpy")).as_matrix()
    _origin(joint).set("xyz", _words(_three(joint, "xyz") + turn @ across))
    child = _get(joint.find("child"), "link")
    for link in root.findall("link"):
        if link.get("name") == child:
            for part in (*link.findall("visual"), *link.findall("collision")):
                _origin(part).set("xyz", _words(_three(part, "xyz") - across))
    for other in root.findall("joint"):
        if _get(other.find("parent"), "link") == child:
            _origin(other).set("xyz", _words(_three(other, "xyz") - across))
    return True


def _longer(sign: int) -> Callable[[ET.Element, ET.Element, CheckModel, UrdfTree], bool]:
    def change(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
        limit = joint.find("limit")
        if limit is None or joint.get("type") == "continuous":
            return False
        low, high = (float(limit.get(k) or 0) for k in ("lower", "upper"))
        limit.set("upper" if sign > 0 else "lower", repr((high if sign > 0 else low)
                                                         + sign * (high - low)))  # fmt: skip
        return True

    return change


def _exchanged(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    parent, child = joint.find("parent"), joint.find("child")
    assert parent is not None and child is not None
    a, b = parent.get("link") or "", child.get("link") or ""
    parent.set("link", b)
    child.set("link", a)
    return True


def _no_inertia(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    link = _child_link(root, joint)
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="1")
    zero = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    ET.SubElement(inertial, "inertia", zero)
    return True


def _no_mesh(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    mesh = next(iter(_child_link(root, joint).iter("mesh")), None)
    if mesh is None:
        return False
    mesh.set("filename", "nothing.obj")
    return True


def _not_a_number(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    _origin(joint).set("xyz", "nan 0 0")
    return True


def _filled(root: ET.Element, joint: ET.Element, model: CheckModel, tree: UrdfTree) -> bool:
    """A block of the body that the part hangs on collides wherever the part may go."""
    articulation = model.articulation
    moved = next(j for j in articulation.joints if j.name == joint.get("name"))
    faces = np.concatenate([articulation.links[i].faces for i in articulation.carried_links(moved)])
    low, high = articulation.mesh.submesh(faces).bounds
    index = {link.name: i for i, link in enumerate(articulation.links)}
    for link in root.findall("link"):  # a link without a visual would show the block
        name = link.get("name") or ""
        if link.find("visual") is None or tree.body_of(name, index) is None:
            continue
        if index[tree.body_of(name, index) or ""] == moved.parent:
            block = ET.SubElement(link, "collision")
            there = np.linalg.inv(tree.frames[name]) @ [*(low + high) / 2, 1.0]
            ET.SubElement(block, "origin", xyz=_words(there[:3]))
            size = _words(np.full(3, articulation.mesh.diagonal))
            ET.SubElement(ET.SubElement(block, "geometry"), "box", size=size)
            return True
    return False


KINDS: dict[str, Callable[[ET.Element, ET.Element, CheckModel, UrdfTree], bool]] = {
    "axis tilted 5 degrees": _tilted,
    "pivot off by 5 %": _pivot,
    "upper limit doubled": _longer(1),
    "lower limit doubled": _longer(-1),
    "block over the cavity": _filled,
    EXCHANGED: _exchanged,
    "zero inertia": _no_inertia,
    "missing mesh": _no_mesh,
    "NaN": _not_a_number,
}

LIMITS = {"upper limit doubled": 1, "lower limit doubled": -1}


def _child_link(root: ET.Element, joint: ET.Element) -> ET.Element:
    name = _get(joint.find("child"), "link")
    return next(k for k in root.findall("link") if k.get("name") == name)


def _origin(element: ET.Element) -> ET.Element:
    found = element.find("origin")
    if found is None:
        found = ET.Element("origin")
        element.insert(0, found)
    return found


def _three(element: ET.Element, key: str) -> np.ndarray:
    return np.array([float(w) for w in (_get(element.find("origin"), key) or "0 0 0").split()])


def _get(element: ET.Element | None, key: str) -> str:
    return "" if element is None else element.get(key) or ""


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)


if __name__ == "__main__":
    tyro.cli(main)
