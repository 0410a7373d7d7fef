"""Parts cut from one skin get backs, drawers boxes, bodies compartments; others stay untouched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.interiors import add_interiors
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check import check_asset
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import make_asset
from mam_pipeline.types import Articulation, Joint, Link, Mesh, RangeBasis, RangeRule

pytestmark = pytest.mark.sim


def fused(kind: str) -> Articulation:
    """A closed block of 0.5 x 0.6 x 0.7 m whose front's middle square is the moving part."""
    block = trimesh.creation.box(bounds=np.array([[0, -0.3, 0], [0.5, 0.3, 0.7]]))
    for _ in range(5):
        block = block.subdivide()
    middle = block.triangles_center
    front = (
        (middle[:, 0] < 1e-6) & (np.abs(middle[:, 1]) < 0.2) & (np.abs(middle[:, 2] - 0.35) < 0.2)
    )
    links = (
        Link("body", "body", np.flatnonzero(~front)),
        Link("part", kind, np.flatnonzero(front)),
    )
    edge = float(np.abs(block.vertices[block.faces[front]][..., 1]).max())
    if kind == "drawer":
        joint = Joint("j", "prismatic", "slide", 0, 1, np.array([-1.0, 0, 0]),
                      np.array([0, 0, 0.35]), 0, 0.25, 0, 0.25)  # fmt: skip
    else:
        joint = Joint("j", "revolute", "hinge", 0, 1, np.array([0, 0, 1.0]),
                      np.array([0, -edge, 0.35]), 0, 1.5, 0, 1.5)  # fmt: skip
    return Articulation(Mesh(block.vertices, block.faces), links, (joint,))


@pytest.mark.parametrize("kind", ["drawer", "door"])
def test_a_cut_part_gets_an_inside_and_runs_free(tmp_path: Path, kind: str) -> None:
    source = fused(kind)
    made, notes = add_interiors(source)
    assert len(notes) == 1 and "assumed" in notes[0]
    count = len(source.mesh.faces)
    np.testing.assert_array_equal(made.mesh.faces[:count], source.mesh.faces)
    part = made.mesh.submesh(made.links[1].faces)
    depth = part.bounds[1, 0]
    assert depth > 0.2 if kind == "drawer" else 0.005 < depth < 0.03
    body = made.mesh.submesh(made.links[0].faces)
    assert trimesh.Trimesh(body.vertices, body.faces).area > source.mesh.diagonal**2
    asset = write_asset(made, tmp_path / "a", name="a")
    report = check_asset(asset.folder)
    assert report.passed, report.joints


def test_a_body_too_shallow_for_a_drawer_gets_no_box() -> None:
    source = fused("drawer")
    flat = source.mesh.vertices * [0.15, 1, 1]
    made, notes = add_interiors(replace(source, mesh=replace(source.mesh, vertices=flat)))
    assert "a back" in notes[0] and "box" not in notes[0]
    assert made.mesh.submesh(made.links[1].faces).bounds[1, 0] < 0.03


@pytest.mark.parametrize("interiors", [True, False])
def test_a_skin_gets_them_unless_told_not_to(tmp_path: Path, interiors: bool) -> None:
    body = trimesh.creation.box(bounds=np.array([[-0.5, -0.5, 0], [0.5, 0.5, 1]]))
    knob = trimesh.creation.box(bounds=np.array([[-0.25, -0.7, 0.25], [0.25, -0.5, 0.75]]))
    both: Any = trimesh.util.concatenate([body, knob])
    save_glb(fuse_mesh(Mesh(both.vertices, both.faces), 48), tmp_path / "skin.glb")
    made = make_asset(tmp_path / "skin.glb", tmp_path / "a", MakeConfig(interiors=interiors))
    assert made.card.joints
    assert any("(assumed)" in note for note in made.card.notes) == interiors


def short(source: Articulation, rule: RangeRule) -> Articulation:
    """The drawer as the engine leaves it: a thin front goes a centimetre, and why."""
    joint = replace(source.joints[0], upper=0.01, open=0.01, basis=RangeBasis(rule))
    return replace(source, joints=(joint,))


