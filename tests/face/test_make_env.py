"""The whole way through the command line: photo, mesh and URDF; stages reused and edited."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
import yaml

import mam_world as world
from mam_pipeline.asset.card import Asset
from mam_pipeline.formats.mesh_files import save_glb
from mam_sim.cli import main

pytestmark = pytest.mark.sim

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="module")
def photo_asset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("photo") / "nightstand"
    status = main(["make-env", str(ROOT / "examples" / "nightstand.jpg"), "--out", str(out)])
    assert status == 0
    return out


def test_a_photo_becomes_an_asset_that_passes_and_an_environment_that_steps(
    photo_asset: Path,
) -> None:
    card = Asset.load(photo_asset).card
    assert [j.subtype for j in card.joints] == ["slide"] * 3
    assert card.checks["executability"]["passed"]
    assert card.checks["environment"]["ok"]
    page = (photo_asset / "report.html").read_text()
    assert page.count("data:image/") >= 8
    # the turning object's own script names an XML namespace, which nothing is fetched from
    addresses = set(re.findall(r"\w+://[^\s&\"']*", page.split("<body", 1)[-1]))
    assert addresses <= {"http://www.w3.org/1999/xhtml"}
    assert (photo_asset / "stages" / "0_photo" / "hints.yaml").is_file()


def test_the_folder_can_be_moved_and_read_by_others(photo_asset: Path, tmp_path: Path) -> None:
    import yourdfpy

    moved = tmp_path / "elsewhere"
    shutil.copytree(photo_asset, moved)
    robot = yourdfpy.URDF.load(str(moved / "object.urdf"))
    assert len(robot.actuated_joints) == 3
    assert main(["check", str(moved)]) == 0


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """A procedural chest of drawers as a static GLB."""
    made = world.make_object("chest", 3, world.Style())
    save_glb(made.static, tmp_path / "chest.glb")
    return tmp_path / "chest.glb"


def test_an_edited_stage_is_kept_and_what_follows_is_computed_again(
    unit: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "asset"
    hints = tmp_path / "hints.yaml"
    hints.write_text("parts: [{name: drawer, primitives: [1], joint: {subtype: slide}}]\n")
    command = ["articulate", str(unit), "--out", str(out), "--hints", str(hints)]
    assert main(command) == 0
    file = out / "stages" / "4_joints" / "joints.yaml"
    data = yaml.safe_load(file.read_text())
    assert data["joints"]
    data["joints"][0]["upper"] = data["joints"][0]["upper"] * 0.5
    wanted = data["joints"][0]["upper"]
    file.write_text(yaml.safe_dump(data))
    capsys.readouterr()
    assert main([*command, "--json"]) == 0
    card = json.loads(capsys.readouterr().out)
    assert card["backends"]["solver"]["name"] == "embedded"
    assert card["backends"]["solver"]["edited"]
    assert card["backends"]["segmenter"]["name"] == "geometric"
    assert not card["backends"]["segmenter"]["edited"] and "segment" not in card["seconds"]
    assert card["joints"][0]["provenance"] == "user"
    assert card["joints"][0]["upper"] == pytest.approx(wanted, abs=1e-6)


def test_hints_have_the_last_word(unit: Path, tmp_path: Path) -> None:
    out = tmp_path / "asset"
    hints = tmp_path / "hints.yaml"
    hints.write_text(
        "parts:\n- {name: tray, kind: drawer, primitives: [1], joint: {subtype: slide, "
        "axis: [-1, 0, 0], lower: 0.0, upper: 0.05}}\n"
    )
    command = ["articulate", str(unit), "--out", str(out), "--hints", str(hints)]
    assert main(command) == 0
    joint = next(j for j in Asset.load(out).card.joints if j.child == "tray")
    assert joint.type == "prismatic" and joint.upper == pytest.approx(0.05)


def test_a_urdf_enters_at_the_asset(photo_asset: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    assert main(["articulate", str(photo_asset / "object.urdf"), "--out", str(out)]) == 0
    first, second = Asset.load(photo_asset).card, Asset.load(out).card
    assert [j.name for j in first.joints] == [j.name for j in second.joints]
    for a, b in zip(first.joints, second.joints):
        assert a.axis == pytest.approx(b.axis, abs=1e-6)
        assert (a.lower, a.upper) == pytest.approx((b.lower, b.upper), abs=1e-6)


def test_a_photo_without_an_object_is_refused_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from PIL import Image

    wall = tmp_path / "wall.png"
    Image.new("RGB", (640, 480), (200, 198, 190)).save(wall)
    status = main(["make-env", str(wall), "--out", str(tmp_path / "out")])
    assert status in (3, 4)
    assert "Traceback" not in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_doubted_photo_gives_a_draft_that_its_line_confirms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shlex

    import cv2

    picture = cv2.imread(str(ROOT / "examples" / "nightstand.jpg"))
    assert picture is not None
    picture[430:530, 240:480] = picture[410, 360]  # the handle in the middle is hidden
    photo, out = tmp_path / "hidden.png", tmp_path / "twin"
    cv2.imwrite(str(photo), picture)
    assert main(["articulate", str(photo), "--out", str(out), "--quiet"]) == 3
    line = next(x for x in capsys.readouterr().err.splitlines() if "mam-sim make-env" in x)
    draft = Asset.load(out)
    assert draft.card.unconfirmed and draft.card.draft.startswith("twin is a draft")
    assert line in draft.card.unconfirmed
    assert "nobody has confirmed" in (out / "report.html").read_text()
    assert not list(tmp_path.glob("*.png.*")) and len(draft.card.movable) == 3

    words = ["articulate", *shlex.split(line)[2:], "--quiet"]
    assert main(words) == 0
    made = Asset.load(out)
    assert made.card.draft == ""
    for read, typed in zip(draft.card.joints, made.card.joints, strict=True):
        assert read.origin == typed.origin and read.upper == typed.upper
        assert typed.basis.rule == "depth"  # nobody said how far it goes
    assert main(["articulate", str(photo), "--out", str(out), "--quiet"]) == 3
    assert Asset.load(out).card.draft == ""  # a draft replaces nothing that was confirmed
