"""The shared types: arrays are read-only, motions are rigid, trees are trees."""

from __future__ import annotations

import numpy as np
import pytest

from mam_pipeline.types import (
    Articulation,
    Joint,
    KinematicTree,
    Link,
    Mesh,
    PartNode,
    joint_motion,
)

TRIANGLES = Mesh(np.eye(4, 3), [[0, 1, 2], [1, 2, 3]])  # type: ignore[arg-type]


def test_arrays_are_read_only_and_checked() -> None:
    with pytest.raises(ValueError, match="read-only"):
        TRIANGLES.vertices[0] = 1
    with pytest.raises(ValueError, match="expected shape"):
        Mesh(np.zeros((4, 2)), [[0, 1, 2]])  # type: ignore[arg-type]


def test_submesh_keeps_only_used_vertices() -> None:
    one = TRIANGLES.submesh(np.array([False, True]))
    assert len(one.vertices) == 3
    np.testing.assert_allclose(one.vertices[one.faces[0]], TRIANGLES.vertices[[1, 2, 3]])


def test_revolute_motion_keeps_the_axis_and_turns_right_handed() -> None:
    axis, origin = np.array([0.0, 0, 1]), np.array([1.0, 2, 0])
    motion = joint_motion("revolute", axis, origin, np.pi / 2)
    np.testing.assert_allclose(motion @ [1, 2, 5, 1], [1, 2, 5, 1], atol=1e-12)
    np.testing.assert_allclose(motion @ [2, 2, 0, 1], [1, 3, 0, 1], atol=1e-12)


def test_forward_kinematics_of_a_chain() -> None:
    z = np.array([0.0, 0, 1])
    links = tuple(Link(n, n, np.zeros(0, int)) for n in "abc")
    joints = (
        Joint("ab", "revolute", "hinge", 0, 1, z, np.zeros(3), 0, 1),
        Joint("bc", "prismatic", "slide", 1, 2, np.array([1.0, 0, 0]), np.zeros(3), 0, 1),
    )
    poses = Articulation(TRIANGLES, links, joints).link_poses({"ab": np.pi / 2, "bc": 0.5})
    np.testing.assert_allclose(poses[2] @ [0, 0, 0, 1], [0, 0.5, 0, 1], atol=1e-12)


def test_a_tree_needs_a_base_and_valid_parents() -> None:
    with pytest.raises(ValueError, match="base"):
        KinematicTree((PartNode("a", "body", (), 0, "fixed"),))
    with pytest.raises(ValueError, match="no valid parent"):
        KinematicTree(
            (PartNode("a", "body", (), -1, "fixed"), PartNode("b", "door", (), 1, "hinge"))
        )
