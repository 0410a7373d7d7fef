"""An open object: undo, saved hints that make the same asset, standing, and a folder's review."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.hints import Hints
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import make_asset
from mam_pipeline.types import KinematicTree, Mesh
from mam_sim.studio import edits
from mam_sim.studio.place import Place, place_of
from mam_sim.studio.review import Review
from mam_sim.studio.session import Session
from tests.face.studio_window import (
    door,
    joint_of,
)


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


def test_hints_are_not_saved_over_another_file(session: Session) -> None:
    session.place.hints.write_text("a note of mine\n")
    with pytest.raises(ConfigError, match="is kept: name another file with --hints"):
        session.save()
    assert session.place.hints.read_text() == "a note of mine\n"
    session.place.hints.unlink()
    assert session.save() == session.save() == session.place.hints
    session.place.hints.unlink()


def test_faces_are_cut_off_a_piece_and_articulate_cuts_the_same(
    cabinet: Path, session: Session, tmp_path: Path
) -> None:
    normals = face_geometry(session.mesh.vertices, session.mesh.faces)[0]
    middles = session.mesh.vertices[session.mesh.faces].mean(axis=1)
    panel = door(session)
    piece = session.primitives.labels[np.argmin(np.abs(middles - [-0.222, 0, 0.3]).sum(axis=1))]
    front = np.flatnonzero((session.primitives.labels == piece) & (normals[:, 0] < -0.9))
    before, count = session.primitives, session.primitives.count

    def split(h: Hints, t: KinematicTree) -> Hints:
        cut, pieces = edits.cut_off(h, before, [*front, *np.flatnonzero(before.labels == 0)])
        assert sorted(pieces) == [0, count], "a whole piece keeps its number"
        return edits.make_part(cut, t, [count], "lid", "hinge")

    session.edit(split)
    assert session.primitives.count == count + 1
    made = {n.name: n.primitives for n in session.state.tree.nodes}
    assert made["lid_0"] == (count,) and made[panel.name] == panel.primitives
    assert set(np.flatnonzero(session.primitives.labels == count)) == set(front)
    session.undo()
    assert session.primitives.count == count
    session.redo()
    session.stand(size=1.5)
    ours = session.make()
    theirs = make_asset(cabinet, tmp_path / "made", MakeConfig(hints=session.place.hints))
    for file in ("object.urdf", "stages/3_parts/parts.yaml", "stages/4_joints/joints.yaml"):
        assert (ours.folder / file).read_bytes() == (theirs.folder / file).read_bytes()
    again = Session(place_of(ours.folder, MakeConfig()))
    assert again.state.hints == session.state.hints and again.primitives.count == count + 1
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
    assert front["why"] == "said by you"
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
    with pytest.raises(ConfigError, match="is no review of the studio"):
        Review(tmp_path)
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="holds no asset"):
        Review(tmp_path / "none")


def test_an_object_that_is_made_in_the_background_takes_its_place_in_the_review(
    tmp_path: Path,
) -> None:
    import threading

    import trimesh

    from mam_sim.studio.ahead import Ahead
    from mam_sim.studio.review import asset_of

    box = trimesh.creation.box((0.3, 0.4, 0.5))
    save_glb(Mesh(box.vertices, box.faces), tmp_path / "box.glb")
    (tmp_path / "broken.glb").touch()
    review = Review(tmp_path)
    review.decide(review.index("box.glb"), "mend", "a note", 2.0)
    ended, errors = threading.Event(), dict[str, str]()

    def done(place: Place, error: str) -> None:
        errors[place.asset.name] = error
        if len(errors) == 2:
            ended.set()

    ahead = Ahead(done)
    files = [tmp_path / entry.path for entry in review.entries]
    ahead.want([place_of(file, MakeConfig(), asset_of(file)) for file in files])
    assert ended.wait(120)
    ahead.stop()
    assert errors["box-asset"] == "" and "broken.glb" in errors["broken-asset"]
    review.look_again("box.glb")
    entry = review.entries[review.index("box.glb")]
    assert (entry.path, entry.decision, entry.note) == ("box-asset", "mend", "a note")
    assert entry.why.startswith("nothing moves") and review.entries[0] == entry
    again = Review(tmp_path)
    assert [e.path for e in again.entries] == ["box-asset", "broken.glb"]
    assert again.entries[0].note == "a note"


@pytest.mark.parametrize("executability", [
    None, [], {}, {"passed": False}, {"passed": False, "reasons": 5}, {"passed": "no"},
])  # fmt: skip
def test_a_check_without_reasons_is_no_reason_to_stop(executability: object) -> None:
    from mam_pipeline.asset.card import AssetCard
    from mam_sim.studio.review import doubt

    card = AssetCard("a", checks={"executability": executability})
    assert doubt(card)[1] in ("the check fails", "nothing moves")
