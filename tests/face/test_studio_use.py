"""What is done in the studio beside edits, in a real browser: an edge, the robot, a lost link."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.errors import MamSimError
from mam_pipeline.hints import load_hints
from mam_sim.studio import edits
from mam_sim.studio.session import Session
from tests.face.studio_window import (
    PATIENCE,
    camera_of,
    canvas,
    changed,
    click_at,
    door,
    door_front,
    joint_of,
    pixel,
    seen,
    show,
    until,
    window_middle,
)


@pytest.fixture
def own_page(opened: Session) -> Iterator[Any]:
    """A page of this test alone, since it ends; yields it and what makes it again."""
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_sim.studio.page import Page

    pages = [Page()]
    pages[0].put(opened)

    def again() -> Any:
        port = pages[-1].server.get_port()
        pages[-1].stop()
        pages.append(Page(port))
        pages[-1].put(opened)
        return pages[-1]

    yield pages[0], again
    pages[-1].stop()


def test_in_a_browser_an_axis_is_taken_from_an_edge_and_again_from_the_one_behind_it(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window, "Put right")
    work, part = page.work, door(session).name
    before = joint_of(session, part)
    here = -np.sign(before.origin[1]) * 0.23  # the edge without the hinge
    front = session.mesh.bounds[0, 0] + 0.04  # the knob stands 0.04 m before it
    work.choose(part)
    window.get_by_role("button", name="Take the axis from the mesh").click()
    window.get_by_text("point at an edge or a round rim").wait_for()
    at = pixel(page, window, [[front, here, 0.4]])[0]
    window.mouse.move(*at)
    name = f"edge of the {work.called(part)}, 55.0 cm"
    window.get_by_text(re.compile(name, re.IGNORECASE)).first.wait_for()
    node = until(lambda: page.mend.from_mesh._drawn or None)[-1]
    assert node.text == name and joint_of(session, part) is before, "a line is only shown"

    window.mouse.click(*at)
    window.get_by_text(f"Taken: {name}").wait_for()
    joint = joint_of(session, part)
    assert np.allclose(joint.origin[:2], [front, here], atol=1e-4)
    assert abs(joint.axis[2]) > 0.9999 and joint.provenance == "user"
    opened = joint.axis @ np.cross([0, -np.sign(here), 0], [-1, 0, 0])
    assert opened > 0, "positive motion brings the free side to the front"
    hits = page.mend.from_mesh._place.hits
    hidden = [hit for hit in hits if hit.hidden]
    assert hidden and hits[-1].hidden, "those that are hidden come last"

    def another_than(state: Any) -> bool:
        return session.state is not state

    for _ in hits[1:]:
        now = session.state
        window.mouse.click(*at)
        until(partial(another_than, now))
    lines = page.mend.from_mesh.lines()
    last = joint_of(session, part)
    assert np.allclose(last.origin, lines.origin[hits[-1].line], atol=1e-6)
    assert not np.allclose(last.origin[:2], joint.origin[:2], atol=1e-3)
    for _ in hits[1:]:
        now = session.state
        window.keyboard.press("Control+z")
        until(partial(another_than, now))
    assert joint_of(session, part) is joint

    card = session.make().card  # which saves the hints
    row = next(row for row in card.joints if row.child == part)
    assert np.allclose(np.abs(row.axis), [0, 0, 1]) and np.allclose(row.origin[1], here, atol=1e-4)
    said = next(p for p in load_hints(session.place.hints).parts if p.name == part).joint
    assert said is not None and np.allclose(said.origin or 0.0, joint.origin)
    session.place.hints.unlink()

    window.mouse.click(canvas(window)["x"] + 20, canvas(window)["y"] + 20)
    window.get_by_text("no straight edge and no round rim is near the pointer").wait_for()
    window.keyboard.press("Escape")
    until(lambda: work.pointing is None)
    assert work.part == part, "Escape has ended the pointing alone"
    window.get_by_text("Taken:").wait_for(state="hidden")


def test_a_drawer_takes_the_direction_of_an_edge_alone(page: Any, session: Session) -> None:
    work, part = page.work, door(session).name
    work.choose(part)
    work.edit(lambda h, t: edits.set_subtype(h, t, part, "slide"))
    origin = joint_of(session, part).origin
    page.mend._take_line(np.array([0.0, 1.0, 0.0]), np.array([5.0, 5.0, 5.0]))
    joint = joint_of(session, part)
    assert joint.type == "prismatic" and np.allclose(np.abs(joint.axis), [0, 1, 0])
    assert np.allclose(joint.origin, origin)
    work.choose(session.state.tree.nodes[0].name)
    with pytest.raises(MamSimError, match="choose a part first"):
        page.mend.point()
    assert work.pointing is None


def test_in_a_browser_the_tree_chooses_and_keys_edit_the_chosen_part(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window)
    part = door(session).name
    joint, called = joint_of(session, part), page.work.called(part)
    undo = window.get_by_role("button", name="Undo")
    assert undo.is_disabled() and undo.get_attribute("title") == "nothing to undo"
    heights = window.locator(".part").evaluate_all("rows => rows.map((row) => row.clientHeight)")
    assert len(heights) > 1 and max(heights) < 60, "a row is as high as two lines at most"
    window.locator(".part", has_text=called).click()
    until(lambda: page.work.part == part)
    before = camera_of(page).position
    window.keyboard.press("f")
    until(lambda: bool(np.allclose(joint_of(session, part).axis, -joint.axis)))
    window.locator(".part", has_text="said by you").wait_for()
    undo.click()
    until(lambda: joint_of(session, part) is joint)
    window.keyboard.press("t")
    until(lambda: joint_of(session, part).subtype == "spin")
    window.keyboard.press("Control+z")
    until(lambda: joint_of(session, part) is joint)
    window.keyboard.press("d")  # a key of viser's camera
    window.keyboard.press("Space")
    until(lambda: bool(abs(page.work.scene.values[joint.name]) > 0.1))
    window.keyboard.press("Space")
    window.keyboard.press("?")
    window.get_by_text("Show the keys").wait_for()
    window.keyboard.press("Escape")
    window.get_by_text("Show the keys").wait_for(state="detached")
    assert page.work.part == part, "Escape has closed the window of the keys alone"
    assert np.allclose(camera_of(page).position, before)


def test_an_edit_that_is_cancelled_changes_nothing(page: Any, session: Session) -> None:
    work, part, state = page.work, door(session).name, session.state
    work.choose(part)
    told: list[str] = []

    def tell(text: str) -> None:
        told.append(text)
        if len(told) == 1:
            work.cancel()

    work.tell = tell
    with pytest.raises(MamSimError, match="cancelled"):
        work.edit(lambda h, t: edits.flip(h, t, part, joint_of(session, part)))
    assert session.state is state and not work.doing
    assert told[0] == f"Working out how {work.called(part)} moves" and told[-1] == ""
    work.tell = page._tell


def test_in_a_browser_a_line_under_the_pointer_is_played_and_a_click_takes_it(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window, "Put right")
    part, state = door(session).name, session.state
    page.work.choose(part)
    page.work.contacts = True
    page.work.mark()
    assert len(page.work.scene._extras["contacts"]) == 1, "the closed door touches the carcass"
    page.work.contacts = False
    line = window.locator(".way[data-key]").first
    line.hover()
    node = page.work.scene._links[joint_of(session, part).child]
    until(lambda: bool(abs(node.wxyz[0]) < 0.99 or np.linalg.norm(node.position) > 0.05))
    assert session.state is state, "nothing is changed by it"
    window.mouse.move(*window_middle(canvas(window)))
    until(lambda: bool(np.allclose(node.position, 0.0) and abs(node.wxyz[0]) > 0.9999))
    assert session.state is state
    way = session.ways(part)[0]
    line.click()
    until(lambda: session.state is not state)
    joint = joint_of(session, part)
    assert joint.provenance == "user" and np.allclose(joint.origin, way.origin)


def test_in_a_browser_the_part_under_the_pointer_is_coloured_in_the_view_and_in_the_tree(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window)
    work, part = page.work, door(session).name
    called, link = work.called(part), joint_of(session, part).child
    work.axes = False  # whose names would be there already
    work.choose("")
    row = window.locator(".part", has_text=called)
    row.hover()
    until(lambda: len(work.scene._extras.get("over", ())) == 2)  # one after the other
    over = work.scene._extras["over"]
    assert [node.name for node in over] == [f"/object/{link}/over", f"/object/{link}/over_name"]
    assert over[1].text == called and work.part != part
    box = canvas(window)
    window.mouse.move(box["x"] + 5, box["y"] + 5)
    until(lambda: not work.scene._extras.get("over"))

    window.mouse.move(*pixel(page, window, [door_front(session)])[0])
    window.locator(".part.over", has_text=called).wait_for()
    until(lambda: len(work.scene._extras.get("over", ())) == 2)
    assert work.part != part
    window.mouse.move(box["x"] + 5, box["y"] + 5)
    window.locator(".part.over").wait_for(state="detached")
    work.axes = True


def test_pictures_of_a_folders_objects_are_made_in_the_background(
    cabinet: Path, tmp_path: Path
) -> None:
    from PIL import Image

    from mam_sim.studio.thumbnails import EMPTY, Thumbnails

    (tmp_path / "cabinet.glb").write_bytes(cabinet.read_bytes())
    Image.new("RGB", (640, 480), (200, 40, 40)).save(tmp_path / "photo.jpg")
    (tmp_path / "broken.glb").write_bytes(b"no mesh")
    ready: list[int] = []
    pictures = Thumbnails(tmp_path, lambda: ready.append(1))
    names = ["cabinet.glb", "photo.jpg", "broken.glb"]
    assert pictures.url(names[0]) == EMPTY
    pictures.want(names)
    until(lambda: len(ready) == 3)
    urls = [pictures.url(name) for name in names]
    assert urls[2] == EMPTY and all(u.startswith("data:image/png") for u in urls[:2])


def test_in_a_browser_the_robots_attempt_is_played(
    page: Any, window: Any, session: Session
) -> None:
    pytest.importorskip("mani_skill", reason="the robot needs ManiSkill")
    session.make()
    page.work.refresh()
    show(page, window, "Try")
    before, box = seen(window), canvas(window)
    window.get_by_text("Robot", exact=True).click()
    window.get_by_role("button", name="Let the robot try").click()
    robot: Any = page.trying.robot
    until(lambda: robot._attempt is not None and robot.at.value >= robot.at.max - 0.1, 400)
    done = robot._attempt
    window.get_by_text("It succeeds" if done.success else "It fails").wait_for()
    assert len(done.poses) > 20
    last, values = float(done.values[-1][0]), page.work.scene.values
    until(lambda: abs(values[done.joints[0]] - last) < 1e-6)
    assert until(lambda: changed(before, seen(window), box)) is not None, "an arm is drawn"
    window.get_by_text("Moment (s)").wait_for()
    session.place.hints.unlink(missing_ok=True)


def test_in_a_browser_a_lost_connection_comes_back_with_all_that_was_said(
    own_page: Any, window: Any, session: Session
) -> None:
    page, again = own_page
    show(page, window, "Put right")
    part, joint = door(session).name, joint_of(session, door(session).name)
    click_at(page, window, door_front(session))
    assert page.work.part == part
    window.get_by_role("button", name="Other direction").click()
    until(lambda: bool(np.allclose(joint_of(session, part).axis, -joint.axis)))
    page = again()
    until(lambda: len(page.server.get_clients()) > 0)
    window.get_by_text("not saved").wait_for()
    window.get_by_role("tab", name="Put right").click()
    window.get_by_role("button", name="Undo").click()
    until(lambda: joint_of(session, part) is joint)


def test_in_a_browser_a_gallery_leads_to_a_page_and_a_report_shows_its_pictures(
    window: Any, session: Session, tmp_path: Path
) -> None:
    from mam_sim.report import write_report
    from mam_sim.verbs.view import View
    from mam_world.dataset import write_dataset

    write_dataset("station_button", 2, 0, tmp_path / "all")
    assert View(asset=tmp_path / "all", html=True, quiet=True, size=64).run() == 0
    requests: list[str] = []
    window.on("request", lambda request: requests.append(request.url))
    loaded = "[...document.images].every((i) => i.complete && i.naturalWidth > 0)"
    window.goto((tmp_path / "all" / "gallery.html").as_uri())
    window.wait_for_function(f"document.images.length === 4 && {loaded}", timeout=PATIENCE)
    window.get_by_role("link").first.click()
    window.wait_for_function("document.body.dataset.ready === 'yes'", timeout=PATIENCE)
    assert window.get_by_role("heading").inner_text().startswith("station_button")
    report = write_report(session.make())
    window.goto(report.as_uri())
    window.wait_for_function(f"document.images.length > 3 && {loaded}", timeout=PATIENCE)
    window.get_by_role("heading", name="Joints").wait_for()
    pages = re.findall(rb"/Type\s*/Page\b", window.pdf(prefer_css_page_size=True))
    assert 1 <= len(pages) <= 2
    for width in (390, 800, 1280, 2560):
        window.set_viewport_size({"width": width, "height": 900})
        assert window.evaluate("document.documentElement.scrollWidth") <= width
    assert all(u.startswith(("file:", "blob:", "data:")) for u in requests), requests
    session.place.hints.unlink(missing_ok=True)
