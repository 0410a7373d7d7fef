"""Ground truth: any folder of URDF objects, each as one static mesh and the joints it hides."""

from __future__ import annotations

import csv
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yourdfpy

from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf_mesh import Soup, concatenate, geometry_soup
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint, Link, Mesh, readonly

MOVING = {"revolute", "continuous", "prismatic"}


@dataclass(frozen=True)
class GroundTruth:
    """One object: what the engine sees (`mesh`) and what it should find.

    Attributes:
        id, category: from the folder's name and MANIFEST.csv.
        mesh: all links' surfaces at rest (q = 0) in the URDF root's frame, metres; faces shuffled,
            vertices not shared between source meshes, no names and no materials.
        face_link: (F,) index of the link that owns each face.
        links: rigid groups; links[0] is the base, links joined by fixed joints are one.
        joints: one per link other than the base, in the frame of `mesh` at rest.
    """

    id: str
    category: str
    mesh: Mesh
    face_link: IntArray
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        labels = readonly(self.face_link, np.int64, (len(self.mesh.faces),))
        object.__setattr__(self, "face_link", labels)

    def truth_articulation(self) -> Articulation:
        """The truth in the form of an answer: it scores 1 against itself."""
        return Articulation(self.mesh, self.links, self.joints)


def list_objects(dataset: str | Path) -> list[tuple[str, str, Path]]:
    """(id, category, URDF path) of every object of a dataset folder, sorted by id.

    An object is a sub-folder with `object.urdf`, `mobility.urdf` or any `*.urdf`, or a `*.urdf`
    beside the others.

    Raises:
        InputError: no such folder, or no URDF in it.
    """
    root = Path(dataset).expanduser()
    if not root.is_dir():
        raise InputError(f"no dataset folder at {root}")
    categories = _categories(root / "MANIFEST.csv")
    found = {p.stem if p.stem != "object" else root.name: p for p in sorted(root.glob("*.urdf"))}
    for folder in sorted(p for p in root.iterdir() if p.is_dir()):
        usual = [folder / "object.urdf", folder / "mobility.urdf", *sorted(folder.glob("*.urdf"))]
        urdf = next((p for p in usual if p.is_file()), None)
        if urdf is not None:
            found[folder.name] = urdf
    if not found:
        raise InputError(f"{root} holds no URDF object (looked for <id>/object.urdf and *.urdf)")
    return [(name, categories.get(name, "unknown"), found[name]) for name in sorted(found)]


def read_object(urdf: str | Path, name: str = "", category: str = "unknown") -> GroundTruth:
    """Read one URDF with its meshes as ground truth.

    Links without a surface are dummies: one that moves hands its motion to the body behind it
    (of a chain of joints the last that is not a mimic counts). Planar and floating joints are
    fixed; a revolute joint without limits is continuous.

    Raises:
        InputError: not a URDF, or it has no surface at all.
    """
    path = Path(urdf)
    name = name or path.parent.name
    robot = parse_urdf(path)
    frames = rest_frames(robot, path)
    inbound = {j.child: j for j in robot.joints}
    soups = {link.name: _link_soup(link, path.parent) for link in robot.links}
    group = {n: carrier(n, inbound) for n in frames}
    solid = {group[n] for n, soup in soups.items() if soup is not None and n in group}
    if not solid:
        raise InputError(f"{path} shows no surface: none of its links has a readable visual")
    base = next(n for n in frames if n not in inbound)
    bodies = [base] + [n for n in frames if group[n] == n and n in solid and n != base]
    index = {n: i for i, n in enumerate(bodies)}
    mesh, face_link = _merge(soups, frames, group, index, name)
    links = tuple(
        Link("base" if i == 0 else f"link_{i}", "body", np.flatnonzero(face_link == i))
        for i in range(len(bodies))
    )
    joints = tuple(truth_joint(n, index, inbound, group, frames) for n in bodies[1:])
    return GroundTruth(name, category, mesh, face_link, links, joints)


def _categories(manifest: Path) -> dict[str, str]:
    if not manifest.is_file():
        return {}
    with manifest.open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if "id" in row]
    return {row["id"]: row.get("category") or "unknown" for row in rows}


