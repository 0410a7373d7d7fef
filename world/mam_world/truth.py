"""Generated objects as ground truth for measuring and fitting."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from mam_pipeline.geometry.front import moved
from mam_world.ground_truth import GroundTruth
from mam_world.object import make_object


def generated_truth(category: str, seed: int) -> GroundTruth:
    """A generated object as ground truth: its file's surface, turned by a quarter turn or none."""
    made = make_object(category, seed)
    turn = np.eye(4)
    quarter = zlib.crc32(made.name.encode()) % 4
    c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
    turn[:2, :2] = [[c, -s], [s, c]]
    truth = moved(made.truth(), turn)
    mesh = replace(truth.mesh, face_group=None, group_names=("mesh",))
    order = np.random.default_rng(quarter).permutation(len(mesh.faces))
    assert mesh.face_material is not None
    mesh = replace(mesh, faces=mesh.faces[order], face_material=mesh.face_material[order])
    label = truth.face_link[order]
    links = tuple(
        replace(link, faces=np.flatnonzero(label == i)) for i, link in enumerate(truth.links)
    )
    return GroundTruth(made.name, category, mesh, label, links, truth.joints)
