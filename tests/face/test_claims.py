"""Every command writes only into a folder that is new, empty or its own, and over no other file."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from mam_envs.scene.video import write_strip, write_video
from mam_pipeline import claims
from mam_pipeline.errors import ConfigError
from mam_sim.cli import main
from mam_world.dataset import write_dataset

URDF = "<robot name='r'><link name='a'/></robot>"
FOLDERS = {
    "articulate": ["articulate", "a.urdf", "--out", "OUT"],
    "make-env": ["make-env", "a.urdf", "--out", "OUT"],
    "batch": ["batch", "a.urdf", "--out", "OUT"],
    "rank": ["rank", "a.urdf", "--out", "OUT"],
    "mend": ["mend", "a.urdf", "--out", "OUT"],
    "generate": ["generate", "--category", "box_slider", "--out", "OUT"],
    "collect": ["collect", "asset", "--out", "OUT"],
    "train": ["train", "asset", "--out", "OUT"],
    "export": ["export", "asset", "--to", "mjcf", "--out", "OUT"],
    "view": ["view", "asset", "--out", "OUT"],
    "bench-photo": ["bench-photo", "--count", "1", "--save-photos", "OUT"],
    "calibrate": ["calibrate", "run", "--setup", "OUT"],
}
"""A command line of every verb that fills a folder."""
FILES = {
    "check": ["check", "asset", "--no-drive", "--out", "FILE.json"],
    "check --picture": ["check", "asset", "--no-drive", "--picture", "FILE.png"],
    "view --html": ["view", "asset", "--html", "--out", "FILE.html"],
    "gallery": ["view", ".", "--html", "--out", "FILE.html"],
    "eval": ["eval", "--expert", "--asset", "asset", "--out", "FILE.json"],
    "bench": ["bench", "generated:test", "--limit", "1", "--out", "FILE.json"],
    "bench-photo": ["bench-photo", "--count", "1", "--out", "FILE.json"],
}
"""A command line of every verb that writes a file."""
NAMED = {
    "perceived.png": ["perceive", "run", "--setup", "."],
    "rehearsal.png": ["deploy", "run", "--setup", "."],
    "evaluation.mp4": ["eval", "--expert", "--asset", "asset", "--video"],
    "review.csv": ["studio", ".", "--no-open"],
}
"""A command line of every verb that writes a file whose name no flag chooses."""
THEIRS = {".json": "{}", ".html": "<p>mine", ".yaml": "mine: 1", ".png": "mine"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    write_dataset("box_slider", 1, 3, folder, False, False, 1)
    return next(folder.glob("box_slider*"))


@pytest.fixture
def place(tmp_path: Path, made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "a.urdf").write_text(URDF)
    (tmp_path / "asset").symlink_to(made)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], args: list[str]) -> str:
    """Run a verb that must end with status 2 and one sentence; returns it."""
    if args[0] in ("calibrate", "perceive", "deploy"):
        pytest.importorskip("mam_sim_arm", reason="the package of real arms is not installed")
    capsys.readouterr()
    assert main([*args, "--quiet"]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mam-sim: ")]
    assert len(said) == 1
    return said[0]


def everything(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("verb", sorted(FOLDERS))
def test_a_stranger_s_folder_is_left_as_it_is(
    verb: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs = place / "theirs"
    for name in ("thesis.tex", "index.html", "records/a.json", "rows/a.json", "data/a", "x.png"):
        (theirs / name).parent.mkdir(parents=True, exist_ok=True)
        (theirs / name).write_text("mine")
    for name in ("asset.json", "rank.json", "run.json", "collect.json", "mam_sim_export.json"):
        (theirs / name).write_text('{"name": "mine"}')
    (theirs / "batch.yaml").write_text("queue: mine")
    (theirs / "MANIFEST.csv").write_text("mine,yours\n")
    (place / "file").write_text("mine")
    (place / "link").symlink_to("nowhere")
    before = everything(place)
    for out, why in (("theirs", "is not empty"), ("file", "is a file"), ("link", "leads nowhere")):
        args = [out if word == "OUT" else word for word in FOLDERS[verb]]
        assert why in refused(capsys, args)
    assert everything(place) == before


@pytest.mark.parametrize("verb", sorted(FILES))
def test_a_stranger_s_file_is_left_as_it_is(
    verb: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    *words, name = FILES[verb]
    suffix = Path(name).suffix
    (place / f"mine{suffix}").write_text(THEIRS[suffix])
    os.mkfifo(place / f"pipe{suffix}")
    before = (place / f"mine{suffix}").read_bytes()
    assert "is kept: name another file with" in refused(capsys, [*words, f"mine{suffix}"])
    assert "is no ordinary file" in refused(capsys, [*words, f"pipe{suffix}"])
    assert (place / f"mine{suffix}").read_bytes() == before


@pytest.mark.parametrize("name", sorted(NAMED))
def test_a_stranger_s_file_of_our_name_is_left_as_it_is(
    name: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / name).write_bytes(b"mine")
    assert "is kept: " in refused(capsys, NAMED[name])
    assert (place / name).read_bytes() == b"mine"


def test_a_film_and_a_strip_are_known_again(tmp_path: Path) -> None:
    frames = [np.full((16, 16, 3), k, np.uint8) for k in range(4)]
    for _ in range(2):
        claims.claim_file(write_video(frames, tmp_path / "a.mp4"), claims.FILM)
        claims.claim_file(write_strip(frames, tmp_path / "a.png"), claims.PICTURE)


def test_a_result_takes_the_place_of_one_of_its_kind(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check = ["check", "asset", "--no-drive", "--quiet", "--out", "r.json", "--picture", "r.png"]
    for _ in range(2):
        assert main(check) < 2
        assert main(["view", "asset", "--out", "pictures", "--frames", "2", "--quiet"]) == 0
        assert main(["view", "asset", "--html", "--out", "page.html", "--quiet"]) == 0
    assert json.loads((place / "r.json").read_text())["joints"]
    (place / "pictures" / "holiday.png").write_bytes(b"mine")
    assert "holds no pictures of an asset" in refused(
        capsys, ["view", "asset", "--out", "pictures"]
    )


def test_what_a_killed_command_left_half_made_is_nobody_s(tmp_path: Path) -> None:
    (tmp_path / ".a.partial-1").mkdir()
    (tmp_path / ".lock").touch()
    claims.claim_folder(tmp_path, claims.BATCH)
    with pytest.raises(ConfigError, match="holds no asset"):
        claims.claim_folder(tmp_path, claims.ASSET)
