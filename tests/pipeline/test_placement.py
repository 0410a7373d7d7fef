"""Up, unit and front: what is stated, then the shape, then the usual size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import ConfigError
from mam_pipeline.formats.mesh_files import load_mesh
from mam_pipeline.formats.placement import choose_unit
from mam_pipeline.geometry.front import front_of, moved
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import Source, turned_to_front
from mam_pipeline.types import Articulation, Joint, Link, Mesh
from mam_world.dataset import write_dataset
from mam_world.object import make_object


@pytest.mark.parametrize(
    ("size", "suffix", "stated", "usual", "unit"),
    [
        (223.0, ".dae", 0.0254, None, 0.0254),  # a truck of 5.66 m is believed
        (180.0, ".stl", None, None, 0.001), (35.0, ".stl", None, None, 0.001),
        (1.2, ".stl", None, None, 1.0), (900.0, ".obj", None, None, 0.001),
        (180.0, ".obj", None, 1.7, 0.01),  # a refrigerator of 180 units
        (70.0, ".obj", None, 1.8, 0.0254), (9e5, ".glb", 1.0, None, 0.7 / 9e5),
    ],
)  # fmt: skip
def test_a_stated_unit_is_believed_else_format_and_usual_size_decide(
    size: float, suffix: str, stated: float | None, usual: float | None, unit: float
) -> None:
    extent = np.array([size / 2, size / 3, size])
    sizes = None if usual is None else (usual / 2, usual, usual * 2)
    found, _, decision = choose_unit(extent, stated, None, None, suffix, sizes)
    assert found == pytest.approx(unit)
    assert decision.about == "unit" and 0.0 < decision.confidence <= 1.0


def test_a_size_that_no_such_thing_has_is_doubted_aloud() -> None:
    extent = np.array([150.0, 80.0, 90.0]) / 1000
    _, _, decision = choose_unit(extent / 5, 1.0, None, None, ".glb", (1.0, 2.0, 3.0))
    assert decision.confidence < 0.7 and "usually 2 m; --height" in decision.runner_up
    _, _, sure = choose_unit(extent, 1.0, None, None, ".glb", (0.1, 0.2, 0.3))
    assert sure.confidence > 0.9 and not sure.runner_up


@pytest.mark.parametrize(
    ("size", "sizes", "longest"),
    [
        (1750.0, (0.5, 1.75, 2.2), 1.75),  # millimetres
        (60.0, (0.3, 0.7, 1.0), 0.6),  # centimetres
        (20.0, (0.25, 0.5, 0.9), 0.508),  # inches
        (7.2, (0.25, 0.5, 0.9), 0.5),  # no unit explains it
        (2.3, (0.5, 1.75, 2.2), 2.3),  # a little large is believed
        (0.2, (3.0, 4.5, 6.0), 0.2),  # a toy stays one
    ],
)  # fmt: skip
def test_no_thing_is_larger_than_all_of_its_kind(
    size: float, sizes: tuple[float, float, float], longest: float
) -> None:
    extent = np.array([size / 2, size / 3, size])
    unit, why, decision = choose_unit(extent, 1.0, None, None, ".glb", sizes)
    assert size * unit == pytest.approx(longest)
    assert ("no such thing" in why) == (longest != size)
    assert longest == size or "--scale 1" in decision.runner_up


def test_generated_files_are_as_gltf_has_it(tmp_path: Path) -> None:
    """Up, unit and front of the world's own files come back as they are."""
    write_dataset("wardrobe", 2, 0, tmp_path, textures=False, plain=True)
    for file in sorted(tmp_path.glob("*/static.glb")):
        got = load_mesh(file)
        card = Asset.load(file.parent).card
        made = make_object("wardrobe", card_seed(file)).articulation
        engine_T_asset = got.source_to_asset @ np.linalg.inv(card.source_to_asset)
        assert np.allclose(engine_T_asset[:3, :3] @ [0, 0, 1], [0, 0, 1], atol=1e-6)
        found = front_of(moved(made, engine_T_asset), (0, -1, 0))
        front = found.yaw[:3, :3] @ engine_T_asset[:3, :3] @ [-1, 0, 0]
        assert np.allclose(front, [-1, 0, 0], atol=0.05) and found.confidence > 0.8


def card_seed(file: Path) -> int:
    return int(file.parent.name.rpartition("_")[2])


def _car() -> Articulation:
    """A box on four wheels that stands along Y, metres."""
    boxes = [trimesh.creation.box(extents=[0.8, 2.0, 0.5])]
    boxes[0].apply_translation([0, 0, 0.5])
    joints, links, start = [], [Link("body", "body", np.arange(12))], 12
    for k, (x, y) in enumerate([(-0.4, -0.7), (0.4, -0.7), (-0.4, 0.7), (0.4, 0.7)]):
        wheel = trimesh.creation.cylinder(0.2, 0.1, sections=8)
        wheel.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
        wheel.apply_translation([x, y, 0.2])
        boxes.append(wheel)
        links.append(Link(f"w{k}", "wheel", np.arange(start, start + len(wheel.faces))))
        start += len(wheel.faces)
        joints.append(Joint(
            f"j{k}", "continuous", "spin", 0, k + 1, np.array([1.0, 0, 0]), np.array([x, y, 0.2]),
            -np.inf, np.inf,
        ))  # fmt: skip
    whole: Any = trimesh.util.concatenate(boxes)
    return Articulation(Mesh(whole.vertices, whole.faces), tuple(links), tuple(joints))


