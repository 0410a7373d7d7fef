"""The reference pages: every verb, every flag and every key, made from the parsers."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mam_sim.cli import VERBS

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))

generate_reference = pytest.importorskip("generate_reference")


def test_every_verb_is_on_the_page_of_the_command_line() -> None:
    page = generate_reference.cli()
    for verb in VERBS:
        assert f"\n## {verb}\n" in f"\n{page}"
    for flag in ("--height", "--segmenter", "--algo", "--episodes", "--hints", "--out"):
        assert f"`{flag}`" in page


def test_every_key_has_its_default_and_its_meaning() -> None:
    page = generate_reference.config()
    assert "| `height` |  | Height of the object: 55cm, 22in; a bare number is metres. |" in page
    assert "| `solver` | `auto` |" in page and "### env.reward" in page
    assert "| `clip_range` | `0.15` |" in page and "### train, algo: bc" in page
