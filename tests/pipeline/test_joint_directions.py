"""Candidate axes that neither walls nor broad contact show: between pins, along the trend."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.joints.context import directions_of, part_context
from mam_pipeline.types import Mesh
from mam_world import make_object


def slab(angle: float, extents: tuple[float, float, float], cuts: int = 0) -> Mesh:
    shape = trimesh.creation.box(extents)
    for _ in range(cuts):
        shape = shape.subdivide(np.arange(len(shape.faces) // 2))  # one half finer than the other
    shape.apply_transform(trimesh.transformations.rotation_matrix(angle, (0, 0, 1)))
    return Mesh(np.array(shape.vertices), np.array(shape.faces))


@pytest.mark.parametrize("cuts", [0, 2])
def test_the_trend_follows_the_surface_and_not_its_triangles(cuts: int) -> None:
    trend = estimate_frame(slab(0.5, (2, 1, 1), cuts)).trend
    assert trend is not None
    assert abs(trend @ [np.cos(0.5), np.sin(0.5), 0]) == pytest.approx(1.0, abs=1e-6)
    assert estimate_frame(slab(0.5, (1, 1, 2), cuts)).trend is None


@pytest.mark.parametrize("kind,seed", [("globe", 1001), ("globe", 1010), ("kettle", 1003)])
def test_the_true_axis_is_among_the_candidates(kind: str, seed: int) -> None:
    truth = make_object(kind, seed).truth()
    frame = estimate_frame(truth.mesh)
    for joint in truth.joints:
        if joint.type in ("fixed", "prismatic"):
            continue
        part = np.flatnonzero(truth.face_link == joint.child)
        static = np.flatnonzero(truth.face_link != joint.child)
        context = part_context(truth.mesh, part, static, frame)
        best = max(abs(float(d @ joint.axis)) for d in directions_of(context))
        assert np.degrees(np.arccos(min(best, 1.0))) < 5.0
