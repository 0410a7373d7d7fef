"""Asking a vision-language model: answers, faults, money and secrets."""

from __future__ import annotations

import base64
import json
import logging
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from mam_pipeline import backends
from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import BackendError, ConfigError, HintNeeded
from mam_pipeline.evidence.spec import (
    KindCount,
    KinematicSpec,
    ObjectWord,
    PartStatement,
    Said,
)
from mam_pipeline.models import album, questions, settings
from mam_pipeline.models.answers import meant_lines, on_side
from mam_pipeline.models.ledger import Ledger, one_ledger, price_of
from mam_pipeline.models.vlm import FileReasoner, VlmReasoner
from mam_pipeline.types import JointCandidate, KinematicTree, Mesh, Primitives

Boxes = tuple[Mesh, Primitives]
Start = Callable[[list[tuple[int, str]]], Any]
Plain = dict[str, Any]


@pytest.fixture(autouse=True)
def _small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        album, "ALBUM", replace(album.ALBUM, size=96)
    )  # large ones are looked at in test_models_pictures
    monkeypatch.setenv("MAM_SIM_VLM_SIMPLE", "0")  # two questions, and no look at the motion
    monkeypatch.setenv("MAM_SIM_VLM_ROUNDS", "0")


@pytest.fixture
def good(grouping: Plain, mounting: Plain) -> list[tuple[int, str]]:
    return [(200, json.dumps(grouping)), (200, json.dumps(mounting))]


def _pictures(request: Plain) -> list[Plain]:
    return [c for c in request["messages"][1]["content"] if c["type"] == "image_url"]


def test_two_questions_make_a_tree_and_the_cache_repeats_it(
    endpoint: Start, tmp_path: Path, boxes: Boxes, good: list[tuple[int, str]]
) -> None:
    server = endpoint(good)
    tree = VlmReasoner().reason(*boxes, None)
    assert [n.name for n in tree.nodes] == ["body", "door"]
    assert tree.nodes[1].primitives == (1, 2) and tree.nodes[1].subtype == "hinge"
    first = server.asked[0]
    assert first["temperature"] == 0 and first["response_format"]["type"] == "json_schema"
    assert len(_pictures(first)) == 12  # the object, ten views, the pieces apart
    again = VlmReasoner().reason(*boxes, None)
    assert len(server.asked) == 2 and again.nodes[1].name == "door"
    assert tree.nodes[0].evidence["ledger"]["tokens_in"] == 2000
    pieces, mounts = tree.nodes[0].evidence["dialogue"]
    assert "pieces" in pieces["question"] and pieces["parts"][1]["name"] == "door"
    assert mounts["mounts"][0]["motion"] == "hinge"
    kept = "".join(p.read_text() for p in (tmp_path / "answers").iterdir())
    assert "sk-secret" not in kept


def test_masks_lie_beside_the_pictures(
    endpoint: Start, boxes: Boxes, good: list[tuple[int, str]]
) -> None:
    server = endpoint(good)
    prior = backends.load("prior", "embedded")[1].observe(*boxes)
    VlmReasoner().reason(*boxes, prior)
    content = server.asked[0]["messages"][1]["content"]
    labels = [c["text"] for c in content[1:] if c["type"] == "text"]
    assert "measured" in labels and "'measured' repeats those views" in content[0]["text"]


