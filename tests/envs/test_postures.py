"""The arm's postures at the marks of a motion are near those that the expert goes through."""

from __future__ import annotations

from pathlib import Path

import numpy as np

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
            marks = dict(zip(MARKS, (path.approach[0], path.follow[0], None, path.follow[-1])))
            for name, posture in marks.items():
                left = obs[0, rows[f"extra/privileged/posture_{name}"]].numpy()
                if posture is not None:
                    found = left + base.planner_state().arm
                    np.testing.assert_allclose(found, posture, atol=0.1)
        env.close()
    assert compared >= 2
