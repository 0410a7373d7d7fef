"""The studio: edits, undo, hints that make the same asset, and its page in a real browser."""

from __future__ import annotations

import io
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.hints import load_hints
from mam_pipeline.run import MakeConfig, make_asset
from mam_pipeline.types import FloatArray, Joint, KinematicTree, Mesh, PartNode, Primitives
from mam_sim.studio import edits
from mam_sim.studio.picking import Camera, Snap, primitives_in_box, snapped, snaps
from mam_sim.studio.place import place_of
from mam_sim.studio.review import Review
from mam_sim.studio.session import Session
from mam_sim.studio.words import joint_text, line, verdict_text

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SIZE = {"width": 900, "height": 560}
DRAWN_BY_CPU = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 120_000  # ms: on a machine with other work a frame takes seconds


@pytest.fixture(scope="module")
def cabinet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cabinet of plain boxes as a file: a carcass, a door before it, a knob on the door."""
    import trimesh

    carcass = [
        ((0.4, 0.02, 0.6), (0, 0.24, 0.3)), ((0.4, 0.02, 0.6), (0, -0.24, 0.3)),
        ((0.4, 0.5, 0.02), (0, 0, 0.01)), ((0.4, 0.5, 0.02), (0, 0, 0.59)),
        ((0.02, 0.5, 0.6), (0.19, 0, 0.3)),
    ]  # fmt: skip
    door = [((0.02, 0.46, 0.55), (-0.212, 0, 0.3)), ((0.04, 0.03, 0.1), (-0.242, -0.18, 0.3))]
    boxes = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        for size, at in (*carcass, *door)
    ]
    joined: Any = trimesh.util.concatenate(boxes)
    path = tmp_path_factory.mktemp("studio") / "cabinet.glb"
    save_glb(Mesh(joined.vertices, joined.faces), path)
    return path


@pytest.fixture(scope="module")
def opened(cabinet: Path) -> Session:
    return Session(place_of(cabinet, MakeConfig(), cabinet.parent / "made"))


@pytest.fixture
def session(opened: Session) -> Session:
    while opened.can_undo:
        opened.undo()
    return opened


def door(session: Session) -> PartNode:
    """The part that has the panel: the largest piece at the front."""
    middles = session.mesh.vertices[session.mesh.faces].mean(axis=1)
    piece = session.primitives.labels[np.argmin(np.abs(middles - [-0.222, 0, 0.3]).sum(axis=1))]
    return next(n for n in session.state.tree.nodes if piece in n.primitives)


def joint_of(session: Session, name: str) -> Joint:
    articulation = session.state.articulation
    names = [link.name for link in articulation.links]
    found = articulation.joint_of(names.index(name))
    assert found is not None
    return found


def test_edits_make_the_asset_that_articulate_makes_of_the_saved_hints(
    cabinet: Path, session: Session, tmp_path: Path
) -> None:
    name = door(session).name
    session.edit(lambda h, t: edits.set_line(h, t, name, "hinge", (0, 0, 1), (-0.2, -0.23, 0.3)))
    session.edit(lambda h, t: edits.flip(h, t, name, joint_of(session, name)))
    session.edit(lambda h, t: edits.rename(h, t, name, "front door"))
    now = joint_of(session, "front_door")
    session.edit(lambda h, t: edits.set_limits(h, t, "front_door", now, -1.2, 0.0))
    assert session.unsaved
    ours = session.make()
    assert not session.unsaved
    theirs = make_asset(cabinet, tmp_path / "made", MakeConfig(hints=session.place.hints))
    for file in ("object.urdf", "stages/3_parts/parts.yaml", "stages/4_joints/joints.yaml"):
        assert (ours.folder / file).read_bytes() == (theirs.folder / file).read_bytes()
    said = next(j for j in theirs.card.joints if j.child == "front_door")
    assert said.provenance == "user" and (said.lower, said.upper) == (-1.2, 0.0)
    shown = joint_of(session, "front_door")
    assert np.allclose(shown.origin, said.origin) and np.allclose(shown.axis, said.axis)

    again = Session(place_of(ours.folder, MakeConfig()))  # its source and its hints are found
    assert again.state.hints == session.state.hints and not again.unsaved
    (tmp_path / "empty").mkdir()
    ours.folder.rename(tmp_path / "empty" / "moved")
    alone = Session(place_of(tmp_path / "empty" / "moved", MakeConfig()))
    with pytest.raises(ConfigError, match="source was not found"):
        alone.edit(lambda h, t: h)
    session.place.hints.unlink()


def test_undo_and_redo_walk_through_the_states(session: Session) -> None:
    before = session.state
    name = door(session).name
    after = session.edit(lambda h, t: edits.set_kind(h, t, name, "hatch"))
    assert {n.kind for n in after.tree.nodes} >= {"hatch"}
    assert session.undo() is before and not session.can_undo
    assert session.redo() is after and not session.can_redo
    session.undo()
    session.edit(lambda h, t: edits.rename(h, t, name, "hatch"))
    assert not session.can_redo, "a new edit forgets what was undone"


def test_an_edit_that_cannot_be_changes_nothing(session: Session) -> None:
    before, name = session.state, door(session).name
    for change, why in (
        (lambda h, t: edits.rename(h, t, name, "?!"), "no name"),
        (lambda h, t: edits.add_to(h, t, name, []), "nothing is selected"),
        (lambda h, t: edits.set_parent(h, t, name, name), "hangs on"),
        (lambda h, t: edits.set_limits(h, t, name, joint_of(session, name), 0.2, 0.5), "range"),
    ):
        with pytest.raises(ConfigError, match=why):
            session.edit(change)
    assert session.state is before


Change = Callable[..., object]


def tree() -> KinematicTree:
    """A base, a door with a knob on it, and a drawer."""
    return KinematicTree((
        PartNode("base", "body", (0, 1), -1, "fixed"),
        PartNode("door", "door", (2, 3), 0, "hinge"),
        PartNode("knob", "knob", (4,), 1, "spin"),
        PartNode("drawer", "drawer", (5, 6), 0, "slide"),
    ))  # fmt: skip


def after(*changes: Change) -> dict[str, PartNode]:
    """The parts after edits, by name; the tree of each edit is that which the one before made."""
    from mam_pipeline.hints import Hints
    from mam_pipeline.parts.hints import apply_hints

    corners = np.concatenate([[[k, 0, 0], [k + 0.5, 0, 0], [k, 0, 0.5]] for k in range(7)])
    mesh, primitives = Mesh(corners, np.arange(21).reshape(7, 3)), Primitives(np.arange(7))
    hints, now = Hints(), tree()
    for change in changes:
        made = change(hints, now)
        assert isinstance(made, Hints)
        hints = edits.with_living_parents(made, now)
        now = apply_hints(tree(), primitives, mesh, hints)
    assert sorted(p for n in now.nodes for p in n.primitives) == list(range(7))
    return {n.name: n for n in now.nodes}


def parent(parts: dict[str, PartNode], name: str) -> str:
    return list(parts)[parts[name].parent]


def test_pieces_become_a_part_and_go_back() -> None:
    parts = after(lambda h, t: edits.make_part(h, t, [1, 5], "lid", "hinge"))
    assert parts["lid_0"].primitives == (1, 5) and parts["drawer"].primitives == (6,)
    parts = after(
        lambda h, t: edits.make_part(h, t, [1, 5], "lid", "hinge"),
        lambda h, t: edits.do_not_move(h, [5]),
        lambda h, t: edits.add_to(h, t, "drawer", [1]),
    )
    assert "lid_0" not in parts and parts["drawer"].primitives == (1, 6)


def test_how_an_object_stands_is_said_kept_and_read_by_articulate(
    cabinet: Path, session: Session, tmp_path: Path
) -> None:
    name = door(session).name
    session.edit(lambda h, t: edits.set_line(h, t, name, "hinge", (0, 0, 1), (-0.2, -0.23, 0.3)))
    session.stand(size=1.5)
    assert np.ptp(session.mesh.vertices[:, 2]) == pytest.approx(0.9)
    assert np.allclose(joint_of(session, name).origin, (-0.3, -0.345, 0.45), atol=1e-6)
    session.stand(front=(0, 1, 0))
    assert np.allclose(session.state.turn @ (0, 1, 0), (-1, 0, 0), atol=1e-9)
    with pytest.raises(ConfigError, match="looks up or down"):
        session.stand(front=(0, 0, 1))
    made = session.make()
    theirs = make_asset(cabinet, tmp_path / "made", MakeConfig(hints=session.place.hints))
    for file in ("object.urdf", "stages/4_joints/joints.yaml"):
        assert (made.folder / file).read_bytes() == (theirs.folder / file).read_bytes()
    (front,) = (d for d in theirs.card.placement if d["about"] == "front")
    assert front["why"] == "as asked"
    again = Session(place_of(made.folder, MakeConfig()))
    assert np.ptp(again.mesh.vertices[:, 2]) == pytest.approx(0.9)
    session.place.hints.unlink()

    session.stand(up=(0, -1, 0))  # lying on its side, its right side on top
    assert np.allclose(np.ptp(session.mesh.vertices, axis=0), (0.693, 0.9, 0.75), atol=0.001)
    assert abs(joint_of(session, name).axis @ (0, 1, 0)) > 0.99
    session.undo()
    assert abs(joint_of(session, name).axis @ (0, 0, 1)) > 0.99


def test_a_heavy_object_is_edited_as_articulate_finds_it(tmp_path: Path) -> None:
    import trimesh

    boxes = [((0.4, 0.5, 0.02), (0, 0, 0.01)), ((0.4, 0.5, 0.02), (0, 0, 0.59)),
             ((0.02, 0.5, 0.6), (0.19, 0, 0.3)), ((0.4, 0.02, 0.6), (0, 0.24, 0.3)),
             ((0.4, 0.02, 0.6), (0, -0.24, 0.3)), ((0.02, 0.46, 0.55), (-0.212, 0, 0.3)),
             ((0.04, 0.03, 0.1), (-0.242, -0.18, 0.3))]  # fmt: skip
    joined: Any = trimesh.util.concatenate([
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        for size, at in boxes
    ])  # fmt: skip
    while len(joined.faces) < 100_000:
        joined = joined.subdivide()
    source = tmp_path / "fine.glb"
    save_glb(Mesh(joined.vertices, joined.faces), source)
    session = Session(place_of(source, MakeConfig(), tmp_path / "made"))
    assert len(session.mesh.faces) < 100_000 < session.faces_in_file
    name = session.state.tree.nodes[1].name
    joint = joint_of(session, name)
    session.edit(lambda h, t: edits.flip(h, t, name, joint))
    made = session.make()
    said = next(j for j in made.card.joints if j.child == name)
    shown = joint_of(session, name)
    assert said.provenance == "user"
    assert np.allclose(session.state.turn @ shown.axis, said.axis, atol=1e-6)


def test_what_hangs_on_a_part_stays_on_it_when_it_is_edited() -> None:
    for change in (
        lambda h, t: edits.set_kind(h, t, "door", "gate"),
        lambda h, t: edits.add_to(h, t, "door", [1]),
        lambda h, t: edits.set_subtype(h, t, "door", "slide"),
    ):
        assert parent(after(change), "knob") == "door"
    assert parent(after(lambda h, t: edits.rename(h, t, "door", "gate")), "knob") == "gate"
    fixed = after(
        lambda h, t: edits.set_kind(h, t, "knob", "dial"),
        lambda h, t: edits.set_subtype(h, t, "door", "fixed"),
    )
    assert "door" not in fixed and parent(fixed, "knob") == "base"


def test_merged_parts_move_as_the_first_and_carry_what_hung_on_both() -> None:
    parts = after(lambda h, t: edits.merge(h, t, "drawer", "door"))
    assert parts["drawer"].primitives == (2, 3, 5, 6) and parts["drawer"].subtype == "slide"
    assert parent(parts, "knob") == "drawer"
    parts = after(lambda h, t: edits.merge(h, t, "knob", "door"))
    assert parts["knob"].primitives == (2, 3, 4) and parent(parts, "knob") == "base"


def test_a_part_is_the_engines_again() -> None:
    parts = after(
        lambda h, t: edits.set_kind(h, t, "door", "gate"),
        lambda h, t: edits.as_the_engine_says(h, t, "door"),
    )
    assert parts["door"].kind == "door" and parts["door"].provenance == "inferred"


def test_a_box_on_the_screen_selects_what_is_seen_whole_in_it() -> None:
    import trimesh

    from mam_pipeline.render.tracer import Tracer

    places = [
        ((0.4, 0.5, 0.6), (0, 0, 0.3)),
        ((0.02, 0.46, 0.5), (-0.215, 0, 0.3)),
        ((0.04, 0.05, 0.05), (-0.245, 0.18, 0.3)),
    ]
    joined: Any = trimesh.util.concatenate([
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)).subdivide()
        for size, at in places
    ])  # fmt: skip
    mesh = Mesh(joined.vertices, joined.faces)
    primitives = Primitives(np.repeat(np.arange(3), 48))
    tracer = Tracer(mesh.vertices, mesh.faces)
    ahead = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # looks along +X, Z up
    camera = Camera(np.array([-2.0, 0, 0.3]), ahead, 0.6, 1.0)

    def box(low: tuple[float, float], high: tuple[float, float]) -> list[int]:
        corners = np.array(low), np.array(high)
        return primitives_in_box(mesh, primitives.labels, tracer, camera, *corners)

    assert box((0, 0), (1, 1)) == [0, 1, 2]
    low, high = camera.screen(np.array([[-0.225, 0.23, 0.55], [-0.225, -0.23, 0.05]]))
    assert box(tuple(low - 0.005), tuple(high + 0.005)) == [1, 2], "the body reaches beyond it"
    knob = camera.screen(np.array([[-0.265, 0.18, 0.3]]))[0]
    assert box(tuple(knob - 0.06), tuple(knob + 0.06)) == [2]


def test_an_axis_snaps_to_edges_and_circles_with_its_sign() -> None:
    import trimesh

    shapes = [trimesh.creation.box((0.4, 0.5, 0.6)), trimesh.creation.cylinder(0.05, 0.2)]
    for shape, left, want, what in (
        (shapes[0], ((0.02, 0.01, -1), (0.21, 0.24, 0.1)), (0.2, 0.25), "edge"),
        (shapes[1], ((0.1, 0.02, -1), (0.005, 0.0, 0.11)), (0.0, 0.0), "circle"),
    ):
        mesh = Mesh(shape.vertices, shape.faces)
        axis = np.array(left[0]) / np.linalg.norm(left[0])
        lines = [s for s in snaps(mesh, np.arange(len(mesh.faces))) if s.what == what]
        found = snapped(axis, np.array(left[1]), lines, mesh.diagonal)
        assert isinstance(found, Snap) and found.what == what
        assert np.allclose(found.axis, [0, 0, -1], atol=1e-6)
        assert np.allclose(found.origin[:2], want, atol=1e-6)


def test_words_say_where_a_line_runs_as_seen_from_the_front() -> None:
    box = np.array([[-0.22, -0.23, 0.0], [-0.2, 0.23, 0.6]])
    assert line("hinge", np.array([0, 0, 1.0]), np.array([-0.2, -0.23, 0.3]), box) == (
        "hinge at its right, upright"
    )
    assert line("slide", np.array([-1.0, 0, 0]), np.zeros(3), box) == "slide out to the front"
    joint = Joint("j", "revolute", "hinge", 0, 1, np.array([0, 0, 1.0]),
                  np.array([-0.2, 0.23, 0.3]), 0.0, np.pi / 2, confidence=0.4)  # fmt: skip
    runs = line("hinge", joint.axis, joint.origin, box)
    text = joint_text(joint, "door_0", "door", runs)
    assert "at its left, upright" in text and "0 to 90 °" in text
    assert "40 % sure. Please look at it." in text
    assert "runs into another" in verdict_text(False, True, ["penetration"], [])


def test_a_urdf_is_looked_at_only(session: Session, tmp_path: Path) -> None:
    from mam_pipeline.asset.writer import write_asset

    bare = session.state.articulation
    folder = write_asset(bare, tmp_path / "bare", name="bare").folder
    seen = Session(place_of(folder / "object.urdf", MakeConfig()))
    assert len(seen.state.articulation.joints) == len(bare.joints)
    with pytest.raises(ConfigError, match="has its joints already"):
        seen.edit(lambda h, t: h)


def test_a_folder_is_reviewed_in_order_of_doubt_and_goes_on_where_it_stopped(
    tmp_path: Path,
) -> None:
    from mam_pipeline.asset.card import AssetCard, CardJoint

    def card(name: str, confidence: float, passed: bool) -> None:
        joint = CardJoint("j", "revolute", "hinge", "a", "b", [0, 0, 1], [0, 0, 0], 0, 1,
                          confidence=confidence)  # fmt: skip
        reasons = [] if passed else ["penetration"]
        checks = {"executability": {"passed": passed, "driven": True, "reasons": reasons}}
        (tmp_path / name).mkdir()
        made = {"path": f"{name}.glb"}
        urdf = (
            '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute">'
            '<parent link="a"/><child link="b"/><limit lower="0" upper="1"/></joint></robot>'
        )
        (tmp_path / name / "object.urdf").write_text(urdf)
        AssetCard(name, joints=[joint], checks=checks, source=made).save(tmp_path / name)

    for name, confidence, passed in (
        ("sure", 0.95, True), ("unsure", 0.3, True), ("fails", 0.99, False)
    ):  # fmt: skip
        card(name, confidence, passed)
    for file in ("new.glb", "sure.glb", "notes.txt"):
        (tmp_path / file).touch()
    review = Review(tmp_path)
    assert [e.path for e in review.entries] == ["fails", "unsure", "new.glb", "sure"]
    assert "runs into another" in review.entries[0].why
    assert "needs review" in review.entries[1].why
    review.decide(0, "reject", "a lamp, really", 3.2)
    review.decide(2, "accept", "", 1.0)

    again = Review(tmp_path)
    assert again.done == 2 and again.entries[0].note == "a lamp, really"
    assert again.next_from(0) == 1 and again.next_from(2) == 3
    again.decide(0, "mend", "", 2.0)
    assert Review(tmp_path).entries[0].seconds == 5.2
    (tmp_path / "review.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="is not a review"):
        Review(tmp_path)
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="holds no asset"):
        Review(tmp_path / "none")


def test_the_viewers_script_was_built_from_its_source() -> None:
    import hashlib
    from importlib import resources

    folder = resources.files("mam_sim.viewer")
    digest = hashlib.sha256(folder.joinpath("source.js").read_bytes()).hexdigest()
    built = folder.joinpath("viewer.js").read_text(encoding="utf-8")
    assert digest in built[:200], "run scripts/build_viewer.sh"
    assert "three.js authors" in built[:2000] and len(built) < 1_000_000


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    """A window of a browser without a screen; skips where there is none."""
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine: apt-get install chromium")
    with sync.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=[*DRAWN_BY_CPU, "--no-sandbox"]
        )
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(PATIENCE)
        yield page
        browser.close()


def until(true: Callable[[], Any], seconds: float = PATIENCE / 1000) -> Any:
    """Wait until something is neither None nor False; returns it."""
    end = time.monotonic() + seconds
    while (found := true()) is None or found is False:
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.05)
    return found


@pytest.fixture(scope="module")
def page(opened: Session) -> Iterator[Any]:
    """The studio's page, served, with the cabinet open."""
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_sim.studio.page import Page

    page = Page()
    page.put(opened)
    yield page
    page.stop()


