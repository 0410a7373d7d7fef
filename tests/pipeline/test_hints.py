"""The hints file: round trip, and errors that name the place and the nearest key."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import (
    HintBox,
    HintJoint,
    HintPart,
    Hints,
    load_hints,
    parse_hints,
    save_hints,
)


def test_round_trip(tmp_path: Path) -> None:
    hints = Hints(
        up="z",
        merge=((1, 2), (5, 6, 7)),
        fixed=(4,),
        parts=(
            HintPart(
                "drawer_0",
                "drawer",
                nodes=("drawer_0_front",),
                box=HintBox((0.0, 0.1, 0.2), (0.4, 0.3, 0.2)),
                joint=HintJoint("slide", axis=(-1.0, 0.0, 0.0), lower=0.0, upper=0.3),
                handle=HintBox((-0.2, 0.0, 0.2), (0.02, 0.1, 0.02)),
                confidence=0.75,
                provenance="observed",
            ),
            HintPart("knob", primitives=(3,), joint=HintJoint("spin")),
        ),
    )
    save_hints(hints, tmp_path / "hints.yaml")
    assert load_hints(tmp_path / "hints.yaml") == hints


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"part": []}, "part is an unknown key; did you mean 'parts'?"),
        ({"parts": [{"name": "d", "kid": "x"}]}, "parts[0].kid is an unknown key; did you mean"),
        ({"parts": [{"kind": "door"}]}, "parts[0] has no name"),
        (
            {"parts": [{"name": "d", "joint": {"subtype": "hing"}}]},
            "parts[0].joint.subtype must be one of fixed, hinge, spin, slide, not 'hing'; did you",
        ),
        ({"parts": [{"name": "d", "joint": {"axis": [0, 0, 0]}}]}, "axis must not have zero"),
        ({"parts": [{"name": "d", "joint": {"axis": [0, 1]}}]}, "axis must be a list of 3, not"),
        ({"parts": [{"name": "d", "joint": {"axis": [0, 1, ".nan"]}}]}, "axis[2] must be a number"),
        ({"parts": [{"name": "d", "joint": {"lower": float("nan")}}]}, "lower must be a finite"),
        ({"parts": [{"name": "d", "joint": {"lower": 1, "upper": 0}}]}, "upper 0, which is not"),
        ({"parts": [{"name": "d", "primitives": [-1]}]}, "primitives[0] must be at least 0"),
        ({"parts": [{"name": "d", "primitives": [True]}]}, "must be a whole number, not True"),
        ({"parts": [{"name": "d", "confidence": 7}]}, "must be a number from 0 to 1, not 7"),
        ({"parts": [{"name": "d"}, {"name": "d"}]}, "parts[1] is a second part named 'd'"),
        ({"parts": [{"name": "d", "parent": "d"}]}, "parts[0] is its own ancestor"),
        (
            {"parts": [{"name": "a", "primitives": [1]}, {"name": "b", "primitives": [1]}]},
            "parts[1].primitives names primitive 1, which is in 'a' already",
        ),
        ({"parts": [{"name": "d" * 300}]}, "name must be text of at most 200 characters"),
        ({"photo_front": [1, 2]}, "photo_front must be eight numbers, not 2"),
        ({"merge": 3}, "merge must be a list, not 3"),
        ({"schema": 7}, "schema must be one of 1, not 7"),
        ([1], "must hold names and values, not [1]"),
    ],
)
def test_errors_name_the_place(data: object, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_hints(data)
    assert message in str(caught.value)


def test_missing_and_malformed_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no hints file at"):
        load_hints(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("parts: [")
    with pytest.raises(ConfigError, match="is not YAML"):
        load_hints(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("up: z\nparts:\n- name: d\n  kind: 3\n", "bad.yaml, line 4: parts[0].kind must be text"),
        ("merge: [&a [1, 2], *a]\n", "line 1: YAML aliases"),
        ("up: !!python/object:os.system z\n", "line 1: YAML tags"),
        ("up: y\nup: z\n", "line 2: the key 'up' is there twice"),
        ("fixed: " + "[" * 40 + "]" * 40, "nested deeper than 32"),
        ("up: z\n---\nup: y\n", "line 2: a second document"),
        ("fixed: [" + "9" * 5000 + "]", "is no number that can be read"),
        ("? [a]\n: 1\n", "a key must be a name"),
        ("parts:\n- {name: d, joint: {axis: [.inf, 0, 0]}}\n", "axis[0] must be a finite"),
        ("\x00", "is not YAML"),
    ],
)
def test_what_a_file_may_hold(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_hints(tmp_path / "bad.yaml")
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_of_many_faces_passes_and_one_of_megabytes_fails_unread(tmp_path: Path) -> None:
    row = "[" + ", ".join(["1000001"] * 1000) + "],"
    for name, rows in (("pass", 20), ("fail", 500)):
        (tmp_path / f"cut_{name}.yaml").write_text(f"cut: [{row * rows}]\n")
    assert len(load_hints(tmp_path / "cut_pass.yaml").cut) == 20
    began = time.process_time()
    with pytest.raises(ConfigError, match=r"cut_fail.yaml is larger than 4 MiB; name fewer faces"):
        load_hints(tmp_path / "cut_fail.yaml")
    assert time.process_time() - began < 0.2
