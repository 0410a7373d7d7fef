"""Static checks of a URDF, safe on a stranger's file: nothing is expanded, nothing outside read."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mam_pipeline import thresholds as limits
from mam_pipeline.asset.card import AssetCard, unlike
from mam_pipeline.check.report import Finding
from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.formats.door import Door, Outside, lost_names
from mam_pipeline.formats.files import files_of
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.suffixes import mesh_suffixes
from mam_pipeline.formats.urdf.admit import refused
from mam_pipeline.formats.xml_file import Doctype, parse_xml

MOVING = ("revolute", "continuous", "prismatic")
KNOWN = (*MOVING, "fixed")


@dataclass(frozen=True)
class LintRules:
    """What is told of numbers that no reader refuses.

    Attributes:
        unit: by how much an axis may be longer or shorter than 1.
        radians: largest end of a range in radians; a whole number beyond it is one of degrees.
    """

    unit: float = 1e-3
    radians: float = 8.0


RULES = LintRules()


def in_degrees(lower: float, upper: float) -> bool:
    """Whether ends of a revolute joint are whole numbers too large for radians."""
    whole = all(abs(v - round(v)) < 1e-6 for v in (lower, upper))
    return whole and max(abs(lower), abs(upper)) > RULES.radians


def lint(urdf: Path, card: AssetCard | None = None) -> list[Finding]:
    """Findings about a URDF, the files it names and its card; none of them needs a simulator."""
    found = Linter(urdf, card)
    found.run()
    return found.findings


class Linter:
    """Walks over one URDF and collects what is wrong."""

    def __init__(self, urdf: Path, card: AssetCard | None = None) -> None:
        self.urdf, self.card = urdf, card
        self.door = Door(urdf.parent)
        self.findings: list[Finding] = []
        self.links: dict[str, ET.Element] = {}
        self.joints: list[ET.Element] = []
        self.bytes = self.shapes = self.faces = 0
        self.read: dict[Path, int] = {}

    def run(self) -> None:
        root = self._parse()
        if root is None:
            return
        self._tree(root)
        for why in () if self.card is None else unlike(self.card, root):
            self._say("card_differs", "asset.json", why)
        for joint in self.joints:
            self._joint(joint)
        moved = {self.end(j, "child") for j in self.joints if j.get("type") in MOVING}
        surface = False
        for name, link in self.links.items():
            self._inertial(name, link, name in moved)
            surface |= self._shapes(name, link, name in moved)
        if not surface and not any(f.code.startswith("mesh_") for f in self.findings):
            self._say("no_surface", "robot", "no link has a visual or collision surface")
        if not moved:
            self._say("no_joint", "robot", "no joint is revolute, continuous or prismatic")

    def _say(self, code: str, where: str, message: str, warning: bool = False) -> None:
        self.findings.append(Finding(code, where, message, warning))

    def _parse(self) -> ET.Element | None:
        where = self.urdf.name
        try:
            root = parse_xml(self.urdf, limits.MAX_XML_BYTES)
        except Doctype as error:
            self._say("xml_entities", where, str(error))
            return None
        except InputError as error:
            self._say("xml_unreadable", where, str(error))
            return None
        if root.tag != "robot":
            self._say("xml_unreadable", where, f"the root element is <{root.tag}>, not <robot>")
            return None
        for refusal in refused(self.urdf, root):
            outside = isinstance(refusal, Outside)
            self._say("mesh_outside" if outside else "mesh_unreadable", where, str(refusal))
        return root

    def _tree(self, root: ET.Element) -> None:
        for link in root.findall("link"):
            name = link.get("name") or ""
            if not name or name in self.links:
                self._say("bad_tree", name or "link", "a link has no name, or one that is taken")
            self.links[name] = link
        if len(self.links) > limits.MAX_LINKS:
            self._say("too_large", "robot", f"{len(self.links)} links")
        self.joints = root.findall("joint")
        parents: dict[str, str] = {}
        names: set[str] = set()
        for joint in self.joints:
            name = joint.get("name") or ""
            parent, child = self.end(joint, "parent"), self.end(joint, "child")
            if not name or name in names:
                self._say("bad_tree", name or "joint", "a joint has no name, or one that is taken")
            names.add(name)
            for ref in (parent, child):
                if ref not in self.links:
                    self._say("bad_tree", name, f"it names the link {ref!r}, which does not exist")
            if child in parents:
                self._say("bad_tree", name, f"link {child!r} has two parents")
            parents[child] = parent
        roots = [n for n in self.links if n not in parents]
        if self.links and len(roots) != 1:
            self._say("bad_tree", "robot", f"{len(roots)} links have no parent; one must")
        for start in self.links:
            seen, at = set(), start
            while at in parents and at not in seen:
                seen.add(at)
                at = parents[at]
            if at in seen:
                self._say("bad_tree", start, "its joints form a loop")
                break

    @staticmethod
    def end(joint: ET.Element, key: str) -> str:
        """Name of the link that a joint's `parent` or `child` element names."""
        found = joint.find(key)
        return "" if found is None else found.get("link") or ""

    def _joint(self, joint: ET.Element) -> None:
        name, kind = joint.get("name") or "joint", joint.get("type") or ""
        self._origin(joint, name)
        if kind not in KNOWN:
            self._say("bad_joint", name, f"type {kind!r} is not one of {', '.join(KNOWN)}")
            return
        self._mimic(joint, name)
        if kind == "fixed":
            return
        axis_element = joint.find("axis")
        if axis_element is not None:
            axis = self._numbers(axis_element.get("xyz") or "1 0 0", 3, name)
            if axis is not None and np.linalg.norm(axis) < 1e-3:
                self._say("bad_joint", name, "its axis is zero (loaders silently take x)")
            elif axis is not None and abs(np.linalg.norm(axis) - 1.0) > RULES.unit:
                text = f"its axis has length {np.linalg.norm(axis):.4g}: some loaders scale by it"
                self._say("axis_length", name, text, warning=True)
        if kind != "continuous":
            self._limit(joint, name)
        dynamics, resists = joint.find("dynamics"), False
        for key in ("damping", "friction"):
            told = "0" if dynamics is None else dynamics.get(key) or "0"
            value = self._numbers(told, 1, name)
            if value is not None and value[0] < 0:
                self._say("bad_joint", name, f"its {key} is negative")
            resists |= value is not None and value[0] != 0
        if not resists and joint.find("mimic") is None:
            text = "it has neither friction nor damping: it swings on for ever"
            self._say("no_friction", name, text, warning=True)

    def _mimic(self, joint: ET.Element, name: str) -> None:
        mimic = joint.find("mimic")
        if mimic is None:
            return
        for key in ("multiplier", "offset"):
            self._numbers(mimic.get(key) or "0", 1, name)
        follows = {j.get("name"): _leader(j) for j in self.joints}
        seen, at = {name}, mimic.get("joint")
        while at is not None:
            if at not in follows:
                self._say("bad_joint", name, f"it follows the joint {at!r}, which does not exist")
                return
            if at in seen:
                self._say("bad_joint", name, "it follows itself")
                return
            seen.add(at)
            at = follows[at]

    def _limit(self, joint: ET.Element, name: str) -> None:
        limit = joint.find("limit")
        if limit is None:
            self._say("bad_limits", name, "it has no <limit>")
            return
        values = [self._numbers(limit.get(k) or "0", 1, name) for k in ("lower", "upper")]
        if any(v is None for v in values):
            return
        lower, upper = (float(v[0]) for v in values if v is not None)
        if upper < lower:
            self._say("bad_limits", name, f"lower {lower:.4g} is above upper {upper:.4g}")
        elif joint.get("type") == "revolute" and in_degrees(lower, upper):
            text = (
                f"{lower:g} to {upper:g} rad are {(upper - lower) / math.tau:.0f} turns; degrees?"
            )
            self._say("limits_degrees", name, text, warning=True)
        elif upper - lower < 1e-6:
            self._say("bad_limits", name, f"its range is empty ({lower:.4g} to {upper:.4g})")

    def _inertial(self, name: str, link: ET.Element, moves: bool) -> None:
        element = link.find("inertial")
        if element is None:
            if moves:
                text = "no <inertial>: simulators guess a mass from collision shapes"
                self._say("no_inertia", name, text, warning=True)
            return
        self._origin(element, name)
        mass_element, tensor = element.find("mass"), element.find("inertia")
        mass = None if mass_element is None else mass_element.get("value")
        value = self._numbers(mass or "0", 1, name)
        if value is None or tensor is None:
            if tensor is None:
                self._say("bad_inertia", name, "it has no <inertia>", warning=not moves)
            return
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        numbers = [self._numbers(tensor.get(k) or "0", 1, name) for k in keys]
        if any(n is None for n in numbers):
            return
        ixx, ixy, ixz, iyy, iyz, izz = (float(n[0]) for n in numbers if n is not None)
        eigen = np.linalg.eigvalsh([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        why = ""
        if value[0] <= 0:
            why = f"its mass is {value[0]:.4g} kg"
        elif eigen[0] <= 0:
            why = "its inertia is not positive definite"
        elif eigen[0] + eigen[1] < eigen[2] * (1 - 1e-3):
            why = "its inertia breaks the triangle inequality: no body has it"
        if why:
            self._say("bad_inertia", name, why, warning=not moves)

    def _shapes(self, name: str, link: ET.Element, moves: bool) -> bool:
        counts = {"visual": 0, "collision": 0}
        for kind in counts:
            for element in link.findall(kind):
                counts[kind] += self._shape(f"{name}, {kind}", element)
        if moves and counts["visual"] and not counts["collision"]:
            self._say("no_collision", name, "it moves but has no collision shape")
        return bool(counts["visual"] or counts["collision"])

    def _shape(self, where: str, element: ET.Element) -> bool:
        self._origin(element, where)
        self.shapes += 1
        geometry = element.find("geometry")
        if self.shapes > limits.MAX_SHAPES or geometry is None or not len(geometry):
            if self.shapes == limits.MAX_SHAPES + 1:
                self._say("too_large", where, f"more than {limits.MAX_SHAPES} shapes")
            return False
        shape = geometry[0]
        wanted = {"box": [("size", 3)], "sphere": [("radius", 1)]}
        wanted |= {"cylinder": [("radius", 1), ("length", 1)], "capsule": [("radius", 1)]}
        for key, width in wanted.get(shape.tag, []):
            size = self._numbers(shape.get(key) or "0", width, where)
            if size is not None and (size <= 0).any():
                self._say("bad_joint", where, f"its {shape.tag} has no size", warning=True)
        if shape.tag == "mesh":
            self._numbers(shape.get("scale") or "1 1 1", 3, where)
            return self._mesh(where, shape.get("filename") or "")
        return shape.tag in wanted

    def _mesh(self, where: str, name: str) -> bool:
        try:
            file = self.door.find(name, self.urdf)
        except InputError:  # it has been said
            return False
        if file is None:
            self._say("mesh_missing", where, f"{name!r} does not exist")
            return False
        if "://" in name or name.startswith("/"):
            text = f"{name!r} is found from this folder, and nowhere else"
            self._say("mesh_path", where, text, warning=True)
        if file in self.read:
            return self.read[file] > 0
        self.read[file] = 0
        self.bytes += file.stat().st_size
        if self.bytes > limits.MAX_MESH_BYTES or self.faces > limits.MAX_FACES:
            self._say("too_large", where, "its meshes are larger than a check will read")
            return False
        if file.suffix.lower() not in mesh_suffixes():
            self._say("mesh_unreadable", where, f"{name!r} is of an unknown format")
            return False
        try:
            pieces = read_file(file, self.door.root).pieces
        except MamSimError as error:
            self._say("mesh_unreadable", where, str(error))
            return False
        if not all(np.isfinite(p.vertices).all() for p in pieces):
            self._say("not_finite", where, f"{name!r} has vertices that are NaN or infinite")
            return False
        for by in files_of(file, self.door.root):
            for lost in lost_names(by):
                text = f"{by.name} names {lost!r}, which does not exist under that name"
                self._say("texture_missing", where, text, warning=True)
        self.read[file] = sum(len(p.faces) for p in pieces)
        self.faces += self.read[file]
        return True

    def locate(self, name: str) -> Path | None:
        """The file that a mesh name means, None if there is none that may be opened."""
        try:
            return self.door.find(name, self.urdf)
        except InputError:
            return None

    def _origin(self, element: ET.Element, where: str) -> None:
        origin = element.find("origin")
        if origin is not None:
            for key in ("xyz", "rpy"):
                self._numbers(origin.get(key) or "0 0 0", 3, where)

    def _numbers(self, text: str, count: int, where: str) -> np.ndarray | None:
        try:
            values = [float(w) for w in text.split()]
        except ValueError:
            self._say("bad_joint", where, f"{text!r} is not a number")
            return None
        if not all(math.isfinite(v) for v in values):
            self._say("not_finite", where, f"{text!r} is not finite")
            return None
        if len(values) != count:
            self._say("bad_joint", where, f"{text!r} should be {count} numbers")
            return None
        return np.array(values)


def _leader(joint: ET.Element) -> str | None:
    mimic = joint.find("mimic")
    return None if mimic is None else mimic.get("joint")
