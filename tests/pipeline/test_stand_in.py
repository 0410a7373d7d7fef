"""A heavy mesh is worked on by a light one, and every heavy face gets the part it belongs to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.inertia import link_inertials
from mam_pipeline.geometry import stand_in as module
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.stand_in import Weight, lightened, restored, stand_in
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import make_asset
from mam_pipeline.types import Articulation, Joint, Link, Mesh

SMALL = Weight(heavy=3000, light=1500, piece=100)


def cabinet(cuts: int = 5) -> Mesh:
    """A body, a door that touches it, and a knob of few faces; drawn twice where they touch."""
    body = trimesh.creation.box(extents=[0.5, 0.6, 0.8])
    door = trimesh.creation.box(extents=[0.02, 0.6, 0.8])
    door.apply_translation([-0.26, 0, 0])
    knob = trimesh.creation.icosphere(1, 0.02)
    knob.apply_translation([-0.3, 0.2, 0.1])
    parts = [body, door, knob]
    for part in parts[:2]:
        for _ in range(cuts):
            part.vertices, part.faces = trimesh.remesh.subdivide(part.vertices, part.faces)
    counts = [len(p.faces) for p in parts]
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.faces + o for p, o in zip(parts, offsets)]),
        face_group=np.repeat([0, 1, 2], counts),
        group_names=("body", "door", "knob"),
    )


def test_a_light_mesh_is_left_alone() -> None:
    mesh = cabinet(2)
    assert stand_in(mesh) is None
    whole = Articulation(mesh, (Link("base", "body", np.arange(len(mesh.faces))),), ())
    assert lightened(whole) is whole


def test_every_heavy_face_lies_on_the_light_face_that_stands_for_it() -> None:
    mesh = cabinet()
    made = stand_in(mesh, weight=SMALL)
    assert made is not None
    assert 1000 < len(made.mesh.faces) < 1600 < len(mesh.faces)
    assert mesh.face_group is not None and made.mesh.face_group is not None
    np.testing.assert_array_equal(made.mesh.face_group[made.nearest], mesh.face_group)
    np.testing.assert_allclose(made.mesh.bounds, mesh.bounds, atol=1e-6)
    for group in range(3):  # the same surface, seen from either side
        ours = mesh.submesh(mesh.face_group == group)
        light = made.mesh.submesh(made.mesh.face_group == group)
        for a, b in ((ours, light), (light, ours)):
            middles = a.vertices[a.faces].mean(axis=1)
            assert RayScene(b.vertices, b.faces).distance(middles).max() < 1e-3
    knob = mesh.face_group == 2  # few faces: as they are
    np.testing.assert_allclose(
        made.mesh.vertices[made.mesh.faces[made.nearest[knob]]].mean(axis=1),
        mesh.vertices[mesh.faces[knob]].mean(axis=1),
    )


def test_parts_go_back_onto_the_heavy_mesh_whole() -> None:
    mesh = cabinet()
    made = stand_in(mesh, weight=SMALL)
    assert made is not None and made.mesh.face_group is not None
    door = made.mesh.face_group > 0
    links = (
        Link("base", "body", np.flatnonzero(~door)), Link("door", "door", np.flatnonzero(door)),
    )  # fmt: skip
    joint = Joint("hinge", "revolute", "hinge", 0, 1, np.array([0, 0, 1.0]), np.zeros(3), 0.0, 1.0)
    light = Articulation(made.mesh, links, (joint,))
    heavy = restored(light, mesh, made)
    assert heavy is not None and mesh.face_group is not None
    np.testing.assert_array_equal(heavy.face_link, (mesh.face_group > 0).astype(int))
    again = lightened(heavy, SMALL)
    for a, b in zip(link_inertials(heavy), link_inertials(again)):
        assert b.mass == pytest.approx(a.mass, rel=0.01)
        np.testing.assert_allclose(b.center, a.center, atol=1e-3)
        np.testing.assert_allclose(b.inertia, a.inertia, rtol=0.02, atol=1e-4)
    empty = replace(light, links=(*links, Link("lost", "knob", np.zeros(0, dtype=np.int64))))
    assert restored(empty, mesh, made) is None


@pytest.mark.slow
def test_an_asset_of_a_heavy_mesh_keeps_its_faces_and_its_joints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mam_pipeline.formats.mesh_files import save_glb
    from mam_world import make_object

    mesh = make_object("cabinet_one_door", 3).truth().mesh
    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) < 4000:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    save_glb(Mesh(vertices, faces), tmp_path / "a.glb")
    monkeypatch.setattr(module, "WEIGHT", Weight(heavy=2000, light=1000, piece=60))
    asset = make_asset(tmp_path / "a.glb", tmp_path / "asset", MakeConfig())
    (joint,) = asset.card.joints
    assert joint.type == "revolute" and abs(joint.axis[2]) > 0.99
    assert any(f"of the {len(faces)} faces" in note for note in asset.card.notes)
    drawn = sum(
        line.startswith("f ")
        for file in (asset.folder / "visual").glob("*.obj")
        for line in file.read_text().splitlines()
    )
    assert drawn == len(faces)
