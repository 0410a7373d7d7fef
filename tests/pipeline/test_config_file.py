"""Configurations from YAML: nested, strict, and the same again after being written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest

from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError


@dataclass(frozen=True)
class Camera:
    eye: tuple[float, float, float] = (0.0, 0.0, 1.0)
    width: int = 128


@dataclass(frozen=True)
class Inner:
    rate: float = 1e-3
    kind: Literal["open", "close"] = "open"
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class Outer:
    name: str = "a"
    file: Path | None = None
    on: bool = True
    sizes: tuple[int, ...] = (1, 2)
    inner: Inner = field(default_factory=Inner)
    cameras: Mapping[str, Camera] = field(default_factory=lambda: {"front": Camera()})
    more: dict[str, Any] = field(default_factory=dict)


def test_a_file_fills_what_it_names_and_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(
        "inner: {rate: 2e-4, span: [1, 2]}\nsizes: [5]\ncameras: {top: {eye: [1, 2, 3]}}\n"
    )
    made = config_file.fill(Outer(), config_file.read(file), file)
    assert made == Outer(
        sizes=(5,), inner=Inner(2e-4, "open", (1.0, 2.0)), cameras={"top": Camera((1.0, 2.0, 3.0))}
    )


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    config = Outer("b", tmp_path / "x", False, (), Inner(1.0, "close", (0, 1)), more={"k": [1]})
    config_file.save(config, tmp_path / "a.yaml")
    assert config_file.fill(Outer(), config_file.read(tmp_path / "a.yaml")) == config


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"nmae": "x"}, "f.yaml: there is no setting 'nmae'; did you mean 'name'?"),
        ({"inner": {"rat": 1}}, "there is no setting 'rat' in inner; did you mean 'inner.rate'?"),
        ({"rate": 1}, "there is no setting 'rate'; did you mean 'inner.rate'?"),
        ({"zzz": 1}, "no setting 'zzz'; there are: name, file"),
        ({"inner": {"rate": "x"}}, "inner.rate must be a number, not 'x'"),
        ({"inner": {"rate": True}}, "inner.rate must be a number, not True"),
        ({"inner": {"kind": "opne"}}, "one of open, close, not 'opne'; did you mean 'open'?"),
        ({"inner": {"span": [1]}}, "inner.span must be a list of 2, not of 1"),
        ({"inner": 3}, "inner must hold names and values, not 3"),
        ({"on": "yes please"}, "on must be true or false, not 'yes please'"),
        ({"name": 3}, "name must be text, not 3"),
        ({"sizes": [1, 2.5]}, r"sizes\[1\] must be a whole number, not 2.5"),
        ({"sizes": 3}, "sizes must be a list, not 3"),
        ({"cameras": {"front": {"widht": 3}}}, "did you mean 'cameras.front.width'?"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence.replace("?", r"\?")) as told:
        config_file.fill(Outer(), values, "f.yaml")
    assert str(told.value).startswith("f.yaml: ") and "\n" not in str(told.value)


def test_files_that_hold_no_settings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no configuration file"):
        config_file.read(tmp_path / "none.yaml")
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(ConfigError, match="must hold names and values"):
        config_file.read(tmp_path / "list.yaml")
    (tmp_path / "broken.yaml").write_text("a: [1\n")
    with pytest.raises(ConfigError, match="is not YAML"):
        config_file.read(tmp_path / "broken.yaml")
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    assert config_file.read(tmp_path / "empty.yaml") == {}
