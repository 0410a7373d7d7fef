"""Open-loop replay as in the paper: the best trajectory, sent to the robot without feedback.

The best demonstration is the shortest success. It is written as a LeRobot dataset in motor units,
so that lerobot-replay sends it to a real arm, and is measured here on the simulated robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_policies.collection import Names, Track
from mam_policies.demonstrations import Demonstration, is_noisy, load, seed_of
from mam_policies.lerobot.dataset import write_dataset
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_policies.lerobot.policy import PERCEIVED
from mam_policies.lerobot.robot_interface import Faults, Outcome, RobotInterface
from mam_policies.run import EnvChoice, RunInfo
from mam_policies.wilson import wilson


@dataclass(frozen=True)
class Trajectory:
    """States (T, n) and targets (T, m) of one success in motor units, and its seed."""

    seed: int
    states: NDArray[np.float32]
    targets: NDArray[np.float32]


@dataclass(frozen=True)
class Replayed:
    """Successes of open-loop replays with their Wilson 95 % interval."""

    episodes: int
    successes: int
    low: float
    high: float
    each: tuple[Outcome, ...]


def best_demonstration(run: Path) -> tuple[RunInfo, int, Demonstration]:
    """The shortest success without noise among a run's demonstrations, with its seed.

    Raises:
        InputError: the run keeps no demonstrations of absolute targets.
    """
    info = RunInfo.load(run)
    best: tuple[int, Demonstration] | None = None
    for file in sorted((run / "demos").glob("[0-9]*.npz")):
        number = int(file.stem)
        found = load(file)
        if isinstance(found, str) or is_noisy(number):
            continue
        if best is None or len(found.obs) < len(best[1].obs):
            best = (seed_of(int(info.config.get("seed", 0)), number), found)
    if best is None or info.env.control_mode != "pd_joint_pos":
        raise InputError(f"{run} keeps no demonstrations to replay; train it with --algo bc")
    return info, *best


def best_trajectory(run: Path, interface: RobotInterface) -> Trajectory:
    """Run the best demonstration from its own start, and keep what was sent and read.

    Raises:
        InputError: see best_demonstration; or the demonstration no longer succeeds, because the
            asset or the environment has changed since.
    """
    _, seed, demo = best_demonstration(run)
    spec = interface.spec
    arm = len(spec.arm)
    low, high = spec.grip
    gripper = low + (np.clip(demo.actions[:, arm].astype(float), -1, 1) + 1) / 2 * (high - low)
    sim = np.concatenate([demo.actions[:, :arm], gripper[:, None]], axis=1)
    targets = interface.mapping.to_real(interface.moved, sim).astype(np.float32)
    states = [interface.reset(seed)]
    for target in targets:
        states.append(interface.step(target))
    if not interface.outcome.success:
        raise InputError(f"the best demonstration of {run} does not succeed any more; train anew")
    return Trajectory(seed, np.stack(states[:-1]), targets)


def replay(
    trajectory: Trajectory,
    interface: RobotInterface,
    seeds: list[int],
    on_episode: Callable[[int, int], None] = lambda *_: None,
) -> Replayed:
    """Send the targets blindly in episodes with other starts; how often does it still succeed?"""
    each: list[Outcome] = []
    for seed in seeds:
        interface.reset(seed)
        for target in trajectory.targets:
            interface.step(target)
            if interface.outcome.success or interface.outcome.truncated:
                break
        each.append(interface.outcome)
        on_episode(len(each), sum(o.success for o in each))
    good = sum(o.success for o in each)
    return Replayed(len(each), good, *wilson(good, len(each)), tuple(each))


def write_trajectory(
    trajectory: Trajectory, interface: RobotInterface, task: str, root: Path
) -> Path:
    """The trajectory as a dataset of one episode that lerobot-replay takes."""
    names = Names(
        tuple(interface.state_names[: -len(PERCEIVED)]),
        tuple(interface.action_names),
        tuple(PERCEIVED),
    )
    count = len(trajectory.targets)
    track = Track(
        state=trajectory.states[:, : -len(PERCEIVED)],
        action=trajectory.targets,
        environment=trajectory.states[:, -len(PERCEIVED) :],
        images={},
        success=True,
        task=task,
    )
    rewards = np.zeros(count, dtype=np.float32)
    root.parent.mkdir(parents=True, exist_ok=True)
    return write_dataset([(track, rewards)], names, interface.mapping.robot, root)


def measure(
    run: Path,
    episodes: int = 10,
    mapping: str | JointMapping | None = None,
    faults: Faults | None = None,
    out: Path | None = None,
) -> Replayed:
    """Replay a run's best trajectory at unseen starts (and with `faults`); optionally write it.

    Raises:
        InputError: see best_trajectory.
    """
    info = RunInfo.load(run)
    choice: EnvChoice = info.env
    clean = RobotInterface(choice, mapping)
    try:
        trajectory = best_trajectory(run, clean)
        if out is not None:
            write_trajectory(trajectory, clean, "replay of the best demonstration", out)
    finally:
        clean.close()
    interface = RobotInterface(choice, mapping, faults)
    try:
        return replay(trajectory, interface, [60_000_011 + i for i in range(episodes)])
    finally:
        interface.close()
