"""Configurations that come with the package, by name: `--config paper`."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError

FOLDER = Path(__file__).parent / "presets"  # the repository's configs/
SECTIONS = ("pipeline", "env", "policies")


def presets() -> dict[str, Path]:
    """The packaged files by their names without suffix."""
    return {f.stem: f for s in SECTIONS for f in sorted((FOLDER / s).glob("*.yaml"))}


def located(config: str | Path) -> Path:
    """The file that a path, or the name of a preset, means.

    Raises:
        ConfigError: a bare name that is neither a file here nor a preset.
    """
    path, known = Path(config), presets()
    if path.exists() or path.suffix or path.name != str(config):
        return path
    if str(config) not in known:
        near = difflib.get_close_matches(str(config), known, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ConfigError(
            f"there is neither a file nor a preset {config}{hint} (presets: {', '.join(known)})"
        )
    return known[str(config)]


def values_of(config: str | Path | None) -> dict[str, Any]:
    """What a configuration file, or the preset of that name, holds; {} for None.

    Raises:
        ConfigError: there is no such file and no such preset, or it is no mapping in YAML.
    """
    return {} if config is None else config_file.read(located(config))
