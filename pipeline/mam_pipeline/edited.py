"""The one layer that reads what a person may edit: hints, parts, joints, settings, asset.json.

A file is YAML or JSON without aliases, tags and double keys, bounded in size and depth. What it
must hold says a dataclass, whose annotations give types, ranges and lengths; pydantic compares the
two. What is wrong is said in one sentence that names the file as the person knows it, the line
where that is known, the key, and what would be right.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import typing
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import AfterValidator, BeforeValidator, Field, GetCoreSchemaHandler, TypeAdapter
from pydantic import ValidationError as _Refusal
from pydantic_core import PydanticCustomError, core_schema

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.lengths import metres

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class EditLimits:
    """What a file that a person may edit can hold.

    Attributes:
        bytes: of the file. depth: of lists and mappings within each other.
        shown: characters of a wrong value that a sentence repeats.
    """

    bytes: int = 32 << 20
    depth: int = 32
    shown: int = 60


LIMITS = EditLimits()


ROUNDING = 1e-6
"""By so much a number may miss its range: sums of shares are rounded."""


HUGE = 1e9
"""Bounds from here on only keep numbers from overflowing."""


@dataclass(frozen=True)
class Range:
    """An annotation of a number: finite, from `low` to `high`; `above`: more than `low`.

    Example:
        >>> noise: Annotated[float, Range(0, 1)]
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """What pydantic asks for."""
        return core_schema.no_info_after_validator_function(self._within, handler(source))

    def _within(self, value: float | None) -> float | None:
        good = value is None or (
            math.isfinite(value) and self.low - ROUNDING <= value <= self.high + ROUNDING
            and not (self.above and value <= self.low)
        )  # fmt: skip
        if not good:
            raise PydanticCustomError("range", "must be {said}", {"said": self._words(value)})
        return value

    def _words(self, value: float | None) -> str:
        """The range; a bound that only keeps numbers from overflowing is said where it counts."""
        huge = self.high >= HUGE and (value is None or not value > self.high)
        return str(Range(self.low, math.inf, self.above) if huge else self)

    def __str__(self) -> str:
        if math.isinf(self.low) and math.isinf(self.high):
            return "a finite number"
        if math.isinf(self.high):
            return f"a number above {self.low:g}" if self.above else f"at least {self.low:g}"
        if math.isinf(self.low):
            return f"at most {self.high:g}"
        if self.above:
            return f"a number above {self.low:g} and at most {self.high:g}"
        return f"a number from {self.low:g} to {self.high:g}"


def _limit(value: Any) -> Any:
    """A joint without limits has infinite ones, which YAML and JSON of ours hold as text."""
    return float(value) if value in ("inf", "-inf") else value


def _not_nan(value: float) -> float:
    if math.isnan(value):
        raise ValueError("must be a number, not nan")
    return value


