"""Which assets are meant: asset folders, folders that hold some, and batches of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mam_pipeline.asset.card import Asset
from mam_pipeline.claims import ASSET, BATCH, is_ours
from mam_pipeline.formats.door import entries, is_file

CARD = ASSET.file
BATCH_ASSETS = "assets"
"""The folder in a batch's that holds its assets, each in a folder of its own."""


def assets_in(folder: Path, *marks: str) -> list[Path]:
    """Folders directly in one that is no asset itself, and that hold a card or one of `marks`.

    Of a batch's folder, those in its folder of assets.
    """
    if not folder.is_dir() or is_file(folder / CARD):
        return []
    if is_ours(folder / BATCH.file, BATCH) and (folder / BATCH_ASSETS).is_dir():
        folder /= BATCH_ASSETS
    return [p for p in entries(folder) if any(is_file(p / name) for name in (CARD, *marks))]


def asset_folders(paths: Sequence[Path]) -> list[Path]:
    """Asset folders, each once: those named, and all of a folder or batch of assets.

    Raises:
        InputError: a path is no asset and holds none.
    """
    out: dict[Path, None] = {}
    for path in paths:
        for folder in assets_in(path) or [Asset.card_of(path).folder]:
            out[folder.resolve()] = None
    return list(out)
