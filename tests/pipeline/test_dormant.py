"""Dormant parts change nothing until they are woken, and all that is known of them is kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.read import read_asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check import check_asset
from mam_pipeline.dormant import awake, hosts, put_to_sleep, with_dormant, woken
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.formats.urdf.read import read_bodies
from mam_pipeline.geometry.front import front_of, moved
from mam_pipeline.hints import Hints, parse_hints
from mam_pipeline.joints.solver import EmbeddedSolver
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.parts.hints import apply_hints
from mam_pipeline.run import make_asset
from mam_pipeline.stage_artefacts import articulation_codec, tree_codec
from mam_pipeline.types import Articulation, KinematicTree, Mesh, PartNode, Primitives
from mam_world.truth import generated_truth

WHY = "its chance is 0.10, and 0.40 is needed"


def _tree() -> KinematicTree:
    """A knob on a door, and a lid."""
    return KinematicTree((
        PartNode("base", "body", (0,), -1, "fixed"),
        PartNode("door_0", "door", (1,), 0, "hinge", 0.8),
        PartNode("knob_0", "knob", (2,), 1, "spin", 0.6),
        PartNode("lid_0", "lid", (3,), 0, "hinge", 0.7),
    ))  # fmt: skip


def test_a_dormant_part_belongs_to_what_it_hangs_on_and_carries_what_it_carried() -> None:
    tree = put_to_sleep(_tree(), {1: WHY}, {1: 0.1})
    assert [(n.name, n.primitives, n.parent) for n in awake(tree).nodes] == [
        ("base", (0, 1), -1), ("knob_0", (2,), 0), ("lid_0", (3,), 0)
    ]  # fmt: skip
    assert tree.nodes[1].confidence == 0.1
    both = put_to_sleep(tree, {2: WHY})
    assert hosts(both) == [0, 0, 0, 3]
    assert awake(both).nodes[0].primitives == (0, 1, 2)


def test_waking_gives_back_the_tree_and_who_names_a_part_is_sure_of_it() -> None:
    tree = put_to_sleep(_tree(), {1: WHY, 3: WHY})
    found = woken(tree, ["lid_0_joint"])
    assert [bool(n.dormant) for n in found.nodes] == [False, True, False, False]
    assert found.nodes[3].confidence == 1.0 and found.nodes[3].evidence["accepted"] == WHY
    whole = woken(tree, ["all"])
    assert [(n.parent, n.confidence) for n in whole.nodes] == [
        (n.parent, n.confidence) for n in _tree().nodes
    ]
    assert woken(tree, ["knob_0"]) == tree  # it is awake
    with pytest.raises(ConfigError, match=r"'lid_1'; did you mean 'lid_0'\? available: all, door"):
        woken(tree, ["lid_1"])


def test_a_further_part_takes_its_primitives_but_never_all() -> None:
    base = KinematicTree((PartNode("base", "body", (0, 1), -1, "fixed"),))
    one = PartNode("lid_0", "lid", (1,), 0, "hinge", dormant=WHY)
    found = with_dormant(base, [one, replace(one, name="lid_1", primitives=(0,))])
    assert [(n.name, n.primitives) for n in found.nodes] == [("base", (0,)), ("lid_0", (1,))]


def test_a_hint_that_names_a_dormant_part_wakes_it_and_what_it_fixes_is_none() -> None:
    tree, primitives = put_to_sleep(_tree(), {3: WHY}), Primitives(np.arange(4))
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]] * 4))

    def hinted(text: str) -> KinematicTree:
        return apply_hints(tree, primitives, mesh, parse_hints(yaml.safe_load(text)))

    found = hinted("parts: [{name: lid_0}]").nodes[3]
    assert not found.dormant and found.subtype == "hinge" and found.primitives == (3,)
    slide = hinted("parts: [{name: lid_0, joint: {subtype: slide}}]").nodes[3]
    assert (slide.subtype, slide.kind, slide.provenance) == ("slide", "lid", "user")
    assert len(hinted("fixed: [3]").nodes) == 3
    assert hinted("accept: [lid_0]").nodes[3].dormant  # the stage is the same; waking follows it


@pytest.fixture(scope="module")
def cabinet() -> tuple[Articulation, Articulation]:
    """A cabinet whose door is dormant, and the same with the door's faces in the base."""
    truth = generated_truth("cabinet_one_door", 0)
    primitives = Primitives(truth.face_link)
    nodes = [PartNode("base", "body", (0,), -1, "fixed")]
    for joint in truth.joints:
        name = truth.links[joint.child].name
        nodes.append(PartNode(name, "door", (joint.child,), joint.parent, joint.subtype, 0.6))
    tree = KinematicTree(tuple(nodes))
    asleep = put_to_sleep(tree, {1: WHY})
    solver = EmbeddedSolver()
    return (
        solver.solve(truth.mesh, primitives, asleep),
        solver.solve(truth.mesh, primitives, awake(asleep)),
    )


def test_the_object_is_what_it_is_without_its_dormant_parts(
    cabinet: tuple[Articulation, Articulation],
) -> None:
    found, bare = cabinet
    assert len(found.dormant) == 1 and not bare.dormant
    np.testing.assert_array_equal(found.face_link, bare.face_link)
    assert [j.name for j in found.joints] == [j.name for j in bare.joints]
    for one, other in zip(found.joints, bare.joints):
        assert (one.lower, one.upper, one.confidence) == (
            other.lower,
            other.upper,
            other.confidence,
        )
    np.testing.assert_array_equal(front_of(found).yaw, front_of(bare).yaw)
    joint = found.dormant[0].joint
    assert joint.type == "revolute" and joint.dormant == WHY and joint.upper > 0.9


