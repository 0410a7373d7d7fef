"""Which assets are meant: asset folders, and folders that hold some."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mam_pipeline.asset.card import Asset
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
