"""What one simulator would refuse or ignore of a URDF.

Assets of ours were opened in SAPIEN 3.0, MuJoCo 4.0, PyBullet 3.2 and urdf-usd-converter 0.3,
through which Isaac Sim and Newton read URDF (docs/results/conformance.md). Not every rule was tried
by itself. The parsers of Gazebo (sdformat 12.3) and Drake (1.51, in strict mode) were run on our
assets and on broken ones; the limits of PhysX on a GPU come from its documents.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mam_pipeline.check.lint import MOVING, Linter
from mam_pipeline.check.report import Finding
from mam_pipeline.errors import MamSimError, unknown_name
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.soup import FileContent, join

ProfileName = Literal[
    "sapien", "mujoco", "pybullet", "isaac", "newton", "gazebo", "drake", "physx-gpu"
]


@dataclass(frozen=True)
class Profile:
    """What a simulator takes.

    Attributes:
        visual_formats: suffixes of visual meshes that it shows.
        refuses_format: of which shapes an unknown mesh format makes it refuse the whole file.
        identifiers: names must be identifiers (letters, digits, _; no digit first).
        max_hulls: convex pieces of one body, 0 for no limit.
        max_hull_points: vertices of one convex piece, 0 for no limit. max_hull_faces: its faces,
            however many corners each has. max_face_points: corners of a face.
        refuses: what it does not take of a convex piece it refuses, and does not simplify.
        possible_inertia: it refuses an inertia that breaks the triangle inequality.
        turned_inertia: it reads the rotation of an inertial frame.
        mimic: which mimic joints it couples: all, none, or `near` ones: of neighbours, and of
            one link by a multiplier of 1 or -1 without offset.
        needs_effort: without effort and velocity a joint cannot be driven, or is refused.
        reads_friction: it reads the friction of `<dynamics>`. refuses_friction: it refuses the
            file because of it. refused: tags below a joint and attributes of `<dynamics>` that it
            refuses.
        needs_inertial: it drops a link that has no inertial element.
        first_object: of an OBJ file with several objects it reads the first alone.
        any_joint: it takes floating and planar joints.
    """

    visual_formats: frozenset[str]
    refuses_format: Literal["all", "collision", "none"] = "none"
    identifiers: bool = False
    max_hulls: int = 0
    max_hull_points: int = 0
    max_hull_faces: int = 0
    max_face_points: int = 0
    refuses: bool = False
    possible_inertia: bool = False
    turned_inertia: bool = True
    mimic: Literal["all", "near", "none"] = "all"
    needs_effort: bool = False
    reads_friction: bool = True
    refuses_friction: bool = False
    refused: frozenset[str] = frozenset()
    needs_inertial: bool = False
    first_object: bool = False
    any_joint: bool = False


_GENERAL = frozenset({".obj", ".stl", ".dae"})
PROFILES: dict[str, Profile] = {
    "sapien": Profile(
        _GENERAL | {".glb", ".gltf", ".ply"}, max_hull_points=64, reads_friction=False,
        mimic="near",
    ),
    "mujoco": Profile(
        frozenset({".obj", ".stl"}), refuses_format="all", possible_inertia=True,
        needs_effort=True, first_object=True,
    ),
    "pybullet": Profile(_GENERAL, refuses_format="all", mimic="none", needs_effort=True),
    "isaac": Profile(
        _GENERAL, identifiers=True, max_hulls=64, max_hull_points=60, turned_inertia=False,
        needs_effort=True,
    ),
    "newton": Profile(_GENERAL, identifiers=True, turned_inertia=False, needs_effort=True),
    "gazebo": Profile(
        _GENERAL | {".glb", ".gltf"}, needs_effort=True, needs_inertial=True,
        possible_inertia=True, mimic="none",
    ),
    "drake": Profile(
        frozenset({".obj", ".gltf", ".vtk"}), refuses_format="collision", possible_inertia=True,
        refuses_friction=True,
        refused=frozenset({"calibration", "safety_controller", "coulomb_window"}),
    ),
    "physx-gpu": Profile(
        _GENERAL | {".glb", ".gltf", ".ply"}, max_hull_points=64, max_hull_faces=64,
        max_face_points=32, refuses=True,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class HullRules:
    """How convex pieces are judged.

    Attributes:
        filled: share of its convex hull; a collision mesh that fills less becomes another shape.
        flat: angle between triangles of a hull that are one face, radians.
    """

    filled: float = 0.8
    flat: float = 1e-3


HULLS = HullRules()
DEFAULT_EFFORT, DEFAULT_VELOCITY = 100.0, 2.0
"""N or N m, m/s or rad/s: what `mend` writes where a joint has none, as our own assets do."""


def profile_findings(linter: Linter, name: str) -> list[Finding]:
    """Findings about a URDF for one simulator, beyond those of the lint.

    Args:
        linter: one that has run.
        name: of the profile.

    Raises:
        ConfigError: no profile of that name.
    """
    if name not in PROFILES:
        raise unknown_name("profile", name, PROFILES)
    profile = PROFILES[name]
    rules: list[Callable[[Linter, Profile], Iterator[Finding]]]
    rules = [_names, _links, _joints, _meshes]
    return [finding for rule in rules for finding in rule(linter, profile)]


def _names(linter: Linter, profile: Profile) -> Iterator[Finding]:
    if profile.identifiers:
        for element in (*linter.links.values(), *linter.joints):
            name = element.get("name") or ""
            if not is_identifier(name):
                text = "a name must begin with a letter and hold letters, digits and _ only"
                yield Finding("name_invalid", f"{element.tag} {name}", text)


def _links(linter: Linter, profile: Profile) -> Iterator[Finding]:
    moved = {linter.end(j, "child") for j in linter.joints if j.get("type") in MOVING}
    for name, link in linter.links.items():
        hulls = len(link.findall("collision"))
        if 0 < profile.max_hulls < hulls:
            text = f"{hulls} collision shapes; the GPU takes {profile.max_hulls} a body"
            yield Finding("hull_count", name, text)
        inertial = link.find("inertial")
        if inertial is None:
            if profile.needs_inertial and name in moved:
                text = "a link without <inertial> is dropped, and its joint with it"
                yield Finding("inertial_missing", name, text)
            continue
        tensor = tensor_of(inertial)
        if tensor is not None and profile.possible_inertia and lack(tensor) > 0.0:
            text = "its inertia breaks the triangle inequality, and the file is refused"
            yield Finding("inertia_impossible", name, text)
        if not profile.turned_inertia and turn_of(inertial) is not None:
            text = "the rotation of its inertial frame is ignored"
            yield Finding("inertial_turned", name, text)


def _joints(linter: Linter, profile: Profile) -> Iterator[Finding]:
    for joint in linter.joints:
        name, kind = joint.get("name") or "joint", joint.get("type")
        if kind in ("floating", "planar") and not profile.any_joint:
            yield Finding("joint_type", name, f"a {kind} joint is refused or becomes a fixed one")
        mimic = joint.find("mimic")
        if mimic is not None and profile.mimic == "none":
            yield Finding("mimic_ignored", name, "its <mimic> is ignored: it moves freely")
        if mimic is not None and profile.mimic == "near" and not _near(joint, mimic, linter):
            text = "its <mimic> is ignored or inverted; our environments couple it themselves"
            yield Finding("mimic_ignored", name, text, warning=True)
        if kind not in MOVING:
            continue
        limit = joint.find("limit")
        missing = [
            k for k in ("effort", "velocity") if limit is None or not _positive(limit.get(k))
        ]
        if profile.needs_effort and missing:
            text = f"it has no {' and no '.join(missing)}: drives get none, or it is refused"
            yield Finding("effort_missing", name, text)
        dynamics = joint.find("dynamics")
        rubs = dynamics is not None and _positive(dynamics.get("friction"))
        if rubs and profile.refuses_friction:
            text = "joint friction: a parser in strict mode refuses the file, others ignore it"
            yield Finding("friction_refused", name, text)
        for key in refused_tags(joint, profile):
            yield Finding("tag_refused", name, f"<{key}>: in strict mode the file is refused")
        if rubs and not profile.reads_friction:
            text = "the friction of <dynamics> is ignored; set it after loading"
            yield Finding("friction_ignored", name, text, warning=True)


def refused_tags(joint: ET.Element, profile: Profile) -> list[str]:
    """Tags below a joint, and attributes of its `<dynamics>`, because of which it is refused."""
    dynamics = joint.find("dynamics")
    told = {e.tag for e in joint} | set(() if dynamics is None else dynamics.attrib)
    return sorted(told & profile.refused)


def _near(joint: ET.Element, mimic: ET.Element, linter: Linter) -> bool:
    """Whether SAPIEN's own builder couples a joint as the file says."""
    leader = next((j for j in linter.joints if j.get("name") == mimic.get("joint")), None)
    if leader is None:
        return False
    if linter.end(joint, "parent") == linter.end(leader, "child"):
        return True
    factor, offset = float(mimic.get("multiplier") or 1), float(mimic.get("offset") or 0)
    same = linter.end(joint, "parent") == linter.end(leader, "parent")
    return same and abs(factor) == 1.0 and offset == 0.0


