"""PPO and SAC through stable-baselines3, from scratch, from a clone, or along a curriculum.

Actions are changes of joint targets (pd_joint_target_delta_pos). The curriculum starts a share of
the episodes part of the way along the expert's path (a reverse curriculum); it falls to zero
in the second half, and success is counted on full episodes only. Time limits are truncations, so
SB3 bootstraps their value. The trained actor is exported as an MlpPolicy in safetensors.

At every checkpoint all environments and random streams start anew from a seed that follows from
the step count, in a run that goes on as in one that was killed: both end with the same weights.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from mam_pipeline.optional import has, require
from mam_policies.algorithms.bc import BcConfig, Demonstration, demonstrations
from mam_policies.algorithms.rl_checkpoint import load_checkpoint, renew, restore, save_checkpoint
from mam_policies.expert import Expert, PlanningError
from mam_policies.run import (
    EnvChoice,
    MlpPolicy,
    RunInfo,
    claim,
    describe_env,
    few_objects,
    flat,
)

require("reinforcement learning", "stable_baselines3")

from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: E402

OnProgress = Callable[[str, float, str], None]
WIDTH = (256, 256)
CONTROL_MODE = "pd_joint_target_delta_pos"
GAMMA = 0.98


@dataclass(frozen=True)
class RlConfig:
    """Settings of reinforcement learning.

    Attributes:
        algo: ppo | sac. steps: environment steps in all.
        curriculum: whether the expert takes some episodes part of the way first.
        stop_at: success share over the last 40 full episodes that ends training early.
        warm_episodes: expert episodes cloned into the actor first (0: from scratch).
        rollout: steps between two updates of ppo, of all processes together.
        save_every: steps between checkpoints (at the end of a rollout).
    """

    algo: str = "ppo"
    steps: int = 200_000
    seed: int = 0
    processes: int = 1
    curriculum: bool = True
    stop_at: float = 0.95
    warm_episodes: int = 0
    rollout: int = 2048
    save_every: int = 8192


class Prefix(gym.Wrapper):
    """With probability `share`, the expert acts for a random part of its plan after a reset."""

    def __init__(self, env: gym.Env, share: float, seed: int) -> None:
        super().__init__(env)
        self.share = share
        self._rng = np.random.default_rng(seed)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Reset, and sometimes go ahead; info["helped"] says whether."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        obs, info = self.env.reset(seed=seed, options=options)
        self.helped = self._rng.random() < self.share
        if self.helped:
            expert = Expert(self.env)
            try:
                expert.reset()
            except PlanningError:
                self.helped = False
                return obs, info
            for _ in range(int(self._rng.uniform(0.1, 0.95) * len(expert.plan))):
                obs, _, _, truncated, after = self.env.step(expert.act())
                if bool(np.asarray(after["success"]).reshape(-1)[0]) or bool(truncated):
                    return self.reset(seed=None, options=options)
        return obs, info

    def set_share(self, share: float) -> None:
        """Change the probability (called from the training process)."""
        self.share = share


class Plain(gym.Wrapper):
    """Batched tensors of ManiSkill as plain NumPy for one environment; success in info.

    An episode ends at success, which then counts as if it lasted for ever: with a dense reward,
    an end without that would cost more than it brings, and waiting just short of it would pay.
    """

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        size = int(np.prod(env.observation_space.shape or (0,)))
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """See gymnasium."""
        obs, _ = self.env.reset(seed=seed, options=options or {})
        return flat(obs), {}

    def step(self, action: Any) -> Any:
        """See gymnasium."""
        obs, reward, _, truncated, info = self.env.step(action)
        success = bool(np.asarray(info["success"]).reshape(-1)[0])
        helped = bool(getattr(self.env, "helped", False))
        out = {"success": success, "is_success": success, "helped": helped}
        late = bool(np.asarray(truncated).reshape(-1)[0]) and not success
        value = float(np.asarray(reward).reshape(-1)[0]) / ((1 - GAMMA) if success else 1.0)
        return flat(obs), value, success, late, out


def make_training_env(choice: EnvChoice, share: float, seed: int) -> gym.Env:
    """One plain gymnasium environment, as a user's own SB3 code would take it."""
    torch.set_num_threads(1)
    env = choice.make()
    env = Plain(Prefix(env, share, seed))
    env.reset(seed=seed)
    return env


