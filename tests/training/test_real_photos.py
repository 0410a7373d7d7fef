"""Real photos that were marked by eye, as lessons of the networks that look at photos."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.models.photo_reader import PhotoReading, faults
from mam_pipeline.photo.camera import FACES
from mam_pipeline.photo.front_network import KINDS
from mam_training.photo import real_photos as real
from mam_world.photos.truth import PanelTruth

ROOT = Path(__file__).resolve().parents[2]
LABELS = ROOT / "labels" / "photos.jsonl"
FRONT = ((0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75))


def marks() -> list[real.MarkedPhoto]:
    return [
        real.MarkedPhoto.load(json.loads(line)) for line in LABELS.read_text("utf-8").splitlines()
    ]


def answers(path: Path) -> dict[str, PhotoReading]:
    with zipfile.ZipFile(path) as kept:
        names = [n for n in kept.namelist() if n.endswith("answer.json")]
        return {n.split("/")[0]: PhotoReading.model_validate_json(kept.read(n)) for n in names}


def test_the_marks_are_those_of_the_answers_and_no_photo_of_the_readme_is_among_them() -> None:
    found, said = marks(), answers(ROOT / "labels" / "answers" / "photos.zip")
    shown = answers(ROOT / "tests" / "pipeline" / "answers_photos.zip")
    assert not {mark.id for mark in found} & set(shown)
    assert not set(said) & set(shown)
    for mark in found:
        answer = said[mark.id]
        assert not faults(answer) and not answer.opened
        if mark.whole:
            assert answer.in_scope
            assert np.allclose(np.array(mark.front) * 1000, np.array(answer.front), atol=0.1)
        else:
            assert mark.by == real.BY_BOXES and mark.panels
    assert sum(mark.whole for mark in found) > 50


def test_boxes_that_fill_a_rectangle_are_a_front_and_their_handles_tell_what_they_are() -> None:
    def box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
        return real.corners_of((x0, y0, x1, y1)) / 1000

    boxes = {
        "cabinet door or drawer": [
            box(100, 100, 400, 240), box(100, 245, 250, 600), box(255, 245, 400, 600),
            box(700, 700, 760, 760),  # alone
        ],
        "handle": [box(210, 160, 290, 175), box(225, 400, 235, 450)],
    }  # fmt: skip
    ((rect, panels),) = real.fronts_of(boxes, (1000, 1000))
    assert rect == pytest.approx((100, 100, 400, 600))
    assert [(p.kind, p.hinge_side) for p in panels] == [
        ("drawer", None), ("door", "left"), ("panel", None),
    ]  # fmt: skip
    assert panels[0].rect == pytest.approx((0, 0, 1, 0.28))
    assert [len(p.handles) for p in panels] == [1, 1, 0]


def test_of_a_real_photo_only_the_corners_of_the_front_are_known() -> None:
    training = pytest.importorskip("mam_training.photo.train_box")
    torch = pytest.importorskip("torch")
    mark = real.MarkedPhoto("a", "", "x", FRONT, None)
    picture = np.full((400, 400, 3), 128, np.uint8)
    photo = real.photo_lesson(mark, picture, np.random.default_rng(0))
    front = list(FACES["front"])
    assert np.isfinite(photo.corners[front]).all()
    assert np.isnan(np.delete(photo.corners, front, axis=0)).all()
    inside = photo.corners[front].mean(axis=0).astype(int)
    assert photo.seen[inside[1], inside[0]] == 1

    lesson = training.lesson_of(photo, np.random.default_rng(1))
    h, w = lesson.seen.shape
    maps = torch.zeros(1, sum(training.MAPS.values()), h, w, requires_grad=True)
    truth = [torch.from_numpy(a)[None] for a in lesson[1:]]
    losses = training.loss_of(maps, *truth)
    sum(losses.values()).backward()
    assert torch.isfinite(maps.grad).all()
    unknown = torch.from_numpy(lesson.seen == training.UNKNOWN)
    assert unknown.any() and not maps.grad[0][:, unknown].any(), "it says nothing there"
    hidden = sorted(set(range(8)) - set(front))
    spread = maps.grad[0, -8:]
    assert spread[front].any() and not spread[hidden].any()


def test_what_nobody_says_of_a_front_is_not_learned() -> None:
    training = pytest.importorskip("mam_training.photo.train_front")
    torch = pytest.importorskip("torch")
    panels = (
        PanelTruth("drawer", (0, 0, 1, 0.3), None, ((0.4, 0.1, 0.6, 0.15),)),
        PanelTruth("panel", (0, 0.3, 0.5, 1.0)),
        PanelTruth("door", (0.5, 0.3, 1.0, 1.0)),
    )
    mark = real.MarkedPhoto("a", "", "x", FRONT, panels)
    picture = np.random.default_rng(0).integers(0, 255, (400, 400, 3)).astype(np.uint8)
    front = real.front_lesson(mark, picture)
    lessons = (training.lesson_of(front, np.random.default_rng(k), whole=False) for k in range(40))
    lesson = next(one for one in lessons if (one.kind == training.UNKNOWN).mean() > 0.05)
    kinds = set(np.unique(lesson.kind)) - {KINDS.index("none")}  # at the front's rim
    assert kinds == {training.UNKNOWN, KINDS.index("drawer"), *training.SOME.values()}
    assert not (lesson.handle == training.UNMARKED).any() and (lesson.handle > 0).any()

    h, w = lesson.kind.shape
    maps = torch.randn(1, sum(training.MAPS.values()), h, w, requires_grad=True)
    truth = [torch.from_numpy(a)[None] for a in lesson[1:]]
    losses = training.loss_of(maps, *truth)
    sum(losses.values()).backward()
    around = torch.from_numpy(lesson.kind == training.UNKNOWN)
    assert not maps.grad[0][:, around].any()


def test_a_front_on_which_nobody_marked_a_handle_may_have_some() -> None:
    training = pytest.importorskip("mam_training.photo.train_front")
    torch = pytest.importorskip("torch")
    mark = real.MarkedPhoto("a", "", "x", FRONT, (PanelTruth("door", (0, 0, 1, 1)),))
    front = real.front_lesson(mark, np.full((400, 400, 3), 128, np.uint8))
    lesson = training.lesson_of(front, np.random.default_rng(0), whole=False)
    unmarked = torch.from_numpy(lesson.handle == training.UNMARKED)
    assert unmarked.float().mean() > 0.5
    maps = torch.randn(1, sum(training.MAPS.values()), *unmarked.shape, requires_grad=True)
    truth = [torch.from_numpy(a)[None] for a in lesson[1:]]
    sum(training.loss_of(maps, *truth).values()).backward()
    assert not maps.grad[0, 2][unmarked].any()


def test_where_the_kind_is_known_its_loss_is_the_cross_entropy() -> None:
    training = pytest.importorskip("mam_training.photo.train_front")
    torch = pytest.importorskip("torch")
    kinds = torch.randn(2, len(KINDS), 5, 7)
    kind = torch.randint(0, len(KINDS), (2, 5, 7))
    exact = torch.nn.functional.cross_entropy(kinds, kind)
    assert torch.isclose(training._kind_loss(kinds, kind), exact, atol=1e-5)
    some = torch.full_like(kind, training.SOME["panel"])
    share = torch.softmax(kinds, dim=1)[:, 1:].sum(dim=1)
    assert torch.isclose(training._kind_loss(kinds, some), -share.log().mean(), atol=1e-5)


def test_training_goes_on_from_the_weights_of_a_commit() -> None:
    model = pytest.importorskip("mam_training.photo.network_model")
    from mam_pipeline.photo.front_network import WEIGHTS

    state = model.weights_at("HEAD", WEIGHTS)
    with np.load(WEIGHTS) as kept:
        assert set(state) == set(kept.files)