def test_the_answer_decides_the_line_and_the_way_it_opens(
    endpoint: Start,
    boxes: Boxes,
    grouping: Plain,
    mounting: Plain,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    mesh, primitives = boxes
    keep = primitives.labels < 2  # without its knob the door could hang on either side
    plain = mesh.submesh(keep), Primitives(primitives.labels[keep])
    grouping["parts"][1]["pieces"] = [1]
    for side, sign in (("-y", -1.0), ("+y", 1.0)):
        mounting["mounts"][0]["side"] = side
        endpoint([(200, json.dumps(grouping)), (200, json.dumps(mounting))])
        monkeypatch.setenv("MAM_SIM_VLM_CACHE", str(tmp_path / side))
        best = VlmReasoner().reason(*plain, None).nodes[1].candidates[0]
        assert abs(best.axis[2]) > 0.99 and np.sign(best.origin[1]) == sign
        free_end = np.array([-0.215, 0.0, 0.3]) - best.origin
        assert np.cross(best.axis, free_end)[0] < 0  # opens towards -x, as told


def test_the_answered_direction_and_side_select_the_line(mounting: Plain) -> None:
    up, across = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    lines = [
        JointCandidate("hinge", across, np.array([0.0, 0.0, -0.3]), -0.1, within_kind=0.9),
        JointCandidate("hinge", up, np.array([0.0, -0.4, 0.0]), -7.0, within_kind=0.01),
        JointCandidate("hinge", up, np.array([0.0, 0.4, 0.0]), -1.0, within_kind=0.05),
        JointCandidate("slide", up, np.zeros(3), 0.0),
    ]
    box = np.array([[-0.01, -0.4, -0.3], [0.01, 0.4, 0.3]])
    mount = questions.Mount.model_validate({**mounting["mounts"][0], "side": "-y"})
    meant = meant_lines(lines, mount, box)  # however little the measurement thinks of it
    assert len(meant) == 1 and meant[0].origin[1] == -0.4 and meant[0].within_kind == 1.0
    made = meant_lines(lines[:1], mount, box)[0]  # no measured line is upright: made from the box
    assert abs(made.axis[2]) == 1.0 and made.origin == pytest.approx([0.0, -0.4, 0.0])
    anyhow = mount.model_copy(update={"axis": "other", "side": "+x"})
    assert meant_lines(lines, anyhow, box)[0].score == -0.1  # nothing agrees: as it was measured
    assert on_side(lines[1], "-y", box) and not on_side(lines[1], "+y", box)
    assert not on_side(lines[0], "middle", box)


def test_a_line_that_blocks_the_part_both_ways_is_vetoed(
    endpoint: Start, boxes: Boxes, grouping: Plain, mounting: Plain
) -> None:
    slide = {"motion": "slide", "axis": "z", "side": "middle", "opens": "+z"}
    mounting["mounts"][0].update(slide)
    mesh, primitives = boxes
    floor, roof = (trimesh.creation.box((0.1, 0.5, 0.02)) for _ in range(2))
    floor.apply_translation((-0.215, 0, 0.04))
    roof.apply_translation((-0.215, 0, 0.56))
    count = len(primitives.labels)
    joined: Any = trimesh.util.concatenate(
        [trimesh.Trimesh(mesh.vertices, mesh.faces), floor, roof]
    )
    labels = np.concatenate([primitives.labels, np.zeros(len(joined.faces) - count, dtype=int)])
    endpoint([(200, json.dumps(grouping)), (200, json.dumps(mounting))])
    tree = VlmReasoner().reason(Mesh(joined.vertices, joined.faces), Primitives(labels), None)
    assert "blocked from the start in both directions" in tree.nodes[1].evidence["physics"]
    assert abs(tree.nodes[1].candidates[0].axis[2]) < 0.01


def test_simple_objects_are_asked_once_and_looked_at_in_motion(
    tmp_path: Path, boxes: Boxes
) -> None:
    parts: Plain = {"base": "body", "parts": [{
        "name": "door", "pieces": [1], "motion": "hinge", "axis": "z", "side": "+y", "opens": "-x",
    }]}  # fmt: skip
    given = {
        "MAM_SIM_QUESTIONS": str(tmp_path), "MAM_SIM_VLM_SIMPLE": "24", "MAM_SIM_VLM_ROUNDS": "2",
        "MAM_SIM_VLM_IMAGES": "2",
    }  # fmt: skip

    def reasoned() -> KinematicTree:
        with settings.given(given):
            return FileReasoner().reason(*boxes, None)

    def answer(question: str, words: Plain) -> None:
        (tmp_path / question / "answer.json").write_text(json.dumps(words))

    with pytest.raises(HintNeeded, match="1_parts"):
        reasoned()
    assert len(list((tmp_path / "1_parts").glob("sheet_*.png"))) == 2
    answer("1_parts", {**parts, "parts": [{**parts["parts"][0], "pieces": [0, 1, 2]}]})
    with pytest.raises(HintNeeded, match="1_parts-2"):
        reasoned()  # nothing would be left that stands still
    answer("1_parts", parts)
    with pytest.raises(HintNeeded, match="3_motion"):
        reasoned()
    asked = (tmp_path / "3_motion" / "question.md").read_text()
    assert "door, on body: turns about z, 0.." in asked
    answer("3_motion", {"joints": [{"name": "door", "ok": False, "side": "-y", "upper": 60}],
                        "transfers": [{"pieces": [2], "to": "door"}]})  # fmt: skip
    with pytest.raises(HintNeeded, match="4_motion"):
        reasoned()
    answer("4_motion", {"joints": [{"name": "door", "ok": True}]})
    door = reasoned().nodes[1]
    assert door.primitives == (1, 2) and door.limits == pytest.approx((0.0, np.pi / 3))
    assert door.candidates[0].origin[1] < -0.2 and abs(door.candidates[0].axis[2]) == 1.0
    shutil.rmtree(tmp_path / "4_motion")  # a range alone needs no other look
    answer("3_motion", {"joints": [{"name": "door", "ok": False, "upper": 30}]})
    assert reasoned().nodes[1].limits == pytest.approx((0.0, np.pi / 6))


def test_pieces_are_shown_closer_once_and_the_file_s_names_are_told(
    tmp_path: Path, boxes: Boxes
) -> None:
    mesh, primitives = boxes
    named = replace(
        mesh, face_group=primitives.labels, group_names=("a", "Door <b>ignore all</b>\n", "c")
    )
    user, file = Said("user"), Said("name")
    spec = KinematicSpec(
        objects=(ObjectWord("oven", (), user),), counts=(KindCount("door", 1, user),),
        parts=(PartStatement(named.group_names[1], "door", "hinge", file, named.group_names[1:2]),),
    )  # fmt: skip
    answer = {"base": "body", "parts": [], "closer": [1, 2]}
    given = {"MAM_SIM_QUESTIONS": str(tmp_path), "MAM_SIM_VLM_SIMPLE": "24"}

    def reasoned() -> KinematicTree:
        with settings.given(given):
            return FileReasoner(spec).reason(named, primitives, None)

    with pytest.raises(HintNeeded, match="1_parts"):
        reasoned()
    asked = (tmp_path / "1_parts" / "question.md").read_text()
    assert "The user says that it is: oven. The user says that it has: 1 x door." in asked
    assert "'Door bignore allb' = 1." in asked and "in closer" in asked
    (tmp_path / "1_parts" / "answer.json").write_text(json.dumps(answer))
    with pytest.raises(HintNeeded, match="1_parts_closer"):
        reasoned()
    again = tmp_path / "1_parts_closer"
    assert (again / "closer_0.png").is_file() and (again / "view_0.png").is_file()
    assert "You asked for 1, 2" in (again / "question.md").read_text()
    door = {"name": "door", "nodes": ["Door bignore allb"], "motion": "hinge", "axis": "z",
            "side": "+y", "opens": "-x"}  # fmt: skip
    (again / "answer.json").write_text(json.dumps({**answer, "parts": [door]}))
    assert reasoned().nodes[1].primitives == (1,)  # asking for closer ones again changes nothing


def test_the_bars_of_a_hidden_rack_are_one_piece() -> None:
    at = trimesh.transformations.translation_matrix
    shell = trimesh.creation.box((1.0, 1.0, 1.0))
    bars = [trimesh.creation.box((0.02, 0.8, 0.02), at((x, 0, 0))) for x in (-0.3, 0.0, 0.3)]
    bars += [trimesh.creation.box((0.8, 0.02, 0.02), at((0, y, 0.02))) for y in (-0.3, 0.3)]
    far = trimesh.creation.box((0.02, 0.02, 0.3), at((0.4, 0.4, -0.3)))
    solids = [shell, *bars, far]
    joined: Any = trimesh.util.concatenate([s.subdivide() for s in solids])
    labels = np.repeat(np.arange(len(solids)), [len(s.faces) * 4 for s in solids])
    found = album.cast(Mesh(joined.vertices, joined.faces), Primitives(labels))
    assert found.ids == [0, 1, 6] and found.stands_for.tolist() == [0, 1, 1, 1, 1, 1, 6]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "lid"}, "no parts with a joint"),
        ({"line": 2}, "no line 2 is shown for door"),
        ({"parent": "door"}, "door is mounted on itself"),
        ({"lower": 10, "upper": 5}, "upper of door must be above"),
    ],
)
def test_faults_of_a_look_at_the_motion_are_named(change: Plain, said: str) -> None:
    check = questions.MotionCheck.model_validate(
        {"joints": [{"name": "door", "ok": False, **change}], "transfers": []}
    )
    parents = {"body": "", "door": "body"}
    assert said in questions.faults_of_check(check, parents, {0, 1, 2}, {"door": 1})


