"""What is known beside geometry: words in names, animations, and how they weigh."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import ConfigError
from mam_pipeline.evidence.kinds import kinds
from mam_pipeline.evidence.names import counts_of, object_of, part_kind_of
from mam_pipeline.evidence.pivots import hinge_axis
from mam_pipeline.evidence.propose import MEANT, expected_of
from mam_pipeline.evidence.read import spec_of
from mam_pipeline.evidence.spec import KinematicSpec, PartStatement, Said
from mam_pipeline.formats.mesh_files import load_mesh, read_file, save_glb
from mam_pipeline.parts.said import Heard, with_line, with_travel
from mam_pipeline.stages import articulate_mesh
from mam_pipeline.types import (
    JointCandidate,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
    UsualTravel,
)
from tests.pipeline.test_pictures import BIND, dae


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("door", "door"), ("drawerLeft", "drawer"), ("wheel_frontLeft", "wheel"),
        ("Blades", "blade"), ("Schublade_2", "drawer"), ("porte gauche", "door"),
        ("右门", "door"), ("cajón1", "drawer"), ("引き出し_1", "drawer"),
        ("door_frame", "frame"), ("door_handle", "handle"), ("poignee_porte", "handle"),
        ("door_bottom", "door"), ("Bottom", "bottom"), ("fond_tiroir", "drawer"),
        ("Cube.003", None), ("mesh20-geometry", None), ("indoor", None), ("Object001", None),
    ],
)  # fmt: skip
def test_a_name_says_a_kind_of_part_or_nothing(name: str, kind: str | None) -> None:
    found = part_kind_of(name)
    assert (None if found is None else found.kind) == kind


def test_a_sliding_door_slides() -> None:
    door, sliding = part_kind_of("door"), part_kind_of("sliding_door_2")
    assert door is not None and sliding is not None
    assert (door.moves, sliding.moves) == ("hinge", "slide")


@pytest.mark.parametrize(
    ("name", "word", "moves"),
    [
        ("aws_SofaB_01_visual", "sofa", False), ("Bücherregal", "bookshelf", False),
        ("office chair", "swivelchair", True), ("toy_airplane_3", "toyairplane", True),
        ("toaster oven", "oven", True), ("washing machine", "washer", True),
        ("aws_NightStand_01", "nightstand", True),
    ],
)  # fmt: skip
def test_a_name_says_an_object(name: str, word: str, moves: bool) -> None:
    found = object_of(name, Said("file name", name, 0.7))
    assert found is not None and found.word == word
    assert (kinds().objects[word].moves > 0.5) == moves


def test_an_unknown_thing_says_nothing_and_the_users_word_must_be_known() -> None:
    assert object_of("trampoline", Said("file name")) is None
    with pytest.raises(ConfigError, match="did you mean 'refrigerator'"):
        spec_of(_two_boxes(), what="refrigrator")


def test_counts_are_read_from_words_and_digits() -> None:
    found = counts_of("cabinet with 2 doors and three drawers", Said("user"))
    assert {c.kind: c.count for c in found} == {"door": 2, "drawer": 3}


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return np.asarray(low) + corners * (np.asarray(high) - np.asarray(low)), np.array(faces)


def _two_boxes(names: tuple[str, str] = ("body", "door")) -> Mesh:
    """A body with a door before it, metres, front towards -X."""
    body, faces = _box((0, 0, 0), (0.4, 0.5, 0.6))
    door, _ = _box((-0.02, 0, 0), (-0.001, 0.5, 0.6))
    return Mesh(
        np.concatenate([body, door]), np.concatenate([faces, faces + 8]),
        face_group=np.repeat([0, 1], 12), group_names=names,
    )  # fmt: skip


def _primitives() -> Primitives:
    return Primitives(np.repeat([0, 1], 12))


def test_names_that_geometry_bears_out_weigh_more_than_names_that_it_refutes() -> None:
    masks = np.array([[False, True], [True, False]])
    value = np.array([0.7, 0.05])  # geometry: the second box is likely a part, the first is not
    gains = []
    for names in (("body", "door"), ("door", "body")):
        mesh = _two_boxes(names)
        heard = Heard.of(spec_of(mesh), mesh, _primitives())
        assert heard is not None
        gains.append(heard.odds(masks, value))
    meant, swapped = gains
    assert meant[0] > 1.0 > abs(swapped[1])
    assert meant[1] < 0.0


def test_a_named_part_is_as_likely_as_its_name_says_however_low_geometry_scores_it() -> None:
    mesh, masks = _two_boxes(), np.array([[False, True]])
    heard = Heard.of(spec_of(mesh), mesh, _primitives())
    assert heard is not None
    value = heard.heard(masks, np.array([0.01]), np.zeros(1))
    assert value[0] == pytest.approx(MEANT.node * kinds().parts["door"].sure)
    assert heard.heard(masks, np.zeros(1), np.zeros(1))[0] == 0.0  # something must stay
    assert heard.with_stated(np.eye(2, dtype=bool), np.array([0.0, 0.9]), [0]) == [0, 1]


def test_where_one_node_stands_on_its_hinge_the_file_shows_all_that_moves() -> None:
    mesh = _two_boxes()
    masks, value = np.eye(2, dtype=bool), np.array([0.5, 0.5])
    spec = spec_of(mesh)
    placed = replace(
        spec, parts=tuple(replace(p, origin=np.zeros(3), axis=np.array([0, 0, 1.0]))
                          if p.kind == "door" else p for p in spec.parts),
    )  # fmt: skip
    odds = []
    for told in (spec, placed):
        heard = Heard.of(told, mesh, _primitives())
        assert heard is not None
        odds.append(heard.odds(masks, value))
    lost = odds[0] - odds[1]
    door = int(np.argmax(odds[0]))
    assert lost[door] == 0.0 and lost[1 - door] > 1.0


def test_a_kind_says_how_parts_of_such_an_object_move() -> None:
    """A bucket's handle swings, a hammer's head stays, a room's door is a door."""
    bucket = spec_of(_two_boxes(("body", "handle")), Path("bucket.obj")).parts[1]
    assert bucket.moves == "hinge" and bucket.chance == 0.7
    plain = spec_of(_two_boxes(("body", "handle"))).parts[1]
    assert plain.moves == "with"
    alone = spec_of(_two_boxes(("handle", "head"))).parts[1]
    hammer = spec_of(_two_boxes(("handle", "head")), Path("hammer.obj")).parts[1]
    assert hammer.chance < alone.chance


