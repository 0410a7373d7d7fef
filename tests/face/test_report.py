"""What is shown of an asset: report.html, offline and safe against names; and make-env's lines."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from mam_pipeline.asset.card import Asset
from mam_sim.cli import main
from mam_sim.report import write_report
from mam_world.dataset import write_dataset


def test_a_page_shows_joints_and_pictures_and_escapes_what_it_is_given(tmp_path: Path) -> None:
    write_dataset("station_button", 1, 0, tmp_path)
    made = Asset.load(tmp_path / "station_button_000000")
    card = made.card
    evidence = {"loss": [3.0, 2.0, 1.0, 0.5], "why": "<img src=x>"}
    joint = replace(card.joints[0], evidence=evidence)
    card = replace(card, name="a<b>", notes=["<script>alert(1)</script>"], joints=[joint])
    page = write_report(Asset(made.folder, card)).read_text(encoding="utf-8")
    page, turning = re.sub(r' srcdoc="[^"]*"', "", page), page
    assert "srcdoc" in turning and joint.name in turning
    assert "<script" not in page and "&lt;script&gt;" in page and "<title>a&lt;b&gt;" in page
    assert "<img src=x>" not in page and "loss: 0.5 to 3" in page and "<polyline" in page
    assert page.count('src="data:image/png') == 5  # as read, links, and three of the motion
    assert "://" not in page and joint.name in page


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