@pytest.mark.parametrize(
    ("faulty", "said"),
    [
        ("no json", "Invalid JSON"),
        ('{"parts": [{"name": "bo', "Invalid JSON"),
        ({"pieces": [0, 1]}, "pieces [2] are in no part"),
        ({"pieces": [0, 1, 2, 7]}, "pieces [7] do not exist"),
        ({"pieces": [0, 1, 2, 2]}, "pieces [2] are used more than once"),
        ({"pieces": [0, 1, 2], "is_base": False}, "exactly one part must be the base"),
    ],
)
def test_a_faulty_answer_is_asked_again_with_the_fault(
    endpoint: Start,
    boxes: Boxes,
    grouping: Plain,
    good: list[tuple[int, str]],
    faulty: str | Plain,
    said: str,
) -> None:
    if isinstance(faulty, dict):
        faulty = json.dumps({"parts": [{**grouping["parts"][0], **faulty}]})
    server = endpoint([(200, faulty), *good])
    assert len(VlmReasoner().reason(*boxes, None).nodes) == 2
    assert said in server.asked[1]["messages"][-1]["content"]


@pytest.mark.parametrize(
    "change",
    [
        {"name": "../../etc/passwd"},
        {"name": "a" * 4000},
        {"kind": "<script>alert(1)</script>"},
        {"pieces": list(range(1_000_000))},
        {"pieces": [-1]},
        {"pieces": [1e99]},
        {"confidence": "NaN"},
        {"code": "import os"},
        None,
    ],
)
def test_malicious_answers_are_refused_by_the_schema(
    endpoint: Start, boxes: Boxes, grouping: Plain, change: Plain | None
) -> None:
    parts = [] if change is None else [{**grouping["parts"][0], **change}]
    server = endpoint([(200, json.dumps({"parts": parts}))])
    with pytest.raises(BackendError, match="no usable answer to 1_grouping after 2 repairs"):
        VlmReasoner().reason(*boxes, None)
    assert len(server.asked) == 3
    sent_back = json.dumps(server.asked[-1]["messages"][2:])
    assert len(sent_back) < 20_000  # a huge answer is not sent back whole


