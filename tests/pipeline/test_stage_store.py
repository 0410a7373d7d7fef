"""Stages on disk: what is reused, what is made anew, and what becomes of a person's edits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mam_pipeline.backends import Maker, Reconstruction
from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import HintBox, HintPart, Hints
from mam_pipeline.photo.reconstruct import EmbeddedReconstructor
from mam_pipeline.stage_artefacts import (
    PHOTO,
    Codec,
    articulation_codec,
    load_mesh,
    save_mesh,
    tree_codec,
)
from mam_pipeline.stage_store import StageStore
from mam_pipeline.stages import Stages
from mam_pipeline.types import (
    Articulation,
    Joint,
    JointCandidate,
    KinematicTree,
    Link,
    Material,
    Mesh,
    PartNode,
    RangeBasis,
    UsualTravel,
)

UP = np.array([0.0, 0.0, 1.0])
TRIANGLES = Mesh(np.eye(3)[[0, 1, 2, 0, 1, 2]], np.arange(6).reshape(2, 3))
LINE = JointCandidate("hinge", UP, np.zeros(3), -0.1, {"p": 0.9}, 0.8, 0.7,
                      UsualTravel(1.5, 0.0, 0.01))  # fmt: skip
TREE = KinematicTree((
    PartNode("base", "body", (0, 3), -1, "fixed"),
    PartNode("door", "door", (1,), 0, "hinge", 0.81234, candidates=(LINE,), limits=(0.0, 1.0)),
    PartNode("knob", "knob", (2,), 1, "spin", 0.5, candidates=(LINE,)),
))  # fmt: skip
ME = Maker("geometric", "1")


def text_codec() -> Codec[str]:
    def save(value: str, path: Path) -> None:
        path.write_text(value)

    return Codec("text.yaml", save, lambda path, _shown: path.read_text())


def made(store: StageStore, value: str, maker: Maker = ME, **inputs: str) -> tuple[str, Maker]:
    """The stage's result, where computing it would give `value`, and who made it."""
    kept = store.stage("1_text", maker, {"seed": 0}, inputs, text_codec(), lambda: value)
    return kept.value, kept.maker


def test_a_stage_is_made_anew_when_its_input_or_its_maker_changes(tmp_path: Path) -> None:
    store = StageStore(tmp_path)
    assert made(store, "first", mesh="a") == ("first", ME)
    assert made(store, "second", mesh="a") == ("first", ME)
    for changed in (replace(ME, weights="9f"), replace(ME, version="2"), Maker("other", "1")):
        assert made(store, f"by {changed}", changed, mesh="a") == (f"by {changed}", changed)
    assert made(store, "third", changed, mesh="b")[0] == "third"


def test_an_edit_outlives_a_new_version_and_is_set_aside_with_its_input(tmp_path: Path) -> None:
    store = StageStore(tmp_path)
    made(store, "generated", mesh="a")
    (tmp_path / "1_text" / "text.yaml").write_text("edited")
    newer = replace(ME, version="2")
    for _ in range(2):
        assert made(store, "generated", newer, mesh="a") == ("edited", replace(ME, edited=True))
    assert not store.notes
    assert made(store, "other", newer, mesh="b") == ("other", newer)
    assert (tmp_path / "1_text.edited.yaml").read_text() == "edited"
    assert "1_text.edited.yaml" in store.notes[0]


def test_a_tree_is_read_back_as_it_was(tmp_path: Path) -> None:
    codec = tree_codec(4)
    codec.save(TREE, tmp_path / "parts.yaml")
    back = codec.load(tmp_path / "parts.yaml", tmp_path)
    assert codec.prints(back) == codec.prints(TREE)
    assert back.nodes[1].limits == (0.0, 1.0) and back.nodes[1].candidates[0].travel == LINE.travel
    assert codec.marked(back, codec.prints(TREE)) == back