def test_an_object_word_and_told_counts_let_one_expect_parts() -> None:
    mesh = _two_boxes()
    washer = expected_of(spec_of(mesh, what="dishwasher"))
    assert washer is not None and washer.share("hinge") > washer.share("spin")
    told = expected_of(spec_of(mesh, what="cabinet with 2 doors and 4 drawers"))
    assert told is not None and told.share("slide") == pytest.approx(4 / 6)
    assert expected_of(KinematicSpec()) is None


def test_counted_parts_are_no_object_and_count_in_a_files_name() -> None:
    assert object_of("cabinet with 2 doors", Said("user")).word == "cabinet"  # type: ignore[union-attr]
    spec = spec_of(_two_boxes(("a", "b")), Path("three_drawers_two_doors.obj"))
    assert not spec.objects
    assert {c.kind: c.count for c in spec.counts} == {"drawer": 3, "door": 2}


@pytest.mark.parametrize(
    ("pivot", "line", "axis"),
    [
        ((0.0, 0.01, 0.5), "", 2), ((0.4, 0.0, 0.5), "upright", 2),  # a side's middle
        ((0.2, 0.0, 1.0), "", 0),  # the top edge's middle
        ((0.2, 0.0, 1.0), "upright", None),  # which no such hinge has
        ((0.0, 0.0, 0.0), "upright", 2), ((0.0, 0.0, 0.0), "level", 0),  # a corner
        ((0.2, 0.01, 0.5), "", None),  # the middle
        ((2.0, 0.0, 0.5), "", None),  # far off
    ],
)  # fmt: skip
def test_an_origin_on_an_edge_of_a_parts_box_is_a_hinge_there(
    pivot: tuple[float, ...], line: str, axis: int | None
) -> None:
    sheet, _ = _box((0.0, 0.0, 0.0), (0.4, 0.02, 1.0))
    found = hinge_axis(sheet, np.array(pivot), line)
    if axis is None:
        assert found is None
    else:
        assert found is not None and np.array_equal(found, np.eye(3)[axis])


