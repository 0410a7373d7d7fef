"""Which assets are meant: asset folders, and folders that hold some."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import ConfigError
from mam_pipeline.formats.door import entries, is_file


def asset_folders(paths: Sequence[Path]) -> list[Path]:
    """Asset folders, each once: those named, and in a folder that is none, all directly in it.

    Raises:
        InputError: a path is no asset and holds none.
    """
    out: dict[Path, None] = {}
    for path in paths:
        inside = []
        if path.is_dir() and not (path / "asset.json").is_file():
            inside = [p for p in entries(path) if is_file(p / "asset.json")]
        for folder in inside or [Asset.card_of(path).folder]:
            out[folder.resolve()] = None
    return list(out)


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
