"""Learning algorithms: what each of them is, and the names that `mam-sim train --algo` knows.

An algorithm is a frozen dataclass of settings, and a class that trains a run folder with them and
acts from that folder. Listing the names imports none of them, and the settings of the built-in ones
(`mam_policies.settings`) need no torch. Other packages add theirs by an entry point in the group
`mam_sim.algorithm` (docs/extend/algorithm.md).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from mam_pipeline.errors import ConfigError
from mam_policies import settings
from mam_policies.settings import ALGORITHMS, check_least

__all__ = ["ALGORITHMS", "Actor", "Algorithm", "OnProgress", "algorithm", "check_least",
           "settings_of"]  # fmt: skip

if TYPE_CHECKING:  # torch is not needed to list names
    import numpy as np
    from numpy.typing import NDArray

    from mam_policies.mlp import MlpPolicy
    from mam_policies.run import EnvChoice, RunInfo

SETTINGS: dict[str, type[Any]] = {
    "bc": settings.BcConfig,
    "bc_rgb": settings.BcRgbConfig,
    "ppo": settings.PpoConfig,
    "sac": settings.SacConfig,
    "act": settings.LeRobotConfig,
    "diffusion": settings.LeRobotConfig,
    "smolvla": settings.LeRobotConfig,
}
"""Settings of the built-in algorithms, so that reading a command line loads none of them."""

OnProgress = Callable[[str, float, str], None]
"""Called with (phase, share of it that is done, words for people)."""
Settings = TypeVar("Settings")


class Actor(Protocol):
    """A trained policy that acts in one environment, step by step."""

    def reset(self) -> None:
        """Start an episode."""

    def act(self, obs: Any) -> NDArray[np.float32]:
        """The action (m,) for the environment's observation."""


class Algorithm(ABC, Generic[Settings]):
    """A way to make a policy for an environment.

    Attributes:
        name: the one in the registry; it is written into the run.
        Config: frozen dataclass of all settings, each with a default and a sentence.
        control_mode: of the arm, in ManiSkill's words.
        leaves_lerobot: whether a run holds policy/, a folder that LeRobot loads as it is.
    """

    name: ClassVar[str]
    Config: ClassVar[type[Any]]
    control_mode: ClassVar[str] = "pd_joint_pos"
    leaves_lerobot: ClassVar[bool] = False

    @abstractmethod
    def train(
        self,
        choice: EnvChoice,
        config: Settings,
        out: Path,
        update: OnProgress = lambda *_: None,
    ) -> RunInfo:
        """Train into the run folder `out`, or go on where a killed run was.

        Args:
            choice: the environment; `choice.make()` builds it.
            config: an instance of `Config`.
            out: the run folder; run.json is written last.
            update: told about progress.

        Returns:
            What was saved as run.json.
        """

    def env_arguments(self, info: RunInfo) -> dict[str, Any]:
        """Further arguments of the environment that the run's policy acts in."""
        return {}

    def actor(self, run: Path, env: Any) -> Actor:
        """The policy of a run folder, ready to act in `env`.

        This one reads policy.safetensors; an algorithm with another kind of policy overrides it.

        Raises:
            InputError: no policy there.
        """
        from mam_policies.mlp import MlpActor

        return MlpActor(self.network(run))

    def network(self, run: Path) -> MlpPolicy:
        """The small network that is the whole policy of a run: what export and deploy take.

        Raises:
            ConfigError: the algorithm acts by something else. InputError: no policy there.
        """
        if type(self).actor is not Algorithm.actor:
            raise ConfigError(
                f"{run} is a run of {self.name}, which acts by more than one small network; only "
                "`mam-sim eval` runs that, export and deploy do not; bc, ppo and sac have such a "
                "network, and act, diffusion and smolvla are exported as folders of LeRobot"
            )
        from mam_policies.mlp import MlpPolicy

        return MlpPolicy.load(run)


def algorithm(name: str) -> Algorithm[Any]:
    """The algorithm of that name.

    Raises:
        ConfigError: no such name; the message names the nearest.
        BackendError: a package that it needs is missing.
    """
    found: Algorithm[Any] = ALGORITHMS.load(name)()
    return found


def settings_of(name: str) -> type[Any]:
    """The dataclass of an algorithm's settings.

    Raises:
        ConfigError, BackendError: as `algorithm`.
    """
    return SETTINGS[name] if name in SETTINGS else algorithm(name).Config
