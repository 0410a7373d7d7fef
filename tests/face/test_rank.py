"""The measure of task success: its definition is pinned, and anybody's URDF is taken as it is."""

from __future__ import annotations

import json
import os
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.asset.foreign import foreign_asset, foreign_card
from mam_pipeline.config_file import plain
from mam_pipeline.errors import InputError
from mam_sim.cli import main
from mam_sim.rank.measure import VERSION, Measure, Row, Share, Verdict, total
from mam_sim.rank.page import page
from mam_sim.rank.run import Examine, Subject, Try

INERTIA = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'  # noqa: E501
LIMIT = '<limit lower="0" upper="1.57" effort="100" velocity="2"/>'


def _shape(origin: str, size: str) -> str:
    inside = f'<origin xyz="{origin}"/><geometry><box size="{size}"/></geometry>'
    return f"<visual>{inside}</visual><collision>{inside}</collision>"


def _cabinet(path: Path, limit: str = LIMIT) -> Path:
    """A cabinet as others write it: boxes, mass 1, visual as collision, no card."""
    path.write_text(
        f'<robot name="cabinet"><link name="body">{_shape("0 0 0", "0.4 0.4 0.4")}{INERTIA}</link>'
        f'<link name="door">{_shape("0 -0.2 0", "0.02 0.38 0.38")}'
        f"{_shape('-0.03 -0.35 0', '0.02 0.02 0.12')}{INERTIA}</link>"
        '<joint name="hinge" type="revolute"><parent link="body"/><child link="door"/>'
        f'<origin xyz="-0.215 0.2 0"/><axis xyz="0 0 -1"/>{limit}</joint></robot>'
    )
    return path


@pytest.mark.sim
def test_a_number_is_only_compared_with_one_of_the_same_measure() -> None:
    """Whoever changes one of these raises VERSION, here, there, and on the page."""
    from mam_envs.config import EnvConfig

    assert VERSION == 11
    assert asdict(Measure()) == {
        "episodes": 5, "seed": 50_000_017, "max_steps": None, "control_mode": "pd_joint_pos",
        "task": None,
    }  # fmt: skip
    assert plain(EnvConfig().success) == {
        "fraction": 0.75, "widest": np.pi / 2, "start": 0.6, "value": None, "tolerance": None,
        "still_speed": [0.1, 0.5], "driven": 0.5, "touch_force": 0.1, "part_force": 60.0,
        "link_force": 150.0, "grace_steps": 5,
    }  # fmt: skip
    assert plain(EnvConfig().randomisation) == {
        "position": 0.02, "yaw": 10.0, "robot_qpos": 0.01, "friction": [1.0, 1.0],
        "damping": [1.0, 1.0], "mass": [1.0, 1.0], "spread": False, "start": None,
        "light": [1.0, 1.0], "light_colour": 0.0,
        "light_turn": 0.0, "camera": 0.0, "camera_turn": 0.0, "fov": 0.0,
        "colour": 0.0, "scenery": 0.0, "noise": 0.0, "blur": 0.0, "backgrounds": 0.0,
        "away": [1.0, 1.5], "away_angle": 30.0, "away_turn": 20.0,
    }  # fmt: skip
    text = (Path(__file__).resolve().parents[2] / "docs/concepts/success.md").read_text()
    assert f"Its version is {VERSION}," in text and "50 000 017" in text and "200 control" in text


def test_what_cannot_be_tried_counts_as_failed() -> None:
    verdicts = [
        Verdict("a", "a", folder="a", lint=True, check=True, joints=(("d", "revolute"),) * 2),
        Verdict("b", "b", why="no XML", lint=False, check=False),
    ]
    rows = [
        Row("a", "d", "revolute", "panda", 5, successes=4, policy=3),
        Row("a", "e", "revolute", "panda", 5, cause="force", why="it is too heavy"),
    ]
    found = total(verdicts, rows, "panda", 5)
    assert (found.assets, found.loaded, found.lint, found.joints, found.tried) == (2, 1, 1, 2, 1)
    assert found.success == Share.of(4, 15) and found.on_tried == Share.of(4, 5)
    assert found.policy == Share.of(3, 15)
    assert found.success.line() == "27 % [11, 52]" and found.of_true is None
    html = page(verdicts, rows, [found], Measure(), {("a", "d", "panda"): "videos/x.mp4"})
    assert "force: it is too heavy" in html and "no XML" in html and 'src="videos/x.mp4"' in html


