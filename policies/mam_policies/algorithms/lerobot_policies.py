"""LeRobot's own policies (act, diffusion, smolvla), trained by LeRobot on the scripted expert.

The policy sees cameras and motor values only, as on a real arm; the expert knows everything.
Demonstrations are collected with cameras, written in motor units, and given to
stock `lerobot-train`. In DAgger rounds the policy acts, the expert's plan says what it would have
done, and training goes on with those episodes added. Without cameras
the privileged state stands in for them: quick on a CPU, but no policy for a real arm.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mam_pipeline import folders
from mam_pipeline.arrays import Arrays
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.folder_data import file_of
from mam_policies.algorithms import Algorithm, OnProgress
from mam_policies.collect import collect
from mam_policies.collection import CollectConfig, Names, Track
from mam_policies.dagger import dagger_steps
from mam_policies.demonstrations import seed_of
from mam_policies.expert import PlanningError
from mam_policies.lerobot.actor import LeRobotActor
from mam_policies.lerobot.dataset import (
    load_dataset,
    offline,
    read_tracks,
    track_of,
    write_dataset,
)
from mam_policies.lerobot.export import MAPPING, export_dataset
from mam_policies.lerobot.robot_interface import mapping_of
from mam_policies.lerobot.training import LeRobotTraining, train_policy
from mam_policies.run import EnvChoice, RunInfo, describe_env, few_objects
from mam_policies.settings import LeRobotConfig


class LeRobotAlgorithm(Algorithm[LeRobotConfig]):
    """Training by stock lerobot-train; a subclass names the policy."""

    Config = LeRobotConfig
    leaves_lerobot = True
    policy: ClassVar[str]
    """Argument of lerobot-train that names it."""
    without_downloads: ClassVar[tuple[str, ...] | None]
    """Arguments that keep it from asking for weights on the Hub; None: it cannot start without."""

    def train(
        self,
        choice: EnvChoice,
        config: LeRobotConfig,
        out: Path,
        update: OnProgress = lambda *_: None,
    ) -> RunInfo:
        """Collect, train with LeRobot, and leave its policy folder in out/policy.

        Raises:
            ConfigError, HintNeeded: several assets; a policy that needs downloads; no mapping.
            BackendError: no Vulkan driver for the cameras. TrainingError: lerobot-train failed.
        """
        wanted = self._training(config)
        if len(choice.assets) != 1:
            raise ConfigError(f"{self.name} is trained on one asset at a time")
        demos = CollectConfig(
            episodes=config.episodes, joint=choice.joint, task=choice.task, robot=choice.robot,
            seed=seed_of(config.seed, 0), noise=config.noise, cameras=config.cameras,
            max_steps=choice.max_steps,
        )  # fmt: skip
        found = collect(
            choice.assets[0], demos, out / "demos",
            lambda n, of, words: update("demonstrations", n / of, words), choice.config,
        )  # fmt: skip
        export_dataset(out / "demos", out / "data", config.mapping)
        tell = partial(update, self.name)
        policy = train_policy(out / "data" / "dataset", wanted, out / "lerobot", tell)
        env = choice.make(**_view(config.cameras))
        try:
            sizes = describe_env(env)
            for k in range(1, config.rounds + 1):
                with few_objects():
                    _dagger_round(env, policy, config, out, k, update)
                data = _with_rounds(out, k)
                policy = train_policy(data, wanted, out / f"lerobot_{k}", tell)
        finally:
            env.close()
        _put(policy, out / "policy")
        shutil.copy(out / "data" / MAPPING, out / MAPPING)
        results = {"demonstrations": found.episodes, "steps": config.steps}
        info = RunInfo(self.name, choice, **sizes, config=asdict(config), results=results)
        info.save(out)
        return info

    def env_arguments(self, info: RunInfo) -> dict[str, Any]:
        """Cameras, where the policy sees them."""
        return _view(bool(info.config.get("cameras", True)))

    def actor(self, run: Path, env: Any) -> LeRobotActor:
        """LeRobot's policy folder in a run."""
        offline()
        base = env.unwrapped
        return LeRobotActor(run / "policy", base, mapping_of(base, str(file_of(run, MAPPING))))

    def _training(self, config: LeRobotConfig) -> LeRobotTraining:
        """What lerobot-train is asked for; keeps it off the network unless downloads are wanted."""
        more = config.more
        if not config.download:
            if self.without_downloads is None:
                raise ConfigError(f"{self.name} starts from weights on the Hub; add --download")
            offline()
            more = (*self.without_downloads, *more)
        return LeRobotTraining(
            self.policy, config.steps, config.batch, config.seed, config.cameras, config.download,
            more,
        )  # fmt: skip


