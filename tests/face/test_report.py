"""What is shown of an asset: report.html, offline and safe against names; and make-env's lines."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.asset.card import Asset, AssetCard, CardJoint, CardPart
from mam_sim.cli import main
from mam_sim.facts import check_sentences, joint_facts, timeline, verdict
from mam_sim.report import write_report
from mam_world.dataset import write_dataset


def test_a_page_shows_joints_and_pictures_and_escapes_what_it_is_given(tmp_path: Path) -> None:
    write_dataset("station_button", 1, 0, tmp_path)
    made = Asset.load(tmp_path / "station_button_000000")
    card = replace(made.card, name="a<b>", notes=["<script>alert(1)</script>"])
    page = write_report(Asset(made.folder, card)).read_text(encoding="utf-8")
    page, turning = re.sub(r' srcdoc="[^"]*"', "", page), page
    joint = card.joints[0]
    assert "srcdoc" in turning and joint.name in turning
    assert "<script" not in page and "&lt;script&gt;" in page and "<title>a&lt;b&gt;" in page
    # the whole and the joint, each closed and open; as read; links
    assert page.count('src="data:image/png') == 6
    assert "://" not in page and joint.name in page and 'href="asset.json"' in page
    assert "read from the file" in page


def test_a_failed_check_is_told_in_sentences_with_the_place() -> None:
    joint = CardJoint("lid_joint", "revolute", "hinge", "body", "lid", [0, 0, 1], [0, 0, 0], 0, 2)
    found = {
        "passed": False, "driven": True, "reasons": ["penetration", "mesh_missing", "drift"],
        "joints": [{"joint": "lid_joint", "reasons": ["penetration"], "at": np.pi / 2}],
        "findings": [{"where": "link lid", "code": "mesh_missing", "message": "no file lid.obj"}],
    }  # fmt: skip
    card = AssetCard("a", joints=[joint], checks={"executability": found})
    assert verdict(card) == "It fails the check."
    assert check_sentences(card) == [
        "lid_joint at 90 °: a part runs into another within its range.",
        "link lid: no file lid.obj.",
        "the base moves.",
    ]
    odd = {"passed": False, "driven": 3, "reasons": "drift", "joints": {"a": 1}, "findings": [7]}
    assert check_sentences(AssetCard("a", checks={"executability": odd})) == []


def test_the_timeline_counts_no_time_twice() -> None:
    card = AssetCard("a", seconds={"segment": 1.0, "write": 2.0, "asset": 2.5, "check": 1.5})
    rows = timeline(card)
    assert [(row.seconds, row.share) for row in rows] == [(1.0, 0.2), (2.5, 0.5), (1.5, 0.3)]


def test_masses_and_forces_have_their_ranges() -> None:
    part = CardPart("lid", "lid", "lid", mass=3.0, mass_range=(2.0, 4.0), material="steel")
    joint = CardJoint("j", "prismatic", "slide", "body", "lid", [0, 0, 1], [0, 0, 0], 0, 0.3,
                      friction=5.0, friction_range=(1.0, 9.0))  # fmt: skip
    card = AssetCard("a", parts=[part], joints=[joint], source={"kind": "mesh"})
    (row,) = joint_facts(card, card.joints)
    assert (row.span.value, row.mass.value) == ("0 to 30 cm", "3 kg (2 to 4)")
    assert row.force.value == "5 N (1 to 9)" and row.mass.origin == "assumed: steel"


def test_an_asset_that_no_arm_can_operate_is_told_and_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_dataset("station_button", 1, 0, tmp_path)
    made = Asset.load(tmp_path / "station_button_000000")
    verdict = {"passed": True, "driven": True, "reasons": []}
    made = Asset(made.folder, replace(made.card, checks={"executability": verdict}))
    rows = [{"joint": "button", "ok": False, "cause": "force", "why": "it is too heavy"}]
    refused = {"ok": False, "joint": None, "robot": "panda", "why": "too heavy", "joints": rows}
    monkeypatch.setattr("mam_sim.verbs.articulate.make", lambda *_args: made)
    monkeypatch.setattr("mam_envs.trial.try_environment", lambda *_args: refused)
    mesh = tmp_path / "button.glb"
    mesh.write_bytes(b"")
    command = ["make-env", str(mesh), "--out", str(made.folder)]
    assert main(command) == 1
    said = capsys.readouterr().out
    assert "env:    none: too heavy" in said and "collect" not in said
    assert "cannot (force): it is too heavy" in said
    assert said.splitlines()[-1] == f"next:   mam-sim view {made.folder}"
    assert Asset.load(made.folder).card.checks["environment"] == refused
    assert main([*command, "--asset-ok"]) == 0


def test_an_asset_that_fails_its_check_is_kept_and_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_dataset("station_button", 1, 0, tmp_path)
    made = Asset.load(tmp_path / "station_button_000000")
    verdict = {"passed": False, "driven": True, "reasons": ["frozen"]}
    made = Asset(made.folder, replace(made.card, checks={"executability": verdict}))
    tried = {"ok": True, "joint": "button", "robot": "panda", "joints": [
        {"joint": "button", "ok": True, "cause": "", "why": ""}]}  # fmt: skip
    monkeypatch.setattr("mam_sim.verbs.articulate.make", lambda *_args: made)
    monkeypatch.setattr("mam_envs.trial.try_environment", lambda *_args: tried)
    mesh = tmp_path / "button.glb"
    mesh.write_bytes(b"")
    for verb in ("articulate", "make-env"):
        assert main([verb, str(mesh), "--out", str(made.folder)]) == 1
        said = capsys.readouterr().out
        assert "check:  FAILS (frozen)" in said
    last = said.splitlines()[-1]
    assert last.startswith(f"next:   mam-sim collect {made.folder} --joint button ")
    assert (made.folder / "asset.json").is_file()
    assert main(["make-env", str(mesh), "--out", str(made.folder), "--asset-ok"]) == 1
