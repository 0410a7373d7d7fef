"""The true object in the asset's place: a wrong joint type opens by itself, but not in truth."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.foreign import true_asset
from mam_pipeline.errors import InputError, NotPhysicalError
from mam_pipeline.formats.urdf.read import read_urdf
from mam_policies.evaluate import evaluate_expert
from mam_policies.run import EnvChoice
from mam_sim.cli import main


def sliding(door: Path, out: Path) -> Path:
    """The URDF of the door as a sliding one: it goes 0.3 m to the side."""
    text = (door / "object.urdf").read_text(encoding="utf-8")
    text = text.replace('type="revolute"', 'type="prismatic"')
    text = text.replace('axis xyz="0 0 -1"', 'axis xyz="0 1 0"')
    out.write_text(text.replace(f'upper="{np.pi / 2}"', 'upper="0.3"'), encoding="utf-8")
    return out


def test_a_hinge_that_is_a_slide_in_truth_does_not_open(door: Path, tmp_path: Path) -> None:
    asset, choice = Asset.load(door), EnvChoice((str(door),), "joint_1")
    same = true_asset(door / "object.urdf", asset, tmp_path / "same")
    assert evaluate_expert(choice, 1, truth=same.folder).successes == 1
    slide = true_asset(sliding(door, tmp_path / "slide.urdf"), asset, tmp_path / "slide")
    found = evaluate_expert(choice, 1, truth=slide.folder)
    assert found.successes == 0 and found.joint == "joint_1"


def test_rank_and_eval_take_a_truth(
    door: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = str(sliding(door, tmp_path / "slide.urdf"))
    command = ["eval", "--expert", "--asset", str(door), "--episodes", "1", "--json"]
    assert main([*command, "--truth", truth]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["run"] is None and result["total"]["successes"] == 0
    assert result["results"][0]["expert"]["episodes"] == 1
    assert main(["rank", str(door), "--truth", truth, truth]) == 2
    assert "--truth needs one URDF per asset: 1, not 2" in capsys.readouterr().err
    assert main(["eval", "--asset", str(door)]) == 2
    assert "--expert" in capsys.readouterr().err


def test_the_truth_stands_in_the_asset_s_frame_and_size(drawer: Path, tmp_path: Path) -> None:
    from mam_envs.object_model import ObjectModel

    place = np.eye(4)
    place[:3, :3] = 0.5 * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    place[:3, 3] = [0.1, 0.2, 0.3]
    asset = Asset.load(drawer)
    moved = Asset(drawer, replace(asset.card, source_to_asset=place.tolist()))
    truth = true_asset(drawer / "object.urdf", moved, tmp_path / "truth")
    model = ObjectModel.load(truth, truth.card.metres_per_unit)
    low, high = ObjectModel.load(asset).bounds()
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                        for z in (low[2], high[2])]) @ place[:3, :3].T + place[:3, 3]  # fmt: skip
    np.testing.assert_allclose(
        model.bounds(), [corners.min(axis=0), corners.max(axis=0)], atol=1e-6
    )


@pytest.mark.parametrize("written", ["Z up", "Y up"])
def test_a_truth_stands_whatever_way_is_up_in_the_asset_s_file(
    written: str, drawer: Path, tmp_path: Path
) -> None:
    """Of a GLB, in which Y is up, the truth is often a URDF with Z up: it is turned once."""
    asset = Asset.load(drawer)
    y_up = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # to Z up
    card = replace(asset.card, source_to_asset=y_up.tolist())
    truth, joint = drawer / "object.urdf", ""
    if written == "Y up":
        joint = (
            '<link name="file"/><joint name="up" type="fixed"><parent link="file"/>'
            f'<child link="base"/><origin rpy="{-np.pi / 2} 0 0"/></joint></robot>'
        )
        shutil.copytree(drawer, tmp_path / "file")
        truth = tmp_path / "file" / "object.urdf"
        truth.write_text((drawer / "object.urdf").read_text().replace("</robot>", joint))
    found = true_asset(truth, Asset(drawer, card), tmp_path / "truth")
    boxes = [read_urdf(a.urdf_path).mesh.bounds for a in (found, asset)]
    np.testing.assert_allclose(boxes[0], boxes[1], atol=1e-6)
    axes = [read_urdf(a.urdf_path).joints[0].axis for a in (found, asset)]
    np.testing.assert_allclose(axes[0], axes[1], atol=1e-6)


def test_a_truth_made_from_the_same_file_stands_by_its_card(drawer: Path, tmp_path: Path) -> None:
    """`static.glb` of a generated object and the asset that was made of it, each in its frame."""
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    place, own = np.eye(4), np.eye(4)
    place[:3, :3], own[:3, 3] = 0.5 * quarter, (0.2, 0.1, 0)
    shutil.copytree(drawer, tmp_path / "true")
    card, same = Asset.load(drawer).card, {"path": "static.glb", "sha256": "ab"}
    replace(card, source=same, source_to_asset=own.tolist()).save(tmp_path / "true")
    asset = Asset(drawer, replace(card, source=same, source_to_asset=place.tolist()))
    turned = Asset(drawer, replace(asset.card, source={**same, "sha256": "another"}))
    truth = tmp_path / "true" / "object.urdf"
    found, other = (
        true_asset(truth, a, tmp_path / f"out{i}") for i, a in enumerate((asset, turned))
    )
    before = read_urdf(drawer / "object.urdf").mesh
    scaled = [a.card.metres_per_unit * read_urdf(a.urdf_path).mesh.bounds for a in (found, other)]
    np.testing.assert_allclose(
        scaled[0], before.transformed(place @ np.linalg.inv(own)).bounds, atol=1e-6
    )
    np.testing.assert_allclose(scaled[1], before.transformed(place).bounds, atol=1e-6)


def test_what_is_fixed_in_truth_and_what_is_elsewhere_is_said(drawer: Path, tmp_path: Path) -> None:
    from mam_envs.config import EnvConfig
    from mam_envs.robots import robot_spec
    from mam_envs.scene.layout import arrange
    from mam_envs.tasks.operate_joint import OperateJoint
    from mam_envs.truth import true_layout

    asset, config = Asset.load(drawer), EnvConfig()
    claimed = arrange(asset, "joint_1", "open", robot_spec("panda"), 1.0, config)
    text = (drawer / "object.urdf").read_text(encoding="utf-8")
    fixed, far = tmp_path / "fixed.urdf", tmp_path / "far.urdf"
    box = '<origin xyz="0 0 0.6"/><geometry><box size="0.1 0.1 0.1"/></geometry>'
    extra = (
        f'<link name="lid"><visual>{box}</visual><collision>{box}</collision></link>'
        '<joint name="j" type="revolute"><parent link="base"/>'
        '<child link="lid"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>'
        "</joint></robot>"
    )
    fixed.write_text(text.replace("prismatic", "fixed").replace("</robot>", extra), "utf-8")
    far.write_text(text.replace('<origin xyz="0.0 0.0 0.2"/>', '<origin xyz="3 0 0.2"/>'), "utf-8")
    cases = (fixed, NotPhysicalError, "is fixed"), (far, InputError, "stand as")
    for urdf, error, words in cases:
        truth = true_asset(urdf, asset, tmp_path / urdf.stem)
        with pytest.raises(error, match=words):
            true_layout(claimed, truth, OperateJoint, config.success)


def test_the_true_part_begins_where_the_assets_does(door: Path, tmp_path: Path) -> None:
    """A joint with another zero and range, but the same motion, is the same joint."""
    text = (door / "object.urdf").read_text(encoding="utf-8")
    wide = tmp_path / "wide.urdf"
    wide.write_text(text.replace('lower="0', 'lower="-0.9'), encoding="utf-8")
    assert wide.read_text(encoding="utf-8") != text
    asset = Asset.load(door)
    truth = true_asset(wide, asset, tmp_path / "truth")
    found = evaluate_expert(EnvChoice((str(door),), "joint_1"), 1, truth=truth.folder)
    assert found.successes == 1