def _direction(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if sum(v * v for v in value) < 1e-12:
        raise ValueError("must not have zero length")
    return value


Finite = Annotated[float, Range(-1e9, 1e9)]
NotNegative = Annotated[float, Range(0, 1e9)]
Positive = Annotated[float, Range(0, 1e9, above=True)]
Length = Annotated[float, BeforeValidator(metres), Range(0, 1000, above=True)]
"""Metres, which may be written with a unit: 55cm."""
Share = Annotated[float, Range(0, 1)]
Index = Annotated[int, Range(0, 2**31)]
Count = Annotated[int, Range(1, 1e9)]
Seed = Annotated[int, Range(0, 2**31 - 1)]
Limit = Annotated[
    float, Field(allow_inf_nan=True), AfterValidator(_not_nan), BeforeValidator(_limit)
]
Word = Annotated[str, Field(min_length=1, max_length=200)]
Text = Annotated[str, Field(max_length=10_000)]
Vector = tuple[Finite, Finite, Finite]
Direction = Annotated[Vector, AfterValidator(_direction)]
Size = tuple[NotNegative, NotNegative, NotNegative]
STRICT: dict[str, Any] = {"extra": "forbid", "allow_inf_nan": False}
"""`__pydantic_config__` of a dataclass that is read here: no other keys, no NaN."""


class Wrong(ValueError):
    """Something that types cannot say is wrong at a place of a document."""

    def __init__(self, place: Place, text: str) -> None:
        super().__init__(text)
        self.place = place


@dataclass(frozen=True)
class Document:
    """What a file holds.

    Attributes:
        values: mappings, lists, text and numbers.
        source: the file as the person knows it, or whatever else the values come from.
        lines: line of every place, where it is known; the first is 1.
        error: what is raised where something is wrong.
    """

    values: Any
    source: str = ""
    lines: Mapping[Place, int] = field(default_factory=dict)
    error: type[ConfigError] | type[InputError] = ConfigError

    def wrong(self, place: Place, text: str) -> ConfigError | InputError:
        """The error that says what is wrong at a place."""
        at = place
        while at and at not in self.lines:
            at = at[:-1]
        line = f", line {self.lines[at]}" if at in self.lines and at else ""
        start = f"{self.source}{line}: " if self.source or line else ""
        return self.error(f"{start}{dotted(place)}{' ' if place else ''}{text}")


def dotted(place: Place) -> str:
    """A place in words: parts[0].joint.axis."""
    out = ""
    for step in place:
        out += f"[{step}]" if isinstance(step, int) else f".{step}" if out else str(step)
    return out


def read_yaml(path: Path, shown: str | Path | None = None) -> Document:
    """The document in a YAML (or JSON) file; an empty file holds None.

    Args:
        shown: the file as the person knows it, where it is read from a copy.

    Raises:
        ConfigError: too large, not UTF-8, not YAML, an alias, a tag, a double key, too deep.
    """
    source = str(path if shown is None else shown)
    return parse_yaml(_text(path, source, ConfigError), source)


def parse_yaml(text: str, source: str = "") -> Document:
    """The document in a YAML text; for the errors see `read_yaml`."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _look(yaml.parse(text, loader), source)
        node = yaml.compose(text, loader)
    except yaml.YAMLError as error:
        said = getattr(error, "problem", None) or str(error).splitlines()[0]
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f", line {mark.line + 1}"
        raise ConfigError(f"{source}{line} is not YAML: {said}") from error
    lines: dict[Place, int] = {}
    values = None if node is None else _value(node, (), lines, source)
    return Document(values, source, lines)


def read_json(path: Path) -> Document:
    """The document in a JSON file.

    Raises:
        InputError: too large, not UTF-8, not JSON, NaN, a double key, too deep.
    """
    return parse_json(_text(path, str(path), InputError), str(path))


def parse_json(text: str, source: str) -> Document:
    """The document in a JSON text; for the errors see `read_json`."""

    def pairs(rows: list[tuple[str, Any]]) -> dict[str, Any]:
        out = dict(rows)
        if len(out) < len(rows):
            names = [name for name, _ in rows]
            double = next(n for n in names if names.count(n) > 1)
            raise InputError(f"{source}: the key {double!r} is there twice")
        return out

    def constant(name: str) -> None:
        raise InputError(f"{source}: {name} is no number")

    try:
        values = json.loads(text, object_pairs_hook=pairs, parse_constant=constant)
    except RecursionError as error:
        raise InputError(f"{source} is nested too deep") from error
    except ValueError as error:
        raise InputError(f"{source} is not JSON: {error}") from error
    if _depth(values) > LIMITS.depth:
        raise InputError(f"{source} is nested deeper than {LIMITS.depth} levels")
    return Document(values, source, error=InputError)


def validated(kind: Any, document: Document) -> Any:
    """The document as a dataclass, or another annotation, that it must obey.

    Raises:
        ConfigError, InputError: as the document wants; the first of all that is wrong.
    """
    try:
        return _adapter(kind).validate_json(_json(document.values), strict=True)
    except _Refusal as refusal:
        place, first = _first(refusal)
        if first["type"] in ("missing", "unexpected_keyword_argument"):
            raise _key(kind, document, place, first["type"]) from None
        raise document.wrong(place, _said(first)) from None
    except (ValueError, TypeError, RecursionError) as error:
        raise document.wrong((), f"cannot be used: {error}") from error


def value_as(kind: Any, value: Any, name: str, source: str = "") -> Any:
    """One value as an annotation wants it; for the errors see `validated`.

    Args:
        name: of the setting. source: where it comes from.
    """
    try:
        return _adapter(kind).validate_json(_json(value), strict=True)
    except _Refusal as refusal:
        place, first = _first(refusal)
        inner = "".join(f"[{s}]" if isinstance(s, int) else f".{s}" for s in place)
        start = f"{source}: " if source else ""
        raise ConfigError(f"{start}{name}{inner} {_said(first)}") from None
    except (ValueError, TypeError, RecursionError) as error:
        raise ConfigError(f"{source}: {name} cannot be used: {error}") from error


def check_ranges(
    config: Any, above: str = "", *, flag: bool = False, only: Collection[str] = ()
) -> None:
    """Hold every number of a dataclass, and of those in it, against the range of its annotation.

    Args:
        above: what stands before the names.
        flag: say them as flags; without a beginning (env.), those of sections stand alone.
        only: names of the fields that are looked at; all where none is given.

    Raises:
        ConfigError: one is outside; the sentence names it and its range.
    """
    kind: Any = type(config)
    hints = _hints(kind)
    for f in fields(config):
        value = getattr(config, f.name)
        if only and f.name not in only:
            continue
        if is_dataclass(value) and not isinstance(value, type):
            check_ranges(value, "" if flag and not above else f"{above}{f.name}.", flag=flag)
        elif isinstance(value, Mapping):
            for name, inner in value.items():
                if is_dataclass(inner) and not isinstance(inner, type):
                    check_ranges(inner, f"{above}{f.name}.{name}.", flag=flag)
        elif value is not None and range_of(hints[f.name]) is not None:
            value_as(hints[f.name], value, _spelt(above, f.name, flag))
        elif isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"{_spelt(above, f.name, flag)} must be a finite number, not {value}")


def _spelt(above: str, name: str, flag: bool) -> str:
    return f"--{above}{name}".replace("_", "-") if flag else f"{above}{name}"


def range_of(kind: Any) -> Range | None:
    """The range in an annotation, also within a tuple or beside None; None where there is none."""
    if isinstance(kind, Range):
        return kind
    found = (range_of(k) for k in typing.get_args(kind))
    inner = (range_of(k) for k in getattr(kind, "__metadata__", ()))
    return next((r for r in (*found, *inner) if r is not None), None)


def no_doubles(names: Sequence[str], place: Place, what: str) -> None:
    """Raise `Wrong` where a name is there twice."""
    seen: set[str] = set()
    for i, name in enumerate(names):
        if name in seen:
            raise Wrong((*place, i), f"is a second {what} named {name!r}")
        seen.add(name)


def no_cycle(parents: Mapping[str, str | None], place: Place) -> None:
    """Raise `Wrong` where a name is its own ancestor.

    Args:
        parents: by name, in the order of the document.
    """
    for i, start in enumerate(parents):
        seen, at = {start}, parents[start]
        while at is not None and at in parents:
            if at in seen:
                text = f"is its own ancestor: {start!r} hangs on {parents[start]!r}"
                raise Wrong((*place, i), text)
            seen.add(at)
            at = parents[at]


def shown(value: Any) -> str:
    """A value in a sentence, cut where it is long."""
    text = repr(value) if not isinstance(value, list | dict) or len(str(value)) < 1000 else "..."
    return text if len(text) <= LIMITS.shown else f"{text[: LIMITS.shown - 3]}..."


def _text(path: Path, source: str, error: type[ConfigError] | type[InputError]) -> str:
    try:
        with path.open("rb") as stream:
            data = stream.read(LIMITS.bytes + 1)
    except OSError as why:
        raise error(f"{source} cannot be read: {why.strerror}") from why
    if len(data) > LIMITS.bytes:
        raise error(f"{source} is larger than {LIMITS.bytes >> 20} MiB")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as why:
        raise error(f"{source} is not text in UTF-8") from why


def _look(events: Iterator[Any], source: str) -> None:
    """Refuse what a file of settings has no use for, before anything is built of it."""
    depth = documents = 0
    for event in events:
        line = f"{source}, line {event.start_mark.line + 1}"
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise ConfigError(f"{line}: YAML aliases (& and *) are not read; write the value out")
        if getattr(event, "tag", None) is not None and event.tag != "!":
            raise ConfigError(f"{line}: YAML tags ({event.tag}) are not read")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > LIMITS.depth:
                raise ConfigError(f"{line}: nested deeper than {LIMITS.depth} levels")
        depth -= isinstance(event, yaml.CollectionEndEvent)
        documents += isinstance(event, yaml.DocumentStartEvent)
        if documents > 1:
            raise ConfigError(f"{line}: a second document begins; one is read")


def _value(node: Any, place: Place, lines: dict[Place, int], source: str) -> Any:
    """What a node means, with the lines of all places in it."""
    lines[place] = node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        return [_value(n, (*place, i), lines, source) for i, n in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode):
        out: dict[str, Any] = {}
        for key, value in node.value:
            line = f"{source}, line {key.start_mark.line + 1}"
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigError(f"{line}: a key must be a name")
            if key.value in out:
                raise ConfigError(f"{line}: the key {key.value!r} is there twice")
            out[key.value] = _value(value, (*place, key.value), lines, source)
            lines[(*place, key.value)] = key.start_mark.line + 1
        return out
    return _scalar(node, f"{source}, line {lines[place]}")


def _scalar(node: Any, line: str) -> Any:
    kind, text = node.tag.rpartition(":")[2], node.value
    try:
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() in ("yes", "true", "on")
        if kind == "int":
            return yaml.SafeLoader("").construct_yaml_int(node)
        if kind == "float":
            return yaml.SafeLoader("").construct_yaml_float(node)
    except ValueError as error:
        raise ConfigError(f"{line}: {shown(text)} is no number that can be read") from error
    if not node.style and re.fullmatch(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+", text):
        return float(text)  # YAML 1.1 takes 1e-3 for text
    return text


def _depth(value: Any, most: int = 4 * LIMITS.depth) -> int:
    if most == 0 or not isinstance(value, list | dict):
        return 0
    inner = value.values() if isinstance(value, dict) else value
    return 1 + max((_depth(v, most - 1) for v in inner), default=0)


@lru_cache(maxsize=512)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@lru_cache(maxsize=256)
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind, include_extras=True)


def _json(values: Any) -> str:
    """Values as JSON; what JSON cannot hold becomes text, which no number accepts."""
    return json.dumps(values, default=_plain)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # NumPy
        return value.tolist()
    return dict(value) if isinstance(value, Mapping) else str(value)


_WANTED = {
    "float_type": "a number", "int_type": "a whole number", "int_from_float": "a whole number",
    "float_parsing": "a number", "int_parsing": "a whole number", "bool_type": "true or false",
    "string_type": "text", "finite_number": "a finite number", "path_type": "a path",
    "list_type": "a list", "tuple_type": "a list", "none_required": "empty",
    "dataclass_type": "names and values", "dict_type": "names and values",
}  # fmt: skip


def _first(refusal: _Refusal) -> tuple[Place, dict[str, Any]]:
    """The first thing that pydantic refused, and its place."""
    errors: list[dict[str, Any]] = [dict(e) for e in refusal.errors(include_url=False)]
    place, first = tuple(errors[0]["loc"]), errors[0]
    if first["type"] == "missing" and isinstance(place[-1], int):  # a list of fixed length
        above = place[:-1]
        lacking = [e["loc"][-1] for e in errors if tuple(e["loc"][:-1]) == above]
        sizes = {"max_length": max(lacking) + 1, "actual_length": place[-1]}
        return above, {**first, "type": "too_long", "ctx": sizes}
    return place, first


def _said(error: Mapping[str, Any]) -> str:
    """What is wrong, in the words of somebody who edits a file."""
    kind, context, value = error["type"], error.get("ctx") or {}, error["input"]
    said = shown(value)
    if kind in ("dataclass_type", "dict_type"):
        return f"must hold names and values, not {said}"
    if kind in _WANTED:
        return f"must be {_WANTED[kind]}, not {said}"
    if kind == "range":
        return f"must be {context['said']}, not {said}"
    if kind == "literal_error":
        options = re.findall(r"'((?:[^'\\]|\\.)*)'", context["expected"]) or [context["expected"]]
        near = difflib.get_close_matches(str(value), options, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"must be one of {', '.join(options)}, not {said}{hint}"
    if kind == "value_error":
        return str(context["error"])
    if kind.startswith("string_too"):
        bound = context.get("min_length", context.get("max_length"))
        least = "at least" if kind == "string_too_short" else "at most"
        return f"must be text of {least} {bound} character{'' if bound == 1 else 's'}"
    if kind == "too_long":
        return f"must be a list of {context['max_length']}, not of {context['actual_length']}"
    if kind == "too_short":
        return f"must be a list of {context['min_length']}, not of {context['actual_length']}"
    return error["msg"][0].lower() + error["msg"][1:]


def _key(kind: Any, document: Document, place: Place, what: str) -> ConfigError | InputError:
    """The error for a key that is missing, or one too many; the nearest known one is named."""
    *above, key = place
    if what == "missing":
        return document.wrong(tuple(above), f"{'has' if above else 'there is'} no {key}")
    known = _names_at(kind, tuple(above))
    near = difflib.get_close_matches(str(key), known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
    return document.wrong(place, f"is an unknown key; {hint}")


def _names_at(kind: Any, place: Place) -> list[str]:
    """Fields of the dataclass at a place of `kind`."""
    for step in place:
        options = [kind, *_within(kind)]
        owner = next((k for k in options if isinstance(k, type) and is_dataclass(k)), None)
        if isinstance(step, int) or owner is None:
            kind = next((k for k in _within(kind)), kind)
            continue
        kind = _hints(owner).get(str(step), kind)
    found = next(
        (k for k in (kind, *_within(kind)) if isinstance(k, type) and is_dataclass(k)), None
    )
    return [] if found is None else [f.name for f in fields(found)]


def _within(kind: Any) -> list[Any]:
    """The types that an annotation is made of, without itself."""
    out: list[Any] = []
    for inner in typing.get_args(kind):
        out += [inner, *_within(inner)]
    return out
