"""Lengths with units, and sizes that no such thing has."""

from __future__ import annotations

from pathlib import Path

import pytest

from mam_pipeline.config_file import fill
from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import parse_hints
from mam_pipeline.lengths import UnusualSize, ask_unusual, metres
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.photo.options import parse_options
from mam_sim.cli import main


@pytest.mark.parametrize("text, value", [
    ("55cm", 0.55), ("0.55", 0.55), ("22in", 0.5588), ("550 mm", 0.55), ("1.2m", 1.2),
    ("2ft", 0.6096),
    (" 5.5e1 CM ", 0.55), (".5", 0.5), ("1 metre", 1.0), ('10"', 0.254),
])  # fmt: skip
def test_a_length_is_read_with_its_unit_everywhere(text: str, value: float) -> None:
    assert metres(text) == pytest.approx(value)
    assert fill(MakeConfig(), {"height": text}).height == pytest.approx(value)
    assert parse_hints({"height": text}).height == pytest.approx(value)
    assert parse_options({"width": text}).width == pytest.approx(value)


@pytest.mark.parametrize(
    "text", ["55xy", "cm", "", "1,2m", "1 2", "0x10", "nan", "inf", "--", "5 cm 3"]
)
def test_what_is_no_length_is_told_with_valid_ones(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match=r"height must be a length such as .*, 55cm"):
        fill(MakeConfig(), {"height": text})
    (tmp_path / "a.glb").write_text("x")
    args = ["articulate", str(tmp_path / "a.glb"), "--out", str(tmp_path / "o"), f"--height={text}"]
    assert main(args) == 2
    assert "--height must be a length such as 0.55 (metres)" in capsys.readouterr().err


def test_a_size_beyond_three_times_the_usual_range_is_asked_about() -> None:
    usual = (0.5, 1.0, 2.4)
    for size in (0.17, 0.5, 2.4, 7.1):
        ask_unusual(size, {"height": size}, "cabinet", usual)
    with pytest.raises(UnusualSize) as told:
        ask_unusual(55.0, {"height": 55.0}, "cabinet", usual)
    assert str(told.value) == (
        "a cabinet of 55 m at its longest? usual is 0.5 to 2.4 m; --height 55cm, or add --yes"
    )
    with pytest.raises(UnusualSize, match="correct --scale"):
        ask_unusual(0.1, {"scale": 0.001}, "cabinet", usual)
    with pytest.raises(UnusualSize, match="an object of 20 m"):
        ask_unusual(20.0, {"height": 20.0})
    ask_unusual(5.0, {"height": 5.0})


def test_the_command_asks_before_it_makes_a_cabinet_of_55_metres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import trimesh

    mesh = tmp_path / "cabinet.stl"
    trimesh.creation.box(extents=(0.4, 0.5, 0.8)).export(mesh)
    args = ["articulate", str(mesh), "--out", str(tmp_path / "out"), "--quiet", "--height"]
    assert main([*args, "55"]) == 2
    said = capsys.readouterr().err
    assert (
        "a cabinet of 55 m at its longest? usual is" in said
        and "--height 55cm, or add --yes" in said
    )
    assert not (tmp_path / "out").exists()
