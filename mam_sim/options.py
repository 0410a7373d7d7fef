"""Options of a verb: a dataclass that a YAML file fills and flags go over.

`--config FILE` holds the fields of the verb's dataclass; those that are dataclasses of a wing
(`pipeline`, `env` ...) are sections with that dataclass's fields. A section that belongs to
another verb is passed over, so that one file can serve a whole project; any other key that the
verb does not have is an error. `mam_pipeline.config_file` says how values are checked.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from mam_pipeline import config_file

SECTIONS = ("pipeline", "env", "collect", "train", "evaluate", "bench")
"""Sections that some verb has; every verb passes over those of others."""


@dataclass(frozen=True, kw_only=True)
class Verb:
    """What all verbs have in common; subclasses add their arguments and `run`."""

    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """YAML file with settings; flags go over it."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> int:
        """Do it; returns the exit status."""
        raise NotImplementedError


V = TypeVar("V", bound=Verb)


def parse(kind: type[V], prog: str, args: Sequence[str]) -> V:
    """The options that a command line and its `--config` file say.

    Raises:
        ConfigError: the file is missing, or holds something that the verb does not have.
        SystemExit: a flag is wrong (2), or --help was asked for (0).
    """
    base = defaults(kind)
    file = _config_of(args)
    if file is not None:
        base = from_file(base, file)
    return tyro.cli(kind, prog=prog, args=list(args), default=base)


def from_file(base: V, file: Path) -> V:
    """`base` with a file's values put in; sections of other verbs are passed over.

    Raises:
        ConfigError: the file is missing, or holds something that the verb does not have.
    """
    own = {f.name for f in fields(base)}
    values = config_file.read(file)
    told = {k: v for k, v in values.items() if k in own or k not in SECTIONS}
    return config_file.fill(base, told, file)


def defaults(kind: type[V]) -> V:
    """A verb's options with every default, and `tyro.MISSING` where the user must say."""
    required = {
        f.name: tyro.MISSING
        for f in fields(kind)
        if f.default is MISSING and f.default_factory is MISSING
    }
    return kind(**required)


def sections(options: Verb) -> dict[str, Any]:
    """The settings of a verb that belong to wings, as a file holds them and `--config` reads."""
    found = {f.name: getattr(options, f.name) for f in fields(options)}
    return {name: config_file.plain(v) for name, v in found.items() if is_dataclass(v)}


def _config_of(args: Sequence[str]) -> Path | None:
    """The value of the last --config among arguments."""
    file = None
    for i, word in enumerate(args):
        if word == "--":
            break
        if word == "--config" and i + 1 < len(args):
            file = Path(args[i + 1])
        elif word.startswith("--config="):
            file = Path(word.partition("=")[2])
    return file


def say_error(text: str) -> None:
    """One sentence on stderr."""
    print(f"mam-sim: {text}", file=sys.stderr)
