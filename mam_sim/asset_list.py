"""Which of several assets are taken: those that an arm can operate; some to train on, some not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mam_envs.config import EnvConfig
from mam_pipeline.errors import ConfigError, MamSimError


def split(folders: Sequence[Path], share: float, seed: int) -> tuple[list[Path], list[Path]]:
    """Some to train on, the rest to test on; at least one of each.

    Args:
        share: of those to train on, above 0 and below 1. seed: of the order.

    Raises:
        ConfigError: there are fewer than two.
    """
    if len(folders) < 2:
        raise ConfigError(f"--split needs at least two assets, not {len(folders)}")
    order = np.random.default_rng(seed).permutation(len(folders))
    count = int(np.clip(round(share * len(folders)), 1, len(folders) - 1))
    chosen = set(order[:count].tolist())
    train = [f for i, f in enumerate(folders) if i in chosen]
    return train, [f for i, f in enumerate(folders) if i not in chosen]


def operable(
    folders: Sequence[Path], joint: str | None, task: str | None, robot: str, config: EnvConfig,
    say: Callable[[str], None],
) -> tuple[list[str], list[str]]:  # fmt: skip
    """Asset folders that an arm can operate, and those that it cannot, told one by one.

    Raises:
        MamSimError: of the first, where it can operate none.
    """
    from mam_envs.robots import robot_spec
    from mam_envs.scene.layout import arrange

    fit, refused, errors = [], [], []
    for folder in folders:
        try:
            arrange(folder, joint, task, robot_spec(robot), "auto", config)
            fit.append(str(folder))
        except MamSimError as error:
            errors.append(error)
            refused.append(str(folder))
            say(f"left out: {error}")
    if not fit:
        raise errors[0]
    return fit, refused
