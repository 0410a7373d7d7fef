"""Steps per second beside ManiSkill's own tasks in the same run, and a soak of resets and steps.

    python benchmarks/env_speed.py ASSET --steps 600 --resets 1000 --soak-steps 100000

OpenCabinetDrawer needs PartNet models that ManiSkill does not bundle; where they are not installed
the output says so.
"""

from __future__ import annotations

import json
import resource
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import mani_skill.envs  # noqa: F401 - registers PickCube
import numpy as np
import torch
import tyro
from mani_skill.utils.assets.data import DATA_GROUPS, is_data_source_downloaded

import mam_envs
from mam_envs.vulkan import vulkan_ok

MODE = "pd_joint_delta_pos"


def steps_per_second(env: Any, steps: int) -> float:
    """Random steps per second of processor time, resets every 100 steps included."""
    env.reset(seed=0)
    env.action_space.seed(0)
    start = time.process_time()
    for k in range(steps):
        env.step(env.action_space.sample())
        if k % 100 == 99:
            env.reset()
    return steps / (time.process_time() - start)


def soak(env: Any, resets: int, steps: int) -> dict[str, float]:
    """Resets and random steps; looks for NaN, self-opening and growing memory."""
    env.reset(seed=0)
    env.action_space.seed(1)
    bad = opened = 0
    memory = []
    for k in range(resets):
        obs, info = env.reset()
        opened += abs(float(info["open_fraction"][0])) > 0.01
        for _ in range(steps // resets):
            obs, reward, _, _, info = env.step(env.action_space.sample())
            bad += not (bool(torch.isfinite(obs).all()) and bool(torch.isfinite(reward).all()))
            by_itself = float(info["open_fraction"][0]) > 0.75 and not bool(info["by_contact"][0])
            opened += by_itself
        memory.append(_resident())
        if k == resets // 4:
            quarter = memory[-1]
    return {
        "resets": resets,
        "steps": steps,
        "not_finite": bad,
        "opened_by_itself": opened,
        "memory_growth_percent": 100 * (memory[-1] / quarter - 1),
        "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def _resident() -> float:
    """Resident memory of this process, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def main(
    asset: tyro.conf.Positional[Path],
    /,
    steps: int = 600,
    resets: int = 0,
    soak_steps: int = 0,
    rounds: int = 3,
    joint: str | None = None,
) -> None:
    """Measure and print JSON; the best of `rounds` alternating rounds counts."""
    torch.set_num_threads(1)
    rendering = "cpu" if vulkan_ok() else "none"
    makers = {"OperateJoint": lambda: mam_envs.make(asset, joint=joint, control_mode=MODE)}
    if rendering == "cpu":  # PickCube builds render materials even for state observations
        makers["PickCube"] = lambda: gym.make(
            "PickCube-v1", control_mode=MODE, obs_mode="state", render_backend="cpu"
        )
    models = DATA_GROUPS.get("partnet_mobility_cabinet", ())
    cabinets = bool(models) and all(is_data_source_downloaded(m) for m in models)
    if cabinets and rendering == "cpu":
        makers["OpenCabinetDrawer"] = lambda: gym.make(
            "OpenCabinetDrawer-v1", control_mode=MODE, obs_mode="state", render_backend="cpu"
        )
    best: dict[str, float] = {}
    for _ in range(rounds):
        for name, make in makers.items():
            env = make()
            best[name] = max(best.get(name, 0.0), steps_per_second(env, steps))
            env.close()
    out: dict[str, Any] = {"steps_per_second": {k: round(v, 1) for k, v in best.items()}}
    out["ratio"] = {
        name: round(best["OperateJoint"] / speed, 2)
        for name, speed in best.items()
        if name != "OperateJoint"
    }
    if not cabinets:
        out["OpenCabinetDrawer"] = "not measured: its PartNet models are not installed"
    if resets:
        env = mam_envs.make(asset, joint=joint, control_mode=MODE)
        out["soak"] = soak(env, resets, soak_steps or 100 * resets)
        env.close()
    print(json.dumps(out, indent=1, default=lambda v: float(np.asarray(v))))


if __name__ == "__main__":
    tyro.cli(main)