def train_rl(
    choice: EnvChoice,
    config: RlConfig,
    out: Path,
    start: Path | None = None,
    progress: OnProgress = lambda *_: None,
    on_checkpoint: Callable[[int, MlpPolicy], None] = lambda *_: None,
) -> RunInfo:
    """Train with SB3 into the run folder `out`; goes on from its checkpoint if there is one.

    `on_checkpoint(steps, actor)` is called at the start and at every checkpoint.
    """
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor

    out.mkdir(parents=True, exist_ok=True)
    claim(out, choice, f"{config.algo} rollout {config.rollout} seed {config.seed}")
    probe = choice.make()
    sizes = describe_env(probe)
    demos = _demos(probe, config, out, start, progress)
    probe.close()
    saved = load_checkpoint(out / "checkpoint")
    done = saved["steps"] if saved else 0
    makers: list[Callable[[], gym.Env]] = [
        partial(make_training_env, choice, _share(config, done), config.seed * 100 + i)
        for i in range(config.processes)
    ]
    single = config.processes == 1
    raw = DummyVecEnv(makers) if single else SubprocVecEnv(makers, "forkserver")
    venv = VecMonitor(raw, info_keywords=("success",))
    model = _model(config, venv, demos, out)
    if saved:
        restore(model, saved)
        renew(model, config.seed, done)
    elif demos:
        _clone(model, demos, config)
    elsewhere = partial(actor_of, model, sizes, choice.max_steps)
    listener = _listener(config, out, progress, saved, lambda n: on_checkpoint(n, elsewhere()))
    if not saved:
        on_checkpoint(0, elsewhere())
    started = time.monotonic()
    with few_objects():
        model.learn(max(config.steps - done, 0), callback=listener, reset_num_timesteps=False)
    venv.close()
    policy = actor_of(model, sizes, choice.max_steps)
    policy.save(out)
    results = {
        "steps": int(model.num_timesteps),
        "seconds": round(time.monotonic() - started, 1),
        "success_while_training": listener.rate(),
        "curve": listener.curve,
    }
    info = RunInfo(
        config.algo,
        choice,
        sizes["observation"],
        sizes["action_dim"],
        sizes["arm_joints"],
        asdict(config),
        results,
    )
    info.save(out)
    return info


def _demos(
    env: Any, config: RlConfig, out: Path, start: Path | None, progress: OnProgress
) -> list[Demonstration]:
    """Demonstrations of the warm start, in the control mode of reinforcement learning."""
    if config.warm_episodes < 1:
        return []
    settings = BcConfig(episodes=config.warm_episodes, seed=config.seed)
    folder = (start or out) / "demos_delta"
    return demonstrations(env, settings, folder, progress)


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


def _share(config: RlConfig, steps: int) -> float:
    """Share of episodes that the expert begins: falls to zero in the middle of training."""
    return 0.7 * max(0.0, 1.0 - 2.0 * steps / config.steps) if config.curriculum else 0.0


