"""Assets in other formats: who writes which. Other packages do, by the format's name."""

from __future__ import annotations

from pathlib import Path

from mam_pipeline.asset.card import Asset
from mam_pipeline.optional import not_installed
from mam_pipeline.registry import Registry


def export_asset(asset: Asset, kind: str, path: Path) -> Path:
    """Write an asset as one file and what belongs to it; plugins/mam_sim_formats has the writers.

    Args:
        kind: the format: mjcf, usd, usdz or sdf. path: of the file.

    Raises:
        MissingExtra: the package that writes the format, or one that it needs, is not installed.
        InputError: the format cannot hold the asset.
    """
    table = Registry("exporter", {})
    if kind not in table.targets():
        raise not_installed(f"{kind.upper()} export")
    written: Path = table.load(kind)(asset, path)
    return written