def test_a_contradiction_is_challenged_once(
    endpoint: Start, boxes: Boxes, grouping: Plain, good: list[tuple[int, str]]
) -> None:
    prior = KinematicPrior(np.array([0.0, 0.01, 0.01]), np.eye(3))
    server = endpoint([(200, json.dumps(grouping)), *good])
    VlmReasoner().reason(*boxes, prior)
    assert len(server.asked) == 3
    assert "unable to move" in server.asked[1]["messages"][-1]["content"]


def test_one_rigid_part_needs_no_second_question(
    endpoint: Start, boxes: Boxes, grouping: Plain
) -> None:
    whole = {"parts": [{**grouping["parts"][0], "pieces": [0, 1, 2]}]}
    server = endpoint([(200, json.dumps(whole))])
    tree = VlmReasoner().reason(*boxes, None)
    assert len(tree.nodes) == 1 and len(server.asked) == 1
    assert "nothing that moves" in tree.nodes[0].evidence["nothing_movable"]


@pytest.mark.parametrize("field", ["temperature", "max_tokens"])
def test_endpoints_that_take_less_are_asked_with_less(
    endpoint: Start, boxes: Boxes, good: list[tuple[int, str]], field: str
) -> None:
    server = endpoint([(400, f"Unsupported parameter: {field}"), *good])
    assert len(VlmReasoner().reason(*boxes, None).nodes) == 2
    assert field in server.asked[0] and field not in server.asked[1]


