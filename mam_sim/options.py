"""Options of a verb: a dataclass that a YAML file fills and flags go over.

`--config FILE` holds the fields of the verb's dataclass; those that are dataclasses of a wing
(`pipeline`, `env` ...) are sections with that dataclass's fields. What belongs to another verb is
passed over, so that one file can serve a whole project; any other key that the verb does not have
is an error. `mam_pipeline.config_file` says how values are checked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

import tyro

from mam_pipeline import config_file

V = TypeVar("V", bound="Verb")

OTHERS = ("pipeline", "env", "collect", "train", "bench", "algo", "joint", "task", "robot")
"""Names that some verb has; every verb passes over those of others."""


@dataclass(frozen=True, kw_only=True)
class Verb:
    """What all verbs have in common; subclasses add their arguments and `run`."""

    saved: ClassVar[tuple[str, ...]] = ()
    """Fields besides the sections that are saved beside a result."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """YAML file with settings; flags go over it."""
    quiet: bool = False
    """Print nothing but errors."""

    @classmethod
    def start(cls, args: Sequence[str], values: Mapping[str, Any]) -> Verb:
        """Defaults for a command line and the values of its file, where these decide them."""
        return defaults(cls)

    def home(self) -> Self:
        """These options with defaults that what they name brings along (the settings of a run)."""
        return self

    def run(self) -> int:
        """Do it; returns the exit status."""
        raise NotImplementedError


def parse(kind: type[Verb], prog: str, args: Sequence[str]) -> Verb:
    """The options that a command line and its `--config` file say.

    Raises:
        ConfigError: the file is missing, or holds something that the verb does not have.
        SystemExit: a flag is wrong (2), or --help was asked for (0).
    """
    file = last_value(args, "--config")
    values = {} if file is None else config_file.read(file)
    base = kind.start(args, values)
    said = _parsed(fill(base, values, file or ""), prog, args)
    home = said.home()
    if home is said:
        return said
    found = {name: getattr(home, name) for name, value in settings(home).items()}
    return _parsed(fill(replace(base, **found), values, file or ""), prog, args)


def _parsed(base: Verb, prog: str, args: Sequence[str]) -> Verb:
    from mam_sim.flags import REGISTRY

    return tyro.cli(type(base), prog=prog, args=list(args), default=base, registry=REGISTRY)


def fill(base: V, values: Mapping[str, Any], source: str | Path = "") -> V:
    """`base` with the values of a file put in; those that belong to other verbs are passed over.

    Raises:
        ConfigError: the file holds something that the verb does not have.
    """
    own = {f.name for f in fields(base)}
    told = {k: v for k, v in values.items() if k in own or k not in OTHERS}
    return config_file.fill(base, told, source)


def defaults(kind: type[V]) -> V:
    """A verb's options with every default, and `tyro.MISSING` where the user must say."""
    required = {
        f.name: tyro.MISSING
        for f in fields(kind)
        if f.default is MISSING and f.default_factory is MISSING
    }
    return kind(**required)


def settings(options: Verb) -> dict[str, Any]:
    """What is saved beside a result, and what `--config` reads again: the verb's sections."""
    found = {f.name: getattr(options, f.name) for f in fields(options)}
    return {
        name: config_file.plain(value)
        for name, value in found.items()
        if name in options.saved or is_dataclass(value)
    }


def last_value(args: Sequence[str], flag: str) -> str | None:
    """The value of the last `flag` among arguments."""
    found = None
    for i, word in enumerate(args):
        if word == "--":
            break
        if word == flag and i + 1 < len(args):
            found = args[i + 1]
        elif word.startswith(f"{flag}="):
            found = word.partition("=")[2]
    return found
