"""Inputs that lead round in a circle, to a pipe or to far too much end in a sentence, at once."""

from __future__ import annotations

import io
import os
import socket
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import WalkLimits, entries
from mam_sim.batch import inputs
from mam_sim.batch.inputs import find_inputs
from mam_sim.cli import main
from mam_sim.studio.trying import zipped

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def looped(tmp_path: Path) -> Path:
    """A folder with a mesh, one in a folder below, and two links to itself in either."""
    folder = tmp_path / "in"
    for at in (folder, folder / "below"):
        at.mkdir()
        (at / "one").symlink_to(folder)
        (at / "two").symlink_to(".")
    (folder / "a.obj").write_text(OBJ)
    (folder / "below" / "b.obj").write_text(OBJ + "# another\n")
    return folder


@pytest.mark.parametrize("word", ["", "**", "**/*.obj", "**/**/*.obj"])
def test_links_to_itself_are_followed_once(looped: Path, word: str) -> None:
    found = find_inputs([str(looped / word)])
    assert sorted(i.path.name for i in found) == ["a.obj", "b.obj"]


@pytest.mark.parametrize(
    ("pattern", "names"),
    [("*.obj", ["a.obj"]), ("*/*.obj", ["b.obj"]), ("below/?.obj", ["b.obj"]),
     ("**/b*", ["b.obj"]), ("[a-c].obj", ["a.obj"]), ("be*/**", ["b.obj"])],
)  # fmt: skip
def test_a_pattern_stands_for_what_it_does_in_a_shell(
    tmp_path: Path, pattern: str, names: list[str]
) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "below" / "b.obj").write_text(OBJ + "# another\n")
    (tmp_path / ".hidden.obj").write_text(OBJ + "# third\n")
    assert [i.path.name for i in find_inputs([str(tmp_path / pattern)])] == names


def test_lists_that_name_each_other_twice_are_read_once(tmp_path: Path) -> None:
    for i in range(40):
        (tmp_path / f"{i}.txt").write_text(f"{i + 1}.txt\n{i + 1}.txt\n")
    (tmp_path / "40.txt").write_text("a.obj\n")
    (tmp_path / "a.obj").write_text(OBJ)
    assert [i.path.name for i in find_inputs([str(tmp_path / "0.txt")])] == ["a.obj"]


def test_a_folder_that_leads_to_too_much_is_refused(
    looped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inputs, "WALK", WalkLimits(entries=7))
    assert len(find_inputs([str(looped)])) == 2  # seven entries in all
    (looped / "one_more").touch()
    with pytest.raises(InputError, match="more than 7 entries"):
        find_inputs([str(looped)])


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


KINDS: dict[str, Callable[[Path], None]] = {
    "pipe": os.mkfifo,
    "device": lambda p: p.symlink_to("/dev/zero"),
    "socket": _socket,
}
VERBS: dict[str, tuple[str, ...]] = {
    "articulate": ("articulate", "{}.glb", "--out", "out"),
    "hints": ("articulate", "a.obj", "--hints", "{}.yaml", "--out", "out"),
    "config": ("articulate", "a.obj", "--config", "{}.yaml", "--out", "out"),
    "mask": ("articulate", "p.png", "--mask", "{}.png", "--out", "out"),
    "out": ("articulate", "a.obj", "--out", "{}"),
    "make-env": ("make-env", "{}.glb", "--out", "out"),
    "batch": ("batch", "{}.glb", "--out", "out"),
    "batch list": ("batch", "{}.txt", "--out", "out"),
    "check": ("check", "{}.urdf"),
    "check profile": ("check", "{}.usda", "--profile", "isaac"),
    "check out": ("check", "a.obj", "--out", "{}"),
    "rank": ("rank", "{}.urdf"),
    "rank truth": ("rank", "a.obj", "--truth", "{}.urdf"),
    "bench": ("bench", "{}"),
    "collect": ("collect", "{}", "--out", "out"),
    "train": ("train", "{}", "--out", "out"),
    "eval": ("eval", "{}"),
    "export": ("export", "{}", "--to", "mjcf", "--out", "out"),
    "view": ("view", "{}.urdf"),
    "studio": ("studio", "{}.glb", "--no-open"),
    "studio photo": ("studio", "{}.jpg", "--no-open"),
    "bench-photo": ("bench-photo", "{}"),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("verb", VERBS)
def test_what_is_no_ordinary_file_is_refused_by_every_verb(
    verb: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "p.png").write_bytes(b"")
    words = [w.format("odd") for w in VERBS[verb]]
    KINDS[kind](tmp_path / next(w for w in words if w.startswith("odd")))
    assert main(words) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("mam-sim: ") and "odd" in said[-1]
    assert not (tmp_path / "out").exists()


FOLDERS: dict[str, tuple[str, ...]] = {
    "bench": ("bench", "odd"), "rank": ("rank", "odd"), "train": ("train", "odd", "--out", "out"),
    "eval": ("eval", "--expert", "--asset", "odd"), "view": ("view", "odd", "--html"),
    "studio": ("studio", "odd", "--no-open"), "batch": ("batch", "odd", "--out", "out"),
}  # fmt: skip


@pytest.mark.parametrize("verb", FOLDERS)
def test_a_folder_that_holds_no_ordinary_file_is_refused_by_every_verb(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("MANIFEST.csv", "a.urdf", "a.glb", "a/object.urdf", "a/asset.json", "asset.json"):
        (tmp_path / "odd" / name).parent.mkdir(parents=True, exist_ok=True)
        os.mkfifo(tmp_path / "odd" / name)
    (tmp_path / "odd" / "loop").symlink_to(".")
    assert main([*FOLDERS[verb]]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("mam-sim: ") and "odd" in said[-1]


def test_an_entry_of_a_folder_is_found_once(looped: Path) -> None:
    os.mkfifo(looped / "pipe")
    (looped / "b.obj").symlink_to("a.obj")
    (looped / "gone").symlink_to("nothing")
    assert [p.name for p in entries(looped)] == ["a.obj", "below", "one"]
    assert [p.name for p in entries(looped, "*.obj")] == ["a.obj"]


def test_a_zipped_asset_holds_nothing_from_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "a" / "visual").mkdir(parents=True)
    (tmp_path / "key").write_text("of mine")
    (tmp_path / "a" / "asset.json").write_text("{}")
    (tmp_path / "a" / "visual" / "key").symlink_to(tmp_path / "key")
    with zipfile.ZipFile(io.BytesIO(zipped(tmp_path / "a"))) as archive:
        assert archive.namelist() == ["a/asset.json"]
