"""Refinement speed in one run: the paper's recipe (trimesh SDF + Nelder-Mead) against ours.

    python benchmarks/joint_refinement_speed.py [--objects 3] [--contacts 60] [--out FILE]

Both minimise the same loss (paper eq. 9) from the same start, on the same contact points, states
and normalised mesh. Loss is compared by one measure (unsigned Open3D distance) for both results.
"""

from __future__ import annotations

import time
import warnings
from pathlib import Path

import numpy as np
import trimesh
import tyro
from common import save
from mam_sim_paper.initialise import initialise, paper_part
from mam_sim_paper.optimise import minimise, residuals, states_of

from mam_pipeline.geometry.motion import Motion
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import thin_out, unit
from mam_pipeline.types import Articulation, FloatArray, Joint
from mam_world import make_object


def compare(truth: Articulation, joint: Joint, contacts: int) -> dict[str, float]:
    """Seconds and final losses of both recipes on one joint."""
    mesh, label = truth.mesh, truth.face_link
    faces, parent = np.flatnonzero(label == joint.child), np.flatnonzero(label == joint.parent)
    part = paper_part(mesh, faces, parent)
    start = initialise(part, joint.subtype)
    contact = part.contact[thin_out(len(part.contact), contacts)]
    motion: Motion = "prismatic" if joint.subtype == "slide" else "revolute"
    states = states_of(motion, 0.5 * float(np.ptp(part.points @ unit(start.axis))))
    origin = (start.origin - part.center) / part.unit
    normalised = (mesh.vertices - part.center) / part.unit
    slow_mesh = trimesh.Trimesh(normalised, mesh.faces[parent], process=False)
    scene = RayScene(normalised, mesh.faces[parent])

    def slow_distance(points: FloatArray) -> FloatArray:
        return np.asarray(trimesh.proximity.signed_distance(slow_mesh, points))

    def loss(axis: FloatArray, at: FloatArray) -> float:
        return float((residuals(scene.distance, contact, motion, axis, at, states) ** 2).mean())

    row = {"start_loss": loss(start.axis, origin), "faces": float(len(parent))}
    begun = time.perf_counter()
    axis, at, *_, curve = minimise(
        slow_distance, contact, motion, start.axis, origin, states, "nelder-mead"
    )
    row["paper_seconds"], row["paper_loss"] = time.perf_counter() - begun, loss(axis, at)
    row["paper_evaluations"] = float(len(curve))
    for method in ("nelder-mead", "lm"):
        begun = time.perf_counter()
        axis, at, *_, curve = minimise(
            scene.distance, contact, motion, start.axis, origin, states,
            method,  # type: ignore[arg-type]
        )  # fmt: skip
        name = method.replace("-", "_")
        row[f"{name}_seconds"], row[f"{name}_loss"] = time.perf_counter() - begun, loss(axis, at)
        row[f"{name}_ratio"] = row["paper_seconds"] / row[f"{name}_seconds"]
    return row


def main(objects: int = 3, contacts: int = 60, out: Path | None = None) -> None:
    """Run and print one line per joint and the medians.

    Args:
        objects: how many. contacts: points at most.
        out: JSON file for the figures.
    """
    warnings.filterwarnings("ignore")
    rows = []
    for k, name in enumerate(["cabinet_one_door", "chest_of_drawers", "valve"][:objects]):
        truth = make_object(name, 100 + k).truth()
        joint = truth.joints[0]
        found = compare(truth, joint, contacts)
        rows.append({"object": name, "subtype": joint.subtype, **found})
        print({k: round(v, 6) if isinstance(v, float) else v for k, v in rows[-1].items()})
    keys = [k for k in rows[0] if k not in ("object", "subtype")]
    median = {k: float(np.median([r[k] for r in rows])) for k in keys}
    print("median", {k: round(v, 6) for k, v in median.items()})
    save(out, {"rows": rows, "median": median})


if __name__ == "__main__":
    tyro.cli(main)
