"""What ppo and sac share: training through stable-baselines3, from scratch or from a clone.

Actions are changes of joint targets (pd_joint_target_delta_pos). The curriculum starts a share of
the episodes part of the way along the expert's path (a reverse curriculum); it falls to zero
in the second half, and success is counted on full episodes only. Time limits are truncations, so
SB3 bootstraps their value. The trained actor is exported as an MlpPolicy in safetensors.

At every checkpoint all environments and random streams start anew from a seed that follows from
the step count, in a run that goes on as in one that was killed: both end with the same weights.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import torch

from mam_pipeline.optional import has, require
from mam_policies.algorithms import Algorithm, OnProgress
from mam_policies.algorithms.sb3_checkpoint import load_checkpoint, renew, restore, save_checkpoint
from mam_policies.algorithms.sb3_env import make_training_env
from mam_policies.demonstrations import Demonstration, demonstrations
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo, claim, describe_env, few_objects
from mam_policies.settings import Sb3Config

require("reinforcement learning", "stable_baselines3")

from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: E402
from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    SubprocVecEnv,
    VecMonitor,
)


class Sb3Algorithm(Algorithm[Any]):
    """The training that ppo and sac share; a subclass builds SB3's model and names its layers."""

    control_mode = "pd_joint_target_delta_pos"
    squash: ClassVar[str]
    """How the actor keeps its mean action in -1..1: clip or tanh."""

    @abstractmethod
    def model(
        self, config: Any, venv: Any, cloned: bool, policy: dict[str, Any], common: dict[str, Any]
    ) -> Any:
        """A fresh SB3 model.

        Args:
            cloned: whether demonstrations will be cloned into it.
            policy: policy_kwargs. common: further arguments that all algorithms of SB3 take.
        """

    @abstractmethod
    def layers(self, policy: Any) -> tuple[torch.nn.Module, torch.nn.Module, torch.nn.Module]:
        """(features extractor, hidden layers, last layer) of the actor in an SB3 policy."""

    def train(
        self,
        choice: EnvChoice,
        config: Any,
        out: Path,
        update: OnProgress = lambda *_: None,
        on_checkpoint: Callable[[int, MlpPolicy], None] = lambda *_: None,
    ) -> RunInfo:
        """Train with SB3 into the run folder `out`; goes on from its checkpoint if there is one.

        `on_checkpoint(steps, actor)` is called at the start and at every checkpoint.

        Raises:
            TrainingError: the expert succeeds too seldom to start from.
        """
        probe = choice.make()
        claim(out, choice, self.claimed(config))
        sizes = describe_env(probe)
        demos: list[Demonstration] = []
        if config.episodes:
            folder = (config.demos_from or out) / "demos_delta"
            demos = demonstrations(probe, config, folder, update)
        probe.close()
        saved = load_checkpoint(out / "checkpoint")
        done = saved["steps"] if saved else 0
        venv = _environments(choice, config, done)
        model = self._fresh(config, venv, demos, out)
        if saved:
            restore(model, saved)
            renew(model, config.seed, done)
        elif demos:
            self._clone(model.policy, demos, config)
        actor = partial(self.export, model.policy, config, sizes, choice.max_steps)
        listener = _Listener(
            config, out, partial(update, self.name), saved, lambda n: on_checkpoint(n, actor())
        )
        if not saved:
            on_checkpoint(0, actor())
        started = time.monotonic()
        with few_objects():
            left = max(config.steps - done, 0)
            model.learn(left, callback=listener, reset_num_timesteps=False)
        venv.close()
        actor().save(out)
        results = {
            "steps": int(model.num_timesteps),
            "seconds": round(time.monotonic() - started, 1),
            "success_while_training": listener.rate(),
            "curve": listener.curve,
        }
        info = RunInfo(self.name, choice, **sizes, config=asdict(config), results=results)
        info.save(out)
        return info

    def claimed(self, config: Any) -> str:
        """Settings that a run which goes on cannot change."""
        return f"{self.name} seed {config.seed}"

    def export(
        self, policy: Any, config: Sb3Config, sizes: dict[str, Any], horizon: int
    ) -> MlpPolicy:
        """The mean of an SB3 policy as an MlpPolicy: the same numbers, without SB3."""
        out = MlpPolicy(
            sizes["observation"][-1][2],
            sizes["action_dim"],
            sizes["arm_joints"],
            1,
            config.hidden,
            horizon,
            timed=False,
            relative=False,
            squash=self.squash,
            activation="tanh",
        )
        extractor, hidden, last = self.layers(policy)
        source = [*(m for m in hidden.modules() if isinstance(m, torch.nn.Linear)), last]
        target = [m for m in out.net if isinstance(m, torch.nn.Linear)]
        for ours, theirs in zip(target, source, strict=True):
            ours.load_state_dict(theirs.state_dict())
        out.mean.copy_(extractor.get_buffer("mean"))
        out.std.copy_(extractor.get_buffer("std"))
        return out.eval()

    def _fresh(self, config: Sb3Config, venv: Any, demos: list[Demonstration], out: Path) -> Any:
        """A model with fixed observation statistics."""
        rows = np.concatenate([d.obs for d in demos]) if demos else _random_rows(venv, config.seed)
        policy: dict[str, Any] = {
            "net_arch": list(config.hidden),
            "features_extractor_class": Normalise,
            "features_extractor_kwargs": {
                "mean": rows.mean(0).tolist(),
                "std": np.maximum(rows.std(0), 1e-2).tolist(),
            },
            "activation_fn": torch.nn.Tanh,
        }
        common: dict[str, Any] = {
            "device": "cpu",
            "seed": config.seed,
            "gamma": config.gamma,
            "batch_size": config.batch,
            "verbose": 0,
        }
        if has("tensorboard"):
            common["tensorboard_log"] = str(out / "tensorboard")
        return self.model(config, venv, bool(demos), policy, common)

    def _clone(self, policy: Any, demos: list[Demonstration], config: Sb3Config) -> None:
        """Supervised start of the actor's mean action."""
        obs = torch.as_tensor(np.concatenate([d.obs for d in demos]), dtype=torch.float32)
        goal = torch.as_tensor(np.concatenate([d.actions for d in demos]), dtype=torch.float32)
        extractor, hidden, last = self.layers(policy)
        optimiser = torch.optim.Adam(policy.parameters(), lr=config.clone_learning_rate)
        generator = torch.Generator().manual_seed(config.seed)
        for _ in range(config.clone_epochs):
            for rows in torch.randperm(len(obs), generator=generator).split(config.batch):
                mean = last(hidden(extractor(obs[rows])))
                mean = torch.tanh(mean) if self.squash == "tanh" else mean
                error = torch.nn.functional.smooth_l1_loss(mean, goal[rows], beta=0.1)
                optimiser.zero_grad()
                error.backward()
                optimiser.step()


