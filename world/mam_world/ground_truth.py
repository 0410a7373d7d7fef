"""Ground truth: any folder of URDF objects, each as one static mesh and the joints it hides."""

from __future__ import annotations

import csv
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import entries, is_file
from mam_pipeline.formats.urdf.geometry import link_triangles
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.geometry.surface import Triangles, concatenate
from mam_pipeline.types import Articulation, IntArray, Joint, Link, Mesh, readonly


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
    inside = entries(root)
    urdfs = [p for p in inside if p.suffix == ".urdf" and p.is_file()]
    found = {p.stem if p.stem != "object" else root.name: p for p in urdfs}
    for folder in (p for p in inside if p.is_dir()):
        usual = [folder / "object.urdf", folder / "mobility.urdf", *entries(folder, "*.urdf")]
        urdf = next((p for p in usual if is_file(p)), None)
        if urdf is not None:
            found[folder.name] = urdf
    if not found:
        raise InputError(f"{root} holds no URDF object (looked for <id>/object.urdf and *.urdf)")
    return [(name, categories.get(name, "unknown"), found[name]) for name in sorted(found)]


def read_object(
    urdf: str | Path, name: str = "", category: str = "unknown", named: bool = False
) -> GroundTruth:
    """Read one URDF with its meshes as ground truth.

    Which links are bodies and how each moves is the URDF reader's rule (`UrdfTree.joint`).

    Args:
        named: whether `mesh` has a node for every link, by the link's name; else it has no names.

    Raises:
        InputError: not a URDF, or it has no surface at all.
    """
    path = Path(urdf)
    name = name or path.parent.name
    tree = UrdfTree.read(path)
    found = {link.name: link_triangles(link, path.parent) for link in tree.robot.links}
    surfaces = {n: own for n in tree.frames if (own := found.get(n)) is not None}
    if not surfaces:
        raise InputError(f"{path} shows no surface: none of its links has a readable visual")
    bodies = tree.bodies(surfaces)
    mesh, face_link, source = _merge(surfaces, tree, bodies, name)
    if named:
        mesh = replace(mesh, face_group=source, group_names=tuple(surfaces))
    links = tuple(
        Link("base" if i == 0 else f"link_{i}", "body", np.flatnonzero(face_link == i))
        for i in range(len(bodies))
    )
    joints = tuple(
        replace(tree.joint(n, bodies), name=f"joint_{i}", coupling=None)
        for n, i in list(bodies.items())[1:]
    )
    return GroundTruth(name, category, mesh, face_link, links, joints)


def _categories(manifest: Path) -> dict[str, str]:
    if not is_file(manifest):
        return {}
    with manifest.open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if "id" in row]
    return {row["id"]: row.get("category") or "unknown" for row in rows}


def _merge(
    surfaces: Mapping[str, Triangles], tree: UrdfTree, bodies: Mapping[str, int], name: str
) -> tuple[Mesh, IntArray, IntArray]:
    """The mesh, the body of every face, and which of `surfaces` it is of."""
    placed: list[Triangles] = []
    owner: list[IntArray] = []
    source: list[IntArray] = []
    for k, (link, (points, corners)) in enumerate(surfaces.items()):
        frame = tree.frames[link]
        placed.append((points @ frame[:3, :3].T + frame[:3, 3], corners))
        owner.append(np.full(len(corners), bodies[tree.carrier(link)], dtype=np.int64))
        source.append(np.full(len(corners), k, dtype=np.int64))
    vertices, faces = concatenate(placed)
    order = np.random.default_rng(zlib.crc32(name.encode())).permutation(len(faces))
    mesh = Mesh(vertices, faces[order])
    return mesh, np.concatenate(owner)[order], np.concatenate(source)[order]
