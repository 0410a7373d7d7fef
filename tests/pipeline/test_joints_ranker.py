"""The joint ranker: its weights fit its features, its odds add up, its input's triangles are not
what it goes by."""

from __future__ import annotations

import json
import lzma
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mam_pipeline.errors import ConfigError
from mam_pipeline.geometry.boxes import angle_between
from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.joints import ranker
from mam_pipeline.joints.candidates import kind_probabilities, rank_hypotheses
from mam_pipeline.joints.context import part_context
from mam_pipeline.joints.features import (
    LINE_NAMES,
    PART_NAMES,
    SLIDE_NAMES,
    enumerate_hypotheses,
    part_features,
    remeasured,
)
from mam_pipeline.joints.line_features import ANGLES
from mam_pipeline.joints.slide_features import STEPS
from mam_pipeline.joints.surroundings import SIBLING_NAMES
from mam_pipeline.types import IntArray, Mesh
from mam_pipeline.weights import place_of
from mam_training.joints.examples import make_examples, of_whole_primitives
from mam_training.parts.corpus import as_met


def drawers() -> tuple[Mesh, IntArray]:
    """A carcass with two like drawers, one above the other, that slide towards -X."""
    t, g = 0.018, 0.003
    boxes = [
        (0, (0, 0, 0), (0.45, t, 0.5)), (0, (0, 0.5 - t, 0), (0.45, 0.5, 0.5)),
        (0, (0, t, 0), (0.45, 0.5 - t, t)), (0, (0, t, 0.5 - t), (0.45, 0.5 - t, 0.5)),
        (0, (0.45 - t, t, t), (0.45, 0.5 - t, 0.5 - t)),
    ]  # fmt: skip
    for part, z in ((1, 0.02), (2, 0.26)):
        low, high = t + g, 0.5 - t - g
        boxes += [
            (part, (-0.02, 0, z), (-0.001, 0.5, z + 0.22)),
            (part, (-0.001, low, z + 0.02), (0.4, low + 0.012, z + 0.18)),
            (part, (-0.001, high - 0.012, z + 0.02), (0.4, high, z + 0.18)),
            (part, (-0.001, low, z + 0.02), (0.4, high, z + 0.03)),
            (part, (0.388, low, z + 0.03), (0.4, high, z + 0.18)),
            (part, (-0.05, 0.2, z + 0.1), (-0.02, 0.3, z + 0.115)),
        ]  # fmt: skip
    shapes = [trimesh.creation.box(bounds=[a, b]) for _, a, b in boxes]
    faces = [s.faces + 8 * i for i, s in enumerate(shapes)]
    mesh = Mesh(np.concatenate([s.vertices for s in shapes]), np.concatenate(faces))
    return mesh, np.repeat([p for p, _, _ in boxes], 12)


def faces(owner: IntArray, part: int) -> tuple[IntArray, IntArray]:
    return np.flatnonzero(owner == part), np.flatnonzero(owner != part)


def test_the_packaged_weights_fit_the_features() -> None:
    model = ranker.learned()  # raises where a feature was renamed without training again
    assert model is not None, "the package carries no weights; the rules would be used silently"
    for booster, names in ((model.line_side, LINE_NAMES), (model.slide_side, SLIDE_NAMES)):
        if booster is not None:
            assert booster.num_feature() == len(names) + len(PART_NAMES)
    row = ranker.model_rows(np.zeros(len(PART_NAMES)), np.zeros((1, len(LINE_NAMES))), LINE_NAMES)
    assert model.line.num_feature() == row.shape[1]


def test_a_renamed_feature_is_an_error() -> None:
    file = place_of(ranker.WEIGHTS) / ranker.FILE
    data = json.loads(lzma.decompress(file.read_bytes()))
    data["line_names"][3] = "renamed"
    with pytest.raises(ConfigError, match="other features"):
        ranker.unpack(data)


def test_parts_of_fused_meshes_ask_the_boosters_that_know_them() -> None:
    file = place_of(ranker.WEIGHTS) / ranker.FILE
    data = json.loads(lzma.decompress(file.read_bytes()))
    every, few = ranker.learned(), ranker.learned(fused=True)
    assert every is not None and few is not None
    for bag in ("line", "line_open"):
        asked, there = getattr(few, bag).boosters, getattr(every, bag).boosters
        assert len(asked) == round(data["of_fused"]["share"] * len(data[bag]))
        assert 0 < len(asked) < len(there) == len(data[bag])
    assert few.line_temperature == data["of_fused"]["line_temperature"] != every.line_temperature
    row = np.random.default_rng(0).normal(size=(1, few.line.num_feature()))
    each = [b.predict(row)[0] for b in few.line.boosters]
    assert few.line.predict(row)[0] == pytest.approx(np.mean(each))
    del data["of_fused"]
    assert len(ranker.unpack(data, fused=True).line.boosters) == len(data["line"])


def test_names_used_by_the_model_exist() -> None:
    known = {*LINE_NAMES, *SLIDE_NAMES}
    assert {*ranker._LEAST, *ranker._MOST} <= known
    assert len(set(PART_NAMES)) == len(PART_NAMES)


