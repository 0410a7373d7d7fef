"""Frames per second of an environment with a camera, in one process and in several at once.

    python benchmarks/camera_speed.py ASSET [--processes 1 8 16] [--seconds 20] [--size 128]

Random actions, one picture a control step; the renderer is the one that ManiSkill finds (the GPU
where there is one, else Mesa's software renderer). State observations alone are the last row.
"""

from __future__ import annotations

import multiprocessing
import time
from pathlib import Path

import torch
import tyro
from common import save
from tyro.conf import Positional


def steps_per_second(job: tuple[str, float, int]) -> float:
    """Of one process; size 0: without pictures."""
    import mam_envs

    asset, seconds, size = job
    torch.set_num_threads(1)
    world = {"cameras": {"front": {"width": size, "height": size}}} if size else {}
    more = {"obs_mode": "rgb+state", "world": world} if size else {"obs_mode": "state"}
    env = mam_envs.make(asset, control_mode="pd_joint_delta_pos", **more)
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(5):
        env.step(env.action_space.sample())
    steps, started = 0, time.time()
    while time.time() - started < seconds:
        env.step(env.action_space.sample())
        steps += 1
        if steps % 100 == 0:
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
    for count, side in [*((n, size) for n in processes), (1, 0)]:
        with context.Pool(count) as pool:
            rates = pool.map(steps_per_second, [(str(asset), seconds, side)] * count, 1)
        rows.append({"processes": count, "size": side, "rate": sum(rates), "gpu": gpu})
        what = "frames" if side else "steps, state only,"
        print(f"{count:3d} processes: {sum(rates):8.1f} {what} a second", flush=True)
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
