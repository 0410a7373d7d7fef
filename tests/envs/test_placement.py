"""Goals, grasps and places: what is asked of a joint, and refusals that say why."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mam_envs.config import EnvConfig, RandomisationConfig, SuccessConfig
from mam_envs.grasping.candidates import PlacementError, card_grasps, tool_path
from mam_envs.grasping.limits import LIMITS
from mam_envs.grasping.surface import surface_grasps
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import _keeps_off
from mam_envs.placement.base import _floor, object_pose, place
from mam_envs.robots import robot_spec
from mam_envs.tasks.operate_joint import joint_goal
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import ConfigError, NotPhysicalError


def model_of(folder: Path, scale: float = 1.0) -> ObjectModel:
    return ObjectModel.load(Asset.load(folder), scale)


def edited(folder: Path, to: Path, **grasp: object) -> Path:
    shutil.copytree(folder, to)
    card = json.loads((to / "asset.json").read_text())
    card["grasps"][0].update(grasp)
    (to / "asset.json").write_text(json.dumps(card))
    return to


def test_goals_follow_the_task(drawer: Path) -> None:
    model = model_of(drawer)
    opening = joint_goal(model, None, None, SuccessConfig())
    assert (opening.task, opening.q_start) == ("open", 0.0)
    assert opening.q_goal == pytest.approx(0.75 * 0.25)
    closing = joint_goal(model, "joint_1", "close", SuccessConfig())
    assert closing.q_start == pytest.approx(0.15) and closing.q_goal == pytest.approx(0.015)
    turning = joint_goal(model, "joint_1", "turn_to", SuccessConfig(value=0.1))
    assert turning.q_goal == pytest.approx(0.1) and turning.tolerance > 0


def test_goals_scale_with_the_object(drawer: Path) -> None:
    small = joint_goal(model_of(drawer, 0.5), None, "open", SuccessConfig())
    assert small.q_goal == pytest.approx(0.5 * 0.75 * 0.25)


def test_unknown_names_are_errors(drawer: Path) -> None:
    with pytest.raises(ConfigError, match="no joint named 'joint_2'; did you mean 'joint_1'"):
        joint_goal(model_of(drawer), "joint_2", None, SuccessConfig())
    with pytest.raises(ConfigError, match="no task named 'opem'; did you mean 'open'"):
        joint_goal(model_of(drawer), None, "opem", SuccessConfig())
    with pytest.raises(ConfigError, match=r"did you mean 'success\.fraction'"):
        EnvConfig.make({"success": {"fractoin": 0.5}})


def test_the_tool_stays_on_the_handle(door: Path) -> None:
    model = model_of(door)
    goal = joint_goal(model, None, "open", SuccessConfig())
    grasp = card_grasps(model, goal, robot_spec("panda"))[0]
    q: Any = np.linspace(0, 1.2, 5)
    path = tool_path(model, goal, grasp, q)
    in_part = np.linalg.inv(model.kinematics.link_poses({"joint_1": q})["part_1"]) @ path
    for pose in in_part:
        np.testing.assert_allclose(pose, in_part[0], atol=1e-9)


@pytest.mark.parametrize(("kind", "most"), [("handle", 180.0), ("rim", LIMITS.board_tilt)])
def test_fingers_pivot_round_a_bar_and_lie_flat_on_a_board(
    door: Path, tmp_path: Path, kind: str, most: float
) -> None:
    model = model_of(edited(door, tmp_path / kind, kind=kind, depth=0.03))
    goal = joint_goal(model, None, "open", SuccessConfig())
    turned = np.degrees(abs(goal.q_goal - goal.q_start))
    behind = [
        (1 - lag) * turned
        for grasp in card_grasps(model, goal, robot_spec("panda"))
        if grasp.card.kind == kind and abs(grasp.tool[2, 0]) > 0.99  # the bar is the hinge's way
        for lag in grasp.lags
    ]
    assert behind and max(behind) <= most
    assert kind == "rim" or max(behind) > LIMITS.board_tilt


def test_a_place_serves_displaced_objects(drawer: Path) -> None:
    model = model_of(drawer)
    goal = joint_goal(model, None, "open", SuccessConfig())
    found = place(model, (goal,), robot_spec("panda"), RandomisationConfig())
    assert found.robust >= 0.75
    np.testing.assert_allclose(found.base[2, :3], [0, 0, 1])
    chain = robot_spec("panda").chain
    _, position, _ = chain.forward(found.path.follow)
    world = position @ found.base[:3, :3].T + found.base[:3, 3]
    wanted = object_pose(model, found.object_height, (0, 0), 0) @ tool_path(
        model, goal, found.path.grasp, found.path.q
    )
    np.testing.assert_allclose(world, wanted[:, :3, 3], atol=0.008)
    assert (found.path.follow >= chain.limits[:, 0]).all()


def test_a_door_does_not_swing_through_the_arm_s_foot(door: Path) -> None:
    model, robot = model_of(door), robot_spec("panda")
    goal = joint_goal(model, None, "open", SuccessConfig())
    found = place(model, (goal,), robot, RandomisationConfig())
    world_asset = object_pose(model, found.object_height, (0, 0), 0)
    assert robot.foot == ("panda_link0", "panda_link1")
    assert _keeps_off(model, goal, robot, found.path, world_asset, {})
    opened = model.motion(goal.joint, found.path.q, {})[7]  # half way
    edge = (world_asset @ opened @ [*found.path.grasp.card.position, 1.0])[:3]
    base = found.base.copy()
    base[:2, 3] = edge[:2]
    path = replace(found.path, base=base)
    assert not _keeps_off(model, goal, robot, path, world_asset, {})


@pytest.mark.parametrize(("board", "stands"), [((0.5, 0.6), 0.0), ((1.0, 1.0), 0.031)])
def test_a_floor_reaches_beyond_what_stands_on_it(
    board: tuple[float, float], stands: float
) -> None:
    def box(w: float, d: float, low: float, high: float) -> SimpleNamespace:
        x, y = w / 2, d / 2
        corners = [(a, b, c) for a in (-x, x) for b in (-y, y) for c in (low, high)]
        return SimpleNamespace(points=np.array(corners))

    pieces = {"base": [box(*board, 0.0, 0.03), box(0.5, 0.6, 0.03, 0.7)]}
    model = SimpleNamespace(pieces=pieces, footprint=(np.zeros(3), np.ones(3)))
    assert _floor(model) == pytest.approx(stands)  # type: ignore[arg-type]


def test_refusals_name_the_reason(drawer: Path, tmp_path: Path) -> None:
    robot = robot_spec("panda")

    def refuse(folder: Path) -> None:
        model = model_of(folder)
        goal = joint_goal(model, None, "open", SuccessConfig())
        place(model, (goal,), robot, RandomisationConfig())

    for name, change, reason in (
        ("wide", {"width": 0.2}, r"20\.0 cm wide; panda opens to 7\.8 cm"),
        ("air", {"position": [-0.2, 0, 4.0]}, "finds nothing of it there"),
    ):
        model = model_of(edited(drawer, tmp_path / name, **change))  # type: ignore[arg-type]
        goal = joint_goal(model, None, "open", SuccessConfig())
        with pytest.raises(PlacementError, match=reason):
            card_grasps(model, goal, robot)
        # the drawer is served all the same: its bar is found on its surface
        assert place(model, (goal,), robot, RandomisationConfig()).robust > 0.0
    heavy = edited(drawer, tmp_path / "heavy")
    card = json.loads((heavy / "asset.json").read_text())
    card["joints"][0]["friction"] = 500.0
    (heavy / "asset.json").write_text(json.dumps(card))
    with pytest.raises(PlacementError, match="too heavy: it needs 500 N"):
        refuse(heavy)
    card["grasps"] = []
    (heavy / "asset.json").write_text(json.dumps(card))
    # no grasp is named: the part's own surface is tried, and is as heavy
    with pytest.raises(PlacementError, match="too heavy: it needs 500 N"):
        refuse(heavy)
    assert issubclass(PlacementError, NotPhysicalError)


def test_a_part_without_named_grasps_is_taken_by_its_surface(drawer: Path, tmp_path: Path) -> None:
    bare = edited(drawer, tmp_path / "bare")
    card = json.loads((bare / "asset.json").read_text())
    card["grasps"] = []
    (bare / "asset.json").write_text(json.dumps(card))
    model, robot = model_of(bare), robot_spec("panda")
    goal = joint_goal(model, "joint_1", "open", SuccessConfig())
    with pytest.raises(PlacementError, match="offers nothing to grasp"):
        card_grasps(model, goal, robot)
    found = surface_grasps(model, goal, robot)
    assert found
    for grasp in found:
        # the bar stands 4 cm in front of the closed drawer: nothing else of it can be got at
        assert grasp.card.position[0] < -0.18
        assert grasp.card.width <= robot.max_width
        np.testing.assert_allclose(np.linalg.det(grasp.tool[:3, :3]), 1.0, atol=1e-9)


def test_depth_agrees_with_the_boxes(drawer: Path) -> None:
    model = model_of(drawer)
    # the middle of the drawer's front board (15 mm), at rest and pulled by 0.1 m
    point = np.array([[-0.18 + 0.0075, 0.0, 0.1], [-0.3, 0.0, 0.5]])
    assert model.depth(point, {})[0] == pytest.approx(0.0075, abs=1e-6)
    assert model.depth(point, {})[1] == -np.inf
    assert model.depth(point, {"joint_1": 0.1})[0] == -np.inf
    assert model.depth(point - [0.1, 0, 0], {"joint_1": 0.1})[0] == pytest.approx(0.0075, abs=1e-6)
