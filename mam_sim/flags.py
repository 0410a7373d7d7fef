"""How dataclasses become flags: a rule for tyro, with sentences and values as people read them.

tyro keeps the line breaks and the indentation of a field's sentence, knows no sentence for several
names ("lower, upper: ..."), and writes the value of an optional number as {None}|FLOAT.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
import types
import typing
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Union

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from mam_pipeline.edited import Length
from mam_pipeline.errors import ConfigError
from mam_pipeline.lengths import metres

USUAL: dict[str, tuple[str, ...]] = {
    "MakeConfig": ("up", "facing", "height", "scale", "hints", "what", "accept", "reconstructor"),
    "EngineConfig": ("reasoner",),
    "PhotoConfig": ("front", "layout", "accept_low_confidence"),
    "ModelConfig": ("vlm_model",),
    "Rules": (),
    "BenchConfig": ("fuse", "named", "seeds", "execute"),
    "Batch": ("config", "quiet", "inputs", "out", "jobs", "retry", "environment", "report"),
    "DemonstrationConfig": (
        "episodes", "epochs", "steps", "batch", "learning_rate", "rounds", "seed", "deployable",
    ),
    "LeRobotConfig": (
        "episodes", "steps", "batch", "cameras", "mapping", "download", "rounds", "seed",
    ),
    "SafetyConfig": ("rate", "speed", "margin", "lag", "current"),
}  # fmt: skip
"""Settings that --help shows of a section or a verb, by its class or one that it extends; of others
all, of environments none. No verb shows more than twenty."""
SHORT: ContextVar[bool] = ContextVar("short", default=False)
"""Whether only what people use is shown, and taken."""
WORDS = {int: "INT", float: "FLOAT", str: "TEXT", Path: "PATH"}
REPEATED = ("accept",)
"""Flags that take one value and may be repeated."""
REGISTRY = ConstructorRegistry()


@REGISTRY.struct_rule
def _dataclass(info: StructTypeInfo) -> StructConstructorSpec | None:
    """The fields of a dataclass that has a default instance; None leaves it to tyro."""
    if not is_dataclass(info.type) or not isinstance(info.default, info.type):
        return None
    hints = typing.get_type_hints(info.type, include_extras=True)
    said = sentences(info.type)
    specs = [
        StructFieldSpec(
            name=f.name,
            type=_shown(info.type, f.name, hints[f.name], getattr(info.default, f.name)),
            default=getattr(info.default, f.name),
            helptext=said.get(f.name),
        )
        for f in fields(info.type)
    ]
    return StructConstructorSpec(instantiate=info.type, fields=tuple(specs))


def _shown(kind: type, name: str, hint: Any, value: Any) -> Any:
    """The type of a field as tyro is to see it; hidden where it is not usual."""
    if SHORT.get() and not is_dataclass(value) and not is_usual(kind, name):
        return Annotated[hint, tyro.conf.Suppress]
    return _repeated(hint) if name in REPEATED else _with_word(hint, name)


def is_usual(kind: type, name: str) -> bool:
    """Whether --help shows a setting; --help-all shows all."""
    for cls in kind.__mro__:
        if cls.__name__ in USUAL:
            return name in USUAL[cls.__name__]
    return not kind.__module__.startswith("mam_envs.")


def sentences(kind: type) -> dict[str, str]:
    """What is said of each field of a dataclass: a string below it, or a line of "Attributes:"."""
    out: dict[str, str] = {}
    for cls in reversed(kind.__mro__[:-1]):
        if "__annotations__" not in vars(cls):
            continue
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
        except (OSError, TypeError, SyntaxError):  # made at run time: its fields are sections
            continue
        assert isinstance(body, ast.ClassDef)
        out |= _listed(ast.get_docstring(body) or "")
        for field, text in zip(body.body, body.body[1:]):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
            ):
                out[field.target.id] = " ".join(str(text.value.value).split())
    return out


def _listed(doc: str) -> dict[str, str]:
    """Sentences of the section "Attributes:" of a docstring, by name."""
    body = doc.partition("Attributes:\n")[2].partition("\n\n")[0]
    joined = re.sub(r"\n {8,}", " ", body)
    found = re.findall(r"^ *([a-z_]+(?:, [a-z_]+)*): (.+)$", joined, re.MULTILINE)
    return {name: text for names, text in found for name in names.split(", ")}


def _repeated(kind: Any) -> Any:
    """A row of texts of which every flag adds one."""
    return Annotated[kind, tyro.conf.UseAppendAction, tyro.conf.arg(metavar=WORDS[str])]


def _with_word(kind: Any, name: str) -> Any:
    """The type of text or of an optional value, with the word for it in the help."""
    if _is_length(kind):
        return Annotated[kind, _length(name)]
    if kind is str:
        return Annotated[str, tyro.conf.arg(metavar=WORDS[str])]
    if typing.get_origin(kind) not in (Union, types.UnionType):
        return kind
    wanted = [_bare(k) for k in typing.get_args(kind) if k is not type(None)]
    if len(wanted) != 1 or len(typing.get_args(kind)) != 2:
        return kind
    many = typing.get_args(wanted[0]) if typing.get_origin(wanted[0]) is tuple else wanted
    many = [_bare(k) for k in many]
    if not all(k in WORDS for k in many):
        return kind
    return Annotated[kind, tyro.conf.arg(metavar=" ".join(WORDS[k] for k in many))]


def _is_length(kind: Any) -> bool:
    """Whether an annotation is that of a length, or of one or none."""
    inner = typing.get_args(kind) if typing.get_origin(kind) is not Annotated else (kind,)
    return any(k == Length for k in inner)


def _length(name: str) -> PrimitiveConstructorSpec[Any]:
    """How tyro reads the length of a field."""

    def read(words: list[str]) -> float | None:
        if words == ["None"]:
            return None
        try:
            return float(metres(words[0]))
        except ValueError as error:
            raise ConfigError(f"--{name.replace('_', '-')} {error}") from None

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="LENGTH",
        instance_from_str=read,
        is_instance=lambda value: value is None or isinstance(value, int | float),
        str_from_instance=lambda value: [str(value)],
    )


def _bare(kind: Any) -> Any:
    """A type without what is annotated to it."""
    return typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else kind