@pytest.mark.parametrize(
    ("change", "left"),
    [
        ({"subtype": "slide"}, 0), ({"name": "flap"}, 0), ({"limits": [0.0, 0.5]}, 0),
        ({"candidates": [{"subtype": "hinge", "axis": [0, 1, 0], "origin": [0, 0, 0]}]}, 1),
    ],
)  # fmt: skip
def test_an_edited_part_is_the_persons_and_no_other_is(
    tmp_path: Path, change: dict[str, Any], left: int
) -> None:
    codec, file = tree_codec(4), tmp_path / "parts.yaml"
    codec.save(TREE, file)
    rows = yaml.safe_load(file.read_text())
    rows[1] |= change
    file.write_text(yaml.safe_dump(rows))
    base, door, knob = codec.marked(codec.load(file, file), codec.prints(TREE)).nodes
    assert (base.provenance, door.provenance, knob.provenance) == ("inferred", "user", "inferred")
    assert len(door.candidates) == left  # what was ranked for the former part is not obeyed
    assert len(knob.candidates) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"primitives": [1, 9]}, "'door': no primitive 9 (0 to 3)"),
        ({"primitives": [1, 2]}, "part 'knob': primitive 2 is in 'door' too"),
        ({"primitives": []}, "primitives 1 are in no part"),
        ({"parent": 2}, "is its own ancestor: 'door' hangs on 'knob'"),
        ({"name": "knob"}, "is a second part named 'knob'"),
        ({"subtype": "swing"}, "subtype must be one of fixed, hinge, spin, slide, not 'swing'"),
        ({"colour": "red"}, "colour is an unknown key"),
        ({"confidence": 1.5}, "line 32: [1].confidence must be a number from 0 to 1, not 1.5"),
        ({"limits": [1.0, 0.0]}, "must be the lower, then the upper"),
        ({"parent": 7}, "must be from 0 to 2, not 7"),
    ],
)
def test_an_edit_that_is_no_tree_is_refused_in_words(
    tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    codec, file = tree_codec(4), tmp_path / "parts.yaml"
    codec.save(TREE, file)
    rows = yaml.safe_load(file.read_text())
    rows[1] |= change
    file.write_text(yaml.safe_dump(rows))
    with pytest.raises(ConfigError) as error:
        codec.load(file, file)
    assert said in str(error.value) and str(file) in str(error.value)


def test_an_edited_joint_keeps_the_persons_range(tmp_path: Path) -> None:
    mesh = Mesh(np.eye(3)[[0, 1, 2] * 3], np.arange(9).reshape(3, 3))
    names = ("base", "door", "flap")
    links = tuple(Link(name, "body", np.array([i])) for i, name in enumerate(names))
    joint = Joint("hinge", "continuous", "spin", 0, 1, UP, np.zeros(3), -np.inf, np.inf,
                  confidence=0.4, basis=RangeBasis("collision", 0.3))  # fmt: skip
    whole = Articulation(mesh, links, (joint, replace(joint, name="other", child=2)))
    codec, file = articulation_codec(mesh), tmp_path / "joints.yaml"
    codec.save(whole, file)
    assert codec.load(file, file).joints[0].basis == RangeBasis("collision", 0.3)
    data = yaml.safe_load(file.read_text())
    data["joints"][0]["upper"] = 0.7
    file.write_text(yaml.safe_dump(data))
    first, second = codec.marked(codec.load(file, file), codec.prints(whole)).joints
    assert (first.upper, first.provenance, first.basis.rule) == (0.7, "user", "given")
    assert second.provenance == "inferred" and second.basis.share == 0.3


def test_a_mesh_is_kept_exactly(tmp_path: Path) -> None:
    mesh = Mesh(
        np.random.default_rng(0).normal(size=(4, 3)), np.array([[0, 1, 2], [1, 2, 3]]),
        (Material("a", image=b"\x89PNG\x00", image_format="png"), Material("b", (1, 0, 0, 0.5))),
        face_material=np.array([1, 0]), uv=np.full((4, 2), 0.25, np.float32),
        face_group=np.array([0, 1]), group_names=("door", "rahmen ä"),
    )  # fmt: skip
    save_mesh(mesh, tmp_path / "mesh.npz")
    back = load_mesh(tmp_path / "mesh.npz")
    assert back.materials == mesh.materials and back.group_names == mesh.group_names
    for name in ("vertices", "faces", "face_material", "face_group", "uv"):
        assert np.array_equal(getattr(back, name), getattr(mesh, name))
    assert back.colors is None


@pytest.fixture
def photographed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[Reconstruction, int]]:
    """Reconstruct with some options; gives what came out, and how often it was computed so far."""
    (tmp_path / "photo.jpg").write_bytes(b"a photo")
    parts = tuple(
        HintPart(n, "drawer", nodes=(n,), box=HintBox((0, 0, 1), (1, 1, 1)), provenance="observed")
        for n in ("upper", "lower")
    )
    calls: list[Any] = []

    def reconstruct(_self: object, photo: Path, options: Any) -> Reconstruction:
        calls.append((photo, options))
        shown = {"front": np.zeros((2, 2, 3), np.uint8)}
        return Reconstruction(TRIANGLES, Hints(parts=parts), {"scale": "low"}, "seen", (), shown)

    monkeypatch.setattr(EmbeddedReconstructor, "reconstruct", reconstruct)

    def run(**options: Any) -> tuple[Reconstruction, int]:
        stages = Stages(store=StageStore(tmp_path / "stages"))
        return stages.reconstruct(tmp_path / "photo.jpg", options), len(calls)

    return run


