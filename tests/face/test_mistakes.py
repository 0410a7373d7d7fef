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
    "flag": (
        f"articulate text.glb {OUT} --heigth 5",
        "there is no option --heigth; did you mean --height? mam-sim articulate --help",
    ),
    "flag of nothing": (f"articulate text.glb {OUT} --bogus", "there is no option --bogus;"),
    "no value": ("articulate text.glb --out", "--out needs a value;"),
    "no input": (f"articulate {OUT}", "PATH is missing: The photo"),
    "two inputs": (f"articulate text.glb more.glb {OUT}", "more.glb is too much;"),
    "words for a number": (f"articulate text.glb {OUT} --scale x", "--scale takes FLOAT, not 'x'"),
    "part of a number": ("eval run --episodes 1.5", "--episodes must be a whole number, not '1.5'"),
    "choice": (f"articulate text.glb {OUT} --up w", "--up must be one of 'auto', 'x'"),
    "place without a name": ("batch text.glb --out s3://", "it names no place"),
    "unit": (f"articulate text.glb {OUT} --height 55xy", "a length such as 0.55 (metres)"),
    "path": (f"articulate nope.glb {OUT}", "no such file: nope.glb"),
    "address": (
        f"articulate https://a.b/c.glb {OUT}",
        "https://a.b/c.glb is an address; download the file first",
    ),
    "archive": (f"articulate a.zip {OUT}", "unpack it"),
    "type": (f"articulate a.xyz {OUT}", "known: .jpg"),
    "empty file": (f"articulate empty.glb {OUT}", "empty.glb is empty"),
    "text as glb": (
        f"articulate text.glb {OUT}",
        "text.glb is not a glTF file: it begins with the text 'hello'",
    ),
    "mesh missing": (f"articulate a.urdf {OUT}", "names a mesh that does not exist: no.stl"),
    "out a file": ("articulate text.glb --out taken", "--out names a folder"),
    "key of config": ("articulate text.glb --config c.yaml", "no setting 'nokey'"),
    "hints a folder": (f"articulate text.glb {OUT} --hints folder", "no hints file at folder"),
    "eval of nothing": ("eval nope", "make one with: mam-sim train"),
    "eval of an asset": ("eval asset", "no run.json in asset, but an asset (asset.json); make one"),
    "eval of a folder": ("eval folder", "make one with: mam-sim train"),
    "view of nothing": ("view nope", "make one with: mam-sim make-env"),
    "view of a run": ("view run", "no asset.json in run, but a run (run.json); make one with:"),
    "check of a run": ("check run", "run holds no asset.json and 0 URDF files, but a run"),
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
    assert words in answer.err
    assert len([x for x in answer.err.splitlines() if x.startswith("mam-sim: ")]) == 1
    assert "Traceback" not in answer.err
    assert (tmp_path / "taken").read_text() == "mine"