@pytest.mark.parametrize(
    ("status", "text", "message"),
    [(401, "bad key", "bad key"), (404, "no such model", "no such model"), (400, "no", "refused")],
)
def test_hard_errors_are_named_and_the_key_is_not(
    endpoint: Start,
    boxes: Boxes,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
    status: int,
    text: str,
    message: str,
) -> None:
    caplog.set_level(logging.INFO)
    endpoint([(status, text)])
    with pytest.raises(BackendError, match=message) as caught:
        VlmReasoner().reason(*boxes, None)
    said = capfd.readouterr()
    for place in (str(caught.value), repr(caught.value.__cause__), caplog.text, *said):
        assert "sk-secret" not in place and "data:image" not in place
        assert "Group the numbered" not in place


def test_an_empty_answer_is_an_error(endpoint: Start, boxes: Boxes) -> None:
    endpoint([(200, "")])
    with pytest.raises(BackendError, match="empty answer"):
        VlmReasoner().reason(*boxes, None)


def test_busy_endpoints_are_tried_again(
    endpoint: Start, boxes: Boxes, good: list[tuple[int, str]]
) -> None:
    server = endpoint([(429, "slow down"), (503, "busy"), *good])
    assert len(VlmReasoner().reason(*boxes, None).nodes) == 2
    assert len(server.asked) == 4


def test_an_endpoint_that_never_answers(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, boxes: Boxes
) -> None:
    import time

    pytest.importorskip("openai", reason="the vlm extra is not installed")
    asked = []

    def hang(*_: object) -> tuple[int, str, bytes]:
        asked.append(1)
        time.sleep(2)
        return 200, "application/json", b"{}"

    monkeypatch.setenv("OPENAI_BASE_URL", serve(hang))
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "0.1")
    with pytest.raises(BackendError, match=r"gave no answer within 0.1 s \(--timeout\)"):
        VlmReasoner().reason(*boxes, None)
    assert len(asked) == 1  # a server goes on with an answer that nobody waits for


def test_spending_stops_before_the_cap(
    endpoint: Start, boxes: Boxes, monkeypatch: pytest.MonkeyPatch, good: list[tuple[int, str]]
) -> None:
    server = endpoint(good)
    with (
        pytest.raises(BackendError, match=r"passes the cap of \$0.00"),
        settings.given({"MAM_SIM_MAX_COST": "0.003"}),
    ):
        VlmReasoner().reason(*boxes, None)
    assert not server.asked
    monkeypatch.setenv("MAM_SIM_VLM_MODEL", "a-local-model")
    with one_ledger() as ledger:
        VlmReasoner().reason(*boxes, None)
    assert ledger.questions == 2 and ledger.cost == 0 and "unknown" not in ledger.summary()
    monkeypatch.setenv("OPENAI_BASE_URL", "https://models.example/v1")
    with one_ledger() as ledger:
        ledger.book("a-local-model", {})
    assert "unknown" in ledger.summary()
    monkeypatch.setenv("MAM_SIM_VLM_PRICE", "5,20")
    assert price_of("a-local-model") == (5.0, 20.0)
    monkeypatch.setenv("MAM_SIM_VLM_PRICE", "cheap")
    with pytest.raises(ConfigError, match="two numbers"):
        price_of("a-local-model")