def test_a_true_joint_that_no_joint_moves_counts_as_failed() -> None:
    verdicts = [Verdict("a", "a", folder="a", joints=(("d", "revolute"),) * 3)]
    rows = [
        Row("a", "d", "revolute", "panda", 5, successes=4, true_joint="left"),
        Row("a", "e", "revolute", "panda", 5, successes=1, true_joint="left"),
        Row("a", "f", "revolute", "panda", 5, cause="truth", why="it is fixed in truth"),
    ]
    found = total(verdicts, rows, "panda", 5, {"a": ("left", "right"), "none": ("lid",)})
    assert found.success == Share.of(5, 15) and found.of_true == Share.of(4, 15)


def test_a_stranger_s_urdf_keeps_its_file_and_gets_a_card(tmp_path: Path) -> None:
    urdf = _cabinet(tmp_path / "cabinet.urdf")
    asset = foreign_asset(urdf, tmp_path / "out")
    assert asset.urdf_path.read_bytes() == urdf.read_bytes()
    joint = asset.card.joints[0]
    assert (joint.name, joint.type, joint.parent, joint.child) == (
        "hinge", "revolute", "body", "door",
    )  # fmt: skip
    assert joint.upper == pytest.approx(1.57) and {g.joint for g in asset.card.grasps} == {"hinge"}
    (tmp_path / "still.urdf").write_text('<robot name="s"><link name="a"/></robot>')
    with pytest.raises(InputError):
        foreign_asset(tmp_path / "still.urdf", tmp_path / "none")


def test_a_stranger_s_friction_damping_and_couplings_are_on_the_card(tmp_path: Path) -> None:
    urdf = _cabinet(tmp_path / "cabinet.urdf")
    text = urdf.read_text().replace(LIMIT, LIMIT + '<dynamics friction="0.7" damping="0.2"/>')
    second = re.findall(r'<link name="door">.*</joint>', text)[0]
    second = second.replace("door", "flap").replace('"hinge"', '"other"').replace("0.2 0", "0.9 0")
    second = second.replace("</joint>", '<mimic joint="hinge" multiplier="-0.5"/></joint>')
    urdf.write_text(text.replace("</robot>", second + "</robot>"))
    cards = {j.name: j for j in foreign_card(urdf).joints}
    hinge, other = cards["hinge"], cards["other"]
    assert (hinge.friction, hinge.damping, hinge.coupling) == (0.7, 0.2, None)
    assert other.coupling is not None
    assert (other.coupling.joint, other.coupling.multiplier) == ("hinge", -0.5)


@pytest.mark.sim
@pytest.mark.slow
def test_what_can_be_run_is_run_and_what_cannot_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = _cabinet(tmp_path / "good.urdf")
    endless = _cabinet(tmp_path / "endless.urdf", limit="")
    broken, other = tmp_path / "broken.urdf", tmp_path / "other.xml"
    broken.write_text("<robot><link name='a'")
    other.write_text('<mujoco model="m"><worldbody><geom type="banana"/></worldbody></mujoco>')
    files = [str(f) for f in (good, endless, broken, other)]
    command = ["rank", *files, "--episodes", "1", "--out", str(tmp_path / "out"), "--json"]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["measure"]["version"] == VERSION
    rows = {r["asset"].split("-")[0]: r for r in found["rows"]}
    assert set(rows) == {"good", "endless"}
    assert rows["good"]["cause"] == "" and rows["good"]["episodes"] == 1
    assert rows["endless"]["cause"] == "asset" and "<limit>" in rows["endless"]["why"]
    why = {a["name"].split("-")[0]: a["why"] for a in found["assets"]}
    assert "XML" in why["broken"] and "MJCF" in why["other"]
    assert main(["rank", str(broken), "--quiet"]) == 2
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "rows").iterdir()}
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out) == found
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "rows").iterdir()} == kept
    assert (tmp_path / "out" / "index.html").is_file()


