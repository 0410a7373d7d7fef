"""Where the files of an object are, and with which settings it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mam_pipeline import config_file
from mam_pipeline.asset.card import Asset
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import ConfigError
from mam_pipeline.folder_data import asset_settings
from mam_pipeline.formats.door import Door
from mam_pipeline.hints import Hints, load_hints
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import kind_of, make_asset


@dataclass(frozen=True)
class Place:
    """Where an object comes from and where its results go.

    Attributes:
        source: photo, mesh or URDF; None for an asset whose source is not at hand.
        asset: the asset that was opened or is to be written. hints: the hints file.
        config: how the asset is made.
    """

    source: Path | None
    asset: Path
    hints: Path
    config: MakeConfig


def place_of(given: Path, config: MakeConfig, out: Path | None = None) -> Place:
    """Where an input's files are.

    Args:
        given: photo, mesh, URDF or asset folder. config: of the command line; of an asset's own
            settings those are used that decide its geometry. out: the asset to write.

    Raises:
        InputError: there is no such input.
    """
    if not (given / "asset.json").is_file():
        kind_of(given)
        hints = config.hints or given.with_name(f"{given.stem}-hints.yaml")
        return Place(given, out or Path(f"{given.stem}-asset"), hints, config)
    asset = Asset.load(given)
    config = asset_settings(asset.folder, config)
    source = _source_of(asset)
    return Place(source, out or asset.folder, config.hints or _hints_of(asset, source), config)


def _hints_of(asset: Asset, source: Path | None) -> Path:
    """The hints file beside the asset, or the one beside its source that it says it was made with.

    The asset's word chooses between these two alone: it names no other file.
    """
    beside = asset.folder.with_name(f"{asset.card.name}-hints.yaml")
    kept = Door(asset.folder).find("stages/config.yaml", asset.folder / "asset.json", asset.folder)
    if source is None or kept is None:
        return beside
    of_source = source.with_name(f"{source.stem}-hints.yaml")
    said = config_file.read(kept).get("pipeline", {}).get("hints")
    return of_source if Path(str(said)).name == of_source.name else beside


def _source_of(asset: Asset) -> Path | None:
    """The file that an asset was made from, beside it or here, unchanged; None if there is none."""
    name = Path(str(asset.card.source.get("path", ""))).name
    for folder in (asset.folder.parent, Path.cwd()):
        file = folder / name
        if name and file.is_file() and file_digest(file) == asset.card.source.get("sha256"):
            return file
    return None


def yielding(config: MakeConfig, hints: Hints | None) -> MakeConfig:
    """The settings without what the hints say in their place."""
    if hints is None:
        return config
    free = config if hints.height is None else replace(config, height=None, scale=None)
    return replace(
        free,
        up="auto" if hints.up else config.up,
        facing="auto" if hints.facing else config.facing,
    )


def make(place: Place, tell: Callable[[str], None] = lambda _stage: None) -> Asset:
    """Write and check the asset exactly as `articulate` does, with the hints file that is there.

    Raises:
        MamSimError: as `make_asset`.
    """
    if place.source is None:
        raise ConfigError(f"{place.asset} was made already, and its source is not beside it")
    config = place.config
    if place.hints.is_file() and kind_of(place.source) != "urdf":
        config = replace(yielding(config, load_hints(place.hints)), hints=place.hints)
    return make_asset(place.source, place.asset, config, tell)
