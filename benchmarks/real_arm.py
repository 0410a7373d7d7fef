"""A policy on the simulated robot with a real one's faults, with and without calibration.

    python benchmarks/real_arm.py RUN --setup FOLDER --draws 5 --episodes 4 --out FILE

Each draw has another zero of every motor and another place, turn and lens of the camera; all have
noise and latency. `as meant` takes mapping and camera as the set-up says; `calibrated` goes through
`mam-sim calibrate` first. Both perceive the handle by tags, as `mam-sim deploy` does.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from common import load, save
from mam_sim_arm.pilot import calibrate_setup, open_pilot, plan_space
from mam_sim_arm.robot_file import open_robot
from mam_sim_arm.setup import ROBOT, Twin, guess_mapping, write_setup

from mam_pipeline.errors import MamSimError
from mam_policies.evaluate import HELD_OUT
from mam_policies.run import few_objects
from mam_policies.wilson import wilson

LEVELS = {
    "motors 0.05 rad, camera 2 cm": (0.05, 0.02),
    "none": (0.0, 0.0),
    "motors 0.02 rad, camera 1 cm": (0.02, 0.01),
    "motors 0.1 rad, camera 4 cm": (0.1, 0.04),
}
ALWAYS = {"joint_noise": 0.001, "latency_steps": 1}


def measure(
    run: Path, setup: Path, faults: dict[str, Any], episodes: int, nominal: bool
) -> tuple[int, list[str]]:
    """Successes in truth, and why episodes were stopped."""
    stopped: list[str] = []
    twin, log = Twin.load(run), setup / "episodes.jsonl"
    log.unlink(missing_ok=True)
    path = twin.layout.placement.path
    with few_objects(), open_pilot(run, setup, nominal=nominal, **faults) as pilot:
        for k in range(episodes):
            if k:
                pilot.arm.begin()
            try:
                seen = pilot.find()
                plan_space(pilot, twin, seen, np.concatenate([path.approach, path.follow]))
                with pilot.arm.moving():
                    found = pilot.run(seen, 200)
                stopped += [found.stopped] if found.stopped else []
            except MamSimError as error:
                stopped.append(str(error))
    rows = log.read_text().splitlines() if log.is_file() else []
    good = sum(json.loads(line)["success"] for line in rows)
    return good, stopped


def main(
    run: tyro.conf.Positional[Path], /, setup: Path, draws: int = 5, episodes: int = 4,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Measure every level and print a table."""
    torch.set_num_threads(1)
    twin, rows = Twin.load(run), load(out) or {}
    write_setup(twin, setup)
    guess = guess_mapping(twin.spec, None, "mam_sim")
    for name, (motors, camera) in LEVELS.items():
        row = rows.setdefault(name, {"draws": []})
        for draw in range(len(row["draws"]), draws):
            faults = {
                **ALWAYS, "seed": HELD_OUT + 100 * draw, "calibration_error": motors,
                "camera_error": camera,
            }  # fmt: skip
            asked = {**faults, "board": True, "max_steps": 100_000}
            found = calibrate_setup(
                twin, setup, open_robot(setup / ROBOT, **asked), guess, speed=1.0
            )
            result: dict[str, Any] = {"residual_px": found.camera.residual}
            for kind, nominal in (("as meant", True), ("calibrated", False)):
                good, stopped = measure(run, setup, faults, episodes, nominal)
                result[kind] = {"successes": good, "stopped": stopped}
            row["draws"].append(result)
            save(out, rows)
            print(name, draw, result, flush=True)
        for kind in ("as meant", "calibrated"):
            good = sum(d[kind]["successes"] for d in row["draws"])
            count = episodes * len(row["draws"])
            low, high = wilson(good, count)
            row[kind] = {"successes": good, "episodes": count, "low": low, "high": high}
        save(out, rows)
    print("| faults | as meant | calibrated |\n|---|---|---|")
    for name, row in rows.items():
        cells = [
            f"{r['successes']}/{r['episodes']} [{100 * r['low']:.0f}, {100 * r['high']:.0f}]"
            for r in (row["as meant"], row["calibrated"])
        ]
        print(f"| {name} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    tyro.cli(main)
