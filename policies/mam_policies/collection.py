"""The folder that `mam-sim collect` writes, one file per attempt, and how it is read back.

collect.json            what was asked for: a file that `mam-sim collect --config` reads
attempts/000000.npz     frames of an attempt; 000000.json its outcome, written last
attempts/names.json     names of the entries of the vectors
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from mam_envs.config import EnvConfig
from mam_pipeline import config_file, folder_data
from mam_pipeline.arrays import Arrays
from mam_pipeline.edited import STRICT, Finite, Index, Range, Seed, Text, Word, validated
from mam_pipeline.errors import InputError
from mam_policies.run import task_settings


@dataclass(frozen=True)
class Track:
    """One episode's frames, T rows each.

    Attributes:
        state: (T, S) float32, what a real arm can measure, named by `Names.state`.
        action: (T, A) float32, absolute targets, and the speeds of a base that drives; named by
            `Names.action`.
        environment: (T, E) float32, privileged (simulation only), named by `Names.environment`.
        images: camera name to (T, H, W, 3) uint8.
        success: of the whole episode. task: in words.
    """

    state: NDArray[np.float32]
    action: NDArray[np.float32]
    environment: NDArray[np.float32]
    images: dict[str, NDArray[np.uint8]]
    success: bool
    task: str


@dataclass(frozen=True)
class Outcome:
    """How an attempt ended, in words, and how far the joint was open then."""

    __pydantic_config__ = STRICT
    seed: Index
    success: bool
    steps: Index
    joint: Word
    task: Text
    reason: Text
    plans: Index = 0
    open_fraction: Finite = 0.0


@dataclass(frozen=True)
class Names:
    """Names of the vectors' entries; units are part of a name (.rad, .m)."""

    state: tuple[str, ...]
    action: tuple[str, ...]
    environment: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class CollectConfig:
    """Which demonstrations of the scripted expert are collected."""

    episodes: Annotated[int, Range(1, 100_000)] = 20
    """Successes that are wanted."""
    joint: str | None = None
    """Joint to operate; by default the surest one that the arm can do."""
    task: str | None = None
    """What to do with it: open, close, turn_to, push, press, take_out, put_in or a plug-in's; by
    default what the joint suggests."""
    robot: str = "panda"
    """Name of the arm: panda, so100, so101, fetch, xarm6_robotiq, or that of a plug-in."""
    seed: Seed = 0
    """Seed of the first attempt; attempt k uses seed + k."""
    noise: Annotated[float, Range(0, 1)] = 0.0
    """Standard deviation of noise on the arm's targets, radians; labels stay clean."""
    control_mode: str = "pd_joint_pos"
    """ManiSkill's control mode of the actions in demos.h5: pd_joint_pos (radians), or, in -1..1,
    pd_joint_delta_pos, pd_joint_target_delta_pos and (panda) pd_ee_delta_pose."""
    cameras: bool = False
    """Record the cameras into the LeRobot dataset (needs a Vulkan driver)."""
    keep_failures: bool = False
    """Keep failed attempts in the data as well."""
    settle: Annotated[int, Range(0, 1000)] = 5
    """Control steps that are recorded after success."""
    max_steps: Annotated[int, Range(1, 100_000)] | None = None
    """Control steps of one attempt; default: the task's, and some for what follows success."""

    @property
    def steps(self) -> int:
        """`max_steps`, or its default."""
        from mam_envs.tasks import episode_steps  # imports torch, which `--help` does without

        return self.max_steps or episode_steps(self.task, robot=self.robot) + 20


def read_claim(file: Path) -> dict[str, Any]:
    """collect.json; older ones name no control mode, and call `cameras` `video`."""
    data = config_file.read(file)
    kinds = {"asset": str, "collect": dict, "env": dict}
    if not all(isinstance(data.get(key), kind) for key, kind in kinds.items()):
        raise InputError(f"{file} is none of mam-sim collect: it lacks {', '.join(kinds)}")
    asked = dict(data["collect"])
    if "video" in asked:
        asked["cameras"] = asked.pop("video")
    return {**data, "collect": {"control_mode": CollectConfig.control_mode, **asked}}


@dataclass(frozen=True)
class Collection:
    """A collection on disk, as far as it has come.

    Attributes:
        asset: folder of the asset.
        config: what was asked for; env_config: settings of the environment.
        outcomes: of the finished attempts, in order, without gaps.
    """

    folder: Path
    asset: str
    config: CollectConfig
    env_config: EnvConfig
    outcomes: list[Outcome]

    @staticmethod
    def load(folder: Path) -> Collection:
        """Read a folder of `mam-sim collect`.

        Raises:
            InputError: there is no collection.
        """
        missing = f"{folder} holds no collection; make one with: mam-sim collect"
        file = folder_data.file_of(folder, "collect.json", missing)
        folder_data.file_of(folder, "attempts/names.json", missing)
        data = read_claim(file)
        config = config_file.fill(CollectConfig(), data["collect"], file)
        settings = config_file.fill(task_settings(config.task), data["env"], file)
        outcomes = finished(folder)
        return Collection(folder, data["asset"], config, settings, outcomes)

    @property
    def names(self) -> Names:
        """Names of the vectors' entries."""
        names: Names = validated(Names, folder_data.read(self.folder, "attempts/names.json"))
        return names

    @property
    def kept(self) -> list[int]:
        """Numbers of the attempts that are in the data."""
        config = self.config
        kept = [k for k, o in enumerate(self.outcomes) if o.success or config.keep_failures]
        return kept[: config.episodes]

    def tracks(self) -> Iterator[tuple[Track, NDArray[np.float32]]]:
        """The episodes that are in the data, with their rewards (T,)."""
        names = self.names
        state, hidden = len(names.state), len(names.environment)
        for k in self.kept:
            data = Arrays(folder_data.file_of(self.folder, f"attempts/{k:06d}.npz"))
            targets = data.numbers("targets", None, len(names.action))
            count = len(targets)
            obs = data.numbers("obs/state", None, None)[:count]
            if len(obs) < count or obs.shape[1] < state + hidden:
                raise InputError(f"{data.file}: obs/state must have {count} rows for {names}")
            images = {n[7:]: _pictures(data, n)[:count] for n in data if n.startswith("images/")}
            # the flat state begins with qpos and ends with the privileged entries
            track = Track(
                state=obs[:, :state],
                action=targets.astype(np.float32),
                environment=obs[:, obs.shape[1] - hidden :],
                images=images,
                success=self.outcomes[k].success,
                task=self.outcomes[k].task,
            )
            yield track, data.numbers("rewards", count).astype(np.float32)


def _pictures(data: Arrays, name: str) -> NDArray[np.uint8]:
    """A camera's pictures (T, H, W, 3)."""
    found = data.numbers(name, None, None, None, 3)
    if found.dtype != np.uint8:
        raise InputError(f"{data.file}: {name} must be pictures of bytes, not of {found.dtype}")
    return found


def finished(folder: Path) -> list[Outcome]:
    """Outcomes of a collection's attempts that are finished, in order, without gaps.

    Raises:
        InputError: one is none; the sentence names the file.
    """
    out: list[Outcome] = []
    while (name := f"attempts/{len(out):06d}.json") and (folder / name).exists():
        out.append(validated(Outcome, folder_data.read(folder, name)))
    return out
