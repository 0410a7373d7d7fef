"""Sweet Home 3D's furniture as a ground-truth dataset: furniture whose joints are known.

    python benchmarks/sweet_home_dataset.py FOLDER [--packages FOLDER_OF_DEBS]
    mam-sim bench FOLDER [--fuse]

Doors, windows, wardrobes, chests, appliances of a home designer's library whose moving parts are
marked in the mesh by the names of groups: what turns about which hinge, what slides on which rail.
The packages `sweethome3d` and `sweethome3d-furniture` are fetched with apt-get (Debian, Ubuntu) and
unpacked aside; nothing is installed. Every model has a licence of its own, see the packages.

A hinge turns about the longest side of its shape, a part slides along the longest side of its rail,
as the designer moves them. Left out is what has no hinge or rail of its own among the still
shapes: lamps on ball joints, a clasp whose hinge moves with a lid.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import zipfile
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh
import tyro
from tyro.conf import Positional

PACKAGES = ("sweethome3d", "sweethome3d-furniture")
ON = re.compile(r"sweethome3d_(?:opening|window_pane|window_mirror)_on_(hinge|rail)_(\d+)")
TIE = re.compile(r"^sweethome3d_(?:unique_)?(hinge|rail)(?:_(\d+))?")  # a unique rail has no number
# the designer: X to the right, Y up, Z to the front; ours: X to the right, Z up, front towards -Y
TURN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
Part = tuple[str, str]  # hinge or rail, and its number


@dataclass(frozen=True)
class Model:
    """One entry of a catalogue: its mesh file and how the designer places it."""

    name: str
    category: str
    file: str
    size: tuple[float, float, float]  # width, height, depth in metres
    rotation: np.ndarray


@dataclass
class Groups:
    """Triangles of a Wavefront file by the part they move with, and what ties the parts."""

    vertices: np.ndarray
    faces: dict[Part | None, list[tuple[int, int, int]]] = field(default_factory=dict)
    ties: dict[Part, list[int]] = field(default_factory=dict)


def catalogue(text: str) -> list[Model]:
    """Entries of a properties file."""
    rows: dict[str, dict[str, str]] = defaultdict(dict)
    for key, number, value in re.findall(r"^(\w+)#(\d+)=(.*?)\s*$", text, re.MULTILINE):
        rows[number][key] = value
    out = []
    for row in rows.values():
        if not row.get("model", "").endswith(".obj"):
            continue
        size = tuple(float(row[k]) / 100 for k in ("width", "height", "depth"))
        turn = np.array(row.get("modelRotation", "1 0 0 0 1 0 0 0 1").split(), dtype=float)
        model = row["model"].lstrip("/")
        out.append(
            Model(Path(model).stem, row.get("category", ""), model, size, turn.reshape(3, 3))  # type: ignore[arg-type]
        )
    return out


def read_groups(text: str) -> Groups:
    """Vertices and named groups of a Wavefront file; polygons become fans."""
    vertices: list[list[float]] = []
    out = Groups(np.zeros((0, 3)))
    part: Part | None = None
    tie: Part | None = None
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            vertices.append([float(x) for x in rest.split()[:3]])
        elif word in ("g", "o"):
            part = (ON.findall(rest) or [None])[-1]
            found = TIE.match(rest)
            tie = (found[1], found[2] or "") if found else None
        elif word == "f":
            index = [int(c.split("/")[0]) for c in rest.split()]
            index = [i - 1 if i > 0 else len(vertices) + i for i in index]
            fan = [(index[0], b, c) for b, c in pairwise(index[1:])]
            out.faces.setdefault(part, []).extend(fan)
            if tie is not None:
                out.ties.setdefault(tie, []).extend(index)
    out.vertices = np.array(vertices)
    return out


def place(model: Model, groups: Groups) -> np.ndarray:
    """(V, 3) vertices as the designer shows them: turned, scaled to the catalogue's size, Z up."""
    points = groups.vertices @ model.rotation.T
    used = np.unique([i for faces in groups.faces.values() for f in faces for i in f])
    span = np.ptp(points[used], axis=0)
    return np.asarray((points * np.where(span > 0, np.array(model.size) / span, 1.0)) @ TURN.T)


