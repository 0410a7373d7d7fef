"""Tables that lie in the package as YAML."""

from __future__ import annotations

from importlib import resources
from typing import Any

import yaml

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""libyaml's, seven times as fast, where PyYAML was built with it."""


def table(package: str, *path: str) -> Any:
    """What a YAML file of a package holds.

    Args:
        package: its dotted name. path: of the file, below the package's folder.
    """
    text = resources.files(package).joinpath(*path).read_text(encoding="utf-8")
    return yaml.load(text, Loader=_LOADER)  # safe: both loaders make plain data only
