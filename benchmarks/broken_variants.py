"""How many faults that were put in on purpose `mam-sim check` catches.

    python benchmarks/broken_variants.py DATASET generated:test --limit 40 --out FILE.json

Every sound joint of every object is broken in several ways, one at a time. Nothing is driven, so
the figures are those of the static check and the sweep. A joint is sound if the check finds nothing
wrong with it; what it finds wrong with the others is listed. A doubled limit that is not caught is
no fault where no edge of either body crosses the other on the added way: it says that the part may
move farther, and so it may. That is looked at by edges and triangles, not by the check.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from common import commit, save
from scipy.spatial.transform import Rotation
from tyro.conf import Positional

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.check.model import CheckModel
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.geometry.motion import Motion, motion_points
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.types import Articulation, FloatArray, Joint
from mam_sim.bench.runner import find_tasks

TILT = np.radians(5.0)
SHIFT = 0.05
"""Share of the diagonal by which a pivot is moved."""
EXCHANGED = "parent and child exchanged"
MOVING = ("revolute", "prismatic", "continuous")


@dataclass
class Count:
    """Figures of one dataset: by kind of fault (caught, free to move, all), joints, reasons."""

    kinds: dict[str, list[int]] = field(default_factory=dict)
    sound: int = 0
    joints: int = 0
    reasons: Counter[str] = field(default_factory=Counter)


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
        for name, file in _files(dataset, limit, only):
            _object(name, file, count)
        print(f"{dataset}: {count.sound} of {count.joints} joints are accepted as they are")
        print(f"  the others: {dict(count.reasons.most_common())}")
        for kind, (hit, free, every) in count.kinds.items():
            print(f"  {kind:27s} {hit} of {every - free}, {free} free to move")
    save(out, {name: vars(count) for name, count in counts.items()})
    if table is not None:
        _write_table(table, list(counts.values()), datasets, limit)


def _files(dataset: str, limit: int | None, only: tuple[str, ...]) -> Iterator[tuple[str, Path]]:
    """Name and URDF of each object, in a folder that may be written to."""
    generated = dataset.startswith("generated:")
    for task in find_tasks(dataset, only, limit if generated else None):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "a"
            if generated:
                yield task.id, _written(task.load().truth_articulation(), folder)
            else:
                urdf = Path(task.source)
                yield task.id, Path(shutil.copytree(urdf.parent, folder)) / urdf.name


def _written(truth: Articulation, folder: Path) -> Path:
    return write_asset(truth, folder, name="a").urdf_path


def _object(name: str, file: Path, count: Count) -> None:
    text = file.read_text(encoding="utf-8")
    (file.parent / "asset.json").unlink(missing_ok=True)  # a card would vouch for the old limits
    base = check_asset(file, drive=False)
    lint = [f.code for f in base.findings if not f.warning]
    model, tree = CheckModel.read(file), UrdfTree.read(file)
    reports = {j.name: j for j in base.joints}
    names = [j.get("name") or "" for j in ET.fromstring(text).findall("joint")]
    for index, joint in enumerate(names):
        if joint not in reports:
            continue
        count.joints += 1
        if lint or reports[joint].reasons:
            count.reasons.update(lint or reports[joint].reasons)
            continue
        count.sound += 1
        said = []
        for kind, change in KINDS.items():
            root = ET.fromstring(text)
            if not change(root, root.findall("joint")[index], model, tree):
                continue
            file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
            alone = () if kind == EXCHANGED else (joint,)  # which changes what all others hang on
            hit = not check_asset(file, drive=False, only=alone).passed
            free = not hit and kind in LIMITS and _free(model.articulation, joint, LIMITS[kind])
            row = count.kinds.setdefault(kind, [0, 0, 0])
            row[:] = row[0] + hit, row[1] + free, row[2] + 1
            said.append(f"{kind} {'yes' if hit else 'free' if free else 'NO'}")
        file.write_text(text, encoding="utf-8")
        print(name, joint, ", ".join(said), flush=True)


def _free(articulation: Articulation, name: str, sign: int) -> bool:
    """Whether no more edges cross the other body on the added way than do on the old one."""
    joint = next(j for j in articulation.joints if j.name == name)
    width = joint.upper - joint.lower
    end = joint.upper if sign > 0 else joint.lower
    old = np.linspace(joint.lower, joint.upper, 11, dtype=np.float64)
    new = np.asarray(end + sign * width * np.linspace(0.1, 1.0, 10), dtype=np.float64)
    return _crossings(articulation, joint, new) <= _crossings(articulation, joint, old)


def _crossings(articulation: Articulation, joint: Joint, values: FloatArray) -> int:
    """Most edges of part or surroundings that cross a triangle of the other, over the values."""
    mesh = articulation.mesh
    part = np.concatenate([articulation.links[i].faces for i in articulation.carried_links(joint)])
    static = np.setdiff1d(np.arange(len(mesh.faces)), part)
    motion: Motion = "prismatic" if joint.type == "prismatic" else "revolute"
    most = np.zeros(len(values), dtype=int)
    for own, other, way in ((part, static, values), (static, part, -values)):
        edges = np.unique(np.sort(mesh.faces[own][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1), axis=0)
        scene = RayScene(mesh.vertices, mesh.faces[other])
        for k, value in enumerate(way):
            there = motion_points(
                motion, joint.axis, joint.origin, np.array([value]), mesh.vertices
            )[0]
            start, step = there[edges[:, 0]], there[edges[:, 1]] - there[edges[:, 0]]
            hits = scene.first_hits(start + 0.01 * step, 0.98 * step)
            most[k] += int((hits.t <= 1.0).sum())
    return int(most.max())


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
    for kind in [*KINDS, "*joints accepted as they are*"]:
        values: dict[str, float] = {}
        for name, count in zip(said, counts):
            hit, free, every = count.kinds.get(kind, [0, 0, 0])
            if kind not in KINDS:
                hit, free, every = count.sound, 0, count.joints
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
