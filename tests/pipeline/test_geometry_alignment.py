"""An axis that lies beside edges and faces is told from one that runs along them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mam_pipeline.geometry.alignment import askew
from mam_pipeline.geometry.hinge_line import HingeBodies
from mam_pipeline.types import FloatArray, IntArray, Mesh

Y, Z = np.eye(3)[1], np.eye(3)[2]
TURNED = Rotation.from_euler("zyx", [24.0, 9.0, -5.0], degrees=True).as_matrix()


def joined(*solids: trimesh.Trimesh) -> tuple[Mesh, list[IntArray]]:
    """One mesh and the faces of each solid."""
    starts = np.cumsum([0, *(len(s.vertices) for s in solids)])
    faces = np.concatenate([s.faces + k for s, k in zip(solids, starts)])
    label = np.repeat(np.arange(len(solids)), [len(s.faces) for s in solids])
    vertices = np.concatenate([s.vertices for s in solids])
    return Mesh(vertices, faces), [np.flatnonzero(label == i) for i in range(len(solids))]


def panel() -> trimesh.Trimesh:
    return trimesh.creation.box([0.02, 0.4, 0.7])


def knob() -> trimesh.Trimesh:
    return trimesh.creation.cylinder(0.03, 0.02, sections=48)


def tilted(axis: FloatArray, degrees: float, about: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(np.radians(degrees) * about).as_matrix() @ axis)


@pytest.mark.parametrize("solid", [panel, knob])
@pytest.mark.parametrize("turn", [np.eye(3), TURNED], ids=["as built", "turned"])
def test_a_tilt_is_measured_about_any_direction(
    solid: Callable[[], trimesh.Trimesh], turn: FloatArray
) -> None:
    mesh, bodies = joined(solid())
    mesh = mesh.transformed(
        np.block([[turn, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    )
    for about in (np.eye(3)[0], Y):
        for degrees in (0.0, 2.0, 5.0):
            found = askew(mesh, bodies, turn @ tilted(Z, degrees, about))
            assert np.degrees(found) == pytest.approx(degrees, abs=0.1)


def test_either_body_vouches_for_an_axis() -> None:
    wedge = trimesh.creation.box([0.3, 0.3, 0.01])
    wedge.apply_transform(trimesh.transformations.rotation_matrix(np.radians(5.0), [1, 0, 0]))
    mesh, (rotor, mast) = joined(wedge, trimesh.creation.box([0.1, 0.1, 1.0]))
    assert np.degrees(askew(mesh, [rotor], Z)) == pytest.approx(5.0, abs=0.1)
    assert askew(mesh, [rotor, mast], Z) == 0.0


def test_a_ball_tells_nothing() -> None:
    mesh, bodies = joined(trimesh.creation.icosphere(3, 0.2))
    assert askew(mesh, bodies, tilted(Z, 5.0, Y)) == 0.0


def test_a_stray_face_tells_nothing() -> None:
    ball = trimesh.creation.icosphere(3, 0.2)
    patch = trimesh.Trimesh([[0, 0, 0.5], [0.2, 0, 0.5], [0, 0.2, 0.5]], [[0, 1, 2]])
    mesh, (faces, one) = joined(ball, patch)
    assert askew(mesh, [np.concatenate([faces, one])], tilted(Z, 5.0, Y)) == 0.0


def test_a_body_without_a_shape_tells_nothing() -> None:
    mesh, (rotor,) = joined(trimesh.creation.box([0.1, 0.1, 1.0]))
    nothing = np.empty(0, np.int64)
    speck = Mesh(1e-9 * np.eye(3), np.array([[0, 1, 2]]))
    assert askew(mesh, [nothing], Z) == 0.0 and askew(speck, [np.array([0])], Z) == 0.0
    assert askew(mesh, [rotor, nothing], Z) == 0.0


def test_a_wheel_turns_about_its_middle() -> None:
    spokes = [
        trimesh.creation.box(bounds=[[0, -0.01, 0], [0.2, 0.01, 0.02]]).apply_transform(
            trimesh.transformations.rotation_matrix(k * 2 * np.pi / 3, [0, 0, 1])
        )
        for k in range(3)
    ]
    mesh, parts = joined(*spokes, trimesh.creation.box(bounds=[[-0.5, -0.5, -0.1], [0.5, 0.5, 0]]))
    bodies = HingeBodies(mesh, np.concatenate(parts[:3]), parts[3])
    shift = 0.05 * mesh.diagonal
    for endless in (True, False):
        assert bodies.off_centre(Z, np.zeros(3), endless) == 0.0
        found = bodies.off_centre(Z, np.array([shift, 0, 0]), endless)
        assert found == pytest.approx(0.05, abs=0.003)
    far = np.array([1.0, 0, 0])  # a carousel: the wheel as a whole swings about a distant post
    assert bodies.off_centre(Z, far, False) == 0.0 < bodies.off_centre(Z, far, True)


def test_a_door_has_no_middle_to_turn_about() -> None:
    mesh, (door, post) = joined(
        panel(), trimesh.creation.box(bounds=[[0, -0.3, 0], [0.1, -0.2, 1]])
    )
    assert HingeBodies(mesh, door, post).off_centre(Z, np.array([0, -0.2, 0]), True) == 0.0
