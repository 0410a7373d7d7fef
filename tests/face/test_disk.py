"""Full disks, missing rights and names that cannot be: a sentence, exit 2, the old result whole."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trimesh

from mam_pipeline import folders
from mam_pipeline.errors import disk_error
from mam_sim.cli import main

SMALL = """<robot name="r"><link name="base"><visual><geometry><box size="1 1 1"/></geometry>
</visual></link><link name="door"><visual><origin xyz="0.6 0 0"/><geometry>
<box size="0.1 1 1"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="door"/>
<origin xyz="0 0.5 0"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/>
</joint></robot>"""


@pytest.fixture
def source(tmp_path: Path) -> Path:
    file = tmp_path / "in" / "small.urdf"
    file.parent.mkdir()
    file.write_text(SMALL)
    return file


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 3 MiB; skips where this user may not mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root can mount a small disk")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=False)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Run a verb that must end with status 2 and one sentence; returns it."""
    capsys.readouterr()
    assert main([str(a) for a in arguments]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mam-sim: ")]
    assert len(said) == 1
    return said[0]


def everything(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_full_disk_leaves_the_old_asset(
    small_disk: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = small_disk / "a"
    assert main(["articulate", str(source), "--out", str(out), "--quiet"]) < 2
    before = everything(small_disk)
    fill = small_disk / "fill"
    fill.write_bytes(bytes(shutil.disk_usage(small_disk).free - (8 << 10)))
    said = refused(capsys, "articulate", source, "--out", out, "--quiet")
    assert "the disk is full" in said and "make room" in said
    said = refused(capsys, "view", out, "--quiet")
    assert "the disk is full" in said
    said = refused(capsys, "articulate", source, "--out", small_disk / "b" / "c", "--quiet")
    assert "the disk is full" in said
    fill.unlink()
    assert everything(small_disk) == before
    assert {p.name for p in small_disk.iterdir()} == {"a"}


def test_a_full_disk_ends_a_batch_and_a_data_set_and_leaves_nothing(
    small_disk: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What a full disk stopped is no result: after room was made, the same command does it."""
    fill, batch = small_disk / "fill", small_disk / "above" / "batch"
    for room in (8 << 10, 40 << 10):
        fill.write_bytes(b"")
        fill.write_bytes(bytes(shutil.disk_usage(small_disk).free - room))
        for words in (
            ["generate", "--category", "box_cabinet", "--count", "2", "--out", small_disk / "g"],
            ["batch", source, "--out", batch],
        ):
            said = refused(capsys, *words, "--quiet")
            assert "the disk is full at" in said and str(small_disk) in said
            assert {p.name for p in small_disk.iterdir()} == {"fill"}
    fill.unlink()
    assert main(["batch", str(source), "--out", str(batch), "--quiet"]) < 2
    assert len(list(batch.glob("assets/*/asset.json"))) == 1


def test_a_disk_that_cannot_be_written(
    small_disk: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = small_disk / "a"
    assert main(["articulate", str(source), "--out", str(out), "--quiet"]) < 2
    before = everything(small_disk)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    for words in (
        ["articulate", source, "--out", out, "--quiet"],
        ["articulate", source, "--out", small_disk / "b", "--quiet"],
        ["view", out, "--quiet"],
        ["check", out, "--no-drive", "--quiet", "--out", out / "report.json"],
    ):
        assert "cannot be written; name another place" in refused(capsys, *words)
    assert everything(small_disk) == before


def test_a_folder_of_somebody_else(tmp_path: Path) -> None:
    """As an ordinary user, in a folder that belongs to another."""
    if os.geteuid() != 0:
        pytest.skip("only root can become somebody else")
    try:
        os.seteuid(65534)
        with pytest.raises(PermissionError) as caught:
            folders.write_text(tmp_path / "a.json", "x")
    finally:
        os.seteuid(0)
    assert "you have no right to use" in str(disk_error(caught.value))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("verb", ["articulate", "view"])
def test_a_path_that_is_a_file_and_a_name_that_is_too_long(
    verb: str, tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    for out, said in (
        (tmp_path / "file", "file"),
        (tmp_path / "file" / "below", "a folder is needed there"),
        (tmp_path / ("n" * 300), "a name has at most 255 bytes"),
    ):
        assert said in refused(capsys, verb, source, "--out", out, "--quiet")
    assert {p.name for p in tmp_path.iterdir()} == {"in", "file"}
    assert (tmp_path / "file").read_text() == "mine"


def test_a_link_with_a_long_name_can_be_written(tmp_path: Path) -> None:
    """Names of files are made of the names of links."""
    file, out = tmp_path / "a.urdf", tmp_path / "a"
    file.write_text(SMALL.replace('"door"', f'"{"d" * 300}"'))
    assert main(["articulate", str(file), "--out", str(out), "--quiet"]) in (0, 1)
    assert (out / "asset.json").is_file()


def test_hdf5_tells_its_error_in_words() -> None:
    said = disk_error(OSError("Can't write data (file write failed: errno = 28, message = 'No'"))
    assert "the disk is full" in str(said)


def test_what_is_unknown_is_still_one_sentence() -> None:
    assert "\n" not in str(disk_error(OSError("several\nlines")))
    assert str(disk_error(OSError(5, "Input/output error", "a"))) == "Input/output error (a)"


def test_reading_without_a_right_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "a.stl"
    trimesh.creation.box().export(file)

    def denied(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied", str(file))

    monkeypatch.setattr("mam_pipeline.formats.mesh_files.load_mesh", denied)
    said = refused(capsys, "articulate", file, "--out", tmp_path / "out", "--quiet")
    assert "you have no right to use" in said and not (tmp_path / "out").exists()
