"""Asking a language model in the studio: consent, an answer as a proposal, taken or left."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.errors import ConfigError
from mam_pipeline.models import album, consent
from mam_pipeline.models.settings import ModelConfig
from mam_sim.studio.place import place_of
from mam_sim.studio.proposal import Stopped, answerer, ask
from mam_sim.studio.session import Session
from tests.conftest import Endpoint
from tests.face.studio_window import door, joint_of, show, until

RIGHT = (200, json.dumps({"joints": []}))
Start = Callable[[list[tuple[int, str]]], Endpoint]


@pytest.fixture(autouse=True)
def at_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Small pictures, and a home folder without any yes or no."""
    monkeypatch.setattr(album, "ALBUM", replace(album.ALBUM, size=96))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "MAM_SIM_QUESTIONS", "MAM_SIM_ALLOW_MODEL"):
        monkeypatch.delenv(name, raising=False)


def mirrored(session: Session) -> tuple[int, str]:
    """The door as an answer says it, hung on the side where it is not now."""
    part = door(session)
    side = "+y" if joint_of(session, part.name).origin[1] < 0 else "-y"
    return 200, json.dumps({"base": "carcass", "parts": [{
        "name": "front_door", "kind": "door", "pieces": list(part.primitives), "motion": "hinge",
        "axis": "z", "side": side, "opens": "-x",
    }]})  # fmt: skip


def asked(session: Session, part: str = "") -> Any:
    return ask(session, part, lambda _text: None, threading.Event())


def test_nothing_is_sent_without_a_yes_and_nobody_configured_says_why(
    session: Session, endpoint: Start
) -> None:
    none = answerer(session.place.config)
    assert not none.ready and "OPENAI_API_KEY" in none.told and "--questions" in none.told
    with pytest.raises(ConfigError, match="Nobody can be asked"):
        asked(session)
    stand = endpoint([RIGHT])
    who = answerer(session.place.config)
    assert who.ready and not who.allowed and "sees pictures of this object" in who.told
    with pytest.raises(ConfigError, match="sees pictures"):
        asked(session)
    assert stand.asked == []
    named = replace(session.place.config.engine, reasoner="vlm")
    assert answerer(replace(session.place.config, engine=named)).allowed


def test_an_answer_about_the_object_is_taken_as_one_edit(session: Session, endpoint: Start) -> None:
    before, old = session.state, joint_of(session, door(session).name)
    stand = endpoint([mirrored(session), RIGHT])
    consent.remember(answerer(session.place.config).who)
    found = asked(session)
    assert session.state is before and len(stand.asked) == 2
    assert [name for name, _ in found.pictures()] == ["front_door"]
    assert found.changes and "axis z" in found.talk and "2 questions asked" in found.cost
    session.edit(found.taken)
    new = joint_of(session, "front_door")
    assert new.provenance == "user" and np.sign(new.origin[1]) == -np.sign(old.origin[1])
    theirs = next(j for j in found.joints if found.found.links[j.child].name == "front_door")
    assert np.allclose(new.axis, theirs.axis) and np.allclose(new.origin, theirs.origin)
    assert (new.lower, new.upper) == pytest.approx((theirs.lower, theirs.upper))
    assert session.undo() is before


def test_of_one_part_it_is_asked_whether_that_is_how_it_moves(
    session: Session, endpoint: Start
) -> None:
    part, before = door(session).name, session.state
    slides = {"name": part, "ok": False, "motion": "slide", "axis": "x", "opens": "-x"}
    stand = endpoint([RIGHT, (200, json.dumps({"joints": [slides]}))])
    consent.remember(answerer(session.place.config).who)
    assert not asked(session, part).changes
    words = stand.asked[0]["messages"][1]["content"][0]["text"]
    assert f"{part}, on " in words and "Is that how it moves?" in words
    # a cache of answers stands between two equal questions, so the object is another now
    session.stand(size=1.25)
    found = asked(session, door(session).name)
    session.edit(found.taken)
    new = joint_of(session, part)
    assert new.subtype == "slide" and np.allclose(new.axis, (-1, 0, 0))
    others = {n.name: n.primitives for n in before.tree.nodes}
    assert {n.name: n.primitives for n in session.state.tree.nodes} == others
    base = session.state.tree.nodes[0].name
    with pytest.raises(ConfigError, match="does not move"):
        asked(session, base)


def test_a_folder_is_waited_for_until_it_is_answered_or_stopped(
    cabinet: Path, session: Session, tmp_path: Path
) -> None:
    config = replace(session.place.config, models=ModelConfig(questions=tmp_path / "asked"))
    own = Session(place_of(cabinet, config, tmp_path / "made"))
    stop, told = threading.Event(), list[str]()

    def answer(text: str) -> None:
        told.append(text)
        if "answer the question in" not in text:
            return
        if "1_parts" in text:
            (tmp_path / "asked" / "1_parts" / "answer.json").write_text(mirrored(own)[1])
        else:
            stop.set()

    with pytest.raises(Stopped):
        ask(own, "", answer, stop)
    assert "3_motion" in told[-1]
    (tmp_path / "asked" / "3_motion" / "answer.json").write_text(RIGHT[1])
    assert ask(own, "", answer, threading.Event()).changes


def test_in_a_browser_a_proposal_is_accepted_by_a_click(
    page: Any, window: Any, session: Session, endpoint: Start
) -> None:
    stand = endpoint([mirrored(session), RIGHT])
    show(page, window, "Ask")
    button = window.get_by_role("button", name="Ask about the object")
    assert button.is_disabled()
    window.get_by_role("button", name="It may be asked, now and later").click()
    until(lambda: button.is_enabled())
    assert stand.asked == []
    button.click()
    window.get_by_role("button", name="Accept").click()
    until(lambda: "front_door" in {n.name for n in session.state.tree.nodes})
    until(lambda: not page.ask.folder.visible)
    session.undo()
