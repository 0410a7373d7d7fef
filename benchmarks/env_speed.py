"""Steps per second beside ManiSkill's own tasks in the same run, and a soak of resets and steps.

    python benchmarks/env_speed.py ASSET --steps 600 --resets 1000 --soak-steps 100000 --workers 10

OpenCabinetDrawer needs PartNet models that ManiSkill does not bundle; where they are not installed
its code runs on the asset itself (which then needs a drawer), and the output says so.
"""

from __future__ import annotations

import json
import re
import resource
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import mani_skill.envs  # noqa: F401 - registers PickCube
import numpy as np
import torch
import tyro
from common import save
from mani_skill.utils.assets.data import DATA_GROUPS, is_data_source_downloaded
from mani_skill.utils.registration import REGISTERED_ENVS

import mam_envs
from mam_envs.scene.vulkan import vulkan_ok
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import MamSimError

MODE = "pd_joint_delta_pos"
FETCH = "OperateJoint, fetch"


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


def scaling(asset: Path, joint: str | None, workers: int, steps: int) -> dict[str, float]:
    """Random steps a second by the clock in one process and in `workers`, and their ratio: the best
    of three rounds each, by turns."""
    best = {1: 0.0, workers: 0.0}
    for count in (1, workers) * 3:
        env = gym.make_vec(
            "mam_envs:OperateJointNumpy-v1", num_envs=count, vectorization_mode="async",
            asset=str(asset), joint=joint, control_mode=MODE,
        )  # fmt: skip
        env.reset(seed=0)
        env.action_space.seed(0)
        start = time.monotonic()
        for _ in range(steps):
            env.step(env.action_space.sample())
        best[count] = max(best[count], count * steps / (time.monotonic() - start))
        env.close()
    return {**{f"{n} processes": v for n, v in best.items()}, "ratio": best[workers] / best[1]}


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


def lend_cabinet(asset: Path, scratch: Path) -> bool:
    """Let ManiSkill's OpenCabinetDrawer load `asset` instead of a PartNet model; False if it has no
    drawer. All visuals are called handles, since the task looks for one by name."""
    from mani_skill.envs.tasks.mobile_manipulation import open_cabinet_drawer as task

    card = Asset.load(asset).card
    if not any(j.type == "prismatic" for j in card.joints):
        return False
    folder = scratch / "cabinet"
    shutil.copytree(asset, folder)
    urdf = folder / card.urdf
    text = re.sub(r'<visual( name="[^"]*")?', '<visual name="handle"', urdf.read_text("utf-8"))
    urdf.write_text(text, encoding="utf-8")

    def builder(scene: Any, _: str) -> Any:
        loader = scene.create_urdf_loader()
        loader.fix_root_link = True
        return loader.parse(str(urdf))["articulation_builders"][0]

    task.articulations.get_articulation_builder = builder
    REGISTERED_ENVS["OpenCabinetDrawer-v1"].asset_download_ids = []  # nothing is to be fetched
    return True


def main(
    asset: tyro.conf.Positional[Path],
    /,
    steps: int = 600,
    resets: int = 0,
    soak_steps: int = 0,
    workers: int = 0,
    rounds: int = 3,
    joint: str | None = None,
    out: Path | None = None,
) -> None:
    """Measure and print JSON (also to `out`); the best of `rounds` alternating rounds counts."""
    torch.set_num_threads(1)
    rendering = "cpu" if vulkan_ok() else "none"
    makers = {"OperateJoint": lambda: mam_envs.make(asset, joint=joint, control_mode=MODE)}
    if rendering == "cpu":  # PickCube builds render materials even for state observations
        makers["PickCube"] = lambda: gym.make(
            "PickCube-v1", control_mode=MODE, obs_mode="state", render_backend="cpu"
        )
    models = DATA_GROUPS.get("partnet_mobility_cabinet", ())
    cabinets = bool(models) and all(is_data_source_downloaded(m) for m in models)
    scratch = tempfile.TemporaryDirectory()
    lent = not cabinets and rendering == "cpu" and lend_cabinet(asset, Path(scratch.name))
    if rendering == "cpu" and (cabinets or lent):
        makers["OpenCabinetDrawer"] = lambda: gym.make(
            "OpenCabinetDrawer-v1", control_mode=MODE, obs_mode="state", render_backend="cpu"
        )
        makers[FETCH] = lambda: mam_envs.make(
            asset, joint=joint, control_mode=MODE, robot_uids="fetch"
        )
    best: dict[str, float] = {}
    failed: dict[str, str] = {}
    for _ in range(rounds):
        for name, make in makers.items():
            try:
                env = make()
            except MamSimError as error:
                failed[name] = str(error)
                continue
            best[name] = max(best.get(name, 0.0), steps_per_second(env, steps))
            env.close()
    found: dict[str, Any] = {"steps_per_second": {k: round(v, 1) for k, v in best.items()}}
    found["ratio"] = {
        name: round(best["OperateJoint"] / speed, 2)
        for name, speed in best.items()
        if not name.startswith("OperateJoint")
    }
    if FETCH in best:
        both = best[FETCH] / best["OpenCabinetDrawer"]
        found["ratio"]["OpenCabinetDrawer, both with fetch"] = round(both, 2)
    found["not_run"] = failed
    if lent:
        found["OpenCabinetDrawer"] = "its PartNet models are not installed: run on this asset"
    elif "OpenCabinetDrawer" not in makers:
        found["OpenCabinetDrawer"] = "not measured: no PartNet models, no drawer in the asset"
    if resets:
        env = mam_envs.make(asset, joint=joint, control_mode=MODE)
        found["soak"] = soak(env, resets, soak_steps or 100 * resets)
        env.close()
    if workers:
        found["workers"] = scaling(asset, joint, workers, steps // 3)
    scratch.cleanup()
    save(out, found)
    print(json.dumps(found, indent=1, default=lambda v: float(np.asarray(v))))


if __name__ == "__main__":
    tyro.cli(main)