def test_a_nameless_node_with_its_own_origin_on_an_edge_is_a_part(tmp_path: Path) -> None:
    _animated(tmp_path / "a.glb", _quaternions([0, 45], (0, 1, 0)), "rotation")
    doc = json.loads((tmp_path / "a.gltf").read_text())
    del doc["animations"]
    (tmp_path / "b.gltf").write_text(json.dumps(doc))
    spec, got = _stated(tmp_path / "b.gltf")
    (part,) = (p for p in spec.parts if p.movable)
    assert part.said.origin == "hierarchy" and part.axis is not None and part.origin is not None
    at = (got.source_to_asset @ np.array([-0.02, 0.0, 0.0, 1.0]))[:3]
    assert np.allclose(part.origin, at)


def test_one_word_on_all_nodes_is_the_objects_and_says_nothing_of_parts() -> None:
    assert not spec_of(_two_boxes(("door_a", "door_b"))).parts


def test_a_thing_in_which_nothing_moves_lowers_every_candidate() -> None:
    mesh = _two_boxes(("a", "b"))
    masks, value = np.array([[False, True]]), np.array([0.6])
    told = Heard.of(spec_of(mesh, what="sofa"), mesh, _primitives())
    guessed = Heard.of(spec_of(mesh, Path("some_sofa.obj")), mesh, _primitives())
    assert told is not None and guessed is not None
    assert told.odds(masks, value)[0] < guessed.odds(masks, value)[0] < 0.0


def test_hinge_lines_that_lie_as_usual_come_first() -> None:
    def candidate(axis: tuple[float, ...], odds: float) -> JointCandidate:
        score = float(np.log(odds))
        return JointCandidate("hinge", np.array(axis), np.zeros(3), score, within_kind=odds)

    pair = [candidate((0, 1, 0), 0.6), candidate((0, 0, 1), 0.4)]
    assert with_line(pair, "level")[0] is not None
    assert with_line(pair, "level")[0].axis[1] == 1.0
    upright = with_line(pair, "upright")
    assert upright[0].axis[2] == 1.0
    assert sum(c.within_kind or 0.0 for c in upright) == pytest.approx(1.0)


def test_a_part_goes_as_far_as_such_parts_usually_do() -> None:
    line = JointCandidate("hinge", np.array([1.0, 0, 0]), np.zeros(3))
    short = replace(line, travel=UsualTravel(0.5, 0.0, 0.0))
    ajar = replace(line, travel=UsualTravel(0.9, 0.5, 0.0))
    found = [c.travel for c in with_travel((line, short, ajar), (70.0, 110.0))]
    ways = [0.0 if t is None else np.degrees(t.open + t.back) for t in found]
    assert ways == pytest.approx([90.0, 70.0, np.degrees(1.4)])


def test_a_part_beyond_the_most_of_its_kind_is_less_likely_unless_somebody_counted() -> None:
    mesh = _two_boxes()
    three = Mesh(
        np.concatenate([mesh.vertices, mesh.vertices[8:] + np.array([0, 0.6, 0])]),
        np.concatenate([mesh.faces, mesh.faces[12:] + 8]),
        face_group=np.repeat([0, 1, 2], 12), group_names=("a", "b", "c"),
    )  # fmt: skip
    tree = KinematicTree((
        PartNode("base", "body", (0,), -1, "fixed"),
        PartNode("p", "door", (1,), 0, "hinge", confidence=0.4),
        PartNode("q", "door", (2,), 0, "hinge", confidence=0.9),
    ))  # fmt: skip
    masks = np.eye(3, dtype=bool)[1:]
    for words, lost in (("microwave", True), ("wardrobe", False), ("microwave 2 doors", False)):
        heard = Heard.of(spec_of(three, what=words), three, Primitives(np.repeat([0, 1, 2], 12)))
        assert heard is not None
        found = [
            n.evidence["said"]["odds"] for n in heard.noted(tree, masks, np.zeros(2)).nodes[1:]
        ]
        assert (found[0] < -2.0) == lost
        assert found[1] == 0.0


def test_an_empty_specification_says_nothing() -> None:
    mesh = _two_boxes()
    assert KinematicSpec().empty
    assert Heard.of(KinematicSpec(), mesh, _primitives()) is None
    assert spec_of(mesh, use_names=False).empty