def camera_of(page: Any) -> Camera:
    """The browser's camera."""
    camera = next(iter(page.server.get_clients().values())).camera
    turn = Rotation.from_quat(np.roll(camera.wxyz, -1)).as_matrix()
    return Camera(np.asarray(camera.position), turn, camera.fov, camera.aspect)


def canvas(window: Any) -> dict[str, float]:
    box: dict[str, float] = window.locator("canvas").first.bounding_box()
    return box


def pixel(page: Any, window: Any, points: Any) -> FloatArray:
    """(n, 2) where points are in the window, pixels."""
    box = canvas(window)
    at = camera_of(page).screen(np.asarray(points, dtype=float))
    return at * [box["width"], box["height"]] + [box["x"], box["y"]]


def seen(window: Any) -> FloatArray:
    """(H, W, 3) the window as it is drawn."""
    picture = Image.open(io.BytesIO(window.screenshot(timeout=PATIENCE))).convert("RGB")
    return np.asarray(picture, dtype=float)


def test_in_a_browser_a_slider_moves_its_part_and_edits_are_undone_saved_and_read_again(
    page: Any, window: Any, session: Session
) -> None:
    work, requests = page.work, []
    window.on("request", lambda request: requests.append(request.url))
    window.goto(page.url)
    window.get_by_text("cabinet").wait_for()
    until(lambda: len(page.server.get_clients()) > 0)
    part = door(session).name
    joint = joint_of(session, part)
    box = canvas(window)
    middle = window_middle(box)
    until(lambda: bool(seen(window)[middle[1], middle[0]].min() < 250))  # the object is there

    before = seen(window)
    slider = window.get_by_role("slider").nth(1)
    slider.focus()
    slider.press("End")
    until(lambda: bool(abs(work.scene.values[joint.name]) > 0.9 * (joint.upper - joint.lower)))
    moved = until(lambda: changed(before, seen(window), box))
    link = next(k for k in session.state.articulation.links if k.name == part)
    corners = session.mesh.vertices[session.mesh.faces[link.faces]].reshape(-1, 3)
    pose = session.state.articulation.link_poses(work.scene.values)[joint.child]
    ways = np.concatenate([corners, corners @ pose[:3, :3].T + pose[:3, 3]])
    low, high = (f(pixel(page, window, ways), axis=0) for f in (np.min, np.max))
    assert np.all(moved >= low - 25) and np.all(moved <= high + 25), "only the door has moved"
    slider.press("Home")

    window.get_by_role("tab", name="Put right").click()
    x, y = pixel(page, window, [door_front(session)])[0]
    window.mouse.click(x, y)
    until(lambda: work.part == part)
    window.get_by_text("1 piece").wait_for()
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
    page.work.refresh()
    window.goto(page.url)
    window.get_by_text("cabinet").wait_for()
    until(lambda: len(page.server.get_clients()) > 0)
    window.get_by_role("tab", name="Put right").click()
    window.get_by_text("How it stands").click()
    length = window.get_by_label("Metres")
    length.fill("1.2")
    length.press("Tab")
    until(lambda: page.work.panels[2].stand.length.value == 1.2)
    window.get_by_role("button", name="Set the size").click()
    until(lambda: bool(np.isclose(page.work.size()[2], 1.2)))
    assert session.state.hints.height == pytest.approx(1.2)

    window.get_by_role("button", name="Undo").click()
    until(lambda: not session.can_undo)
    assert np.isclose(page.work.size()[2], 0.6)


