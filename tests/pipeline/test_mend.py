"""Every reason that is mended has a pair: one file that has it, and one that is left as it is."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yourdfpy

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.listing import asset_folders
from mam_pipeline.check.check import check_asset, check_profile
from mam_pipeline.check.report import REASONS
from mam_pipeline.mend import REPAIRS, Order, mend
from mam_pipeline.mend.work import Work
from mam_sim.cli import main
from mam_sim.rank.run import subjects
from tests.pipeline.fault_cases import FAIL, case, write

pytestmark = pytest.mark.sim


def codes(urdf: Path) -> set[str]:
    """Reasons of the check, and of the profiles; warnings too."""
    names = ("isaac", "mujoco", "gazebo", "drake", "physx-gpu")
    found = {f.code for n in names for f in check_profile(urdf, n).findings}
    report = check_asset(urdf)
    return found | {f.code for f in report.findings} | set(report.reasons)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """What is said of the file with nothing wrong."""
    return codes(case(tmp_path_factory.mktemp("sound")))


@pytest.mark.parametrize("name", list(FAIL))
def test_what_fails_is_refused_for_its_reason_and_mended(tmp_path: Path, name: str) -> None:
    reason, urdf = FAIL[name][0], write(name, tmp_path / "fail")
    before = urdf.read_bytes()
    assert reason in codes(urdf)
    found = mend(urdf, tmp_path / "out", Order(only=(reason,)))
    assert {c.reason for c in found.changes} == {reason}
    assert reason not in codes(tmp_path / "out" / "r.urdf"), found
    assert found.passed, found.left
    assert urdf.read_bytes() == before


def test_every_kind_of_repair_that_a_file_can_ask_for_has_a_pair() -> None:
    pairs = {reason for reason, _, _ in FAIL.values()}
    rest = {"mesh_outside", "collision_off", "exploded", "drift", "frozen", "no_return"}
    assert pairs | rest == set(REPAIRS) and set(REPAIRS) <= set(REASONS)


def test_what_passes_is_left_byte_for_byte(tmp_path: Path, sound: set[str]) -> None:
    urdf = case(tmp_path / "pass")
    found = mend(urdf, tmp_path / "out")
    assert not sound and found.changes == () and found.before and found.passed
    for file in (tmp_path / "pass").iterdir():
        assert (tmp_path / "out" / file.name).read_bytes() == file.read_bytes()
    kept = json.loads((tmp_path / "out" / "mend.json").read_text())
    assert kept["changes"] == [] and kept["source"] == str(urdf)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "r.urdf",
        "body.obj",
        "door.obj",
        "mend.json",
        "asset.json",
    }


def test_what_it_writes_is_an_asset_with_the_numbers_of_the_file(
    tmp_path: Path,
) -> None:
    urdf = case(tmp_path / "fridge")
    text = urdf.read_text().replace('name="r"', 'name="fridge"', 1)
    urdf.write_text(re.sub(r"<inertial>.*?</inertial>|<dynamics[^>]*>", "", text, flags=re.S))
    found = mend(urdf, tmp_path / "out")
    asset = Asset.load(tmp_path / "out")
    assert found.asset and asset.card.executable is found.passed is True
    told = {j.name: j for j in yourdfpy.URDF.load(found.urdf, load_meshes=False).robot.joints}
    for joint in asset.card.movable:
        own = told[joint.name]
        assert joint.friction == pytest.approx(float(own.dynamics.friction)) and joint.friction > 0
        assert joint.damping == pytest.approx(float(own.dynamics.damping)) and joint.damping > 0
        assert (joint.lower, joint.upper) == pytest.approx((own.limit.lower, own.limit.upper))
    assert any("steel sheet" in c.why for c in found.changes)  # a fridge's door, not a cupboard's
    made = {p.link: p.mass for p in asset.card.parts}
    assert all(made[j.child] > 0 for j in asset.card.movable)


def test_a_door_on_a_link_without_a_shape_does_not_collide_with_its_body(tmp_path: Path) -> None:
    """Simulators leave out parent and child alone, and 2 mm of overlap throw such a door open."""
    mount = (
        '<link name="mount"/><joint name="m" type="fixed"><parent link="body"/>'
        '<child link="mount"/></joint></robot>'
    )
    urdf = case(
        tmp_path / "mounted", ('<parent link="body"/>', '<parent link="mount"/>'),
        ("xyz=\"-0.2 -0.2 0\"", "xyz=\"-0.198 -0.2 0\""), ("</robot>", mount),
    )  # fmt: skip
    theirs = '<disable_collisions link1="a" link2="b" reason="Never"/>'
    urdf.with_suffix(".srdf").write_text(f'<robot name="r">{theirs}</robot>')
    found = mend(urdf, tmp_path / "out")
    assert "frozen" in found.reasons_before and found.passed, found.left
    assert [(c.reason, c.where) for c in found.changes] == [("frozen", "body, door")]
    pairs = ET.parse(tmp_path / "out" / "r.srdf").getroot().findall("disable_collisions")
    assert [(p.get("link1"), p.get("link2")) for p in pairs] == [("a", "b"), ("body", "door")]


def test_what_is_taken_back_leaves_no_pair_that_does_not_collide(tmp_path: Path) -> None:
    urdf = case(tmp_path / "door")
    work = Work(urdf, tmp_path / "out")
    state = work.state()
    work.srdf.write_text("<robot name='r'/>")
    work.restore(state)
    assert not work.srdf.exists()


def test_what_does_not_move_is_mended_and_no_asset(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text("<robot name='r'><link name='a'/></robot>")
    found = mend(tmp_path / "r.urdf", tmp_path / "out")
    assert not found.asset and not (tmp_path / "out" / "asset.json").exists()
    assert subjects([tmp_path / "out"]) == [tmp_path / "out" / "r.urdf"]  # rank says why


def test_an_mjcf_comes_out_as_a_urdf_that_passes(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "box.xml").write_text("""<mujoco><worldbody><body name="case">
    <geom type="box" size="0.2 0.2 0.2"/><body name="tray" pos="-0.21 0 0">
    <joint name="slide" type="slide" axis="-1 0 0"/><geom type="box" size="0.01 0.2 0.2"/>
    <geom type="box" size="0.15 0.05 0.05" pos="0.16 0 0"/></body></body></worldbody></mujoco>""")
    found = mend(tmp_path / "box.xml", tmp_path / "out")
    assert [c.reason for c in found.changes][:2] == ["file_format", "bad_limits"]
    assert Path(found.urdf).name == "box.urdf" and not found.before


def test_slides_that_free_a_base_become_fixed(tmp_path: Path) -> None:
    """As a walker of Gymnasium has them: without limits, and with nothing to slide on."""
    pytest.importorskip("mujoco")
    (tmp_path / "walker.xml").write_text("""<mujoco><worldbody><body name="case" pos="0 0 1">
    <joint name="rootx" type="slide" axis="1 0 0"/><joint name="rootz" type="slide" axis="0 0 1"/>
    <geom type="box" size="0.2 0.2 0.2"/><body name="tray" pos="-0.21 0 0">
    <joint name="slide" type="slide" axis="-1 0 0"/><geom type="box" size="0.01 0.2 0.2"/>
    <geom type="box" size="0.15 0.05 0.05" pos="0.16 0 0"/></body></body></worldbody></mujoco>""")
    found = mend(tmp_path / "walker.xml", tmp_path / "out", Order(drive=False))
    joints = {j.get("name"): j for j in ET.parse(found.urdf).getroot().findall("joint")}
    assert [joints[n].get("type") for n in ("rootx", "rootz", "slide")] == ["fixed"] * 2 + [
        "prismatic"
    ]
    assert not any("bad_limits" in line for line in found.left), found.left


def test_the_verb_says_what_it_does_and_ends_with_what_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write("limits_exchanged", tmp_path / "one")
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "r.urdf").write_text("<robot name='r'><link name='a'/></robot>")
    one, two, out = (str(tmp_path / name) for name in ("one", "two", "out"))
    assert main(["mend", one, "--dry-run", "--no-drive"]) == 0
    said = capsys.readouterr().out
    assert "bad_limits: hinge: 1.5 .. 0 -> 0 .. 1.5 (the lower end is the lower number)" in said
    assert not (tmp_path / "out").exists()
    assert main(["mend", one, two, "--out", out, "--no-drive"]) == 1
    said = capsys.readouterr().out
    assert "2 files: 0 passed before, 1 pass now" in said
    assert said.splitlines()[-1] == f"next:   mam-sim rank {out}"
    asset, still = sorted(subjects([Path(out)]), key=Path.is_file)
    assert (asset / "asset.json").is_file() and still.name == "r.urdf"
    assert asset_folders([Path(out)]) == [asset.resolve()]  # what train and register take
    assert main(["mend", one, "--out", out, "--no-drive"]) == 2  # of several files before
    assert main(["mend", one, "--dry-run", "--only", "bad_limit"]) == 2
    assert "did you mean 'bad_limits'" in capsys.readouterr().err
    (tmp_path / "two" / "r.urdf").write_text("<robot")
    assert main(["mend", two, "--out", str(tmp_path / "none"), "--no-drive"]) == 2
