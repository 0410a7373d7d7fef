"""What an exported policy bears: latency, noise, calibration error, and where the camera sits.

    python benchmarks/deployment.py RUN --episodes 24 --out FILE

Each episode has another start and another calibration. The policy runs on motor values through the
same conversion as in LeRobot.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
import tyro
from common import save

from mam_policies.evaluate import HELD_OUT
from mam_policies.lerobot.export import deployment
from mam_policies.lerobot.policy import Converter
from mam_policies.lerobot.robot_interface import Faults, RobotInterface, mapping_of
from mam_policies.mlp import MlpPolicy
from mam_policies.run import RunInfo, few_objects
from mam_policies.wilson import wilson

CASES = {
    "exported policy in motor units": Faults(),
    "2 control steps of latency": Faults(latency=2),
    "0.01 rad joint noise, 0.01 m handle noise": Faults(joint_noise=0.01, handle_noise=0.01),
    "0.02 rad calibration error, fixed camera": Faults(calibration=0.02),
    "0.02 rad calibration error, camera on the hand": Faults(calibration=0.02, eye_in_hand=True),
    "0.05 rad calibration error, camera on the hand": Faults(calibration=0.05, eye_in_hand=True),
}


def measure(run: Path, faults: Faults, episodes: int) -> dict[str, Any]:
    """Successes of one case."""
    info = RunInfo.load(run)
    interface = RobotInterface(info.env, faults=faults)
    base = interface.env.unwrapped
    converter = Converter(deployment(base, info, mapping_of(base, None)), MlpPolicy.load(run))
    good = 0
    with few_objects():
        for k in range(episodes):
            interface.miscalibrate(k)
            state = interface.reset(HELD_OUT + k)
            converter.reset()
            while not (interface.outcome.success or interface.outcome.truncated):
                state = interface.step(converter.act(state[None].astype(float))[0])
            good += interface.outcome.success
    interface.close()
    low, high = wilson(good, episodes)
    return {**asdict(faults), "successes": good, "episodes": episodes, "low": low, "high": high}


def main(run: tyro.conf.Positional[Path], /, episodes: int = 24, out: Path | None = None) -> None:
    """Measure every case and print a table."""
    torch.set_num_threads(1)
    rows = {}
    print("| | successes |\n|---|---|")
    for name, faults in CASES.items():
        row = rows[name] = measure(run, faults, episodes)
        interval = f"[{100 * row['low']:.0f}, {100 * row['high']:.0f}]"
        print(f"| {name} | {row['successes']}/{episodes} {interval} |", flush=True)
        save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