def test_many_sweeps_at_once_are_the_same_as_one_by_one() -> None:
    mesh, owner = drawers()
    scene = SweepScene(mesh, *faces(owner, 1), samples=80, static_samples=120)
    axes = np.array([[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]])
    origins = np.array([[-0.01, 0, 0], [-0.01, 0, 0.02], [0, 0.2, 0.1]])
    turned = scene.blocked_many("revolute", axes, origins, ANGLES)
    steps = np.outer([0.3, 0.5, 0.45], STEPS)
    slid = scene.blocked_many("prismatic", axes, origins, steps)
    for i in range(3):
        one = scene.sweep("revolute", axes[i], origins[i], ANGLES).blocked
        assert turned[i] == pytest.approx(one, abs=1e-6)
        one = scene.sweep("prismatic", axes[i], origins[i], steps[i]).blocked
        assert slid[i] == pytest.approx(one, abs=1e-6)


def test_features_are_complete_and_siblings_are_seen() -> None:
    mesh, owner = drawers()
    frame = estimate_frame(mesh)
    alone = part_context(mesh, *faces(owner, 1), frame)
    context = part_context(mesh, *faces(owner, 1), frame, others=[np.flatnonzero(owner == 2)])
    row = dict(zip(PART_NAMES, part_features(context)))
    assert len(row) == len(PART_NAMES) and np.isfinite(list(row.values())).all()
    assert row["alike"] == 1 and row["above_alike"] == 1 and row["beside_alike"] == 0
    without = dict(zip(PART_NAMES, part_features(alone)))
    assert all(np.isnan(without[n]) for n in SIBLING_NAMES)
    for h in enumerate_hypotheses(context):
        assert len(h.features) == len(LINE_NAMES if h.revolute else SLIDE_NAMES)
        assert np.isfinite(h.features).all()


def test_odds_of_a_drawer() -> None:
    mesh, owner = drawers()
    found = rank_hypotheses(mesh, *faces(owner, 1), others=[np.flatnonzero(owner == 2)])
    odds = kind_probabilities(found)
    assert sum(odds.values()) == pytest.approx(1.0, abs=1e-6)
    assert max(odds, key=lambda k: odds[k]) == "slide" and odds["slide"] > 0.5
    best = next(c for c in found if c.subtype == "slide")
    assert angle_between(best.axis, np.array([1.0, 0, 0])) < 0.02


def test_another_sampling_sees_the_same_hypotheses() -> None:
    mesh, owner = drawers()
    frame = estimate_frame(mesh)
    contexts = [part_context(mesh, *faces(owner, 1), frame, seed=k) for k in (0, 1)]
    first = enumerate_hypotheses(contexts[0])
    assert [h.axis.tolist() for h in remeasured(contexts[0], first)] == [
        h.axis.tolist() for h in first
    ]
    again = remeasured(contexts[1], first)
    assert [h.revolute for h in again] == [h.revolute for h in first]
    assert all(abs(float(a.axis @ b.axis)) > 1 - 1e-9 for a, b in zip(first, again))
    assert any((a.features != b.features).any() for a, b in zip(first, again))


def test_samplings_agree_on_odds_and_vote_on_the_sense() -> None:
    mesh, owner = drawers()
    context = part_context(mesh, *faces(owner, 1), estimate_frame(mesh))
    here = enumerate_hypotheses(context)
    turned = [replace(h, axis=-h.axis) for h in here]
    one = ranker.rank(part_features(context), here)
    same = ranker.agreed([here, here], [one, one])
    assert same.kind == pytest.approx(one.kind, abs=1e-6)
    assert same.line == pytest.approx(one.line, abs=1e-6)
    against = replace(one, slide_side=-one.slide_side)  # the same sense, as its axes are turned
    assert (ranker.agreed([here, turned], [one, against]).slide_side == one.slide_side).all()
    sure = replace(one, kind=np.array([0.0, 0.9, 0.1]))
    unsure = replace(one, kind=np.array([0.0, 0.5, 0.5]))
    assert ranker.agreed([here, here], [sure, unsure]).kind[1] == pytest.approx(0.75, abs=0.01)


@pytest.mark.slow
def test_fused_examples_are_parts_of_whole_primitives() -> None:
    truth, primitives = as_met("nightstand", 200_001, fused=True)
    whole = of_whole_primitives(truth, primitives.labels)
    cut = [len(np.unique(t.face_link[primitives.labels == k])) for t in (truth, whole)
           for k in range(primitives.count)]  # fmt: skip
    assert max(cut[: primitives.count]) > 1, "no primitive spans two links: nothing is shown"
    assert set(cut[primitives.count :]) == {1}
    found = make_examples("nightstand", 200_001, fused=True)
    assert found and all(e.fused and e.name == "nightstand_200001_f" for e in found)
    assert max(e.grade.max() for e in found if e.variant == "true") == 2


@pytest.mark.parametrize("change", ["cut", "doubled", "unshared"])
def test_the_answer_does_not_hang_on_the_triangles(change: str) -> None:
    mesh, owner = drawers()
    before = rank_hypotheses(mesh, *faces(owner, 2))[0]
    if change == "doubled":
        other = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))
        label = np.concatenate([owner, owner])
    elif change == "unshared":
        corners = mesh.vertices[mesh.faces].reshape(-1, 3)
        other = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
        label = owner
    else:
        v, f = trimesh.remesh.subdivide(mesh.vertices, mesh.faces)
        other, label = Mesh(v, f), np.repeat(owner, 4)
        if not np.array_equal(label, np.tile(owner, 4)):  # find the order the library uses
            centre = v[f].mean(axis=1)
            near = np.linalg.norm(centre[:, None] - mesh.vertices[mesh.faces].mean(1)[None], axis=2)
            label = owner[near.argmin(axis=1)]
    after = rank_hypotheses(other, *faces(label, 2))[0]
    assert before.subtype == after.subtype == "slide"
    assert angle_between(before.axis, after.axis) < np.deg2rad(2)