def parse_urdf(path: Path) -> Any:
    if not path.is_file():
        raise InputError(f"no URDF at {path}")
    try:
        return yourdfpy.URDF.load(
            str(path), load_meshes=False, build_scene_graph=False, load_collision_meshes=False
        ).robot
    except Exception as error:  # the parser raises whatever its XML step met
        raise InputError(f"{path} is not a readable URDF: {error}") from error


def rest_frames(robot: Any, path: Path) -> dict[str, FloatArray]:
    """`root_T_link` (4, 4) of every link at q = 0, parents before children."""
    children: dict[str, list[Any]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    has_parent = {j.child for j in robot.joints}
    roots = [link.name for link in robot.links if link.name not in has_parent]
    if not roots:
        raise InputError(f"{path} has no root link: its joints form a loop")
    if len(roots) > 1:
        roots.sort(key=lambda n: -len(children.get(n, [])))
        warnings.warn(f"{path}: several roots, keeping {roots[0]!r}", stacklevel=3)
    frames: dict[str, FloatArray] = {roots[0]: np.eye(4)}
    queue = [roots[0]]
    while queue:
        parent = queue.pop(0)
        for joint in children.get(parent, []):
            offset = np.eye(4) if joint.origin is None else np.asarray(joint.origin)
            frames[joint.child] = frames[parent] @ offset
            queue.append(joint.child)
    return frames


def _link_soup(link: Any, folder: Path) -> Soup | None:
    """A link's visual surface in the link frame, or its collision surface if it has no visual."""
    for shapes in (link.visuals, link.collisions):
        soups = []
        for shape in shapes:
            soup = geometry_soup(shape.geometry, folder)
            if soup is None:
                continue
            vertices, faces = soup
            if shape.origin is not None:
                origin = np.asarray(shape.origin)
                vertices = vertices @ origin[:3, :3].T + origin[:3, 3]
            soups.append((vertices, faces))
        if soups:
            return concatenate(soups)
    return None


def carrier(link: str, inbound: dict[str, Any]) -> str:
    """The link whose joint moves this one: itself, or the nearest ancestor over fixed joints."""
    while link in inbound and inbound[link].type not in MOVING:
        link = inbound[link].parent
    return link


def _merge(
    soups: dict[str, Soup | None],
    frames: dict[str, FloatArray],
    group: dict[str, str],
    index: dict[str, int],
    name: str,
) -> tuple[Mesh, IntArray]:
    placed: list[Soup] = []
    owner: list[IntArray] = []
    for link, frame in frames.items():
        soup = soups.get(link)
        if soup is None:
            continue
        placed.append((soup[0] @ frame[:3, :3].T + frame[:3, 3], soup[1]))
        owner.append(np.full(len(soup[1]), index[group[link]], dtype=np.int64))
    vertices, faces = concatenate(placed)
    order = np.random.default_rng(zlib.crc32(name.encode())).permutation(len(faces))
    return Mesh(vertices, faces[order]), np.concatenate(owner)[order]


def truth_joint(
    body: str,
    index: dict[str, int],
    inbound: dict[str, Any],
    group: dict[str, str],
    frames: dict[str, FloatArray],
) -> Joint:
    chain = [inbound[body]]
    parent = group[inbound[body].parent]
    while parent not in index:  # a moving dummy without a surface
        chain.append(inbound[parent])
        parent = group[inbound[parent].parent]
    source = next((j for j in chain if j.mimic is None), chain[0])
    frame = frames[source.child]
    local = np.array([1.0, 0.0, 0.0]) if source.axis is None else np.asarray(source.axis, float)
    if np.linalg.norm(local) < 1e-9:
        local = np.array([1.0, 0.0, 0.0])
    axis = frame[:3, :3] @ (local / np.linalg.norm(local))
    lower, upper, kind = -np.inf, np.inf, source.type
    if kind != "continuous" and source.limit is not None:
        lower, upper = source.limit.lower or 0.0, source.limit.upper or 0.0
        if source.limit.lower is None and source.limit.upper is None and kind == "revolute":
            lower, upper = -np.inf, np.inf
    if kind == "revolute" and not np.isfinite(upper - lower):
        kind = "continuous"
    return Joint(
        name=f"joint_{index[body]}",
        type=kind,
        subtype={"prismatic": "slide", "continuous": "spin"}.get(kind, "hinge"),  # type: ignore[arg-type]
        parent=index[parent],
        child=index[body],
        axis=axis,
        origin=frame[:3, 3],
        lower=min(lower, upper),
        upper=max(lower, upper),
    )