class Act(LeRobotAlgorithm):
    """act: action chunking with transformers (Zhao 2023), by LeRobot."""

    name = "act"
    policy = "--policy.type=act"
    without_downloads = ("--policy.pretrained_backbone_weights=null",)


class Diffusion(LeRobotAlgorithm):
    """diffusion: diffusion policy (Chi 2023), by LeRobot."""

    name = "diffusion"
    policy = "--policy.type=diffusion"
    without_downloads = ()


class SmolVla(LeRobotAlgorithm):
    """smolvla: a small vision-language-action model, fine-tuned by LeRobot; needs --download."""

    name = "smolvla"
    policy = "--policy.path=lerobot/smolvla_base"
    without_downloads = None


def _view(cameras: bool) -> dict[str, Any]:
    """Arguments of the environment for what the policy sees."""
    return {"obs_mode": "rgb+state"} if cameras else {}


def _dagger_round(
    env: Any, policy: Path, config: LeRobotConfig, out: Path, number: int, update: OnProgress
) -> None:
    """Episodes of round `number`, one file each; an empty one where the expert had no plan."""
    folder = out / f"round_{number}"
    folder.mkdir(exist_ok=True)
    base = env.unwrapped
    actor: LeRobotActor | None = None
    for i in range(config.round_episodes):
        file = folder / f"{i:05d}.npz"
        if not file.is_file():
            mapping = mapping_of(base, str(out / "data" / MAPPING))
            actor = actor or LeRobotActor(policy, base, mapping)
            seed = seed_of(config.seed, 100_000 * number + i)
            rows: dict[str, Any] = _dagger_episode(env, actor, seed, config.lost)
            with folders.new_file(file) as part:
                np.savez_compressed(part, **rows)
        update(f"round {number}", (i + 1) / config.round_episodes, f"{i + 1} episodes")


def _dagger_episode(
    env: Any, actor: LeRobotActor, seed: int, lost: float
) -> dict[str, NDArray[Any]]:
    """Observations and the expert's targets in motor units; {} without a plan."""
    rows: dict[str, list[Any]] = {"action": [], "success": []}
    try:
        for seen, target, success in dagger_steps(env, actor, seed, lost, actor.observe):
            for key, value in seen.items():
                rows.setdefault(key, []).append(value)
            real = actor.mapping.to_real(actor.moved, target)
            rows["action"].append(real.astype(np.float32))
            rows["success"].append(success)
    except PlanningError:
        return {}
    return {k: np.stack(v) for k, v in rows.items()}


def _with_rounds(out: Path, rounds: int) -> Path:
    """The demonstrations and the first `rounds` DAgger rounds as one dataset."""
    source = load_dataset(out / "data" / "dataset")
    names = Names(
        *(
            tuple(source.features[k]["names"])
            for k in ("observation.state", "action", "observation.environment_state")
        )
    )
    task = str(source.meta.tasks.index[0])

    def everything() -> Iterator[tuple[Track, NDArray[np.float32]]]:
        yield from read_tracks(source)
        for k in range(1, rounds + 1):
            for file in sorted((out / f"round_{k}").glob("[0-9]*[0-9].npz")):
                data = Arrays(file)
                if "action" in data:
                    rewards = np.zeros(len(data["action"]), dtype=np.float32)
                    success = bool(data.numbers("success", len(rewards))[-1])
                    yield track_of(data, success, task), rewards

    return write_dataset(everything(), names, str(source.meta.robot_type), out / f"data_{rounds}")


def _put(policy: Path, place: Path) -> None:
    """Copy the policy folder to its place, all or nothing."""
    with folders.new_folder(place) as work:
        shutil.copytree(policy, work, dirs_exist_ok=True)
    if not (place / "model.safetensors").is_file():
        raise BackendError("lerobot-train left no model.safetensors")
