"""The scripted expert's demonstrations for cloning: what was seen and what to do, a file each.

The expert acts with noise on its targets while the noise-free target is the label, so that a
policy learns to come back to the path (as in DART).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline import folders
from mam_pipeline.arrays import Arrays
from mam_pipeline.errors import InputError
from mam_policies.expert import Expert, PlanningError
from mam_policies.run import TrainingError, flat
from mam_policies.settings import DemonstrationConfig


@dataclass(frozen=True)
class Demonstration:
    """One episode: observations (T, n) and the expert's noise-free actions (T, m).

    `success` is that of whoever acted: the expert, or the policy in a DAgger episode.
    """

    obs: np.ndarray
    actions: np.ndarray
    success: bool = True


def seed_of(config_seed: int, number: int) -> int:
    """Seed of a demonstration, from that of its run."""
    return (config_seed * 1_000_003 + number) % 2**31


def is_noisy(number: int) -> bool:
    """Whether a demonstration is recorded with execution noise."""
    return number % 3 != 0


def demonstrations(
    env: Any,
    config: DemonstrationConfig,
    folder: Path,
    update: Callable[[str, float, str], None] = lambda *_: None,
) -> list[Demonstration]:
    """`config.episodes` successes of the expert; those already in `folder` are taken from there.

    Episodes in which the expert would have to try again are left out: they teach a second way of
    doing the same, which a unimodal policy would average with the first.

    Raises:
        TrainingError: after 20 tries fewer than one in five is usable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept: list[Demonstration] = []
    tried, reason = 0, ""
    while len(kept) < config.episodes:
        file = folder / f"{tried:05d}.npz"
        if not file.is_file():
            noise = config.noise if is_noisy(tried) else 0.0
            save(file, record(env, seed_of(config.seed, tried), noise, config.settle))
        found = load(file)
        if isinstance(found, str):
            reason = found
        else:
            kept.append(found)
        tried += 1
        update("demonstrations", len(kept) / config.episodes, f"{len(kept)} of {tried} tries")
        if tried >= 20 and len(kept) < tried / 5:
            raise TrainingError(f"the expert succeeds in {len(kept)} of {tried} tries: {reason}")
    return kept


def record(env: Any, seed: int, noise: float, settle: int) -> Demonstration | str:
    """One episode of the expert with a single plan; the reason where that failed."""
    obs, _ = env.reset(seed=seed)
    expert = Expert(env, noise=noise, seed=seed, attempts=1)  # a second plan is not wanted
    try:
        expert.reset()
    except PlanningError as error:
        return str(error)
    left = settle
    seen, labels = [], []
    while True:
        action = expert.act()
        if expert.phase == "done" and left == settle:
            return expert.reason
        seen.append(flat(obs))
        labels.append(expert.clean_action())
        obs, _, _, truncated, info = env.step(action)
        if bool(np.asarray(info["success"]).reshape(-1)[0]) or left < settle:
            left -= 1
            if left <= 0:
                return Demonstration(np.stack(seen), np.stack(labels))
        if bool(np.asarray(truncated).reshape(-1)[0]):
            return "out of time"


def save(file: Path, found: Demonstration | str) -> None:
    """Write an episode, or the reason why there is none, all or nothing."""
    with folders.new_file(file) as part:
        if isinstance(found, str):
            np.savez_compressed(part, obs=np.zeros(0), actions=np.zeros(0), reason=found)
        else:
            arrays: dict[str, Any] = asdict(found)
            np.savez_compressed(part, **arrays, reason="")


def load(file: Path) -> Demonstration | str:
    """What `save` wrote.

    Raises:
        InputError: it is something else.
    """
    data = Arrays(file)
    if not data["obs"].size:
        return str(data["reason"])[:1000]
    obs, actions = data.numbers("obs", None, None), data.numbers("actions", None, None)
    if len(obs) != len(actions):
        raise InputError(f"{file} holds {len(obs)} observations for {len(actions)} actions")
    return Demonstration(obs, actions, bool(data.numbers("success")))