def test_a_photo_is_reconstructed_once(
    photographed: Callable[..., tuple[Reconstruction, int]], tmp_path: Path
) -> None:
    first, _ = photographed(width=0.4)
    again, count = photographed(width=0.4)
    assert count == 1 and again.hints == first.hints and again.summary == "seen"
    assert np.array_equal(again.mesh.vertices, first.mesh.vertices)
    assert photographed(width=0.5)[1] == 2
    (tmp_path / "photo.jpg").write_bytes(b"another")
    assert photographed(width=0.5)[1] == 3


def test_edited_hints_of_a_photo_are_the_persons(
    photographed: Callable[..., tuple[Reconstruction, int]], tmp_path: Path
) -> None:
    photographed()
    file = tmp_path / "stages" / "0_photo" / PHOTO.filename
    data = yaml.safe_load(file.read_text())
    data["parts"][0]["kind"] = "door"
    file.write_text(yaml.safe_dump(data))
    edited, count = photographed()
    assert count == 1
    assert [p.provenance for p in edited.hints.parts] == ["user", "observed"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joints": []}, "joints hold no door, flap: every link but the first needs one"),
        ({"links": []}, "links must be a list of 1, not of 0"),
        ({"parent": "flap"}, "joints[0].parent is 'flap', which no joint before this one holds"),
        ({"child": "base"}, "joints[0].child is 'base', which another joint holds or which is"),
        ({"child": "x"}, "joints[0].child names no link: 'x' (base, door, flap)"),
        ({"upper": "much"}, "joints[0].upper must be a number, not 'much'"),
        ({"upper": float("nan")}, "joints[0].upper must be a number, not nan"),
        ({"upper": -1.0}, "joints[0].upper must be finite and not below lower"),
        ({"axis": [0, 0, 0]}, "joints[0].axis must not have zero length"),
        ({"type": "floating"}, "joints[0].type must be one of fixed, revolute"),
        ({"name": "other"}, "joints[1] is a second joint named 'other'"),
        ({"friction": -1}, "joints[0].friction must be at least 0, not -1"),
        ({"catch": {"force": -1}}, "joints[0].catch.force must be at least 0, not -1"),
        ({"catch": {"width": 0}}, "joints[0].catch.width must be above 0, not 0"),
        (
            {"friction": 1, "balance": {"friction": 2}},
            "joints[0].balance.friction must be between 0 and the joint's friction, not 2",
        ),
    ],
)
def test_edited_joints_hold_every_link(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    mesh = Mesh(np.eye(3)[[0, 1, 2] * 3], np.arange(9).reshape(3, 3))
    links = tuple(
        Link(name, "body", np.array([i])) for i, name in enumerate(("base", "door", "flap"))
    )
    joint = Joint("hinge", "revolute", "hinge", 0, 1, UP, np.zeros(3), 0.0, 1.0)
    whole = Articulation(mesh, links, (joint, replace(joint, name="other", child=2)))
    codec, file = articulation_codec(mesh), tmp_path / "joints.yaml"
    codec.save(whole, file)
    data = yaml.safe_load(file.read_text())
    if not change.keys() <= data.keys():
        data["joints"][0] |= change
    else:
        data |= change
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as error:
        codec.load(file, Path("mine/joints.yaml"))
    assert said in str(error.value) and str(error.value).startswith("mine/joints.yaml")


def test_a_damaged_stage_says_how_to_go_on(tmp_path: Path) -> None:
    store = StageStore(tmp_path / "copy", tmp_path / "mine")
    codec: Codec[Any] = Codec("a.npz", lambda value, path: np.savez(path, a=value),
                              lambda path, _shown: np.load(path)["a"])  # fmt: skip
    store.stage("1", ME, {}, {}, codec, lambda: 1)
    (tmp_path / "copy" / "1" / "a.npz").write_bytes(b"PK nonsense")
    with pytest.raises(ConfigError, match=r"mine/1/a\.npz or a file beside it cannot be used"):
        store.stage("1", ME, {}, {}, codec, lambda: 1)
    (tmp_path / "copy" / "1" / "stage.json").write_text("{")
    assert store.stage("1", ME, {}, {}, codec, lambda: 2).value == 2
    assert "stages/1/stage.json could not be read" in store.notes[0]
