"""What the check changes of an asset is on the studio's page, as it is in the card."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.hints import HintJoint, HintPart, Hints, save_hints
from mam_pipeline.make_config import MakeConfig
from mam_sim.studio import edits
from mam_sim.studio.place import place_of
from mam_sim.studio.session import Session
from tests.face.studio_window import joint_of, until
from tests.pipeline.test_check import cabinet


@pytest.fixture
def jammed(tmp_path: Path) -> Session:
    """A drawer that runs, over a door whose line leads it through the carcass.

    The line is no person's word: the check may put the joint to sleep.
    """
    source = tmp_path / "two.glb"
    save_glb(cabinet().mesh, source)
    place = place_of(source, MakeConfig(), tmp_path / "made")
    bare = Session(place)
    middles = bare.mesh.vertices[bare.mesh.faces].mean(axis=1)
    piece = bare.primitives.labels[np.argmin(np.abs(middles - [-0.2, 0, 0.25]).sum(axis=1))]
    line = HintJoint("hinge", axis=(0, 1, 0), origin=(0, 0, 0.25), lower=0.0, upper=1.2)
    door = HintPart(
        "door", "door", (int(piece),), parent=bare.state.tree.nodes[0].name, joint=line,
        provenance="inferred", confidence=0.8,
    )  # fmt: skip
    save_hints(Hints(parts=(door,)), place.hints)
    return Session(place)


def moving(session: Session) -> set[str]:
    articulation = session.state.articulation
    return {articulation.links[joint.child].name for joint in articulation.joints}


def asleep(session: Session) -> dict[str, str]:
    return {d.link.name: d.joint.dormant for d in session.state.articulation.dormant}


def test_what_the_check_puts_to_sleep_is_dormant_on_the_page_until_it_is_woken(
    jammed: Session, window: Any
) -> None:
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_sim.studio.page import Page

    page = Page()
    page.put(jammed)
    try:
        assert "door" in moving(jammed)
        window.goto(page.url)
        row = window.locator(".part", has_text="door")
        row.wait_for()
        assert "dormant" not in row.get_attribute("class")
        window.get_by_role("tab", name="Try").click()
        window.get_by_role("button", name="Make and check the asset").click()
        window.locator(".part.dormant", has_text="door").wait_for()
        window.get_by_text("door is kept still: the check stops it").wait_for()
        window.get_by_text("1 joint").wait_for()

        window.get_by_role("button", name="wake").click()
        until(lambda: "door" in moving(jammed))
        assert jammed.state.hints.accept == ("door",) and not asleep(jammed)
    finally:
        page.stop()


def test_the_page_says_why_an_asset_without_moving_parts_fails(
    jammed: Session, window: Any
) -> None:
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_sim.studio.page import Page

    for name in [node.name for node in jammed.state.tree.nodes[1:]]:
        jammed.edit(partial(edits.set_subtype, name=name, subtype="fixed"))
    page = Page()
    page.put(jammed)
    try:
        window.goto(page.url)
        window.get_by_role("tab", name="Try").click()
        window.get_by_role("button", name="Make and check the asset").click()
        window.get_by_text("The check fails").wait_for()
        window.get_by_text("nothing moves").first.wait_for()
    finally:
        page.stop()


def test_the_page_says_of_each_joint_what_the_card_says(jammed: Session) -> None:
    card = jammed.make().card
    assert [row.child for row in card.dormant] == ["door"]
    assert asleep(jammed) == {row.child: row.dormant for row in card.dormant}
    assert next(n for n in jammed.state.tree.nodes if n.name == "door").dormant
    for row in card.joints:
        shown = joint_of(jammed, row.child)
        assert (shown.lower, shown.upper, shown.basis) == (row.lower, row.upper, row.basis)

    again = Session(jammed.place)
    assert asleep(again) == asleep(jammed), "as well where the asset is opened later"
    drawer = next(iter(moving(again)))
    again.edit(lambda h, t: edits.set_kind(h, t, drawer, "tray"))
    assert "door" in asleep(again), "an edit of another part does not wake it"
    again.edit(lambda h, t: edits.set_line(h, t, "door", "hinge", (0, 0, 1), (-0.2, -0.299, 0.25)))
    assert "door" in moving(again), "the check has said nothing of another line"
    again.undo()
    assert "door" in asleep(again)