def test_a_drawer_comes_out_by_its_box_and_the_check_agrees(tmp_path: Path) -> None:
    made, _ = add_interiors(short(fused("drawer"), "contact_loss"))
    joint = made.joints[0]
    assert joint.open == joint.upper == pytest.approx(0.75 * 0.45, abs=0.02)
    assert joint.basis.rule == "drawer_box"
    report = check_asset(write_asset(made, tmp_path / "a", name="a").folder)
    assert report.passed, report.joints
    stopped, _ = add_interiors(short(fused("drawer"), "collision"))
    assert stopped.joints[0].upper == 0.01


def test_something_before_a_drawer_stops_it() -> None:
    source = short(fused("drawer"), "contact_loss")
    wall = trimesh.creation.box(bounds=np.array([[-0.2, -0.3, 0], [-0.15, 0.3, 0.7]]))
    whole: Any = trimesh.util.concatenate(
        [trimesh.Trimesh(source.mesh.vertices, source.mesh.faces, process=False), wall]
    )
    faces = np.arange(len(whole.faces) - 12, len(whole.faces))
    body = replace(source.links[0], faces=np.concatenate([source.links[0].faces, faces]))
    mesh = Mesh(np.asarray(whole.vertices), np.asarray(whole.faces))
    made, _ = add_interiors(replace(source, mesh=mesh, links=(body, source.links[1])))
    assert 0.1 < made.joints[0].upper < 0.15


def test_a_bad_face_at_the_rim_does_not_cost_the_inside() -> None:
    source = fused("drawer")
    link = source.face_link
    touching = source.mesh.vertices[source.mesh.faces[:, 0], 1] > 0.19
    bad = int(np.flatnonzero((link == 1) & touching)[0])
    holes = np.delete(source.mesh.faces, bad, axis=0)
    label = np.delete(link, bad)
    links = tuple(
        replace(old, faces=np.flatnonzero(label == i)) for i, old in enumerate(source.links)
    )
    broken = replace(source, mesh=Mesh(source.mesh.vertices, holes), links=links)
    _, notes = add_interiors(broken)
    assert "drawer box" in notes[0]


def test_a_door_that_is_thick_already_gets_no_second_thickness() -> None:
    block = trimesh.creation.box(bounds=np.array([[0, -0.3, 0], [0.5, 0.3, 0.7]]))
    for _ in range(5):
        block = block.subdivide()
    door = block.triangles_center[:, 0] < 0.04
    links = (
        Link("body", "body", np.flatnonzero(~door)),
        Link("door", "door", np.flatnonzero(door)),
    )
    joint = Joint("j", "revolute", "hinge", 0, 1, np.array([0, 0, 1.0]),
                  np.array([0, -0.3, 0.35]), 0, 1.5, 0, 1.5)  # fmt: skip
    source = Articulation(Mesh(block.vertices, block.faces), links, (joint,))
    before = source.mesh.submesh(source.links[1].faces).bounds[1, 0]
    made, notes = add_interiors(source)
    assert "a back" in notes[0]
    assert made.mesh.submesh(made.links[1].faces).bounds[1, 0] < before + 0.006


def test_parts_that_are_bodies_of_their_own_stay_as_they_are() -> None:
    one = trimesh.creation.box(bounds=np.array([[0, 0, 0], [1, 1, 1]]))
    # touches, but was never cut
    two = trimesh.creation.box(bounds=np.array([[-0.1, 0, 0], [0, 1, 1]]))
    whole: Any = trimesh.util.concatenate([one, two])
    links = (Link("a", "body", np.arange(12)), Link("b", "door", np.arange(12, 24)))
    joint = Joint(
        "j", "prismatic", "slide", 0, 1, np.array([-1.0, 0, 0]), np.zeros(3), 0, 0.2, 0, 0.2
    )
    source = Articulation(Mesh(whole.vertices, whole.faces), links, (joint,))
    made, notes = add_interiors(source)
    assert made is source and notes == []