@pytest.mark.sim
@pytest.mark.slow
def test_what_is_measured_is_filmed_later_on_request(tmp_path: Path) -> None:
    from mam_envs.scene.vulkan import vulkan_ok

    if not vulkan_ok():
        pytest.skip("no Vulkan device to render with")
    out, command = tmp_path / "out", ["rank", str(_cabinet(tmp_path / "good.urdf"))]
    command += ["--episodes", "1", "--quiet", "--out", str(out)]
    assert main(command) == 0 and not (out / "videos").exists()
    assert main([*command, "--video"]) == 0
    (film,) = (out / "videos").iterdir()
    assert film.stat().st_size > 1000 and film.name in (out / "index.html").read_text()


@pytest.mark.parametrize("change", [
    {"lint": "yes"}, {"joints": 5}, {"joints": [["a"]]}, {"name": [1]}, {"more": 1},
    {"folder": "/etc"}, {"name": "another"},
])  # fmt: skip
def test_a_verdict_that_is_none_is_found_again(tmp_path: Path, change: dict[str, object]) -> None:
    task = Examine(Subject.of(_cabinet(tmp_path / "a.urdf")), tmp_path / "out")
    mine = Verdict(task.subject.name, str(tmp_path / "a.urdf"), joints=(("a", "revolute"),))
    task.file.parent.mkdir(parents=True)
    task.file.write_text(json.dumps(asdict(mine)))
    assert task.known == mine
    task.file.write_text(json.dumps({**asdict(mine), **change}))
    assert task.known is None
    for text in ("", "null", "[]", json.dumps(asdict(mine))[:40], "[" * 100_000):
        task.file.write_text(text)
        assert task.known is None


@pytest.mark.parametrize("change", [
    {"successes": "x"}, {"successes": -1}, {"episodes": None}, {"robot": "other"},
    {"reasons": {"a": "b"}}, {"joint": 5}, {"more": 1},
])  # fmt: skip
def test_a_row_that_is_none_is_measured_again(tmp_path: Path, change: dict[str, object]) -> None:
    verdict = Verdict("a", "a", folder="a", joints=(("j", "revolute"),))
    task = Try(verdict, "j", "revolute", "panda", Measure(), "none", tmp_path, "1")
    assert task.known is None and not task.done
    row = task.row(successes=3, reasons={"late": 2})
    task.file.parent.mkdir(parents=True)
    task.file.write_text(json.dumps(asdict(row)))
    assert task.known == row and task.done
    task.file.write_text(json.dumps({**asdict(row), **change}))
    assert task.known is None and not task.done


def test_what_is_no_asset_is_a_row_and_alone_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mesh.glb").write_text("x")
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "empty").mkdir()
    (tmp_path / "card").mkdir()
    (tmp_path / "card" / "asset.json").write_text("[]")
    os.mkfifo(tmp_path / "pipe.urdf")
    why = {
        "mesh.glb": "is a mesh, not an asset", "notes.txt": "is no asset folder, and not a URDF",
        "empty": "no asset.json in", "card": "must hold names and values",
        "pipe.urdf": "is no ordinary file", "gone": "no such file or folder",
    }  # fmt: skip
    for name, words in why.items():
        assert words in Subject.of(tmp_path / name).fault
        task = Examine(Subject.of(tmp_path / name), tmp_path)
        assert task.known is not None and words in task.known.why
    assert main(["rank", str(tmp_path / "gone"), "--out", str(tmp_path / "out")]) == 2
    assert "no such file or folder" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(["rank", str(tmp_path / "gone"), "--truth", str(tmp_path / "pipe.urdf")]) == 2
    assert "is no ordinary file" in capsys.readouterr().err