def _meshes(linter: Linter, profile: Profile) -> Iterator[Finding]:
    read: dict[Path, FileContent | None] = {}
    for name, link in linter.links.items():
        for kind in ("visual", "collision"):
            for mesh in link.findall(f"{kind}/geometry/mesh"):
                file = linter.locate(mesh.get("filename") or "")
                if file is None or not file.is_file():
                    continue  # the lint has said so
                if file not in read:
                    read[file] = _content(file, linter.door.root)
                yield from _mesh(f"{name}, {kind} {file.name}", kind, mesh, file, read[file],
                                 profile)  # fmt: skip


def _mesh(
    where: str, kind: str, mesh: ET.Element, file: Path, content: FileContent | None,
    profile: Profile,
) -> Iterator[Finding]:  # fmt: skip
    suffix = file.suffix.lower()
    if suffix not in profile.visual_formats:
        refused = profile.refuses_format in ("all", kind)
        what = "the whole file is refused" if refused else "the shape is dropped"
        yield Finding("mesh_format", where, f"{suffix} is not read: {what}")
    scale = [float(w) for w in (mesh.get("scale") or "1").split()]
    if min(scale) < 0:
        text = "a negative scale turns faces inside out, or is refused"
        yield Finding("negative_scale", where, text)
    if content is None:
        return
    objects = len({p.group for p in content.pieces})
    if profile.first_object and suffix == ".obj" and objects > 1:
        text = f"only the first of its {objects} objects is read"
        yield Finding("several_objects", where, text)
    if kind == "visual":
        return
    whole = join(content.pieces, content.materials)
    points = np.unique(whole.vertices, axis=0)
    try:
        hull = trimesh.convex.convex_hull(points)
    except Exception:  # flat or worse: the lint and the simulators say what they think of it
        return
    solid = trimesh.Trimesh(whole.vertices, whole.faces, process=True)
    if solid.is_watertight and abs(solid.volume) < HULLS.filled * hull.volume:
        share = 100.0 * abs(solid.volume) / hull.volume
        text = f"it fills {share:.0f} % of its convex hull, which is what will collide"
        yield Finding("concave_collision", where, text, warning=True)
    for code, (count, most) in too_fine(hull, profile).items():
        what = {"hull_points": "vertices", "hull_faces": "faces"}.get(code, "corners of a face")
        text = f"its hull has {count} {what}; the GPU takes {most}"
        yield Finding(code, where, text, warning=not profile.refuses)


