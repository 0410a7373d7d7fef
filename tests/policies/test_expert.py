"""The expert opens box assets, watches the joint, and says why it fails."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import mam_envs
from mam_pipeline.errors import ConfigError
from mam_policies.expert import Expert, run_episode
from mam_policies.expert.compliance import Compliance
from mam_policies.task_words import task_words


@pytest.mark.parametrize("kind", ["drawer", "door"])
def test_it_opens_by_contact(kind: str, request: pytest.FixtureRequest) -> None:
    env = mam_envs.make(request.getfixturevalue(kind), control_mode="pd_joint_pos")
    expert = Expert(env)
    episodes = [run_episode(env, expert, seed=s) for s in (1, 2, 3)]
    assert sum(e.success for e in episodes) >= 2
    best = next(e for e in episodes if e.success)
    assert best.reason == "" and best.open_fraction >= 0.74
    env.close()


def test_contact_is_the_most_of_all_simulation_steps(drawer: Path) -> None:
    env = mam_envs.make(drawer, control_mode="pd_joint_pos")
    base = env.unwrapped
    env.reset(seed=1)
    expert = Expert(env)
    expert.reset()
    links = [base.agent.robot.links_map[n] for n in base.robot_spec.finger_links]  # type: ignore[attr-defined]
    felt: list[float] = []
    after = base._after_simulation_step  # type: ignore[attr-defined]

    def watch() -> None:
        after()
        pairs = [base.scene.get_pairwise_contact_forces(k, base.targets[0]) for k in links]  # type: ignore[attr-defined]
        felt.append(sum(float(p.norm()) for p in pairs))

    base._after_simulation_step = watch  # type: ignore[attr-defined]
    touched = 0
    for _ in range(70):
        felt.clear()
        _, _, _, _, info = env.step(expert.act())
        # each contact point's force counts by itself: at least the force between the bodies
        assert len(felt) == 5 and float(info["contact_force"][0]) >= 0.99 * max(felt)
        touched += max(felt) > 0.1
    assert touched > 10
    env.close()


def test_the_hand_gives_way_across_the_joints_motion_only(drawer: Path) -> None:
    env = mam_envs.make(drawer, control_mode="pd_joint_pos")
    env.reset(seed=4)
    expert = Expert(env)
    expert.reset()
    now, path, config = env.unwrapped.planner_state(), expert.plan.path, expert.config  # type: ignore[attr-defined]
    arm, q = path.follow[0], float(path.q[0])
    turn = now.base[:3, :3]
    axis = now.world_asset[:3, :3] @ np.array([-1.0, 0.0, 0.0])  # in which the drawer opens
    side = np.cross([0.0, 0.0, 1.0], axis)
    along = replace(now, force=40 * axis)
    assert np.array_equal(arm, Compliance(config).target(along, path, arm, q))
    soft = Compliance(config)
    pushed = replace(now, force=25 * side + 40 * axis)
    moved = soft.target(pushed, path, arm, q)
    assert turn @ soft.offset == pytest.approx(config.compliance * (25 - config.bearable) * side)
    hand = now.robot.chain.forward(np.stack([arm, moved]))[1]
    assert hand[1] - hand[0] == pytest.approx(soft.offset, abs=5e-4)
    for _ in range(50):
        soft.target(pushed, path, arm, q)
    assert np.linalg.norm(soft.offset) == pytest.approx(config.most_offset)
    env.close()


def test_two_joints_in_turn(two_drawers: Path) -> None:
    env = mam_envs.make(
        two_drawers, joint=["joint_1", "joint_2"], control_mode="pd_joint_pos",
        max_episode_steps=400,
    )  # fmt: skip
    episode = run_episode(env, Expert(env), seed=0, record=True)
    stages = [int(i["stage"][0]) for i in episode.records["info"]]
    assert episode.success and sorted(set(stages)) == [0, 1] and stages == sorted(stages)
    env.close()


def test_a_button_is_pressed_until_it_latches_and_left(button: Path) -> None:
    env = mam_envs.make(button, task="press", control_mode="pd_joint_pos")
    base: Any = env.unwrapped
    goal = base.layout(0).goals[0]
    env.reset(seed=0)
    base.object.set_qpos(torch.tensor([[0.9 * goal.q_goal]]))  # let go too early
    hold = np.append(base.planner_state().arm, base.robot_spec.shut)
    for _ in range(20):
        _, _, _, _, info = env.step(hold)
    assert float(base.joint_value()[0]) < 0.1 * goal.q_goal and not info["latched"][0]
    expert = Expert(env)
    episode = run_episode(env, expert, seed=0, record=True)
    seen = [(bool(i["latched"][0]), float(i["contact_force"][0])) for i in episode.records["info"]]
    assert episode.success and episode.records["phase"][-1] == "retreat"
    assert all(force < 0.1 for _, force in seen[-5:]) and not seen[0][0] and seen[-1][0]
    for _ in range(20):  # its spring holds it in
        env.step(expert.act())
    assert float(base.joint_value()[0]) == pytest.approx(goal.q_goal, rel=0.1)
    env.close()


def test_a_cube_is_taken_out_of_a_drawer(tray: Path) -> None:
    env = mam_envs.make(tray, task="take_out", control_mode="pd_joint_pos")
    base: Any = env.unwrapped
    assert task_words(base) == "take the cube out of the drawer"
    starts = []
    for seed in (2, 3, 2):
        _, info = env.reset(seed=seed)
        assert info["inside"][0] and not info["success"][0] and info["progress"][0] < 0.05
        starts.append(base.loose.matrix())
    assert (starts[0] == starts[2]).all() and np.abs(starts[0] - starts[1]).max() > 1e-3
    episodes = [run_episode(env, Expert(env), seed=s, record=True) for s in (2, 3, 4)]
    assert sum(e.success for e in episodes) >= 2
    done = next(e for e in episodes if e.success)
    last = done.records["info"][-1]
    assert not last["inside"][0] and float(last["thing_force"][0]) > 0.1
    assert float(done.records["reward"][-1][0]) > float(done.records["reward"][0][0])
    assert list(dict.fromkeys(done.records["phase"]))[-2:] == ["lift", "hold"]
    env.close()


def test_a_closed_drawer_is_opened_before_a_cube_is_taken_out(tray: Path) -> None:
    env = mam_envs.make(
        tray, task="take_out", control_mode="pd_joint_pos", success={"start": 0.0},
        max_episode_steps=400,
    )  # fmt: skip
    episodes = [run_episode(env, Expert(env), seed=s, record=True) for s in (0, 1)]
    assert all(e.success for e in episodes)
    phases = list(dict.fromkeys(episodes[0].records["phase"]))
    assert "follow" in phases and phases[-2:] == ["lift", "hold"]
    env.close()


def test_a_cube_is_put_into_a_drawer_that_is_closed_then(tray: Path) -> None:
    env = mam_envs.make(tray, task="put_in", control_mode="pd_joint_pos", max_episode_steps=400)
    base: Any = env.unwrapped
    assert task_words(base) == "put the cube into and close the drawer"
    _, info = env.reset(seed=0)
    assert not info["inside"][0] and base.loose.matrix()[2, 3] == pytest.approx(0.02, abs=1e-3)
    episodes = [run_episode(env, Expert(env), seed=s, record=True) for s in (0, 1, 2)]
    assert sum(e.success for e in episodes) >= 2
    done = next(e for e in episodes if e.success)
    assert done.records["info"][-1]["inside"][0] and done.open_fraction < 0.1
    phases = list(dict.fromkeys(done.records["phase"]))
    assert phases.index("lift") < phases.index("lower") < phases.index("follow")
    env.close()


def test_it_closes_and_takes_delta_actions(drawer: Path) -> None:
    env = mam_envs.make(drawer, task="close", control_mode="pd_joint_delta_pos")
    episode = run_episode(env, Expert(env), seed=0, record=True)
    assert episode.success and episode.open_fraction < 0.1
    actions = np.stack(episode.records["action"])
    assert actions.shape[1] == 8 and np.abs(actions).max() <= 1.0
    env.close()


def test_plans_keep_limits_and_speeds(drawer: Path) -> None:
    env = mam_envs.make(drawer, control_mode="pd_joint_pos")
    env.reset(seed=4)
    expert = Expert(env)
    expert.reset()
    plan, robot = expert.plan, env.unwrapped.robot_spec  # type: ignore[attr-defined]
    assert list(dict.fromkeys(plan.phase)) == ["move", "approach", "close", "follow", "settle"]
    limits = robot.chain.limits
    assert (plan.arm >= limits[:, 0] - 1e-6).all() and (plan.arm <= limits[:, 1] + 1e-6).all()
    assert np.abs(np.diff(plan.arm, axis=0)).max() <= 1.3 * robot.step
    assert len(plan) == len(plan.gripper) == len(plan.expected)
    env.close()


def test_a_stuck_joint_is_reported(drawer: Path) -> None:
    env = mam_envs.make(drawer, control_mode="pd_joint_pos")
    expert = Expert(env, attempts=1)
    env.reset(seed=0)
    expert.reset()
    joint = env.unwrapped.objects[0].active_joints[0]._objs[0]  # type: ignore[attr-defined]
    joint.set_drive_properties(1e6, 1e4)  # somebody holds the drawer shut
    info = {}
    while expert.phase != "done":
        _, _, _, truncated, info = env.step(expert.act())
        if bool(truncated[0]):
            break
    assert not bool(info["success"][0])
    assert "slipped" in expert.reason or "stopped" in expert.reason or "contact" in expert.reason
    env.close()


def test_it_refuses_control_modes_without_joint_targets(drawer: Path) -> None:
    env = mam_envs.make(drawer, control_mode="pd_joint_vel")
    with pytest.raises(ConfigError, match="pd_joint_pos or pd_joint_delta_pos"):
        Expert(env)
    env.close()
