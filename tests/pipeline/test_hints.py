"""The hints file: round trip, and errors that name the place and the nearest key."""

from __future__ import annotations

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
        ({"part": []}, "unknown key 'part'; did you mean 'parts'?"),
        ({"parts": [{"nam": "x"}]}, "parts[0]: unknown key 'nam'; did you mean 'name'?"),
        ({"parts": [{"kind": "door"}]}, "parts[0] has no name"),
        ({"parts": [{"name": "d", "joint": {"subtype": "hing"}}]}, "'hing' is not one of fixed"),
        ({"parts": [{"name": "d", "joint": {"axis": [0, 0, 0]}}]}, "axis has zero length"),
        ({"parts": [{"name": "d", "joint": {"axis": [0, 1]}}]}, "expected three numbers, got 2"),
        ({"parts": [{"name": "d", "primitives": [-1]}]}, "expected non-negative integers"),
        ({"merge": 3}, "expected a list, got int"),
        ({"schema": 7}, "schema 7 is unknown"),
        ([1], "expected a mapping, got list"),
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
