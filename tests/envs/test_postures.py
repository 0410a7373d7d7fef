"""The arm's postures at the marks of a motion are near those that the expert goes through."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

import mam_envs
from mam_envs.postures import MARKS
from mam_policies.expert import Expert

SEEN = {"articulation": True}


def test_postures_are_near_the_expert_s(drawer: Path, door: Path) -> None:
    compared = 0
    for asset in (drawer, door):
        env = mam_envs.make(asset, observation=SEEN, control_mode="pd_joint_pos")
        base = env.unwrapped
        rows = {n: slice(a, b) for n, a, b, _ in base.observation_layout()}
        for seed in (0, 1):
            obs, _ = env.reset(seed=seed)
            expert = Expert(env)
            expert.reset()
            path, meant = expert.plan.path, base.layout(0).placement.path.grasp
            if path.grasp.lag != meant.lag or not np.allclose(path.grasp.tool, meant.tool):
                continue  # from here it takes hold elsewhere
            compared += 1
            last = len(path.follow) - 1
            way = [path.follow[round(k * last / 4)] for k in range(5)]
            for name, posture in zip(MARKS, [path.approach[0], *way], strict=True):
                left = obs[0, rows[f"extra/privileged/posture_{name}"]].numpy()
                found = left + base.planner_state().arm
                np.testing.assert_allclose(found, posture, atol=0.05)
        env.close()
    assert compared >= 2


def test_a_clone_with_marks_weighs_the_ways_to_them() -> None:
    from mam_policies.mlp import MlpPolicy

    policy = MlpPolicy(6, 3, 2, chunk=2, hidden=(4,), timed=False, marks=(2, 4))
    last = policy.net[-1]
    assert isinstance(last, torch.nn.Linear)
    with torch.no_grad():
        last.weight.zero_()
        last.bias.copy_(torch.tensor([7, 0.1, 0.5] * 2))  # the gripper, then two weights
    policy.scale.copy_(torch.tensor([0.2, 0.3, 1.0]))
    told = policy.actions(torch.tensor([[3.0, -3.0, 4.0, -2.0, 1.0, 0.0]]), torch.zeros(1))
    torch.testing.assert_close(told, torch.tensor([[[3.9, -3.2, 7.0]] * 2]))
