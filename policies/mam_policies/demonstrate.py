"""The expert operates an asset in front of a camera: one video and one strip of pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

import mam_envs
from mam_envs.scene.video import Camera, Frame, write_strip, write_video
from mam_envs.scene.vulkan import vulkan_ok
from mam_envs.tasks import episode_steps
from mam_policies.expert import Expert, PlanningError


@dataclass(frozen=True)
class DemoResult:
    """What came out.

    Attributes:
        success: of the environment; joint, task: what was operated.
        attempts: episodes (seeds) that it took; reason: why the last one failed, or "".
        open_fraction: of the joint at the end.
        video, strip: files, or None.
        renderer: "vulkan", "ray casting", or "none".
    """

    success: bool
    joint: str
    task: str
    attempts: int
    reason: str
    open_fraction: float
    video: Path | None
    strip: Path | None
    renderer: str


def demonstrate(
    asset_dir: Path,
    joint: str | None = None,
    out: Path = Path("."),
    seed: int = 0,
    video: bool = True,
    robot: str = "panda",
    task: str | None = None,
    attempts: int = 3,
    every: int = 2,
    linger: int = 12,
) -> DemoResult:
    """Let the expert operate one joint and film it into out/demo.mp4 and out/demo.png.

    Up to `attempts` episodes with seeds seed, seed + 1, ... are run; the last one is kept, and
    the result says how many there were. Without a Vulkan driver the pictures are ray-cast.

    Args:
        every: control steps per picture (they are slow on a CPU).
        linger: control steps shown after success.

    Raises:
        PlacementError: no place lets this arm operate the joint; the message says why.
        InputError, ConfigError: bad asset, joint or robot.
    """
    torch.set_num_threads(1)
    render = "rgb_array" if video and vulkan_ok() else None
    env = mam_envs.make(
        asset_dir, joint=joint, task=task, robot_uids=robot, control_mode="pd_joint_pos",
        obs_mode="state", render_mode=render, reward_mode="none",
        max_episode_steps=episode_steps(task, robot=robot) + 60,
    )  # fmt: skip
    try:
        camera = Camera(env) if video else None
        expert = Expert(env)
        for attempt in range(1, attempts + 1):
            success, fraction, reason, frames = _film(
                env, expert, seed + attempt - 1, camera, every, linger
            )
            if success:
                break
        goal = env.unwrapped.layout().goals[0]  # type: ignore[attr-defined]
    finally:
        env.close()
    film = strip = None
    if frames:
        film = write_video(frames, Path(out) / "demo.mp4", fps=20 // every)
        strip = write_strip(frames, Path(out) / "demo.png")
    renderer = "none" if not frames else "vulkan" if render else "ray casting"
    return DemoResult(
        success, goal.joint, goal.task, attempt, reason, fraction, film, strip, renderer
    )


def _film(
    env: Any, expert: Expert, seed: int, camera: Camera | None, every: int, linger: int
) -> tuple[bool, float, str, list[Frame]]:
    """One episode: success, open fraction at the end, reason, frames."""
    frames: list[Frame] = []
    _, info = env.reset(seed=seed)
    try:
        expert.reset()
    except PlanningError as error:
        return False, float(info["open_fraction"][0]), str(error), frames
    success, left, k = False, linger, 0
    while True:
        if camera is not None and k % every == 0:
            frames.append(camera.shoot())
        action = expert.act()
        if expert.phase == "done" and not success:
            break
        _, _, _, truncated, info = env.step(action)
        k += 1
        success = success or bool(info["success"][0])
        left -= success
        if left <= 0 or bool(truncated[0]):
            break
    reason = "" if success else expert.reason or "out of time"
    return success, float(info["open_fraction"][0]), reason, frames
