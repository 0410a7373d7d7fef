"""Names of the learning algorithms, their settings, and those of the demonstrations for them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from mam_pipeline.edited import Range, Seed
from mam_pipeline.errors import ConfigError
from mam_pipeline.registry import Registry

ALGORITHMS = Registry(
    "algorithm",
    {
        "bc": "mam_policies.algorithms.bc:BehaviourCloning",
        "bc_rgb": "mam_policies.algorithms.bc_rgb:CameraCloning",
        "ppo": "mam_policies.algorithms.ppo:Ppo",
        "sac": "mam_policies.algorithms.sac:Sac",
        "act": "mam_policies.algorithms.lerobot_policies:Act",
        "diffusion": "mam_policies.algorithms.lerobot_policies:Diffusion",
        "smolvla": "mam_policies.algorithms.lerobot_policies:SmolVla",
    },
)


@dataclass(frozen=True, kw_only=True)
class DemonstrationConfig:
    """Settings of the demonstrations."""

    episodes: Annotated[int, Range(0, 100_000)] = 80
    """Successful demonstrations of the scripted expert."""
    noise: Annotated[float, Range(0, 1)] = 0.008
    """Standard deviation of the expert's execution noise, radians; every third episode has none."""
    settle: Annotated[int, Range(0, 1000)] = 6
    """Control steps of standing still that are recorded after success."""
    seed: Seed = 0
    """Of everything random."""


@dataclass(frozen=True, kw_only=True)
class BcConfig(DemonstrationConfig):
    """Settings of behaviour cloning."""

    epochs: int = 150
    """Passes over the demonstrations."""
    batch: int = 256
    """Rows of one gradient step."""
    learning_rate: float = 1e-3
    """Of Adam, at the start of a cosine schedule."""
    chunk: int = 8
    """Actions predicted at once."""
    hidden: tuple[int, ...] = (256, 256)
    """Widths of the network's hidden layers."""
    deployable: bool = False
    """See positions only, no velocities and no touch, which real arms do not report."""
    rounds: int = 0
    """DAgger rounds: the policy acts, the expert labels, and training starts anew on all data."""
    round_episodes: int = 20
    """Episodes of one round."""
    stop_at: float = 0.95
    """Share of a round's episodes that succeed at which no further round follows."""
    lost: float = 0.5
    """Radians off the expert's plan at which an episode of a round ends."""
    checkpoint_every: int = 25
    """Epochs between checkpoints."""

    def __post_init__(self) -> None:
        check_least(self, episodes=1, epochs=1, batch=1, chunk=1, rounds=0, checkpoint_every=1)


@dataclass(frozen=True, kw_only=True)
class BcRgbConfig(BcConfig):
    """Settings of behaviour cloning that sees one camera."""

    deployable: bool = True
    """The clone sees positions only; always so here."""
    pictures: int = 4000
    """Pictures to learn to see from."""
    every: int = 4
    """Control steps of the expert between two of them."""
    sight_epochs: int = 15
    """Passes over the pictures."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_least(self, pictures=1, every=1, sight_epochs=1)


@dataclass(frozen=True, kw_only=True)
class Sb3Config(DemonstrationConfig):
    """Settings that ppo and sac share."""

    episodes: Annotated[int, Range(0, 100_000)] = 80
    """Demonstrations of the expert cloned into the actor first; 0 starts from scratch."""
    demos_from: Path | None = None
    """Run folder whose demonstrations are used; default: the run's own."""
    steps: int = 200_000
    """Environment steps in all."""
    processes: int = 1
    """Environments, each in a process of its own if there are several."""
    curriculum: bool = True
    """Start some episodes part of the way along the expert's path."""
    curriculum_share: float = 0.7
    """Share of such episodes at the start; it falls to 0 in the middle of training."""
    stop_at: float = 0.95
    """Share of the last full episodes that succeed at which training ends early."""
    window: int = 40
    """Number of those episodes."""
    save_every: int = 8192
    """Environment steps between checkpoints."""
    gamma: float = 0.98
    """Discount per control step."""
    batch: int = 256
    """Rows of one gradient step."""
    hidden: tuple[int, ...] = (256, 256)
    """Widths of the hidden layers of actor and critic."""
    clone_epochs: int = 60
    """Passes over the demonstrations when they are cloned."""
    clone_learning_rate: float = 1e-3
    """Of Adam, when they are cloned."""

    def __post_init__(self) -> None:
        check_least(self, episodes=0, steps=1, processes=1, window=1, save_every=1, batch=1)


@dataclass(frozen=True, kw_only=True)
class PpoConfig(Sb3Config):
    """Settings of ppo."""

    rollout: int = 2048
    """Environment steps between two updates, of all processes together."""
    update_epochs: int = 6
    """Passes over a rollout."""
    learning_rate: float = 3e-4
    """Of Adam, from scratch."""
    cloned_learning_rate: float = 1e-4
    """Of Adam, after a clone."""
    log_std: float = -0.7
    """Logarithm of the exploration noise (normalised actions) at the start, from scratch."""
    cloned_log_std: float = -2.0
    """The same, after a clone."""
    clip_range: float = 0.15
    """By how much an update may change an action's probability, as a share."""
    target_kl: float = 0.03
    """Divergence from the old policy at which an update ends."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_least(self, rollout=8, update_epochs=1)


@dataclass(frozen=True, kw_only=True)
class SacConfig(Sb3Config):
    """Settings of sac."""

    learning_rate: float = 3e-4
    """Of Adam."""
    buffer: int = 200_000
    """Environment steps that are remembered at most."""
    learning_starts: int = 2000
    """Environment steps before the first update, at most a quarter of all."""
    train_every: int = 4
    """Environment steps between two updates."""
    gradient_steps: int = 2
    """Gradient steps of one update."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_least(self, buffer=1, train_every=1, gradient_steps=1)


@dataclass(frozen=True, kw_only=True)
class LeRobotConfig:
    """Settings of act, diffusion and smolvla."""

    episodes: Annotated[int, Range(0, 100_000)] = 80
    """Successful demonstrations of the scripted expert."""
    noise: Annotated[float, Range(0, 1)] = 0.008
    """Standard deviation of the expert's execution noise in them, radians."""
    seed: Seed = 0
    """Of everything random."""
    steps: int = 20_000
    """Training steps, in every round."""
    batch: int = 8
    """Frames of one training step."""
    cameras: bool = True
    """See pictures and motors, as on a real arm (needs a Vulkan driver); else motors and the
    privileged state."""
    mapping: Path | None = None
    """Joint mapping of the real arm (see mam-sim export); needed for arms that LeRobot drives."""
    download: bool = False
    """Start from weights on the Hub (ImageNet for act, the base model for smolvla)."""
    rounds: int = 0
    """DAgger rounds: the policy acts, the expert labels, and training goes on with all data."""
    round_episodes: int = 20
    """Episodes of one round."""
    lost: float = 0.5
    """Radians off the expert's plan at which an episode of a round ends."""
    more: tuple[str, ...] = ()
    """Further arguments for lerobot-train, as they are."""

    def __post_init__(self) -> None:
        check_least(self, episodes=1, steps=1, batch=1, rounds=0)


def check_least(config: Any, **least: float) -> None:
    """Check that settings are not below their least values.

    Raises:
        ConfigError: one is.
    """
    for name, bound in least.items():
        if getattr(config, name) < bound:
            raise ConfigError(f"{name} must be at least {bound}, not {getattr(config, name)}")
