"""Where weights lie, what stands in for them, and what their manifests say."""

from __future__ import annotations

import json
from importlib.resources.abc import Traversable
from pathlib import Path

import pytest

from mam_pipeline import weights
from mam_pipeline.errors import ConfigError
from mam_pipeline.parts import abstain

ROOM = abstain.WEIGHTS


def test_a_folder_stands_in_for_the_rooms_that_it_holds_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = weights.place_of(ROOM)
    (tmp_path / "joints").mkdir()
    monkeypatch.setenv(weights.VARIABLE, str(tmp_path))
    assert weights.place_of("joints") == tmp_path / "joints"
    assert weights.place_of(ROOM) == own
    monkeypatch.setenv(weights.VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(ConfigError, match="names no folder of weights"):
        weights.place_of(ROOM)


def test_manifests_say_the_sources_of_the_training_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (bar,) = weights.learned([ROOM])
    assert "labels" in bar.trained_on and bar.room == ROOM
    (tmp_path / ROOM).mkdir(parents=True)
    monkeypatch.setenv(weights.VARIABLE, str(tmp_path))
    with pytest.raises(ConfigError, match="have no manifest"):
        weights.learned([ROOM])
    (tmp_path / ROOM / weights.MANIFEST).write_text(json.dumps({"reproducible": True}))
    with pytest.raises(ConfigError, match="does not say `trained_on`"):
        weights.learned([ROOM])


def test_rooms_that_are_asked_are_noted_each_time() -> None:
    abstain.load_bar()
    for _ in range(2):
        with weights.noting() as asked:
            abstain.load_bar()
        assert asked == {ROOM}
    with weights.noting() as asked:
        pass
    assert asked == set()


def test_what_stands_in_is_read_afresh(tmp_path: Path) -> None:
    def content(folder: Traversable) -> list[str]:
        return sorted(entry.name for entry in folder.iterdir())

    own = weights.loaded(ROOM, content)
    (tmp_path / ROOM).mkdir(parents=True)
    with weights.standing_in(tmp_path):
        assert weights.loaded(ROOM, content) == []
    assert weights.loaded(ROOM, content) == own != []
