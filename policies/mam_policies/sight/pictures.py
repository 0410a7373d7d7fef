"""What the network learns from: pictures of the expert at work, each with everything drawn anew."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_envs.placement.base import object_pose
from mam_envs.scene.background import kept_of
from mam_envs.scene.layout import Layout
from mam_pipeline import folders
from mam_pipeline.arrays import Arrays
from mam_pipeline.types import FloatArray
from mam_policies.demonstrations import seed_of
from mam_policies.expert import Expert, PlanningError

OUTPUTS = 4
"""What is told: shift of the object in x and y (metres), its yaw (radians), its joint's value."""

PARTS = ("rgb", "kept", "arm", "target")


@dataclass(frozen=True)
class Pictures:
    """Pictures (N, h, w, 3) uint8 RGB, where they show robot or object (N, h, w), arm joints (N, n)
    in radians, and OUTPUTS (N, 4)."""

    rgb: NDArray[np.uint8]
    kept: NDArray[np.bool_]
    arm: NDArray[np.float32]
    target: NDArray[np.float32]


def pictures(
    env: Any, count: int, every: int, noise: float, seed: int, folder: Path,
    told: Callable[[float, str], None] = lambda *_: None,
) -> Pictures:  # fmt: skip
    """`count` pictures, one for every `every` control steps of the expert; those in `folder` are
    taken from there, an episode a file.

    Args:
        env: with pictures and state. noise: of the expert's motion, radians.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, NDArray[Any]]] = []
    got = episode = 0
    while got < count:
        file = folder / f"{episode:05d}.npz"
        if not file.is_file():
            found: dict[str, Any] = _episode(env, every, noise, seed_of(seed, 500_000 + episode))
            with folders.new_file(file) as part:
                np.savez_compressed(part, **found)
        rows.append(dict(Arrays(file)))
        got += len(rows[-1]["target"])
        episode += 1
        told(min(1.0, got / count), f"{got} pictures")
    kept = [row for row in rows if len(row["target"])]
    parts = (np.concatenate([r[key] for r in kept])[:count] for key in PARTS)
    return Pictures(*parts)


def _episode(env: Any, every: int, noise: float, seed: int) -> dict[str, NDArray[Any]]:
    base = env.unwrapped
    rgb, kept, arms, targets = [], [], [], []
    rng = np.random.default_rng(seed)
    with unseen(base):
        env.reset(seed=seed)
        expert = Expert(env, noise=noise, seed=seed, attempts=1)
        try:
            expert.reset()
        except PlanningError:
            return {key: np.zeros(0) for key in PARTS}
        step, done = int(rng.integers(every)), False
        while not done:
            if step % every == 0:
                seen = look(base)
                rgb.append(seen[0])
                kept.append(seen[1])
                now = base.planner_state()
                arms.append(now.arm)
                targets.append([*place_of(base.layout(0), now.world_asset), now.q])
            action = expert.act()
            _, _, _, truncated, info = env.step(action)
            done = bool(info["success"].reshape(-1)[0]) or expert.phase == "done"
            done |= bool(np.asarray(truncated).reshape(-1)[0])
            step += 1
    return {
        "rgb": np.stack(rgb), "kept": np.stack(kept), "arm": np.array(arms, np.float32),
        "target": np.array(targets, np.float32),
    }  # fmt: skip


@contextmanager
def unseen(base: Any) -> Iterator[None]:
    """Steps of an environment with pictures and state give the state only, which is quicker."""
    mode = base._obs_mode
    base._obs_mode = "state"
    try:
        yield
    finally:
        base._obs_mode = mode


def look(base: Any) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """(h, w, 3) RGB of the first camera, with what cameras see drawn anew; and (h, w) where it
    shows robot or object."""
    mode, base._obs_mode = base._obs_mode, "rgb+state"
    try:
        if base._looks is not None:
            base._looks.draw(base._batched_episode_rng[0])
        rgb = picture_of(base._get_obs_sensor_data())
        sensor = next(iter(base.scene.sensors.values()))
        return rgb, kept_of(sensor, base.foreground()).cpu().numpy()[0, ..., 0]
    finally:
        base._obs_mode = mode


def picture_of(sensors: dict[str, Any]) -> NDArray[np.uint8]:
    """(h, w, 3) RGB of the first camera of an observation."""
    first = next(iter(sensors.values()))
    return np.asarray(first["rgb"].cpu().numpy()[0], dtype=np.uint8)


def place_of(layout: Layout, world_asset: FloatArray) -> FloatArray:
    """(3,) shift in x and y and the yaw of an object that stands at (4, 4) world_T_asset."""
    low, high = layout.model.footprint
    middle, turn = 0.5 * (low + high)[:2], world_asset[:2, :2]
    shift = world_asset[:2, 3] - middle + turn @ middle
    return np.array([*shift, np.arctan2(turn[1, 0], turn[0, 0])])


def pose_at(layout: Layout, place: FloatArray) -> FloatArray:
    """(4, 4) world_T_asset of what `place_of` gives."""
    shift, yaw = place[:2].tolist(), float(place[2])
    return object_pose(layout.model, layout.placement.object_height, shift, yaw)
