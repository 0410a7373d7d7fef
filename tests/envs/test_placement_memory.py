"""Places that were found before: the same again, never a wrong one, and nothing of the machine."""

from __future__ import annotations

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_envs.config import RandomisationConfig, SuccessConfig
from mam_envs.grasping.candidates import PlacementError
from mam_envs.object_model import ObjectModel
from mam_envs.placement import memory
from mam_envs.placement.base import Placement, place
from mam_envs.robots import robot_spec
from mam_envs.tasks.operate_joint import joint_goal
from mam_pipeline.asset.card import Asset

CHANCE = RandomisationConfig()


@pytest.fixture
def searches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A folder of its own, and a list that grows by every search."""
    made: list[str] = []

    def counted(model: ObjectModel, *rest: Any) -> Placement:
        made.append(model.asset.card.name)
        return place(model, *rest)

    monkeypatch.setenv(memory.VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr(memory, "place", counted)
    return made


def ask(folder: Path, robot: str = "panda", **more: Any) -> Placement:
    model = ObjectModel.load(Asset.load(folder), more.get("scale", 1.0))
    goal = joint_goal(model, None, None, more.get("success", SuccessConfig()))
    spec = replace(robot_spec(robot), **more.get("spec", {}))
    return memory.remembered_place(model, (goal,), spec, more.get("chance", CHANCE))


def plain(found: Placement) -> str:
    return json.dumps(asdict(found), default=lambda v: np.asarray(v).tolist())


def test_a_place_is_searched_for_once(drawer: Path, tmp_path: Path, searches: list[str]) -> None:
    first = ask(drawer)
    copied = shutil.copytree(drawer, tmp_path / "elsewhere")
    again = ask(copied)
    assert len(searches) == 1 and plain(again) == plain(first)
    assert again.path.grasp.card == first.path.grasp.card
    assert again.path.grasp.lags == first.path.grasp.lags
    (entry,) = (tmp_path / "kept").rglob("*.json")
    text = entry.read_text()
    assert str(tmp_path) not in text and str(drawer) not in text


def test_whatever_it_depends_on_is_asked_anew(
    drawer: Path, tmp_path: Path, searches: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ask(drawer)
    ask(drawer, chance=RandomisationConfig(position=0.0, yaw=0.0))
    ask(drawer, success=SuccessConfig(fraction=0.5))
    ask(drawer, scale=0.9)
    ask(drawer, spec={"base_radius": 0.13})
    edited = shutil.copytree(drawer, tmp_path / "edited")
    card = json.loads((edited / "asset.json").read_text())
    card["grasps"][0]["width"] *= 0.9
    (edited / "asset.json").write_text(json.dumps(card))
    ask(edited)
    monkeypatch.setattr(memory, "_code_digest", lambda: "of later code")
    ask(drawer)
    assert len(searches) == 7
    ask(drawer, chance=RandomisationConfig(light=(0.5, 1.5)))  # no matter for the arm
    assert len(searches) == 7


def test_refusals_are_remembered_with_their_cause(drawer: Path, searches: list[str]) -> None:
    told = []
    for _ in range(2):
        with pytest.raises(PlacementError, match="too heavy") as error:
            ask(drawer, spec={"force": 0.01})
        told.append((str(error.value), error.value.cause))
    assert len(searches) == 1 and told[0] == told[1] and told[0][1] == "force"


@pytest.mark.parametrize("damage", ["", "x", "cut", "digit"])
def test_a_damaged_entry_is_made_again(
    drawer: Path, tmp_path: Path, searches: list[str], damage: str
) -> None:
    first = ask(drawer)
    (entry,) = (tmp_path / "kept").rglob("*.json")
    whole = entry.read_text()
    digit = whole.replace('"robust": ', '"robust": 1')
    entry.write_text({"cut": whole[: len(whole) // 2], "digit": digit}.get(damage, damage))
    assert plain(ask(drawer)) == plain(first) and len(searches) == 2
    assert entry.read_text() == whole


def test_off_and_folders_that_cannot_be_written(
    drawer: Path, tmp_path: Path, searches: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(memory.VARIABLE, "off")
    ask(drawer)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(memory.VARIABLE, str(tmp_path / "file" / "below"))
    ask(drawer)
    assert len(searches) == 2 and [p.name for p in tmp_path.iterdir()] == ["file"]


def test_two_at_once_get_the_same(drawer: Path, tmp_path: Path, searches: list[str]) -> None:
    with ThreadPoolExecutor(2) as pool:
        found = [plain(p) for p in pool.map(ask, [drawer] * 4)]
    assert len(set(found)) == 1
    assert len([p for p in (tmp_path / "kept").rglob("*") if p.is_file()]) == 1
    searched = len(searches)
    assert plain(ask(drawer)) == found[0] and len(searches) == searched
