"""Typical mistakes of users: one clear sentence with the way out, and the exit code of its kind."""

from __future__ import annotations

from pathlib import Path

import pytest

from mam_sim.cli import main

MISSING = '<robot name="a"><link name="b"><visual><geometry><mesh filename="no.stl"/></geometry>'
FILES = {
    "empty.glb": "", "text.glb": "hello", "a.zip": "x", "c.yaml": "nokey: 1", "taken": "mine",
    "a.urdf": f"{MISSING}</visual></link></robot>", "a.xyz": "x",
    "run/run.json": "{}", "asset/asset.json": "{}", "folder/notes.txt": "",
}  # fmt: skip
OUT = "--out new"
MISTAKES = {
    "verb": ("articulte text.glb", "did you mean 'articulate'"),
    "flag": (f"articulate text.glb {OUT} --heigth 5", "--height"),
    "unit": (f"articulate text.glb {OUT} --height 55xy", "a length such as 0.55 (metres)"),
    "path": (f"articulate nope.glb {OUT}", "no such file: nope.glb"),
    "address": (f"articulate https://a.b/c.glb {OUT}", "download the file first"),
    "archive": (f"articulate a.zip {OUT}", "unpack it"),
    "type": (f"articulate a.xyz {OUT}", "known: .jpg"),
    "empty file": (f"articulate empty.glb {OUT}", "empty.glb is empty"),
    "text as glb": (f"articulate text.glb {OUT}", "text.glb is not a glTF file"),
    "mesh missing": (f"articulate a.urdf {OUT}", "names a mesh that does not exist: no.stl"),
    "out a file": ("articulate text.glb --out taken", "--out names a folder"),
    "key of config": ("articulate text.glb --config c.yaml", "no setting 'nokey'"),
    "hints a folder": (f"articulate text.glb {OUT} --hints folder", "no hints file at folder"),
    "eval of nothing": ("eval nope", "make one with: mam-sim train"),
    "eval of an asset": ("eval asset", "make one with: mam-sim train"),
    "eval of a folder": ("eval folder", "make one with: mam-sim train"),
    "view of nothing": ("view nope", "make one with: mam-sim make-env"),
    "view of a run": ("view run", "make one with: mam-sim make-env"),
    "check of a run": ("check run", "holds no asset.json"),
    "rank of a folder": ("rank folder --out new", "make one with: mam-sim make-env"),
    "batch of nothing": ("batch nope --out new", "no such file or folder: nope"),
    "old asset": ("export asset --out new", "make it again with: mam-sim make-env"),
}
"""Command line, and what its answer holds."""


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_answered(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, content in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    monkeypatch.chdir(tmp_path)
    line, words = MISTAKES[case]
    code: int | str | None
    try:
        code = main(line.split())
    except SystemExit as stop:
        code = stop.code
    answer = capsys.readouterr()
    assert code == 2
    assert words in answer.err + answer.out
    assert "Traceback" not in answer.err
    assert (tmp_path / "taken").read_text() == "mine"
