"""Joints are estimated on the object as it stands in its own frame, and turned back with it.

A box about an object that stands askew is larger, and lengths are measured by it: without this a
turned object would get other joints than the same object not turned.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from mam_pipeline.geometry.frames import ObjectFrame, estimate_frame
from mam_pipeline.types import FloatArray, Joint, JointCandidate, KinematicTree, Mesh

Turnable = TypeVar("Turnable", Joint, JointCandidate)
SLIGHT = np.deg2rad(4.0)  # an object that stands askew by less is left as it is


def straightened(mesh: Mesh) -> tuple[Mesh, ObjectFrame, FloatArray | None]:
    """The mesh turned into the frame of its walls, its frame there, and the (3, 3) rotation.

    One that stands askew by less than `SLIGHT` is returned as it is; its rotation is None.
    """
    frame = estimate_frame(mesh)
    axes = frame.axes
    if np.arccos(np.clip((np.trace(axes) - 1) / 2, -1, 1)) < SLIGHT:
        return mesh, frame, None
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    mesh = mesh.transformed(matrix)
    return mesh, estimate_frame(mesh), np.asarray(axes)


def turned_tree(tree: KinematicTree, rotation: FloatArray) -> KinematicTree:
    """The tree with the candidates of its parts turned about the origin."""
    return KinematicTree(tuple(
        replace(n, candidates=tuple(_turned(c, rotation) for c in n.candidates))
        for n in tree.nodes
    ))  # fmt: skip


def turned_joint(joint: Joint, rotation: FloatArray) -> Joint:
    """The joint turned about the origin, with the hypotheses in its evidence."""
    evidence = dict(joint.evidence)
    if "candidates" in evidence:
        evidence["candidates"] = [
            {**c, **{k: np.round(rotation @ c[k], 5).tolist() for k in ("axis", "origin")}}
            for c in evidence["candidates"]
        ]
    return replace(_turned(joint, rotation), evidence=evidence)


def _turned(one: Turnable, rotation: FloatArray) -> Turnable:
    return replace(one, axis=rotation @ one.axis, origin=rotation @ one.origin)