def test_a_car_looks_along_its_track_to_the_side_that_the_format_has_in_front() -> None:
    found = front_of(_car(), (0, -1, 0))
    assert np.allclose(found.yaw[:3, :3] @ [0, -1, 0], [-1, 0, 0], atol=1e-6)
    assert found.runner_up  # the other end is as likely by shape
    across = front_of(_car(), (-1, 0, 0))
    assert np.allclose(np.abs(across.yaw[:3, :3] @ [0, 1, 0]), [1, 0, 0], atol=1e-6)
    turned = front_of(moved(_car(), np.diag([1.0, 1, 1, 1])[[1, 0, 2, 3]] * [[1], [-1], [1], [1]]),
                      (0, -1, 0))  # fmt: skip
    assert np.allclose(turned.yaw[:3, :3] @ [1, 0, 0], [-1, 0, 0], atol=1e-6)


def _two(fixed: list[float], at: list[float], part: Any, **joint: Any) -> Articulation:
    """A body and one part that turns; `joint` as in `Joint`, metres."""
    body = trimesh.creation.box(extents=fixed)
    body.apply_translation(at)
    whole: Any = trimesh.util.concatenate([body, part])
    links = (Link("body", "body", np.arange(12)), Link("p", "lid", np.arange(12, len(whole.faces))))
    made = Joint("j", parent=0, child=1, **{"type": "revolute", "subtype": "hinge", **joint})
    return Articulation(Mesh(whole.vertices, whole.faces), links, (made,))


def _lid(angle: float) -> Any:
    """A plate of 0.3 m that lies on a body's top, from its back edge, opened by some degrees."""
    plate = trimesh.creation.box(extents=[0.4, 0.3, 0.01])
    plate.apply_translation([0, 0.15, 0.005])
    turn = trimesh.transformations.rotation_matrix(np.radians(angle), [1, 0, 0])
    plate.apply_transform(turn)
    plate.apply_translation([0, -0.15, 0.02])
    return plate


@pytest.mark.parametrize("angle, closed", [(0, 0), (110, -110), (110, -40)])
def test_a_lids_front_is_opposite_to_its_line_however_far_it_is_open(
    angle: float, closed: float
) -> None:
    found = front_of(_two(
        [0.4, 0.3, 0.02], [0, 0, 0.01], _lid(angle), axis=np.array([1.0, 0, 0]),
        origin=np.array([0, -0.15, 0.02]), lower=np.radians(min(closed, 0)), upper=1.5,
        closed=np.radians(closed), open=1.5,
    ), (0, -1, 0))  # fmt: skip
    assert np.allclose(found.yaw[:3, :3] @ [0, 1, 0], [-1, 0, 0], atol=1e-6)
    assert found.confidence > 0.8


def test_an_upright_flap_that_drops_shows_the_front() -> None:
    door = trimesh.creation.box(extents=[0.5, 0.02, 0.4])
    door.apply_translation([0, 0.26, 0.25])
    found = front_of(_two(
        [0.5, 0.5, 0.5], [0, 0, 0.25], door, axis=np.array([-1.0, 0, 0]),
        origin=np.array([0, 0.25, 0.05]), lower=0.0, upper=1.5, closed=0.0, open=1.5,
    ), (0, -1, 0))  # fmt: skip
    assert np.allclose(found.yaw[:3, :3] @ [0, 1, 0], [-1, 0, 0], atol=1e-6)


def test_a_tap_does_not_say_where_the_front_of_a_basin_is() -> None:
    tap = trimesh.creation.box(extents=[0.04, 0.2, 0.02])
    tap.apply_translation([0, 0.2, 1.1])
    post = trimesh.creation.box(extents=[0.04, 0.04, 0.15])
    post.apply_translation([0, 0.3, 1.02])
    found = front_of(_two(
        [1.0, 0.7, 0.95], [0, 0, 0.475], trimesh.util.concatenate([tap, post]),
        axis=np.array([0, 0, 1.0]), origin=np.array([0, 0.3, 1.0]), lower=0.0, upper=1.5,
        closed=0.0, open=1.5,
    ), (0, -1, 0))  # fmt: skip
    assert np.allclose(found.yaw[:3, :3] @ [0, -1, 0], [-1, 0, 0], atol=1e-6)
    assert found.confidence < 0.7


def test_knobs_above_the_floor_make_no_vehicle() -> None:
    car = _car()
    raised = car.mesh.vertices.copy()
    body = np.unique(car.mesh.faces[car.links[0].faces])
    raised[body, 2] = np.where(raised[body, 2] < 0.5, 0.0, raised[body, 2])  # down to the floor
    wheels = np.setdiff1d(np.arange(len(raised)), body)
    raised[wheels, 2] += 0.1
    found = front_of(replace(car, mesh=replace(car.mesh, vertices=raised)), (1, 0, 0))
    assert "vehicle" not in found.why
    assert np.allclose(found.yaw[:3, :3] @ [1, 0, 0], [-1, 0, 0], atol=1e-6)


def test_the_user_says_the_front_in_the_files_axes() -> None:
    car = _car()
    turn = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # of a Y-up file
    read = Source("mesh", car.mesh, turn, 1.0, "stated")
    yaw, decisions = turned_to_front(car, read, MakeConfig(facing="-z"))
    assert np.allclose(yaw[:3, :3] @ turn[:3, :3] @ [0, 0, -1], [-1, 0, 0], atol=1e-6)
    assert decisions[-1].chosen == "-z of the file" and decisions[-1].why == "said by you"
    with pytest.raises(ConfigError, match="level axis"):
        turned_to_front(car, read, MakeConfig(facing="y"))