def test_an_asset_keeps_them_fixed_with_their_line_and_reads_them_back(
    cabinet: tuple[Articulation, Articulation], tmp_path: Path
) -> None:
    found, _ = cabinet
    asset = write_asset(found, tmp_path / "asset", name="cabinet")
    card = Asset.load(asset.folder).card
    assert [j.name for j in card.movable] == [j.name for j in found.joints]
    (row,) = card.dormant
    assert row.type == "revolute" and row.review == f"dormant: {WHY}"
    text = (asset.folder / "object.urdf").read_text()
    assert f'<joint name="{row.name}" type="fixed">' in text
    assert next(p for p in card.parts if p.link == row.child).mass > 0.0
    assert (
        f'<link name="{row.child}">' in text and f"collision/{row.child}_" in text
    ) or "<box" in text
    back = read_asset(asset)
    (part,) = back.dormant
    own = found.dormant[0]
    np.testing.assert_allclose(part.joint.axis, own.joint.axis, atol=1e-9)
    np.testing.assert_allclose(part.joint.origin, own.joint.origin, atol=1e-9)
    area = [
        trimesh.Trimesh(a.mesh.vertices, a.mesh.faces[p.link.faces], process=False).area
        for a, p in ((back, part), (found, own))
    ]
    assert area[0] == pytest.approx(area[1], rel=1e-6)
    assert set(part.link.faces) <= set(back.links[part.joint.parent].faces)


def test_the_joints_of_a_stage_come_back_with_their_dormant_ones(
    cabinet: tuple[Articulation, Articulation], tmp_path: Path
) -> None:
    found, _ = cabinet
    codec = articulation_codec(found.mesh)
    codec.save(found, tmp_path / codec.filename)
    back = codec.load(tmp_path / codec.filename, tmp_path / codec.filename)
    assert [d.joint.dormant for d in back.dormant] == [WHY]
    np.testing.assert_array_equal(back.dormant[0].link.faces, found.dormant[0].link.faces)
    trees = tree_codec(4)
    tree = put_to_sleep(_tree(), {3: WHY})
    trees.save(tree, tmp_path / "parts.yaml")
    assert trees.load(tmp_path / "parts.yaml", tmp_path / "parts.yaml").nodes[3].dormant == WHY


def test_dormant_lines_move_with_the_object(cabinet: tuple[Articulation, Articulation]) -> None:
    found, _ = cabinet
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    turn[:3, 3] = [1.0, 2.0, 3.0]
    before, after = found.dormant[0].joint, moved(found, turn).dormant[0].joint
    np.testing.assert_allclose(after.origin, turn[:3, :3] @ before.origin + turn[:3, 3])
    np.testing.assert_allclose(after.axis, turn[:3, :3] @ before.axis)


def test_an_object_without_candidates_is_an_asset_that_the_check_refuses(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.2, 0.3, 0.4))
    file = tmp_path / "box.glb"
    save_glb(Mesh(box.vertices, box.faces), file)
    asset = make_asset(file, tmp_path / "asset", MakeConfig())
    assert asset.card.joints == [] and asset.card.dormant == []
    assert asset.card.checks["executability"]["reasons"] == ["no_joint"]
    assert not read_asset(asset).joints and not read_bodies(asset.urdf_path).joints
    assert not check_asset(asset.folder).passed
    with pytest.raises(ConfigError, match="no dormant part named 'lid_0'"):
        make_asset(file, tmp_path / "asset", MakeConfig(accept=("lid_0",)))


def test_waking_computes_no_parts_again(tmp_path: Path) -> None:
    truth = generated_truth("nightstand", 2)  # two drawers: the object is made four times
    file, out = tmp_path / "nightstand.glb", tmp_path / "asset"
    save_glb(truth.mesh, file)
    make_asset(file, out, MakeConfig())
    stage = out / "stages" / "3_parts"
    rows = yaml.safe_load((stage / "parts.yaml").read_text())
    rows[1]["dormant"] = WHY
    (stage / "parts.yaml").write_text(yaml.safe_dump(rows))
    note = json.loads((stage / "stage.json").read_text())
    name = rows[1]["name"]
    asleep = make_asset(file, out, MakeConfig()).card
    assert [j.child for j in asleep.dormant] == [name] and "reason" not in asleep.seconds
    awoke = make_asset(file, out, MakeConfig(accept=(name,))).card
    assert awoke.dormant == [] and len(awoke.movable) == len(asleep.movable) + 1
    assert "reason" not in awoke.seconds and "joints" in awoke.seconds
    assert json.loads((stage / "stage.json").read_text()) == note
    assert [j.child for j in make_asset(file, out, MakeConfig()).card.dormant] == [name]


def test_a_card_says_why_a_joint_is_dormant(
    cabinet: tuple[Articulation, Articulation], tmp_path: Path
) -> None:
    asset = write_asset(cabinet[0], tmp_path / "asset", name="cabinet")
    card = json.loads((asset.folder / "asset.json").read_text())
    card["dormant"][0]["dormant"] = ""
    (asset.folder / "asset.json").write_text(json.dumps(card))
    with pytest.raises(InputError, match="must say why the joint is dormant"):
        Asset.load(asset.folder)


def test_hints_keep_what_is_accepted() -> None:
    assert parse_hints({"accept": ["lid_0"]}).accept == ("lid_0",)
    assert Hints(accept=("lid_0",)).empty  # of what the parts stage is to obey


def test_a_urdf_has_nothing_to_wake(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text("<robot/>")
    with pytest.raises(ConfigError, match="a URDF has none"):
        make_asset(tmp_path / "a.urdf", tmp_path / "again", MakeConfig(accept=("all",)))