class Normalise(BaseFeaturesExtractor):
    """SB3 features extractor: (obs - mean) / std with fixed statistics, clipped to +-10."""

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, observation_space: gym.Space, mean: list[float], std: list[float]) -> None:
        super().__init__(observation_space, int(np.prod(observation_space.shape or (0,))))
        self.register_buffer("mean", torch.tensor(mean))
        self.register_buffer("std", torch.tensor(std))

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        """(b, n) to (b, n)."""
        return ((obs - self.mean) / self.std).clamp(-10, 10)


class _Listener(BaseCallback):
    """Counts success on full episodes, lowers the curriculum, saves, stops early."""

    def __init__(
        self,
        config: Sb3Config,
        out: Path,
        update: Callable[[float, str], None],
        saved: dict[str, Any] | None,
        on_checkpoint: Callable[[int], None],
    ) -> None:
        super().__init__()
        self.config, self.out = config, out
        self.update, self.on_checkpoint = update, on_checkpoint
        self.recent: list[bool] = list(saved["recent"]) if saved else []
        self.curve: list[tuple[int, float]] = list(saved["curve"]) if saved else []
        self.saved = int(saved["steps"]) if saved else 0

    def rate(self) -> float:
        """Success over the last full episodes."""
        return float(np.mean(self.recent)) if self.recent else 0.0

    def _on_rollout_start(self) -> None:  # the update of the rollout before is done
        steps = self.num_timesteps
        if steps - self.saved < self.config.save_every:
            return
        self.saved = steps
        self.curve.append((steps, self.rate()))
        more = {"recent": self.recent, "curve": self.curve}
        save_checkpoint(self.model, self.out / "checkpoint", more)
        self.on_checkpoint(steps)
        self.training_env.env_method("set_share", _share(self.config, steps))
        renew(self.model, self.config.seed, steps)

    def _on_step(self) -> bool:
        for over, info in zip(self.locals["dones"], self.locals["infos"]):
            if over and not info.get("helped"):
                self.recent = [*self.recent, bool(info["success"])][-self.config.window :]
        rate, count = self.rate(), len(self.recent)
        self.logger.record("rollout/full_episode_success", rate)
        words = f"success {100 * rate:.0f} % of the last {count}"
        self.update(min(self.num_timesteps / self.config.steps, 1.0), words)
        return not (count >= self.config.window and rate >= self.config.stop_at)


def _environments(choice: EnvChoice, config: Sb3Config, done: int) -> Any:
    """SB3's vector of environments, at the curriculum's state after `done` steps."""
    share = _share(config, done)
    makers: list[Callable[[], gym.Env]] = [
        partial(make_training_env, choice, share, (config.seed * 100 + i) % 2**31, config.gamma)
        for i in range(config.processes)
    ]
    single = config.processes == 1
    raw = DummyVecEnv(makers) if single else SubprocVecEnv(makers, "forkserver")
    return VecMonitor(raw, info_keywords=("success",))


def _share(config: Sb3Config, steps: int) -> float:
    """Share of episodes that the expert begins."""
    left = max(0.0, 1.0 - 2.0 * steps / config.steps)
    return config.curriculum_share * left if config.curriculum else 0.0


def _random_rows(venv: Any, seed: int, steps: int = 400) -> np.ndarray:
    """Observations under random actions, for the statistics of a start from scratch."""
    venv.seed(seed)
    venv.action_space.seed(seed)
    rows = [venv.reset()]
    for _ in range(steps):
        rows.append(venv.step([venv.action_space.sample() for _ in range(venv.num_envs)])[0])
    return np.concatenate(rows)