def write_object(model: Model, groups: Groups, folder: Path) -> bool:
    """Write one URDF with a mesh for every link; False when nothing moves as a joint does."""
    if None not in groups.faces or len(groups.faces) < 2:
        return False
    points = place(model, groups)
    joints = {}
    for part in groups.faces:
        if part is None:
            continue
        tie = groups.ties.get(part) or groups.ties.get((part[0], ""))
        if tie is None:
            return False
        low, high = points[tie].min(axis=0), points[tie].max(axis=0)
        joints[part] = np.eye(3)[np.argmax(high - low)], 0.5 * (low + high)
    folder.mkdir(parents=True, exist_ok=True)
    name = {None: "base"} | {p: f"{p[0]}_{p[1]}" for p in joints}
    lines = [f"<robot name={quoteattr(model.name)}>"]
    for part, faces in groups.faces.items():
        origin = joints[part][1] if part is not None else np.zeros(3)
        mesh = trimesh.Trimesh(points - origin, faces, process=False)
        mesh.remove_unreferenced_vertices()
        mesh.export(folder / f"{name[part]}.stl")
        lines.append(
            f'<link name="{name[part]}"><visual><geometry><mesh filename="{name[part]}.stl"/>'
            "</geometry></visual></link>"
        )
    for part, (axis, origin) in joints.items():
        kind = "revolute" if part[0] == "hinge" else "prismatic"
        lines.append(
            f'<joint name="{name[part]}_joint" type="{kind}"><parent link="base"/>'
            f'<child link="{name[part]}"/><origin xyz="{_plain(origin)}"/>'
            f'<axis xyz="{_plain(axis)}"/>'
            '<limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>'
        )
    (folder / "object.urdf").write_text("\n".join([*lines, "</robot>"]) + "\n")
    return True


def _plain(vector: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in vector)


def archives(folder: Path, packages: Path | None) -> list[zipfile.ZipFile]:
    """The libraries inside the packages, fetched if they are not given."""
    if packages is None:
        try:
            subprocess.run(["apt-get", "download", *PACKAGES], cwd=folder, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            sys.exit(f"apt-get cannot fetch {' and '.join(PACKAGES)} ({error}); see --packages")
        packages = folder
    debs = sorted(packages.glob("sweethome3d*.deb"))
    if not debs:
        sys.exit(f"{packages} holds no sweethome3d*.deb")
    for deb in debs:
        subprocess.run(["dpkg", "-x", str(deb), str(folder / "unpacked")], check=True)
    found = (folder / "unpacked").rglob("*")
    return [zipfile.ZipFile(p) for p in sorted(found) if p.suffix == ".sh3f"
            or p.name == "sweethome3d.jar"]  # fmt: skip


def main(folder: Positional[Path], /, packages: Path | None = None) -> None:
    """Write the dataset and its MANIFEST.csv.

    Args:
        folder: where the objects go. packages: folder with the .deb files (else apt-get).
    """
    rows = ["id,category"]
    with tempfile.TemporaryDirectory() as scratch:
        for archive in archives(Path(scratch), packages):
            names = set(archive.namelist())
            index = next(
                n for n in names
                if n.endswith(("PluginFurnitureCatalog.properties",
                               "DefaultFurnitureCatalog.properties"))
            )  # fmt: skip
            for model in catalogue(archive.read(index).decode("latin-1")):
                if model.file not in names:
                    continue
                groups = read_groups(archive.read(model.file).decode("latin-1"))
                library = Path(archive.filename or "").stem.lower()
                name = f"{library}__{model.name}"
                if f"{name},{model.category}" not in rows and write_object(
                    model, groups, folder / name
                ):
                    rows.append(f"{name},{model.category}")
    (folder / "MANIFEST.csv").write_text("\n".join(rows) + "\n")
    print(f"{len(rows) - 1} objects in {folder}")


if __name__ == "__main__":
    tyro.cli(main)
