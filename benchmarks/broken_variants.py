"""How many faults that were put in on purpose `mam-sim check` catches.

    python benchmarks/broken_variants.py DATASET --limit 12 --out FILE.json

Every joint of every URDF in DATASET is broken in several ways, one at a time. Nothing is driven, so
the figures are those of the static check and the sweep. A limit that is doubled is no fault where
the part can move so far; such a variant counts as missed all the same.
"""

from __future__ import annotations

import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tyro
from common import save
from scipy.spatial.transform import Rotation
from tyro.conf import Positional

from mam_pipeline.check.check import check_asset
from mam_pipeline.check.model import CheckModel

TILT = np.radians(5.0)
SHIFT = 0.05
"""Share of the diagonal by which a pivot is moved."""
MOVING = ("revolute", "prismatic", "continuous")


def main(dataset: Positional[Path], /, limit: int | None = None, out: Path | None = None) -> None:
    """Print a line per joint, then the share caught by kind.

    Args:
        dataset: folder of folders with a URDF each. limit: of objects. out: JSON file.
    """
    files = sorted(f for d in dataset.iterdir() if d.is_dir() for f in sorted(d.glob("*.urdf"))[:1])
    seen: dict[str, list[int]] = {}
    sound = [0, 0]
    for urdf in files[:limit]:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(shutil.copytree(urdf.parent, Path(scratch) / "a"))
            file = folder / urdf.name
            text = file.read_text(encoding="utf-8")
            sound[1] += 1
            if not check_asset(file, drive=False).passed:
                continue  # what fails anyhow says nothing of its variants
            sound[0] += 1
            model = CheckModel.read(file)
            diagonal = model.articulation.mesh.diagonal
            for index, joint in enumerate(ET.fromstring(text).findall("joint")):
                if joint.get("type") not in MOVING:
                    continue
                caught = []
                for kind, change in KINDS.items():
                    root = ET.fromstring(text)
                    if not change(root, root.findall("joint")[index], diagonal):
                        continue
                    file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
                    hit = not check_asset(file, drive=False).passed
                    row = seen.setdefault(kind, [0, 0])
                    row[0], row[1] = row[0] + hit, row[1] + 1
                    caught.append(f"{kind} {'yes' if hit else 'NO'}")
                print(urdf.parent.name, joint.get("name"), ", ".join(caught), flush=True)
    print(f"sound ones that pass: {sound[0]} of {sound[1]}")
    for kind, (hit, count) in seen.items():
        print(f"{kind:22s} {hit} of {count}")
    save(out, {"sound": sound, "caught": seen})


def _tilted(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    element = joint.find("axis")
    if element is None:
        element = ET.SubElement(joint, "axis", xyz="1 0 0")
    axis = np.array([float(w) for w in (element.get("xyz") or "1 0 0").split()])
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    element.set("xyz", _words(Rotation.from_rotvec(TILT * across).apply(axis)))
    return True


def _pivot(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    """Shift the hinge line sideways; the geometry stays where it is at rest."""
    if joint.get("type") == "prismatic":
        return False
    element = joint.find("axis")
    axis = np.array([float(w) for w in (_get(element, "xyz") or "1 0 0").split()])
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across *= SHIFT * diagonal / np.linalg.norm(across)
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


def _longer(sign: int) -> Callable[[ET.Element, ET.Element, float], bool]:
    def change(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
        limit = joint.find("limit")
        if limit is None or joint.get("type") == "continuous":
            return False
        low, high = (float(limit.get(k) or 0) for k in ("lower", "upper"))
        limit.set("upper" if sign > 0 else "lower", repr((high if sign > 0 else low)
                                                         + sign * (high - low)))  # fmt: skip
        return True

    return change


def _exchanged(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    parent, child = joint.find("parent"), joint.find("child")
    assert parent is not None and child is not None
    a, b = parent.get("link") or "", child.get("link") or ""
    parent.set("link", b)
    child.set("link", a)
    return True


def _no_inertia(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    link = _child_link(root, joint)
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="1")
    zero = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    ET.SubElement(inertial, "inertia", zero)
    return True


def _no_mesh(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    mesh = next(iter(_child_link(root, joint).iter("mesh")), None)
    if mesh is None:
        return False
    mesh.set("filename", "nothing.obj")
    return True


def _not_a_number(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    _origin(joint).set("xyz", "nan 0 0")
    return True


def _filled(root: ET.Element, joint: ET.Element, diagonal: float) -> bool:
    """The parent collides where the part is: its visual is a collision shape of the parent too."""
    parent = _get(joint.find("parent"), "link")
    body = next(k for k in root.findall("link") if k.get("name") == parent)
    size = _words(np.full(3, diagonal))
    block = ET.SubElement(body, "collision")
    ET.SubElement(block, "origin", xyz=_words(_three(joint, "xyz")))
    ET.SubElement(ET.SubElement(block, "geometry"), "box", size=size)
    return True


KINDS: dict[str, Callable[[ET.Element, ET.Element, float], bool]] = {
    "axis tilted 5 degrees": _tilted,
    "pivot off by 5 %": _pivot,
    "upper limit doubled": _longer(1),
    "lower limit doubled": _longer(-1),
    "block over the cavity": _filled,
    "parent and child exchanged": _exchanged,
    "zero inertia": _no_inertia,
    "missing mesh": _no_mesh,
    "NaN": _not_a_number,
}


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