def test_in_a_browser_a_clicked_face_says_where_the_top_is(
    page: Any, window: Any, session: Session
) -> None:
    page.work.refresh()
    window.goto(page.url)
    window.get_by_text("cabinet").wait_for()
    until(lambda: len(page.server.get_clients()) > 0)
    middle = window_middle(canvas(window))
    until(lambda: bool(seen(window)[middle[1], middle[0]].min() < 250))  # the object is there
    window.get_by_role("tab", name="Put right").click()
    size = page.work.size().copy()
    window.mouse.click(*pixel(page, window, [door_front(session)])[0])
    until(lambda: page.work.face is not None)
    window.get_by_text("How it stands").click()
    window.get_by_role("button", name="The clicked face is on top").click()
    until(lambda: session.state.hints.up is not None)
    until(lambda: bool(np.isclose(page.work.size()[2], size[0])))  # its depth stands upright
    window.get_by_role("button", name="Undo").click()
    until(lambda: not session.can_undo)
    assert np.allclose(page.work.size(), size)


def test_the_page_that_is_given_away_opens_offline_and_its_slider_moves_the_part(
    window: Any, session: Session, tmp_path: Path
) -> None:
    from mam_sim import viewer

    part = door(session).name
    file = tmp_path / "view.html"
    file.write_text(viewer.page(session.state.articulation, "cab</script>inet"), encoding="utf-8")
    requests: list[str] = []
    window.on("request", lambda request: requests.append(request.url))
    window.goto(file.as_uri())
    window.wait_for_function("document.body.dataset.ready === 'yes'")
    assert window.get_by_role("heading").inner_text() == "cab</script>inet"
    before, box = seen(window), canvas(window)
    slider = window.get_by_role("slider", name=part, exact=True)
    slider.focus()
    slider.press("End")
    assert until(lambda: changed(before, seen(window), box)) is not None
    slider.press("Home")
    until(lambda: True if changed(before, seen(window), box) is None else None)
    assert all(u.startswith(("file:", "blob:")) for u in requests), requests


