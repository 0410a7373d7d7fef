"""Options of a verb: a dataclass that a YAML file fills and flags go over.

`--config FILE` holds the fields of the verb's dataclass; those that are dataclasses of a wing
(`pipeline`, `env` ...) are sections with that dataclass's fields. What belongs to another verb is
passed over, so that one file can serve a whole project; any other key that the verb does not have
is an error. `mam_pipeline.config_file` says how values are checked.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

import tyro

from mam_pipeline import config_file
from mam_pipeline.edited import check_ranges
from mam_pipeline.errors import ConfigError
from mam_sim.preset_files import values_of

V = TypeVar("V", bound="Verb")

SHORT_HELP, LONG_HELP = "--help", "--help-all"
PIXELS = ("bbox", "front")
"""Flags that take a row of pixels."""

OTHERS = ("pipeline", "env", "collect", "train", "bench", "algo", "joint", "task", "robot")
"""Names that some verb has; every verb passes over those of others."""


@dataclass(frozen=True, kw_only=True)
class Verb:
    """What all verbs have in common; subclasses add their arguments and `run`."""

    saved: ClassVar[tuple[str, ...]] = ()
    """Fields besides the sections that are saved beside a result."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """YAML file with settings, or the name of a preset (docs: Configuration); flags go over it."""
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
    values = values_of(file)
    base = _varied(kind.start(args, values), args)
    said = _parsed(fill(base, values, file or ""), prog, args)
    _check_ranges(said)
    _check_paths(said)
    home = said.home()
    if home is said:
        return said
    found = {name: getattr(home, name) for name, value in settings(home).items()}
    base = _varied(replace(base, **found), args)
    said = _parsed(fill(base, values, file or ""), prog, args)
    _check_ranges(said)
    return said


def _varied(base: V, args: Sequence[str]) -> V:
    """`base` with the randomisation that --randomise names, by itself or in an `env` section."""
    named = last_value(args, "--randomise")
    if named is None or not hasattr(base, "randomise"):
        return base
    values = values_of(named)
    section = values.get("env", values)
    chance = section.get("randomisation", section) if isinstance(section, Mapping) else section
    env: Any = vars(base)["env"]
    mixed = config_file.fill(env.randomisation, chance, named)
    changed: dict[str, Any] = {"env": replace(env, randomisation=mixed)}
    return replace(base, **changed)


def spread(args: Sequence[str]) -> list[str]:
    """Arguments in which the pixels after --bbox and --front, with commas or not, stand singly."""
    out: list[str] = []
    pixels = False
    for word in args:
        flag, equals, value = word.partition("=")
        if word.startswith("--"):
            pixels = flag.rpartition(".")[2].lstrip("-") in PIXELS
            if not (pixels and equals):
                out.append(word)
                continue
            out.append(flag)
            word = value
        out += [w for w in re.split(r"[,\s]+", word) if w] if pixels else [word]
    return out


def _check_ranges(options: Verb) -> None:
    """Raise ConfigError where a number is outside the range that its type says."""
    for f in fields(options):
        value = getattr(options, f.name)
        if is_dataclass(value) and not isinstance(value, type):
            check_ranges(value, "env." if f.name == "env" else "", flag=True)
    bare = {f.name: f for f in fields(options) if not is_dataclass(getattr(options, f.name))}
    check_ranges(options, flag=True, only=bare)


def _check_paths(value: Any) -> None:
    """Raise ConfigError where a path leads to something that is neither file nor folder.

    Whoever opens a pipe or a device waits, or reads without end.
    """
    if is_dataclass(value) and not isinstance(value, type):
        for f in fields(value):
            _check_paths(getattr(value, f.name))
    elif isinstance(value, list | tuple):
        for inner in value:
            _check_paths(inner)
    elif isinstance(value, Path) and value.exists() and not (value.is_file() or value.is_dir()):
        raise ConfigError(f"{value} is no ordinary file (a pipe, a device); save it to one first")


def _parsed(base: Verb, prog: str, args: Sequence[str]) -> Verb:
    from mam_sim.flags import REGISTRY, SHORT

    words = spread(args)
    asked = _help_of(words)
    if asked is None:
        said = io.StringIO()
        try:
            with redirect_stdout(said), redirect_stderr(said):
                return tyro.cli(type(base), prog=prog, args=words, default=base, registry=REGISTRY)
        except SystemExit as stop:
            raise ConfigError(_sentence(said.getvalue(), prog)) from stop
    token = SHORT.set(asked == SHORT_HELP)
    try:
        return tyro.cli(type(base), prog=prog, args=["--help"], default=base, registry=REGISTRY)
    finally:
        SHORT.reset(token)
        if asked == SHORT_HELP:
            print(f"{prog} {LONG_HELP} shows all options")


_TOLD = {
    r"^Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)$":
        r"\1 must be a whole number, not \2",
    r"^Error parsing (\S+): no type matching (?:\{None\}\|)?\{?([^}]*?)\}? could be instantiated "
    r"from \[(.*?)\]\. Got errors.*": r"\1 takes \2, not \3",
    r"^Missing value for argument '(\S+)'.*": r"\1 needs a value",
    r"^invalid choice (.*?) for argument '(\S+)'. Expected one of \((.*?),?\)\.?$":
        r"\2 must be one of \3, not \1",
    r"^Unrecognized options: (--[^,]*).*$": r"there is no option \1",
    r"^Unrecognized options: (.*)$": r"\1 is too much",
    r"^Missing from .*?: (-*\S+)(?: [A-Z]+)? (.*?)\.? \(required\).*": r"\1 is missing: \2",
}  # fmt: skip
"""What tyro says of a wrong flag, and how it is said here."""


def _sentence(box: str, prog: str) -> str:
    """What tyro says of a wrong flag in a box, below its title, as one sentence."""
    text = "\n".join(row.strip("│| ") for row in box.splitlines())
    _, *parts = (" ".join(p.split()) for p in re.split(r"\n[─-]+\n", text))
    what = parts[0]
    for pattern, words in _TOLD.items():
        what = re.sub(pattern, words, what)
    near = [flag for part in parts for flag in re.findall(r"^Perhaps you meant: (--\S+)", part)]
    hint = f"did you mean {near[0]}? " if near else ""
    return f"{what[:500]}; {hint}{prog} --help lists what there is"


def _help_of(args: Sequence[str]) -> str | None:
    """Which help an argument asks for, if one does."""
    words = args[: args.index("--")] if "--" in args else args
    if LONG_HELP in words:
        return LONG_HELP
    return SHORT_HELP if {"-h", SHORT_HELP} & set(words) else None


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


def carried(
    options: Verb, args: Sequence[str] = (), sections: Sequence[str] = ("env",)
) -> list[str]:
    """Flags with which another verb takes over what the user chose for this one.

    Args:
        options: of the verb that has run.
        args: flags that decide defaults (--task).
        sections: those that are carried over; their flags are those that differ from the defaults
            and from the file, which is carried too.
    """
    values = values_of(options.config)
    base = fill(type(options).start(args, values), values, options.config or "")
    words = [] if options.config is None else ["--config", str(options.config)]
    for name in sections:
        prefix = "env." if name == "env" else ""
        words += differing(getattr(options, name), getattr(base, name), prefix)
    return words


def differing(value: Any, base: Any, prefix: str = "", only: Sequence[str] = ()) -> list[str]:
    """Flags that turn the settings `base` into `value`, both of one dataclass.

    Args:
        prefix: of the flags ("env."), which the sections in it lengthen; without one, none do.
        only: names of the settings that matter; empty: all.
    """
    words = []
    for f in fields(value):
        now, then = getattr(value, f.name), getattr(base, f.name)
        if now != then and (not only or f.name in only):
            words += _said(f.name, now, then, prefix)
    return words


def _said(name: str, now: Any, then: Any, prefix: str) -> list[str]:
    """One setting as flags: --name VALUES, --no-name, or those of a section."""
    if is_dataclass(now):
        return differing(now, then, f"{prefix}{name}." if prefix else "")
    if isinstance(now, Mapping) and any(is_dataclass(v) for v in now.values()):
        inner = f"{prefix}{name}." if prefix else ""
        return [w for k in now if k in then for w in _said(k, now[k], then[k], inner)]
    flag = name.replace("_", "-")
    if isinstance(now, bool):
        return [f"--{prefix}{'' if now else 'no-'}{flag}"]
    if isinstance(now, Mapping):
        return [f"--{prefix}{flag}", *(str(w) for pair in now.items() for w in pair)]
    many = now if isinstance(now, list | tuple) else (now,)
    from mam_sim.flags import REPEATED

    if name in REPEATED:
        return [w for value in many for w in (f"--{prefix}{flag}", str(value))]
    return [f"--{prefix}{flag}", *map(str, many)]


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