def _animated(path: Path, poses: list[list[float]], kind: str) -> None:
    """A glTF of two boxes whose second node is moved through `poses` (rotation or translation)."""
    save_glb(_two_boxes(("body", "Cube.001")), path)
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    doc: dict[str, Any] = json.loads(data[20 : 20 + length])
    blob = bytearray(data[28 + length :])
    # the moved node hangs at the hinge's line, its mesh is shifted back by a child
    doc["nodes"].append({"mesh": 1, "translation": [0.02, 0, 0], "name": "Cube.001"})
    doc["nodes"][1] = {"children": [2], "translation": [-0.02, 0, 0]}
    doc["scenes"][0]["nodes"] = [0, 1]
    times = np.linspace(0, 1, len(poses), dtype="<f4")
    values = np.array(poses, dtype="<f4")
    start = len(blob)
    blob += times.tobytes() + values.tobytes()
    first = len(doc["bufferViews"])
    doc["bufferViews"] += [
        {"buffer": 0, "byteOffset": start, "byteLength": times.nbytes},
        {"buffer": 0, "byteOffset": start + times.nbytes, "byteLength": values.nbytes},
    ]
    accessor = len(doc["accessors"])
    doc["accessors"] += [
        {"bufferView": first, "componentType": 5126, "count": len(poses), "type": "SCALAR"},
        {"bufferView": first + 1, "componentType": 5126, "count": len(poses),
         "type": "VEC4" if kind == "rotation" else "VEC3"},
    ]  # fmt: skip
    doc["animations"] = [{
        "name": "open", "samplers": [{"input": accessor, "output": accessor + 1}],
        "channels": [{"sampler": 0, "target": {"node": 1, "path": kind}}],
    }]  # fmt: skip
    doc["buffers"][0] = {"byteLength": len(blob), "uri": "open.bin"}
    (path.parent / "open.bin").write_bytes(bytes(blob))
    path.with_suffix(".gltf").write_text(json.dumps(doc))


def _quaternions(degrees: list[float], axis: tuple[float, ...]) -> list[list[float]]:
    turned = np.deg2rad(degrees)[:, None] * np.array(axis)
    return Rotation.from_rotvec(turned).as_quat().tolist()


def _stated(path: Path) -> tuple[KinematicSpec, Any]:
    got = load_mesh(path)
    return spec_of(got.mesh, path, got.source_to_asset), got


def test_an_animated_hinge_is_a_joint_with_its_line_and_range(tmp_path: Path) -> None:
    _animated(tmp_path / "a.glb", _quaternions([0, 45, 90], (0, 1, 0)), "rotation")
    spec, got = _stated(tmp_path / "a.gltf")
    part = spec.parts[0]
    assert part.said.origin == "animation" and part.moves == "hinge"
    assert part.axis is not None and part.origin is not None and part.limits is not None
    assert np.allclose(np.abs(part.axis), [0, 0, 1], atol=1e-6)
    assert np.allclose(part.limits, (0, np.pi / 2), atol=1e-5)
    # the line runs through the door's front left edge of the file: x = -0.02, y = 0
    at = (got.source_to_asset @ np.array([-0.02, 0.0, 0.0, 1.0]))[:3]
    assert np.allclose(np.cross(part.origin - at, part.axis), 0.0, atol=1e-6)


def test_a_whole_turn_is_endless_and_a_shift_is_a_slide(tmp_path: Path) -> None:
    _animated(tmp_path / "a.glb", _quaternions(list(range(0, 360, 30)), (1, 0, 0)), "rotation")
    spec, _ = _stated(tmp_path / "a.gltf")
    assert spec.parts[0].moves == "spin" and np.isinf(spec.parts[0].limits).all()  # type: ignore[arg-type]
    _animated(tmp_path / "a.glb", [[-0.02, 0, 0], [-0.2, 0, 0]], "translation")
    spec, _ = _stated(tmp_path / "a.gltf")
    part = spec.parts[0]
    assert part.moves == "slide" and part.axis is not None and part.limits is not None
    assert np.allclose(part.axis, [-1, 0, 0], atol=1e-6)
    assert np.allclose(part.limits, (0.0, 0.18), atol=1e-6)


