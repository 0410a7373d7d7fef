"""Frames per second of an environment with a camera, in one process and in several at once.

    python benchmarks/camera_speed.py ASSET [--processes 1 8 16] [--seconds 20] [--size 128]

Random actions, one picture a control step, a reset without a seed every 50 steps; the renderer is
the one that ManiSkill finds (the GPU where there is one, else Mesa's software renderer). The last
rows: one process with everything randomised that cameras see, and state observations alone.
"""

from __future__ import annotations

import multiprocessing
import time
from pathlib import Path

import torch
import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline import config_file
from mam_sim.preset_files import presets

LOOKS = (
    "light", "light_colour", "light_turn", "camera", "camera_turn", "fov", "colour", "scenery",
    "backgrounds", "noise", "blur",
)  # fmt: skip
"""Randomisation that only cameras see."""


def steps_per_second(job: tuple[str, float, int, bool]) -> float:
    """Of one process; size 0: without pictures; then whether pictures are randomised."""
    import mam_envs

    asset, seconds, size, varied = job
    torch.set_num_threads(1)
    world = {"cameras": {"front": {"width": size, "height": size}}} if size else {}
    more = {"obs_mode": "rgb+state", "scene": world} if size else {"obs_mode": "state"}
    if varied:
        chance = config_file.read(presets()["randomised"])["env"]["randomisation"]
        more["randomisation"] = {k: v for k, v in chance.items() if k in LOOKS}
    env = mam_envs.make(asset, control_mode="pd_joint_delta_pos", **more)
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(5):
        env.step(env.action_space.sample())
    steps, started = 0, time.time()
    while time.time() - started < seconds:
        env.step(env.action_space.sample())
        steps += 1
        if steps % 50 == 0:
            env.reset()
    rate = steps / (time.time() - started)
    env.close()
    return rate


def main(
    asset: Positional[Path],
    /,
    processes: tuple[int, ...] = (1, 2),
    seconds: float = 20.0,
    size: int = 128,
    out: Path | None = None,
) -> None:
    """Print frames per second for each number of processes.

    Args:
        asset: asset folder. processes: how many at once. seconds: of each measurement.
        size: pixels along each side.
        out: JSON file for the figures.
    """
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else "no GPU"
    print(f"{asset}, {gpu}, {size} x {size}")
    rows = []
    context = multiprocessing.get_context("spawn")
    jobs = [*((n, size, False) for n in processes), (1, size, True), (1, 0, False)]
    for count, side, varied in jobs:
        with context.Pool(count) as pool:
            rates = pool.map(steps_per_second, [(str(asset), seconds, side, varied)] * count, 1)
        row = {"processes": count, "size": side, "randomised": varied, "rate": sum(rates)}
        rows.append({**row, "gpu": gpu})
        what = "frames" if side else "steps, state only,"
        what = f"randomised {what}" if varied else what
        print(f"{count:3d} processes: {sum(rates):8.1f} {what} a second", flush=True)
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