def _model(config: RlConfig, venv: Any, demos: list[Demonstration], out: Path) -> Any:
    """A fresh SB3 model with fixed observation statistics."""
    import stable_baselines3 as sb3

    algorithm: Any = {"ppo": sb3.PPO, "sac": sb3.SAC}[config.algo]
    rows = np.concatenate([d.obs for d in demos]) if demos else _random_rows(venv, config.seed)
    kwargs: dict[str, Any] = {
        "net_arch": list(WIDTH),
        "features_extractor_class": Normalise,
        "features_extractor_kwargs": {
            "mean": rows.mean(0).tolist(),
            "std": np.maximum(rows.std(0), 1e-2).tolist(),
        },
        "activation_fn": torch.nn.Tanh,
    }
    common: dict[str, Any] = {"device": "cpu", "seed": config.seed, "gamma": GAMMA, "verbose": 0}
    if has("tensorboard"):
        common["tensorboard_log"] = str(out / "tensorboard")
    if config.algo == "ppo":
        kwargs["log_std_init"] = -2.0 if demos else -0.7
        return algorithm(
            "MlpPolicy",
            venv,
            n_steps=max(config.rollout // config.processes, 8),
            batch_size=256,
            n_epochs=6,
            learning_rate=1e-4 if demos else 3e-4,
            ent_coef=0.0,
            clip_range=0.15,
            target_kl=0.03,
            policy_kwargs=kwargs,
            **common,
        )
    return algorithm(
        "MlpPolicy",
        venv,
        buffer_size=min(config.steps, 200_000),
        learning_starts=min(2000, config.steps // 4),
        batch_size=256,
        train_freq=4,
        gradient_steps=2,
        policy_kwargs=kwargs,
        **common,
    )


def _clone(model: Any, demos: list[Demonstration], config: RlConfig) -> None:
    """Supervised warm start of the actor's mean action."""
    obs = torch.as_tensor(np.concatenate([d.obs for d in demos]), dtype=torch.float32)
    goal = torch.as_tensor(np.concatenate([d.actions for d in demos]), dtype=torch.float32)
    policy = model.policy
    optimiser = torch.optim.Adam(policy.parameters(), lr=1e-3)
    generator = torch.Generator().manual_seed(config.seed)
    for _ in range(60):
        for rows in torch.randperm(len(obs), generator=generator).split(256):
            error = torch.nn.functional.smooth_l1_loss(
                _mean_action(model, obs[rows]), goal[rows], beta=0.1
            )
            optimiser.zero_grad()
            error.backward()
            optimiser.step()


def _mean_action(model: Any, obs: torch.Tensor) -> torch.Tensor:
    policy = model.policy
    if hasattr(policy, "actor") and policy.actor is not None:  # SAC
        actor = policy.actor
        latent = actor.latent_pi(actor.extract_features(obs, actor.features_extractor))
        return torch.tanh(actor.mu(latent))
    features = policy.extract_features(obs, policy.pi_features_extractor)
    return policy.action_net(policy.mlp_extractor.forward_actor(features))


def actor_of(model: Any, sizes: dict[str, Any], horizon: int) -> MlpPolicy:
    """The SB3 actor's mean as an MlpPolicy: the same numbers, without SB3."""
    policy = model.policy
    sac = hasattr(policy, "actor") and policy.actor is not None
    out = MlpPolicy(
        sizes["observation"][-1][2],
        sizes["action_dim"],
        sizes["arm_joints"],
        1,
        WIDTH,
        horizon,
        timed=False,
        relative=False,
        squash="tanh" if sac else "clip",
        activation="tanh",
    )
    body = policy.actor.latent_pi if sac else policy.mlp_extractor.policy_net
    head = policy.actor.mu if sac else policy.action_net
    source = [*(m for m in body if isinstance(m, torch.nn.Linear)), head]
    target = [m for m in out.net if isinstance(m, torch.nn.Linear)]
    for ours, theirs in zip(target, source, strict=True):
        ours.load_state_dict(theirs.state_dict())
    normal = policy.actor.features_extractor if sac else policy.pi_features_extractor
    out.mean.copy_(normal.mean)
    out.std.copy_(normal.std)
    return out.eval()


def _listener(
    config: RlConfig,
    out: Path,
    progress: OnProgress,
    saved: dict[str, Any] | None,
    on_checkpoint: Callable[[int], None],
) -> Any:
    from stable_baselines3.common.callbacks import BaseCallback

    class Listener(BaseCallback):
        """Counts success on full episodes, lowers the curriculum, saves, stops early."""

        def __init__(self) -> None:
            super().__init__()
            self.recent: list[bool] = list(saved["recent"]) if saved else []
            self.curve: list[tuple[int, float]] = list(saved["curve"]) if saved else []
            self.saved = int(saved["steps"]) if saved else 0

        def rate(self) -> float:
            """Success over the last full episodes."""
            return float(np.mean(self.recent)) if self.recent else 0.0

        def _on_rollout_start(self) -> None:  # the update of the rollout before is done
            steps = self.num_timesteps
            if steps - self.saved < config.save_every:
                return
            self.saved = steps
            self.curve.append((steps, self.rate()))
            more = {"recent": self.recent, "curve": self.curve}
            save_checkpoint(self.model, out / "checkpoint", more)
            on_checkpoint(steps)
            self.training_env.env_method("set_share", _share(config, steps))
            renew(self.model, config.seed, steps)

        def _on_step(self) -> bool:
            for over, info in zip(self.locals["dones"], self.locals["infos"]):
                if over and not info.get("helped"):
                    self.recent = [*self.recent[-39:], bool(info["success"])]
            rate, count = self.rate(), len(self.recent)
            self.logger.record("rollout/full_episode_success", rate)
            words = f"success {100 * rate:.0f} % of the last {count}"
            progress(config.algo, min(self.num_timesteps / config.steps, 1.0), words)
            return not (count >= 40 and rate >= config.stop_at)

    return Listener()


def _random_rows(venv: Any, seed: int, steps: int = 400) -> np.ndarray:
    """Observations under random actions, for the statistics of a start from scratch."""
    venv.seed(seed)
    venv.action_space.seed(seed)
    rows = [venv.reset()]
    for _ in range(steps):
        rows.append(venv.step([venv.action_space.sample() for _ in range(venv.num_envs)])[0])
    return np.concatenate(rows)
