"""Tasks without a simulator: what is asked, seen and rewarded; names and settings of others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import torch

from mam_envs.config import EnvConfig, RewardConfig, SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.tasks import OtherTaskError, TaskState, rewards, task_class
from mam_envs.tasks.carry import PutIn, TakeOut
from mam_envs.tasks.operate_joint import OperateJoint
from mam_envs.tasks.press_button import PressButton, PressReward
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import ConfigError, NotPhysicalError

CPU = torch.device("cpu")


@dataclass(frozen=True)
class KeepSuccess(SuccessConfig):
    """One setting more."""

    keep_steps: int = 5


@dataclass(frozen=True)
class KeepReward(RewardConfig):
    """One term more."""

    keep: float = 0.5


def state(q: float, speed: float = 0.0, force: float = 0.0, away: float = 0.0) -> TaskState:
    """One sub-scene, one joint; the tool stands `away` metres from the handle."""
    tool = torch.tensor([[away, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    return TaskState(
        q=torch.tensor([[q]]), speed=torch.tensor([[speed]]), force=torch.tensor([force]),
        part_force=torch.tensor([force]), link_force=torch.tensor([force]),
        handle=torch.zeros(1, 1, 3), tool=tool, action_rate=torch.zeros(1),
    )  # fmt: skip


def task_on(asset: Path, config: EnvConfig | None = None) -> OperateJoint:
    chosen = config or EnvConfig()
    goal = OperateJoint.goal("open", ObjectModel.load(Asset.load(asset)), None, chosen.success)
    task = OperateJoint([[goal]], chosen, CPU)
    task.reset(torch.tensor([0]), torch.zeros(1, 1))
    return task


def test_opening_by_contact_is_success_and_pays(drawer: Path) -> None:
    task = task_on(drawer)  # asks for 0.75 of 0.25 m
    for q in (0.05, 0.1, 0.15, 0.2):
        now = state(q, force=5.0)
        task.update(now)
        info = task.evaluate(now)
    assert bool(info["success"][0]) and float(info["progress"][0]) == pytest.approx(0.2 / 0.1875)
    terms = rewards.scaled(task.reward_terms(now, info), RewardConfig())
    assert float(sum(terms.values())) == pytest.approx(1.0 + 0.5 + 3.0 + 2.0)
    assert rewards.largest(RewardConfig()) == pytest.approx(6.5)


def test_reaching_pays_by_distance_until_the_joint_has_moved(drawer: Path) -> None:
    task = task_on(drawer)
    near, far = state(0.0, away=0.02), state(0.0, away=0.5)
    paid = [float(task.reward_terms(s, task.evaluate(s))["reach"]) for s in (near, far)]
    assert paid[0] == pytest.approx(1 - 0.0997, abs=1e-3) and paid[1] < 0.02
    task.update(state(0.1, force=5.0))
    moved = state(0.1, away=0.5)
    assert float(task.reward_terms(moved, task.evaluate(moved))["reach"]) == 1.0


def test_observations_are_named_and_complete(drawer: Path) -> None:
    task = task_on(drawer)
    now = state(0.1, speed=0.2, away=0.3)
    seen = task.observe(now, task.evaluate(now))
    assert float(seen["joint_value"]) == pytest.approx(0.1)
    assert float(seen["joint_goal"]) == pytest.approx(0.1875)
    torch.testing.assert_close(seen["tcp_to_handle"], torch.tensor([[-0.3, 0.0, 0.0]]))


def test_a_start_is_drawn_within_the_range(drawer: Path) -> None:
    goal = task_on(drawer).goals[0][0]
    assert OperateJoint.start(goal, None) == 0.0
    assert OperateJoint.start(goal, 0.4) == pytest.approx(0.1)


def test_terms_and_scales_must_fit() -> None:
    one = torch.ones(1)
    with pytest.raises(ConfigError, match="no scale for the reward term 'keep'"):
        rewards.scaled({"keep": one}, RewardConfig())
    with pytest.raises(ConfigError, match="no reward term 'reach'; set its scale to 0"):
        rewards.scaled({"keep": one}, KeepReward())
    off = KeepReward(**dict.fromkeys(vars(RewardConfig()), 0.0))
    assert float(rewards.scaled({"keep": one}, off)["keep"]) == 0.5


def test_settings_of_a_task_are_filled_from_a_mapping_and_from_plain_settings() -> None:
    base = EnvConfig(success=KeepSuccess(), reward=KeepReward())
    made = EnvConfig.make({"success": {"keep_steps": 9}, "reward": {"keep": 2}}, base)
    assert made.success == KeepSuccess(keep_steps=9) and made.reward == KeepReward(keep=2.0)
    plain = EnvConfig(success=SuccessConfig(fraction=0.5))
    assert EnvConfig.make(plain, base).success == KeepSuccess(fraction=0.5)
    with pytest.raises(ConfigError, match=r"did you mean 'success\.keep_steps'"):
        EnvConfig.make({"success": {"keep_step": 9}}, base)
    with pytest.raises(ConfigError, match="keep_steps"):
        EnvConfig.make({"success": {"keep_steps": 9}})  # not a setting of the default task


class Other(OperateJoint):
    """A task of its own kind."""


def test_names_stand_for_classes_and_sequences_are_of_one_class(monkeypatch: Any) -> None:
    import mam_envs.tasks as tasks

    entry = metadata.EntryPoint("other", f"{__name__}:Other", "mam_sim.task")
    monkeypatch.setattr("mam_pipeline.registry.installed", lambda group: [entry])
    monkeypatch.setattr("mam_pipeline.registry.resolve", _resolve_here)
    assert task_class([None]) is OperateJoint is task_class(["open", "close"])
    assert task_class(["other"]) is Other
    with pytest.raises(ConfigError, match="open, other cannot follow each other"):
        task_class(["open", "other"])
    with pytest.raises(ConfigError, match="no task named 'opem'; did you mean 'open'"):
        task_class(["opem"])
    assert set(tasks.TASKS.targets()) == {
        "open", "close", "turn_to", "push", "press", "take_out", "put_in", "other",
    }  # fmt: skip


def test_a_button_is_pressed_when_it_has_latched_and_was_left(button: Path, drawer: Path) -> None:
    settings = PressButton.defaults()
    model = ObjectModel.load(Asset.load(button))
    goal = PressButton.goal("press", model, None, settings.success)
    task = PressButton([[goal]], settings, CPU)
    task.reset(torch.tensor([0]), torch.zeros(1, 1))

    def step(q: float, force: float) -> dict[str, torch.Tensor]:
        now = state(q, force=force)
        task.update(now)
        info = task.evaluate(now)
        terms = rewards.scaled(task.reward_terms(now, info), settings.reward)
        return {**info, "paid": torch.stack(list(terms.values())).sum(dim=0)}

    def out() -> bool:
        return float(task.spring_targets()[0, 0]) == 0.0

    assert not step(0.5 * goal.q_goal, 3.0)["latched"] and out()
    assert not step(0.0, 0.0)["latched"]  # it came out again
    for _ in range(10):  # long after the touch, it falls in by itself
        step(0.0, 0.0)
    assert not step(1.1 * goal.q_goal, 0.0)["latched"]
    task.reset(torch.tensor([0]), torch.zeros(1, 1))
    held = step(1.1 * goal.q_goal, 3.0)
    assert held["latched"] and not held["success"] and not out()
    free = [step(goal.q_goal, 0.0) for _ in range(5)]
    assert [bool(f["success"]) for f in free] == [False] * 4 + [True]
    assert float(free[0]["paid"]) > float(held["paid"])  # letting go pays
    assert float(free[-1]["paid"]) == pytest.approx(rewards.largest(PressReward()))
    assert not step(0.1 * goal.q_goal, 0.0)["success"]  # pulled out, it is not pressed
    with pytest.raises(OtherTaskError, match=r"joint_1.* is no button"):
        other = ObjectModel.load(Asset.load(drawer))
        PressButton.goal("press", other, None, settings.success)


def test_a_cube_is_taken_out_when_it_rests_outside_and_was_touched(
    tray: Path, drawer: Path, door: Path
) -> None:
    settings = TakeOut.defaults()
    model = ObjectModel.load(Asset.load(tray))
    goal = TakeOut.goal("take_out", model, None, settings.success)
    thing = goal.thing
    assert thing is not None and goal.q_start == pytest.approx(0.8 * goal.open)
    bottom = 0.015 + 0.006 + 0.012
    assert thing.low[2] == pytest.approx(bottom, abs=1e-6)  # the drawer's floor
    task = TakeOut([[goal]], settings, CPU)
    task.reset(torch.tensor([0]), torch.full((1, 1), goal.q_start))

    def step(x: float, z: float, speed: float = 0.0, force: float = 0.0) -> dict[str, torch.Tensor]:
        pose = torch.tensor([[x, 0.0, z, 1.0, 0.0, 0.0, 0.0]])
        now = replace(
            state(goal.q_start), thing=pose, inside=pose[:, :3],
            thing_speed=torch.tensor([speed]), thing_force=torch.tensor([force]),
        )  # fmt: skip
        task.update(now)
        info = task.evaluate(now)
        terms = rewards.scaled(task.reward_terms(now, info), settings.reward)
        return {**info, "paid": torch.stack(list(terms.values())).sum(dim=0)}

    x, _, z = thing.places[0]
    above, beside = thing.high[2] + 0.05, thing.low[0] - 0.2
    lying = step(x, z)
    assert lying["inside"] and float(lying["progress"]) == pytest.approx(0.0, abs=0.05)
    assert not any(bool(step(beside, z)["success"]) for _ in range(20))  # by itself it is none
    lifted = step(x, 0.5 * (z + thing.high[2]), speed=0.2, force=3.0)
    assert 0.3 < float(lifted["progress"]) < 0.7 and float(lifted["paid"]) > float(lying["paid"])
    for at in ((x, above), (beside, z)):  # held above it, or put beside it
        assert not step(*at, speed=0.2, force=3.0)["success"]
        rested = [bool(step(*at, force=3.0)["success"]) for _ in range(10)]
        assert rested == [False] * 9 + [True]
    assert not step(x, z)["success"]  # it fell back in
    with pytest.raises(NotPhysicalError, match=r"joint_1.* has no free space inside for a cube"):
        other = ObjectModel.load(Asset.load(drawer))  # whose drawer has no walls
        TakeOut.goal("take_out", other, None, settings.success)
    with pytest.raises(OtherTaskError, match=r"joint_1.* is no drawer"):
        TakeOut.goal("take_out", ObjectModel.load(Asset.load(door)), None, settings.success)


def test_a_cube_is_put_in_when_it_lies_in_the_closed_drawer(tray: Path) -> None:
    settings = PutIn.defaults()
    goal = PutIn.goal("put_in", ObjectModel.load(Asset.load(tray)), None, settings.success)
    thing = goal.thing
    assert thing is not None and goal.q_start == pytest.approx(0.8 * goal.open)
    assert goal.closing and goal.reached_into == goal.q_start
    task = PutIn([[goal]], settings, CPU)

    def step(q: float, x: float, force: float = 0.0, touched: float = 0.0) -> Any:
        pose = torch.tensor([[x, 0.0, thing.places[0][2], 1.0, 0.0, 0.0, 0.0]])
        now = replace(
            state(q, force=force), thing=pose, inside=pose[:, :3],
            thing_speed=torch.zeros(1), thing_force=torch.tensor([touched]),
        )  # fmt: skip
        task.update(now)
        info = task.evaluate(now)
        terms = rewards.scaled(task.reward_terms(now, info), settings.reward)
        return {**info, "paid": torch.stack(list(terms.values())).sum(dim=0)}

    def begin() -> None:
        task.reset(torch.tensor([0]), torch.full((1, 1), goal.q_start))

    x, beside, half = thing.places[0][0], thing.low[0] - 0.4, 0.5 * (goal.q_start + goal.q_goal)
    begin()
    lying = step(goal.q_start, beside)
    assert not lying["inside"] and float(lying["progress"]) == pytest.approx(0.0)
    held = step(goal.q_start, beside + 0.2, touched=3.0)
    laid = step(goal.q_start, x)
    assert float(lying["paid"]) < float(held["paid"]) < float(laid["paid"])
    assert float(laid["progress"]) == pytest.approx(0.5) and not laid["success"]
    assert float(step(half, x, force=3.0)["paid"]) > float(laid["paid"])
    done = [bool(step(goal.q_goal, x, force=3.0)["success"]) for _ in range(10)]
    assert done[-1] and not done[0]
    begin()  # closed without it
    assert not any(bool(step(q, beside, 3.0, 3.0)["success"]) for q in (half, *[goal.q_goal] * 20))
    begin()  # it fell in by itself
    assert not any(bool(step(q, x, 3.0)["success"]) for q in (half, *[goal.q_goal] * 20))


def _resolve_here(target: str, what: str) -> Any:
    return Other if target.endswith(":Other") else OperateJoint


def test_goals_say_whether_the_part_may_be_pushed_shut(drawer: Path) -> None:
    model = ObjectModel.load(Asset.load(drawer))
    for name, closing in (("open", False), ("close", True)):
        assert OperateJoint.goal(name, model, None, SuccessConfig()).closing is closing
    goal = OperateJoint.goal("open", model, None, SuccessConfig())
    assert replace(goal, q_goal=0.1).direction == 1.0 and goal.range == pytest.approx(0.25)


def test_joints_as_numbers(door: Path, drawer: Path) -> None:
    import numpy as np

    from mam_envs.articulations import Articulations
    from mam_envs.grasping.candidates import upright
    from mam_envs.robots.panda import PANDA
    from mam_envs.scene.layout import Layout

    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    layouts = []
    for asset in (door, drawer):
        model = ObjectModel.load(Asset.load(asset))
        goal = OperateJoint.goal("open", model, None, SuccessConfig())
        hold = upright(PANDA, model.grasps(goal.joint)[0])
        held = np.array(hold.card.position)
        # neither base nor arm matter here
        layouts.append(Layout(model, (goal,), None, PANDA, (held,), (hold,)))  # type: ignore[arg-type]
    poses = torch.zeros(2, 1, 7)
    poses[..., 3] = 1.0
    for i, item in enumerate(layouts):
        link = item.model.kinematics.joint(item.goals[0].joint).child
        poses[i, 0, :3] = torch.tensor(item.model.kinematics.link_poses({})[link][0][:3, 3])
    base = torch.tensor([[-0.6, 0.2, 0.1, *quarter]] * 2, dtype=torch.float32)
    tool = torch.tensor([[-0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]] * 2)
    arm = torch.ones(2, 7)
    seen = Articulations(layouts, layouts, CPU).observe(base, poses, tool, arm)
    assert (seen["posture_grasp"] == -1.0).all()  # none was looked for
    # the base's x axis is the world's y axis
    close = partial(torch.testing.assert_close, atol=1e-6, rtol=0)
    close(seen["joint_axis"], torch.tensor([[[0, 0, -1.0]], [[0, 1.0, 0]]]))
    for i, item in enumerate(layouts):
        world = item.grasps[0].tool[:3, 3]
        close(seen["grasp_offset"][i, 0], torch.tensor(world - [-0.5, 0.0, 0.3]).float())
        away = world - np.array([-0.6, 0.2, 0.1])
        inside = torch.tensor([away[1], -away[0], away[2]]).float()
        close(seen["grasp_position"][i, 0], inside)
        directions = item.grasps[0].tool[:3, [2, 1]].T.reshape(-1)
        close(seen["grasp_turn"][i, 0], torch.tensor(directions).float())
    lever = seen["joint_lever"]
    assert lever[0, 0].norm() > 0.2 and lever[0, 0, 2].abs() < 1e-6
    assert lever[1].abs().sum() == 0 and seen["joint_slides"].tolist() == [[0], [1]]
    assert seen["joint_way"][0, 0] == pytest.approx(0.75 * np.pi / 2)
