"""The studio's page in a real browser without a screen."""

from __future__ import annotations

import urllib.error
import urllib.request
from typing import Any

import numpy as np
import pytest

from mam_pipeline.errors import InputError
from mam_pipeline.hints import load_hints
from mam_sim.studio.session import Session
from tests.face.studio_window import (
    PATIENCE,
    camera_of,
    canvas,
    changed,
    choose,
    click_at,
    door,
    door_front,
    drawn,
    is_lost,
    joint_of,
    lose,
    pixel,
    seen,
    show,
    until,
)


def test_in_a_browser_a_slider_moves_its_part_and_edits_are_undone_saved_and_read_again(
    page: Any, window: Any, session: Session
) -> None:
    work, requests = page.work, []
    window.on("request", lambda request: requests.append(request.url))
    show(page, window)
    part = door(session).name
    joint = joint_of(session, part)
    box = canvas(window)

    before = seen(window)
    slider = window.get_by_role("slider").nth(1)
    slider.focus()
    slider.press("End")
    until(lambda: bool(abs(work.scene.values[joint.name]) > 0.9 * (joint.upper - joint.lower)))
    link = next(k for k in session.state.articulation.links if k.name == part)
    corners = session.mesh.vertices[session.mesh.faces[link.faces]].reshape(-1, 3)
    pose = session.state.articulation.link_poses(work.scene.values)[joint.child]
    ways = np.concatenate([corners, corners @ pose[:3, :3].T + pose[:3, 3]])
    low, high = (f(pixel(page, window, ways), axis=0) for f in (np.min, np.max))

    def only_the_door_has_moved() -> bool:
        moved = changed(before, seen(window), box)
        return moved is not None and bool(np.all((moved > low - 25) & (moved < high + 25)))

    until(only_the_door_has_moved)  # a lost view is empty until the page has loaded itself again
    slider.press("Home")

    window.get_by_role("tab", name="Put right").click()
    click_at(page, window, door_front(session))
    assert work.part == part
    window.get_by_role("button", name="Other direction").click()
    until(lambda: bool(np.allclose(joint_of(session, part).axis, -joint.axis)))
    window.get_by_role("button", name="Undo").click()
    until(lambda: joint_of(session, part) is joint)
    window.get_by_role("button", name="Redo").click()
    until(lambda: joint_of(session, part) is not joint)
    window.get_by_role("button", name="Save").click()
    until(session.place.hints.is_file)

    window.reload()
    window.get_by_text("· saved").wait_for()
    saved = load_hints(session.place.hints)
    assert saved == session.state.hints and saved.parts[0].name == part
    session.place.hints.unlink()
    assert all(u.startswith((page.url, "blob:", "data:")) for u in requests), requests


def test_in_a_browser_a_typed_length_sets_the_size(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window, "Put right")
    window.get_by_text("How it stands").click()
    length = window.get_by_label("Metres")
    length.fill("1.2")
    length.press("Tab")
    until(lambda: page.mend.stand.length.value == 1.2)
    window.get_by_role("button", name="Set the size").click()
    until(lambda: bool(np.isclose(page.work.size()[2], 1.2)))
    assert session.state.hints.height == pytest.approx(1.2)

    window.get_by_role("button", name="Undo").click()
    until(lambda: not session.can_undo)
    assert np.isclose(page.work.size()[2], 0.6)


def test_in_a_browser_a_clicked_face_says_where_the_top_is(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window, "Put right")
    size = page.work.size().copy()
    click_at(page, window, door_front(session))
    window.get_by_text("How it stands").click()
    window.get_by_role("button", name="The clicked face is on top").click()
    until(lambda: session.state.hints.up is not None)
    until(lambda: bool(np.isclose(page.work.size()[2], size[0])))  # its depth stands upright
    window.get_by_role("button", name="Undo").click()
    until(lambda: not session.can_undo)
    assert np.allclose(page.work.size(), size)


def test_in_a_browser_faces_are_taken_up_to_an_edge_and_painted_and_become_a_part(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window, "Put right")
    work, count = page.work, session.primitives.count
    choose(window, "Select", "faces up to an edge")
    until(lambda: work.picks == "areas")
    front = pixel(page, window, [door_front(session)])[0]
    window.mouse.click(*front)
    until(lambda: len(work.brushed) > 0)
    assert len(work.brushed) == 2, "the two triangles of the door's front"
    window.get_by_text("2 faces").wait_for()
    window.get_by_role("button", name="Make a part of them").click()
    until(lambda: work.part == "door_1")
    assert session.primitives.count == count + 1 and len(session.state.hints.cut) == 1
    window.get_by_role("button", name="Undo").click()
    until(lambda: session.primitives.count == count)
    window.get_by_role("button", name="Redo").click()
    until(lambda: session.primitives.count == count + 1)
    window.get_by_role("button", name="Undo").click()
    until(lambda: session.primitives.count == count)

    choose(window, "Select", "faces under a brush")
    window.get_by_text("Brush (%)").wait_for()
    before = camera_of(page).position
    ends = pixel(page, window, [[-0.222, 0.15, 0.5], [-0.222, -0.15, 0.1]])
    window.mouse.move(*ends[0])
    window.mouse.down()
    window.mouse.move(*ends.mean(axis=0), steps=4)
    window.mouse.move(*ends[1], steps=4)
    window.mouse.up()
    until(lambda: len(work.brushed) >= 2)
    assert {*session.primitives.labels[sorted(work.brushed)]} <= {*door(session).primitives}
    assert np.allclose(camera_of(page).position, before), "a stroke does not turn the view"
    choose(window, "Select", "whole pieces")
    until(lambda: work.picks == "pieces")


def test_other_sites_pages_are_refused(page: Any) -> None:
    for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
        request = urllib.request.Request(page.url, headers=headers)
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(request, timeout=20)
    with urllib.request.urlopen(page.url, timeout=20) as answer:
        assert answer.status == 200


def test_a_port_that_is_taken_is_an_error(page: Any) -> None:
    from mam_sim.studio.page import Page

    with pytest.raises(InputError, match="cannot listen on port"):
        Page(page.server.get_port())


def test_in_a_browser_a_view_that_was_lost_is_drawn_again(
    page: Any, window: Any, session: Session
) -> None:
    show(page, window)
    with window.expect_navigation(timeout=PATIENCE):  # the page loads itself again
        assert lose(window)
    until(lambda: not is_lost(window) and drawn(window))
