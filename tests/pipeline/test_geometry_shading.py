"""Normals for shading: a box is sharp, a cylinder round with sharp ends, a flat face its own."""

from __future__ import annotations

import numpy as np
import trimesh

from mam_pipeline.geometry.shading import corner_normals
from mam_pipeline.types import Mesh


def test_a_box_has_the_normals_of_its_faces() -> None:
    box = trimesh.creation.box()
    found = corner_normals(Mesh(box.vertices, box.faces))
    np.testing.assert_allclose(found, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-12)


def test_a_cylinder_is_round_and_its_ends_are_flat() -> None:
    tube = trimesh.creation.cylinder(1.0, 2.0, sections=48)
    found = corner_normals(Mesh(tube.vertices, tube.faces))
    flat = np.abs(tube.face_normals[:, 2]) > 0.5
    np.testing.assert_allclose(np.abs(found[flat][..., 2]), 1.0, atol=1e-12)
    corners = tube.vertices[tube.faces[~flat]]
    outward = corners * [1, 1, 0]
    assert np.einsum("fki,fki->fk", found[~flat], outward).min() > 0.995


def test_a_face_without_area_has_no_normal() -> None:
    found = corner_normals(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))
    assert not found.any()