def test_a_gallery_shows_every_asset_and_leads_to_its_page(tmp_path: Path) -> None:
    from mam_sim.verbs.view import View
    from mam_world.dataset import write_dataset

    write_dataset("station_button", 2, 0, tmp_path / "all")
    assert View(asset=tmp_path / "all", html=True, quiet=True, size=64).run() == 0
    page = (tmp_path / "all" / "gallery.html").read_text(encoding="utf-8")
    assert "all: 2 objects" in page and page.count("data:image/png") == 4
    for k in range(2):
        link = f"station_button_00000{k}/view.html"
        assert f'href="{link}"' in page and (tmp_path / "all" / link).is_file()


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


def window_middle(box: dict[str, float]) -> tuple[int, int]:
    """Column and row of the middle of the view."""
    return int(box["x"] + box["width"] / 2), int(box["y"] + box["height"] / 2)


def door_front(session: Session) -> FloatArray:
    """A point on the door's front, off its knob."""
    return np.array([-0.222, 0.1, 0.35])


def changed(before: FloatArray, after: FloatArray, box: dict[str, float]) -> FloatArray | None:
    """(n, 2) pixels of the view that differ, column and row; None for too few."""
    differs = np.abs(before - after).max(axis=2) > 24
    rows, columns = np.nonzero(differs[:, : int(box["x"] + box["width"])])
    return np.stack([columns, rows], axis=1) if len(rows) > 500 else None
