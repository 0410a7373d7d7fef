"""How every trainer is started: `python -m mam_training.… configs/train/….yaml [--name value]`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TypeVar

import tyro

from mam_pipeline import config_file

T = TypeVar("T")


def configured(base: T, argv: Sequence[str] | None = None) -> T:
    """The config of a trainer: its defaults, a YAML file's values over them, then flags.

    Args:
        base: the defaults. argv: what was typed after the module's name.

    Raises:
        ConfigError: no such file, an unknown key, or a value of the wrong type.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and not arguments[0].startswith("-"):
        file = arguments.pop(0)
        base = config_file.fill(base, config_file.read(file), file)
    return tyro.cli(type(base), default=base, args=arguments)
