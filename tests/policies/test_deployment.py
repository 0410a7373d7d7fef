"""Calibration, perception and limits of a real arm, on what can be known exactly."""

from __future__ import annotations

import os
import select
import termios
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mam_sim_arm.calibration import CalibrationError, View, calibrate
from mam_sim_arm.camera import CameraModel, look_at, pinhole
from mam_sim_arm.held_key import HeldKey
from mam_sim_arm.perception import Perceiver
from mam_sim_arm.poses import board_poses
from mam_sim_arm.recording import solved_mapping
from mam_sim_arm.safety import Box
from mam_sim_arm.setup import guess_mapping
from mam_sim_arm.targets import (
    board_for,
    load_markers,
    save_markers,
    suggest_markers,
)
from scipy.spatial.transform import Rotation

from mam_envs.config import EnvConfig
from mam_envs.robots import robot_spec
from mam_envs.scene.layout import Layout, arrange
from mam_pipeline.errors import ConfigError


def layout_of(asset: Path) -> Layout:
    return arrange(asset, "joint_1", "open", robot_spec("panda"), 1.0, EnvConfig())


def camera_beside(reach: float, forward: float) -> CameraModel:
    """It looks from the left and from above at the middle of an arm's space."""
    at = np.array([np.cos(forward), np.sin(forward)])
    aside = np.array([np.cos(forward + 0.9), np.sin(forward + 0.9)])
    eye, target = np.array([*(1.5 * aside), 0.75]), np.array([*(0.5 * at), 0.45])
    return pinhole("front", (1280, 720), 50.0, look_at(eye * reach, target * reach))


@pytest.mark.parametrize("name", ["panda", "so100"])
def test_signs_zeros_lens_and_place_are_found(name: str) -> None:
    spec, rng = robot_spec(name), np.random.default_rng(0)
    board, nominal = board_for(spec.reach), camera_beside(spec.reach, spec.forward)
    nowhere = Box(np.full((2, 3), 9.0), np.eye(4))
    arms = board_poses(spec, nominal, board, nowhere, 16)
    sign, zero = rng.choice([-1.0, 1.0], len(spec.arm)), rng.normal(0, 0.05, len(spec.arm))
    pose, matrix = nominal.pose.copy(), nominal.matrix.copy()
    pose[:3, 3] += 0.02 * spec.reach
    matrix[[0, 1], [0, 1]] *= 1.02
    true = replace(nominal, pose=pose, matrix=matrix, distortion=np.array([-0.05, 0.02, 0, 0, 0]))
    corners = np.asarray(board.charuco.getChessboardCorners(), dtype=float)
    views = []
    for q in arms:
        rotation, position, _ = spec.chain.forward(q[None])
        hand = np.eye(4)
        hand[:3, :3], hand[:3, 3] = rotation[0], position[0]
        held = hand @ board.mount
        pixels = true.project(corners @ held[:3, :3].T + held[:3, 3])
        motors = (q - zero) * sign
        views.append(View(motors, corners, pixels + rng.normal(0, 0.2, pixels.shape)))
    given = np.ones(len(sign)), np.zeros(len(sign))
    found = calibrate(spec.chain, views, nominal, board.mount, *given)
    np.testing.assert_array_equal(found.sign, sign)
    np.testing.assert_allclose(found.offset[1:-1], zero[1:-1], atol=0.005)
    assert found.camera.residual is not None and found.camera.residual < 0.5
    # where the camera sees the hand is what counts: the first zero and the camera turn together
    inside, told = np.linalg.inv(true.pose), np.linalg.inv(found.camera.pose)
    _, at, _ = spec.chain.forward(arms)
    _, said, _ = spec.chain.forward(arms - zero + found.offset)
    off = (at @ inside[:3, :3].T + inside[:3, 3]) - (said @ told[:3, :3].T + told[:3, 3])
    assert np.linalg.norm(off, axis=1).max() < 0.01 * spec.reach
    with pytest.raises(CalibrationError, match="at least 8"):
        calibrate(spec.chain, views[:7], nominal, board.mount, *given)


def test_a_gripper_s_stops_give_its_range() -> None:
    spec = robot_spec("panda")
    guess = guess_mapping(spec, None, "mam_sim")
    found = calibrate_nothing(spec)
    mapping = solved_mapping(spec, guess, found, {"panda_finger_joint1": (0.05, 0.01)})
    scale, offset = mapping.arrays(["panda_finger_joint1"])
    assert 0.05 * scale[0] + offset[0] == pytest.approx(0.0)  # it counts backwards
    assert 0.01 * scale[0] + offset[0] == pytest.approx(0.04)
    so = guess_mapping(robot_spec("so100"), None, "so101_follower")
    assert {m.unit for m in so.motors} == {"degrees", "percent"} and so.robot == "so101_follower"


def calibrate_nothing(spec):  # type: ignore[no-untyped-def]
    """A calibration that changes nothing."""
    from mam_sim_arm.calibration import Calibration

    n, camera = len(spec.arm), pinhole("front", (64, 48), 50.0, np.eye(4))
    return Calibration(np.ones(n), np.zeros(n), np.zeros(n), camera, np.eye(4))


