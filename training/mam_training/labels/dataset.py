"""Labels as a dataset that `mam-sim bench` reads, and how far two labels of an object agree."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh
from mam_sim_bench.metrics import Scores, score

from mam_pipeline import folders
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.types import Articulation, FloatArray
from mam_pipeline.weights import learned, rooms
from mam_training.labels.ask import items_of, read_item
from mam_training.labels.label import Label
from mam_world.ground_truth import GroundTruth

SOURCE = "labels"  # what manifests of weights call these objects


def labels_in(folder: Path) -> list[Path]:
    """All label files below a folder, sorted.

    Raises:
        InputError: there is none.
    """
    found = sorted(folder.glob("*/*.json"))
    if not found:
        raise InputError(f"no labels in {folder} (looked for <repository>/<id>.json)")
    return found


def on_mesh(label: Label, corpus: Path) -> Articulation:
    """A label on the object's mesh, in the asset frame of today's reader."""
    read = read_item(items_of(corpus, [label.id])[0].file)
    return label.articulation(read.mesh, read.source_to_asset)


def seen_by_weights() -> frozenset[str]:
    """Ids of the labelled objects that some of the package's weights were trained on.

    Raises:
        ConfigError: a manifest says that labels were, and not which.
    """
    found = [one for one in learned(rooms()) if SOURCE in one.trained_on]
    for one in found:
        if not one.objects:
            raise ConfigError(
                f"the manifest of {one.room} does not name the labels that it was trained on "
                "(`data.ids`); train it again"
            )
    return frozenset(name for one in found for name in one.objects)


def write_dataset(files: Sequence[Path], corpus: Path, out: Path) -> int:
    """One folder with a URDF per labelled object, and MANIFEST.csv; the number of objects.

    Raises:
        InputError: none is left.
    """
    rows = []
    for file in files:
        label = Label.load(file)
        if label.out_of_scope:
            continue
        write_urdf(on_mesh(label, corpus), out / label.id, label.id)
        rows.append((label.id, label.category, label.repository, label.by))
    if not rows:
        raise InputError("no labelled object is left: each is out of scope or left out")
    with folders.new_file(out / "MANIFEST.csv") as place, place.open("w", newline="") as stream:
        csv.writer(stream).writerows([("id", "category", "repo", "by"), *rows])
    return len(rows)


def write_urdf(articulation: Articulation, folder: Path, name: str) -> None:
    """The surfaces of all links and their joints, nothing else: what ground truth is read from."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = articulation.mesh
    at: dict[int, FloatArray] = {0: np.zeros(3)}
    at |= {joint.child: np.asarray(joint.origin) for joint in articulation.joints}
    lines = [f"<robot name={quoteattr(name)}>"]
    for i, link in enumerate(articulation.links):
        own = trimesh.Trimesh(mesh.vertices - at[i], mesh.faces[link.faces], process=False)
        own.remove_unreferenced_vertices()
        own.export(folder / f"link_{i}.stl")
        lines.append(
            f"<link name={quoteattr(link.name)}><visual><geometry>"
            f'<mesh filename="link_{i}.stl"/></geometry></visual></link>'
        )
    for joint in articulation.joints:
        ends = f'lower="{joint.lower:.9g}" upper="{joint.upper:.9g}"'
        limit = "" if joint.type == "continuous" else f'<limit {ends} effort="1" velocity="1"/>'
        lines.append(
            f'<joint name={quoteattr(joint.name)} type="{joint.type}">'
            f"<parent link={quoteattr(articulation.links[joint.parent].name)}/>"
            f"<child link={quoteattr(articulation.links[joint.child].name)}/>"
            f'<origin xyz="{_plain(joint.origin - at[joint.parent])}"/>'
            f'<axis xyz="{_plain(joint.axis)}"/>{limit}</joint>'
        )
    folders.write_text(folder / "object.urdf", "\n".join([*lines, "</robot>"]) + "\n")


def agreement(one: Label, other: Label, corpus: Path) -> Scores:
    """What `other` scores where `one` is taken for the truth.

    Raises:
        InputError: they are labels of two objects.
    """
    if one.file_digest != other.file_digest:
        raise InputError(f"{one.id} and {other.id} are labels of different objects")
    read = read_item(items_of(corpus, [one.id])[0].file)
    made, second = (x.articulation(read.mesh, read.source_to_asset) for x in (one, other))
    truth = GroundTruth(one.id, one.category, made.mesh, made.face_link, made.links, made.joints)
    return score(second if second.joints else None, truth)


def agreement_table(pairs: Sequence[tuple[Label, Label]], corpus: Path) -> str:
    """A Markdown table of pairs, and their mean over the pairs in which something moves."""
    names = ("miou", "count", "type_error", "axis", "pivot")
    rows = [f"| object | {' | '.join(names)} |", f"|---|{'---|' * len(names)}"]
    found: list[Scores] = []
    still = 0
    for one, other in pairs:
        if one.out_of_scope or other.out_of_scope or not (one.parts or other.parts):
            same = (one.out_of_scope is None) == (other.out_of_scope is None)
            still += same
            said = "out of scope" if one.out_of_scope or other.out_of_scope else "nothing moves"
            rows.append(f"| {one.id} | {'both' if same else 'one says'}: {said} |")
            continue
        if not one.parts:
            one, other = other, one
        found.append(agreement(one, other, corpus))
        rows.append(f"| {one.id} | {' | '.join(_cell(found[-1:], n) for n in names)} |")
    rows.append(f"| mean of {len(found)} | {' | '.join(_cell(found, n) for n in names)} |")
    rows.append(f"\n{still} further pairs agree that nothing moves, or that no label is possible.")
    return "\n".join(rows)


def _cell(scores: Sequence[Scores], name: str) -> str:
    known = [value for s in scores if (value := getattr(s, name)) is not None]
    return f"{np.mean(known):.2f}" if known else ""


def _plain(vector: FloatArray) -> str:
    return " ".join(f"{v:.9g}" for v in vector)