def too_fine(hull: trimesh.Trimesh, profile: Profile) -> dict[str, tuple[int, int]]:
    """Reason -> (count, the most that is taken) of what a GPU does not take of a convex hull.

    Triangles in one plane are one face, as PhysX makes it.
    """
    flat = hull.face_adjacency[hull.face_adjacency_angles < HULLS.flat]
    faces = trimesh.graph.connected_components(flat, nodes=np.arange(len(hull.faces)))
    corners = max(len(np.unique(hull.faces[face])) for face in faces)
    told = {
        "hull_points": (len(hull.vertices), profile.max_hull_points),
        "hull_faces": (len(faces), profile.max_hull_faces),
        "face_points": (corners, profile.max_face_points),
    }
    return {code: pair for code, pair in told.items() if 0 < pair[1] < pair[0]}


ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2),
            "izz": (2, 2)}  # fmt: skip
"""Attributes of <inertia>, by row and column of the tensor."""


def tensor_of(inertial: ET.Element) -> np.ndarray | None:
    """(3, 3) inertia as written; None if it is missing or not finite."""
    element = inertial.find("inertia")
    if element is None:
        return None
    out = np.zeros((3, 3))
    try:
        for key, (i, k) in ENTRIES.items():
            out[i, k] = out[k, i] = float(element.get(key) or 0)
    except ValueError:
        return None
    return out if np.isfinite(out).all() else None


def lack(tensor: np.ndarray) -> float:
    """By how much the largest moment exceeds the sum of the others; 0 within rounding."""
    low, middle, high = np.linalg.eigvalsh(tensor)
    lack = float(high - low - middle)
    return lack if lack > 1e-9 * high else 0.0


def turn_of(inertial: ET.Element) -> np.ndarray | None:
    """(3, 3) rotation of an inertial frame, None if it is not turned."""
    origin = inertial.find("origin")
    rpy = [float(w) for w in ((origin is not None and origin.get("rpy")) or "0 0 0").split()]
    turn = Rotation.from_euler("xyz", rpy).as_matrix()
    return None if np.allclose(turn, np.eye(3), atol=1e-9) else np.asarray(turn)


def _positive(text: str | None) -> bool:
    try:
        return text is not None and float(text) > 0
    except ValueError:
        return False


def is_identifier(name: str) -> bool:
    """Whether a name is one of letters, digits and _ that begins with no digit."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is not None


def _content(file: Path, root: Path) -> FileContent | None:
    try:
        return read_file(file, root)
    except MamSimError:
        return None
