"""Configurations are dataclasses; a YAML file fills them, strictly.

A file holds some of a dataclass's fields, nested as the dataclasses are; what it leaves out keeps
its default. An unknown key or a value of the wrong type is a ConfigError of one sentence that
names the file and the key. `save` writes every field, in the form that `fill` reads.
"""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union

import numpy as np
import yaml

from mam_pipeline import folders
from mam_pipeline.edited import read_yaml, shown, value_as
from mam_pipeline.errors import ConfigError
from mam_pipeline.secrets import bare_url, masked

T = TypeVar("T")


def read(file: str | Path) -> dict[str, Any]:
    """The mapping that a YAML (or JSON) file holds; an empty file is an empty mapping.

    Raises:
        ConfigError: no such file, no YAML, or something else than a mapping.
    """
    path = Path(file)
    if not path.is_file():
        raise ConfigError(f"there is no configuration file {path}")
    values = read_yaml(path).values
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must hold names and values, not {shown(values)}")
    return values


def fill(base: T, values: Mapping[str, Any], source: str | Path = "") -> T:
    """A copy of the dataclass `base` with (nested) `values` put in.

    Args:
        base: holds the value of every field that `values` leaves out.
        values: by field name; a nested dataclass takes a mapping or an instance.
        source: where the values come from, named in errors: a file, a function.

    Raises:
        ConfigError: an unknown key (the nearest is named), or a value of the wrong type.
    """
    place = f"{source}: " if source else ""
    return _fill(base, values, "", place)


def save(config: Any, file: Path) -> None:
    """Write every field of a dataclass, or of a mapping of dataclasses, as YAML."""
    text = yaml.safe_dump(plain(config), sort_keys=False, allow_unicode=True)
    folders.write_text(file, text)


def plain(value: Any) -> Any:
    """`value` as YAML holds it: dataclasses as mappings, tuples as lists, paths made absolute.

    Secrets are masked, and URLs lose user, password and keys.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, Path):
        return str(value.absolute())
    if isinstance(value, str):
        return bare_url(masked(value))
    if isinstance(value, np.generic):
        return value.item()
    return value


def _fill(base: T, values: Any, where: str, place: str) -> T:
    if isinstance(values, type(base)):
        return values
    if not isinstance(values, Mapping):
        raise ConfigError(
            f"{place}{where or type(base).__name__} must hold names and values, not {shown(values)}"
        )
    hints = typing.get_type_hints(type(base), include_extras=True)
    known = [f.name for f in fields(base)]  # type: ignore[arg-type]
    out = {}
    for key, value in values.items():
        name = f"{where}.{key}" if where else str(key)
        if key not in known:
            raise ConfigError(f"{place}{_unknown(base, str(key), where)}")
        out[key] = _value(hints[key], getattr(base, key), value, name, place)
    return replace(base, **out)  # type: ignore[type-var]


def _unknown(base: Any, key: str, where: str) -> str:
    """A sentence that names the nearest key, of this level or else of a section below."""
    within = f" in {where}" if where else ""
    known = [f.name for f in fields(base)]
    deeper = [n for n in paths(base) if n.rsplit(".", 1)[-1] == key]
    near = difflib.get_close_matches(key, known, n=1) or deeper
    near = near or difflib.get_close_matches(key, list(paths(base)), n=1)
    if near:
        full = f"{where}.{near[0]}" if where else near[0]
        return f"there is no setting {key!r}{within}; did you mean {full!r}?"
    return f"there is no setting {key!r}{within}; there are: {', '.join(known)}"


def paths(config: Any, above: str = "") -> list[str]:
    """Dotted names of all settings of a dataclass, sections first seen first."""
    out = []
    for f in fields(config):
        value = getattr(config, f.name)
        if is_dataclass(value):
            out += [f"{above}{f.name}", *paths(value, f"{above}{f.name}.")]
        else:
            out.append(f"{above}{f.name}")
    return out


def _value(kind: Any, base: Any, value: Any, name: str, place: str) -> Any:
    """`value` as the annotation `kind` wants it.

    Raises:
        ConfigError: it is of another type.
    """
    value = value.item() if isinstance(value, np.generic) else value
    bare = typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else kind
    origin, arguments = typing.get_origin(bare), typing.get_args(bare)
    if bare is Any:
        return value
    if origin in (Union, types.UnionType) and any(_nested(k) for k in arguments):
        return _one_of(arguments, base, value, name, place)
    if isinstance(bare, type) and is_dataclass(bare):
        start = base if isinstance(base, bare) else bare()
        return _fill(start, value, name, place)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(arguments, base, value, name, place)
    made = value_as(kind, value, name, place.removesuffix(": "))
    return made.expanduser() if isinstance(made, Path) else made


def _nested(kind: Any) -> bool:
    """Whether an annotation holds settings of its own."""
    origin = typing.get_origin(kind)
    return (isinstance(kind, type) and is_dataclass(kind)) or (
        isinstance(origin, type) and issubclass(origin, Mapping)
    )


def _one_of(kinds: Sequence[Any], base: Any, value: Any, name: str, place: str) -> Any:
    if value is None and type(None) in kinds:
        return None
    wanted = [k for k in kinds if k is not type(None)]
    errors = []
    for kind in wanted:
        try:
            return _value(kind, base, value, name, place)
        except ConfigError as error:
            errors.append(error)
    raise errors[-1]


def _mapping(kinds: Sequence[Any], base: Any, value: Any, name: str, place: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{place}{name} must hold names and values, not {shown(value)}")
    kind = kinds[1] if len(kinds) > 1 else Any
    before = base if isinstance(base, Mapping) else {}
    return {str(k): _value(kind, before.get(k), v, f"{name}.{k}", place) for k, v in value.items()}