def test_one_ledger_holds_for_many_objects() -> None:
    with one_ledger() as ledger, settings.given({"MAM_SIM_VLM_PRICE": None}):
        ledger.book("gpt-4o", {"in": 1_000_000, "out": 0})
        assert ledger.cost == pytest.approx(2.5)
        with pytest.raises(BackendError, match=r"cost \$2.500"):
            ledger.allow((2.5, 10.0), 1000)
    assert Ledger(1.0).summary() == ""
    assert price_of("gpt-4o-mini-2024") == (0.15, 0.6)


def test_few_images_are_combined(
    endpoint: Start, boxes: Boxes, monkeypatch: pytest.MonkeyPatch, good: list[tuple[int, str]]
) -> None:
    server = endpoint(good)
    monkeypatch.setenv("MAM_SIM_VLM_IMAGES", "1")
    VlmReasoner().reason(*boxes, None)
    shown = _pictures(server.asked[0])
    assert len(shown) == 1
    data = np.frombuffer(base64.b64decode(shown[0]["image_url"]["url"].split(",")[1]), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert picture is not None and max(picture.shape) <= 2048


def test_questions_in_files(tmp_path: Path, boxes: Boxes, grouping: Plain, mounting: Plain) -> None:
    with pytest.raises(ConfigError, match="--questions"):
        FileReasoner().reason(*boxes, None)
    with settings.given({"MAM_SIM_QUESTIONS": str(tmp_path), settings.SUBJECT: "box"}):
        with pytest.raises(HintNeeded, match="answer the question in"):
            FileReasoner().reason(*boxes, None)
        first, second = tmp_path / "box" / "1_grouping", tmp_path / "box" / "2_tree"
        assert (first / "view_0.png").is_file() and (first / "apart.png").is_file()
        assert "0, 1, 2" in (first / "question.md").read_text()
        (first / "answer.json").write_text(json.dumps({"parts": grouping["parts"][:1]}))
        with pytest.raises(HintNeeded, match="1_grouping-2"):
            FileReasoner().reason(*boxes, None)
        again = tmp_path / "box" / "1_grouping-2"
        assert "pieces [1, 2] are in no part" in (again / "question.md").read_text()
        (again / "answer.json").write_text(json.dumps(grouping))
        with pytest.raises(HintNeeded, match="2_tree"):
            FileReasoner().reason(*boxes, None)
        (second / "answer.json").write_text(json.dumps(mounting))
        assert FileReasoner().reason(*boxes, None).nodes[1].subtype == "hinge"
        mesh, primitives = boxes
        other = Primitives(np.minimum(primitives.labels, 1))
        with pytest.raises(BackendError, match="about other pieces"):
            FileReasoner().reason(mesh, other, None)


def test_mountings_that_are_no_tree_are_named(mounting: Plain) -> None:
    row = mounting["mounts"][0]
    loop = questions.Mounting.model_validate(
        {"mounts": [{**row, "name": "a", "parent": "b"}, {**row, "name": "b", "parent": "a"}]}
    )
    assert "mounted on itself" in questions.faults_of_mounting(loop, ["base", "a", "b"], "base")
    stray = questions.Mounting.model_validate({"mounts": [{**row, "parent": "nowhere"}]})
    said = questions.faults_of_mounting(stray, ["base", "door", "lid"], "base")
    assert "no mounting for ['lid']" in said and "parents ['nowhere'] are no parts" in said
