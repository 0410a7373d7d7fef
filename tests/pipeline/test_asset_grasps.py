"""Grasps lie on handles, knobs and free edges, with approach from outside and room for fingers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.grasps import find_grasps
from mam_pipeline.asset.handles import find_handles
from mam_pipeline.types import Articulation, Joint, Link, Mesh

X, Y, Z = np.eye(3)


def assemble(
    base: list[trimesh.Trimesh], part: list[trimesh.Trimesh], joint: Joint, kind: str
) -> Articulation:
    whole: Any = trimesh.util.concatenate([*base, *part])
    count = sum(len(s.faces) for s in base)
    links = (
        Link("base", "body", np.arange(count)),
        Link("part", kind, np.arange(count, len(whole.faces))),
    )
    return Articulation(Mesh(whole.vertices, whole.faces), links, (joint,))


def box(low: list[float], high: list[float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def door(handle: bool) -> Articulation:
    """A door in the plane x = 0 before a block, hinged at y = -0.3, handle near y = 0.25."""
    part = [box([-0.02, -0.3, 0], [0, 0.3, 0.8])]
    if handle:
        part += [
            box([-0.04, 0.24, 0.35], [-0.02, 0.25, 0.36]),
            box([-0.04, 0.24, 0.44], [-0.02, 0.25, 0.45]),
        ]
        part += [box([-0.05, 0.24, 0.34], [-0.04, 0.25, 0.46])]
    joint = Joint("j", "revolute", "hinge", 0, 1, Z, np.array([0, -0.3, 0.4]), 0, 1.5, 0, 1.5)
    return assemble([box([0.001, -0.29, 0], [0.4, 0.29, 0.8])], part, joint, "door")


def test_a_bar_handle_is_taken_across_from_the_front() -> None:
    grasp = find_grasps(door(True))[0]
    assert grasp.kind == "handle" and grasp.confidence > 0.8
    np.testing.assert_allclose(grasp.approach, X, atol=0.05)
    assert abs(grasp.closing @ Y) > 0.95
    assert grasp.position == pytest.approx([-0.045, 0.245, 0.4], abs=0.012)
    assert grasp.width == pytest.approx(0.014, abs=0.004)
    assert 0.0 <= grasp.depth < 0.03


def test_handle_faces_are_those_of_the_bar_and_its_posts() -> None:
    made = door(True)
    (handle,) = find_handles(made, made.joints[0])
    assert len(handle.faces) == 36


def test_a_bare_door_is_taken_at_its_free_edge() -> None:
    made = door(False)
    assert find_handles(made, made.joints[0]) == []
    grasps = [g for g in find_grasps(made) if g.kind == "edge"]
    assert grasps[0].position[1] > 0.27
    assert abs(grasps[0].closing @ X) > 0.95
    assert grasps[0].approach @ Y < -0.95


def test_a_knob_that_spins_is_taken_from_its_front() -> None:
    knob = trimesh.creation.cylinder(0.02, sections=32, segment=[[-0.03, 0, 0.5], [-0.001, 0, 0.5]])
    joint = Joint("j", "continuous", "spin", 0, 1, X, np.array([0, 0, 0.5]), -np.inf, np.inf)
    made = assemble([box([0, -0.3, 0], [0.4, 0.3, 1.0])], [knob], joint, "knob")
    grasp = find_grasps(made)[0]
    assert grasp.kind == "knob"
    np.testing.assert_allclose(grasp.approach, X, atol=1e-6)
    assert grasp.width == pytest.approx(0.044, abs=0.003)
    assert grasp.position[1:] == pytest.approx([0, 0.5], abs=0.003)


def test_a_button_is_pushed() -> None:
    joint = Joint("j", "prismatic", "slide", 0, 1, X, np.zeros(3), 0, 0.01, 0, 0.01)
    button = box([-0.02, -0.02, 0.48], [-0.001, 0.02, 0.52])
    made = assemble([box([0.012, -0.3, 0], [0.4, 0.3, 1.0])], [button], joint, "button")
    grasp = find_grasps(made)[0]
    assert grasp.kind == "push"
    np.testing.assert_allclose(grasp.approach, X, atol=1e-6)
    assert grasp.position[0] == pytest.approx(-0.02, abs=0.002)


def test_directions_are_unit_and_perpendicular() -> None:
    for made in (door(True), door(False)):
        for grasp in find_grasps(made):
            assert np.linalg.norm(grasp.approach) == pytest.approx(1.0)
            assert np.linalg.norm(grasp.closing) == pytest.approx(1.0)
            assert grasp.approach @ grasp.closing == pytest.approx(0.0, abs=1e-6)