def test_an_animation_that_wanders_is_no_joint_and_is_told(tmp_path: Path) -> None:
    wandering = [[-0.02, 0, 0], [-0.1, 0, 0], [-0.1, 0.2, 0]]
    _animated(tmp_path / "a.glb", wandering, "translation")
    spec, _ = _stated(tmp_path / "a.gltf")
    assert not any(part.movable for part in spec.parts)
    assert any("no straight line" in note for note in spec.notes)


def test_nodes_below_a_named_one_belong_to_it(tmp_path: Path) -> None:
    mesh = _two_boxes(("body", "Cube.001"))
    save_glb(mesh, tmp_path / "a.glb")
    scene = read_file(tmp_path / "a.glb").scene
    assert scene is not None
    data = (tmp_path / "a.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    doc = json.loads(data[20 : 20 + length])
    doc["nodes"].append({"name": "Door_left", "children": [1]})
    doc["scenes"][0]["nodes"] = [0, 2]
    doc["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "a.bin").write_bytes(data[28 + length :])
    (tmp_path / "b.gltf").write_text(json.dumps(doc))
    spec, _ = _stated(tmp_path / "b.gltf")
    door = next(p for p in spec.parts if p.kind == "door")
    assert door.groups == ("Cube.001",)


@pytest.mark.slow
def test_an_animated_part_becomes_the_joint_that_the_file_shows(tmp_path: Path) -> None:
    _animated(tmp_path / "a.glb", _quaternions([0, 45, 90], (0, 1, 0)), "rotation")
    spec, got = _stated(tmp_path / "a.gltf")
    run = articulate_mesh(got.mesh, spec=spec)
    (joint,) = run.articulation.joints
    assert joint.provenance == "observed" and np.allclose(joint.upper, np.pi / 2, atol=1e-4)
    assert any("animation" in note for note in run.notes)


@pytest.mark.slow
def test_a_part_turns_about_its_nodes_own_origin(tmp_path: Path) -> None:
    """The hinge lies where the file has it, and the door opens away from the body."""
    _animated(tmp_path / "a.glb", _quaternions([0, 45], (0, 1, 0)), "rotation")
    doc = json.loads((tmp_path / "a.gltf").read_text())
    del doc["animations"]
    (tmp_path / "b.gltf").write_text(json.dumps(doc))
    spec, got = _stated(tmp_path / "b.gltf")
    (joint,) = articulate_mesh(got.mesh, spec=spec).articulation.joints
    at = (got.source_to_asset @ np.array([-0.02, 0.0, 0.0, 1.0]))[:3]
    assert joint.subtype == "hinge" and abs(joint.axis[2]) > 0.99
    assert np.linalg.norm(np.cross(joint.origin - at, joint.axis)) < 0.01
    assert joint.upper > np.deg2rad(60)


def test_a_statement_takes_its_faces_by_material_where_no_group_says() -> None:
    mesh = _two_boxes(("a", "b"))
    first = mesh.materials[0]
    painted = replace(
        mesh, materials=(first, replace(first, name="door")), face_material=np.repeat([0, 1], 12)
    )
    part = PartStatement("door", "door", "hinge", Said("material"), materials=("door",))
    assert part.faces(painted).sum() == 12


def test_collada_nodes_and_copies_speak_as_those_of_gltf_do(tmp_path: Path) -> None:
    """A named node with nameless ones below it, and two nodes that show one geometry."""

    def shown(k: int, name: str) -> str:
        return (f'<node id="k{k}"{name}><translate>{40 * k} 0 0</translate>'
                f'<instance_geometry url="#g">{BIND}</instance_geometry></node>')  # fmt: skip

    door = f'<node id="d" name="door_left">{shown(1, "")}{shown(2, "")}</node>'
    file = tmp_path / "a.dae"
    file.write_text(dae(None, shown(0, ' name="body"') + door))
    scene = read_file(file).scene
    assert scene is not None
    assert [n.name for n in scene.nodes if n.name] == ["body", "door_left", "k1", "k2"]
    loaded = load_mesh(file)
    spec = spec_of(loaded.mesh, file, loaded.source_to_asset)
    (part,) = (p for p in spec.parts if p.movable)
    assert (part.name, part.kind, set(part.groups)) == ("door_left", "door", {"k1", "k2"})
    assert spec.alike == (("body", "k1", "k2"),)