def test_files_are_read_as_written(drawer: Path, tmp_path: Path) -> None:
    layout = layout_of(drawer)
    markers = suggest_markers(layout.model, "joint_1", layout.handles[0])
    assert [m.link for m in markers] == ["base", "part_1"]
    assert markers[0].pose[2, 3] == pytest.approx(0.4)  # on top of the carcass
    save_markers(markers, tmp_path / "markers.yaml")
    for made, read in zip(markers, load_markers(tmp_path / "markers.yaml", layout.model)):
        assert (made.id, made.link, made.size) == (read.id, read.link, read.size)
        np.testing.assert_allclose(made.pose, read.pose)
    camera = replace(camera_beside(0.8, 0.0), residual=0.3)
    camera.save(tmp_path / "camera.yaml")
    again = CameraModel.load(tmp_path / "camera.yaml")
    np.testing.assert_allclose(again.pose, camera.pose)
    assert again.size == camera.size and again.residual == 0.3
    (tmp_path / "camera.yaml").write_text("camera: front\n")
    with pytest.raises(ConfigError, match="no camera file"):
        CameraModel.load(tmp_path / "camera.yaml")
    with pytest.raises(ConfigError, match="--init"):
        load_markers(tmp_path / "none.yaml", layout.model)


@pytest.mark.parametrize("kind", ["drawer", "door"])
def test_what_corners_say_of_joint_and_handle(kind: str, request: pytest.FixtureRequest) -> None:
    layout = layout_of(request.getfixturevalue(kind))
    model, handle = layout.model, layout.handles[0]
    markers = suggest_markers(model, "joint_1", handle)
    camera = pinhole("front", (1280, 720), 40.0, look_at(np.array([-0.1, 0.5, 1.0]), np.zeros(3)))
    camera = replace(camera, pose=look_at(np.array([-0.4, 0.6, 1.0]), np.array([0.6, 0, 0.3])))
    stands = np.eye(4)
    stands[:3, :3] = Rotation.from_rotvec([0, 0, 0.2]).as_matrix()
    stands[:3, 3] = [0.7, -0.05, 0.0]
    perceiver = Perceiver(camera, markers, model, "joint_1", handle)
    for value in (0.0, 0.1, 0.2):
        motion = stands @ model.motion("joint_1", np.array([value]), {})[0]
        tags = {
            m.id: camera.project(_at(m.corners, place @ m.pose))
            for m, place in zip(markers, (stands, motion))
        }
        perceiver._locate(tags)
        np.testing.assert_allclose(perceiver.poses[-1], stands, atol=2e-3)
        assert perceiver._value(stands, markers[1], tags[1]) == pytest.approx(value, abs=2e-3)


def _at(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def test_a_box_tells_how_deep_a_point_is_in_its_own_frame() -> None:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0, 0, np.pi / 4]).as_matrix()
    pose[:3, 3] = [1.0, 0, 0]
    box = Box(np.array([[-0.5, -0.1, 0], [0.5, 0.1, 1]]), pose)
    inside, aside = np.array([1.3, 0.3, 0.5]), np.array([1.3, -0.3, 0.5])  # along and across it
    np.testing.assert_allclose(box.depth(np.stack([inside, aside])), [0.0757, -0.3243], atol=1e-3)


def test_the_arm_moves_while_a_key_repeats() -> None:
    now = [0.0]
    keyboard, terminal = os.openpty()
    try:
        before = termios.tcgetattr(terminal)
        with HeldKey(terminal, lambda: now[0]) as key:
            assert not key.down()
            os.write(keyboard, b" ")
            _settle(terminal)
            assert key.down()
            now[0] = 0.7
            assert key.down()  # a terminal waits before it repeats
            os.write(keyboard, b"  ")
            _settle(terminal)
            assert key.down()
            now[0] = 0.9
            assert key.down()
            now[0] = 1.0
            assert not key.down()  # let go
            os.write(keyboard, b" ")
            _settle(terminal)
            now[0] = 9.0
            assert key.down()
            now[0] = 9.7
            assert key.down()  # a new press, which has not been repeated yet
        assert termios.tcgetattr(terminal) == before
    finally:
        os.close(keyboard)
        os.close(terminal)
    with open(os.devnull) as nothing, pytest.raises(ConfigError, match="needs a terminal"):
        HeldKey(nothing.fileno())


def _settle(terminal: int) -> None:
    assert select.select([terminal], [], [], 5.0)[0]


def test_what_is_not_seen_is_none_and_a_hand_that_slipped_tells_nothing(drawer: Path) -> None:
    layout = layout_of(drawer)
    markers = suggest_markers(layout.model, "joint_1", layout.handles[0])
    camera = pinhole("front", (1280, 720), 40.0, look_at(np.array([-0.4, 0.6, 1.0]), np.zeros(3)))
    perceiver = Perceiver(camera, markers, layout.model, "joint_1", layout.handles[0])
    ground = np.full((720, 1280, 3), 150, np.uint8)
    assert perceiver.update(ground) is None  # no object, and nothing is made up of it
    perceiver.poses = [np.eye(4)]
    seen = perceiver.update(ground)
    assert seen is not None and (seen.value, seen.handle, seen.source) == (None, None, "unseen")
    hand = np.eye(4)
    hand[:3, 3] = layout.handles[0]
    for width, source in ((0.3, "hand"), (0.6, "unseen"), (0.3, "unseen")):
        if width == 0.3 and source == "hand":
            perceiver.held, perceiver.width = (hand, layout.handles[0]), 0.3
        pulled = hand.copy()
        pulled[0, 3] -= 0.1
        seen = perceiver.update(ground, pulled, width)
        assert seen is not None and seen.source == source
        assert seen.value == (pytest.approx(0.1, abs=1e-3) if source == "hand" else None)
    perceiver.held, perceiver.width = (hand, layout.handles[0]), 0.3
    assert perceiver.update(ground, hand, 0.01).value is None  # type: ignore[union-attr]
    perceiver.held = (hand, layout.handles[0])
    assert perceiver.update(ground, hand, None).value is None  # type: ignore[union-attr]
