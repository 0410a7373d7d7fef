"""The training of the model that ranks sets of candidates."""

from pathlib import Path

import lightgbm
import numpy as np
import pytest

from mam_pipeline.parts.features import table
from mam_training.curricula.blocks import of_blocks
from mam_training.curricula.loosening import loosened
from mam_training.parts.corpus import BLOCKS, FUSED, LOOSE, generated, generated_example
from mam_training.parts.recipe import FOLDS, HOUSEHOLD, fold_of, gather, jobs
from mam_training.parts.train import LEVELS, RANKS, Options, fit_choice, lean
from mam_training.parts.views import Rows
from mam_world.object import generator
from mam_world.registry import CATEGORIES
from mam_world.splits import split_of


def options(rng: np.random.Generator, fold: int) -> Options:
    """One object whose sets differ by `sign`; how hard it is hardly shows, and drowns that."""
    count = int(rng.integers(2, 9))
    sign, hard = rng.uniform(0, 1, count), rng.uniform(0, 0.8)
    result = np.stack([1 - hard - 0.2 * (1 - sign), np.ones(count)], axis=1)
    columns = {"sign": sign, "number": rng.uniform(0, 1, count)}
    return Options(fold, 2, table(columns), result, (0.0, 0.0))


def share_right(model, rng: np.random.Generator) -> float:
    """How often the best set of a new object comes first."""
    items = [options(rng, 0) for _ in range(60)]
    return float(np.mean([
        np.argmax(model.predict(item.features.values)) == np.argmax(item.result[:, 0])
        for item in items
    ]))  # fmt: skip


def test_sets_are_ranked_within_their_object() -> None:
    """The best set of new objects comes first, however hard they are."""
    rng = np.random.default_rng(0)
    (model,) = fit_choice([options(rng, k % FOLDS) for k in range(240)], 1)
    assert share_right(model, rng) > 0.8


def test_a_fold_is_left_out_with_its_objects() -> None:
    """One fold teaches the reverse: right is a model without it, wrong one of that fold alone."""
    rng = np.random.default_rng(1)
    rows, wrong = Rows.empty(), Rows.empty()
    for k in range(240):
        item = options(rng, k % FOLDS)
        grade, weight = np.round(item.result[:, 0] * LEVELS), np.ones(len(item.result))
        if item.fold == 0:
            grade = LEVELS - grade
            wrong.add(item.features, grade, weight, item.fold)
        rows.add(item.features, grade, weight, item.fold)
    assert share_right(rows.fit(100, 0, **RANKS), rng) > 0.8
    assert share_right(wrong.fit(100, **RANKS), rng) < 0.2


def test_more_objects_of_homes_are_new_ones_of_the_split() -> None:
    plain, more = jobs("train", 400, 0, 0), jobs("train", 400, 0, 0, household=200)
    extra = more[400:]
    assert more[:400] == plain and len(set(more)) == 600
    assert {kind for kind, _, _ in extra} <= HOUSEHOLD <= set(CATEGORIES)
    assert {split_of(kind, seed) for kind, seed, _ in extra} == {"train"}


def test_what_is_packed_predicts_the_same_in_half_the_room() -> None:
    rng = np.random.default_rng(4)
    (model,) = fit_choice([options(rng, k % FOLDS) for k in range(240)], 1)
    text = model.model_to_string()
    packed = lean(text)
    rows = rng.uniform(0, 1, (200, 2))
    assert len(packed) < 0.7 * len(text)
    again = lightgbm.Booster(model_str=packed)
    np.testing.assert_array_equal(again.predict(rows), model.predict(rows))


def test_loose_objects_keep_links_and_types_but_not_their_clearances() -> None:
    """Pieces of different links run into each other more often than in the exact objects."""
    crossing = {False: 0, True: 0}
    for seed in range(12):
        made = generated("chest_of_drawers", seed, solids=False)
        loose = loosened(made, np.random.default_rng(seed))
        assert set(loose.soup.face_link) == set(made.soup.face_link)
        assert loose.articulation.links == made.articulation.links
        assert len(loose.soup.faces) <= len(made.soup.faces)
        assert np.isfinite(loose.soup.vertices).all()
        assert loose.soup.vertices[:, 2].min() == 0
        crossing[False] += crossings(made.soup)
        crossing[True] += crossings(loose.soup)
    assert crossing[True] > crossing[False]


def test_no_link_of_a_loose_object_loses_its_one_solid() -> None:
    for kind, seed in (("safe", 803), ("fridge", 725), ("toilet", 736), ("door_double", 47)):
        made = generated(kind, seed)
        loose = loosened(made, generator(kind, seed, stream=6))
        assert set(loose.soup.face_link) == set(made.soup.face_link)


def test_the_joints_of_loose_objects_go_with_their_links() -> None:
    """Hinges stay at their leaves, nearer than those of the exact object would be."""
    far: dict[bool, list[float]] = {False: [], True: []}
    for seed in range(12):
        made = generated("cabinet_two_door", seed, solids=False)
        loose = loosened(made, np.random.default_rng(seed))
        for kept, joint in zip(made.articulation.joints, loose.articulation.joints):
            assert (joint.type, joint.child) == (kept.type, kept.child)
            assert np.linalg.norm(joint.axis) == pytest.approx(1.0)
            if kept.subtype == "hinge":
                faces = loose.soup.faces[loose.soup.face_link == kept.child]
                points = loose.soup.vertices[np.unique(faces)]
                diagonal = np.linalg.norm(np.ptp(loose.soup.vertices, axis=0))
                for moved, j in ((True, joint), (False, kept)):
                    gap = np.linalg.norm(np.cross(points - j.origin, j.axis), axis=1).min()
                    far[moved].append(float(gap / diagonal))
    assert len(far[True]) >= 12 and np.mean(far[True]) < 0.02 < np.mean(far[False])


def crossings(soup) -> int:
    """Pairs of pieces of different links whose boxes share more than a millimetre every way."""
    spans = []
    for piece, link in enumerate(soup.piece_link):
        points = soup.vertices[soup.faces[soup.face_piece == piece]].reshape(-1, 3)
        if len(points):
            spans.append((link, points.min(axis=0), points.max(axis=0)))
    return sum(
        bool(a[0] != b[0] and (np.minimum(a[2], b[2]) - np.maximum(a[1], b[1]) > 1e-3).all())
        for k, a in enumerate(spans) for b in spans[:k]
    )  # fmt: skip


def test_a_share_of_the_examples_is_modelled_loosely(tmp_path: Path) -> None:
    wanted = [("nightstand", seed, False) for seed in range(10)] + [("nightstand", 200_000, True)]
    found = gather(wanted, tmp_path, 0.5)
    assert len(found) == len(wanted)
    assert 0 < sum(p.stem.endswith(LOOSE) for p in found) < 10
    assert found[-1].stem.endswith(FUSED)
    loose = next(p for p in found if p.stem.endswith(LOOSE))
    seed = int(loose.stem.removesuffix(LOOSE).rsplit("_", 1)[1])
    exact, slack = (generated_example("nightstand", seed, loose=s) for s in (False, True))
    assert exact.subtype.tolist() == slack.subtype.tolist()
    assert exact.graph.gap.tolist() != slack.graph.gap.tolist()


def spans(soup) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The box around every piece that has faces."""
    out = {}
    for piece in np.unique(soup.face_piece):
        points = soup.vertices[soup.faces[soup.face_piece == piece]].reshape(-1, 3)
        out[int(piece)] = points.min(axis=0), points.max(axis=0)
    return out


def test_objects_of_blocks_keep_links_joints_and_what_their_pieces_span() -> None:
    replaced = 0
    for seed in range(8):
        made = generated("chest_of_drawers", seed, solids=False)
        blocks = of_blocks(made, np.random.default_rng(seed))
        assert blocks.articulation.joints == made.articulation.joints
        assert set(blocks.soup.face_link) == set(made.soup.face_link)
        before, after = spans(made.soup), spans(blocks.soup)
        whole = len(after) < len(before)  # links of one block each have fewer pieces
        for piece in set(after) if not whole else ():
            size = np.ptp(before[piece], axis=0)
            off = np.abs(np.subtract(before[piece], after[piece])).max(axis=0)
            assert (off <= 0.07 * size.max() + 2e-4).all()  # round ones are made quite round
        replaced += len(blocks.soup.faces) != len(made.soup.faces)
    assert replaced > 4


def test_what_stands_open_becomes_blocks_square_to_itself() -> None:
    """Handles of doors that stand open become boxes along the door, not along the object."""
    checked = 0
    for seed in range(160):
        made = generated("abstract_machine", seed, solids=False)
        soup = of_blocks(made, np.random.default_rng(seed)).soup
        for piece in np.unique(soup.face_piece):
            pose = soup.link_poses[soup.piece_link[piece]]
            turned = np.abs(pose[:3, :3] - np.eye(3)).max() > 0.2
            if turned and soup.piece_is_box[piece] and not made.soup.piece_is_box[piece]:
                points = soup.vertices[soup.faces[soup.face_piece == piece]].reshape(-1, 3)
                local = (points - pose[:3, 3]) @ pose[:3, :3]
                ends = np.minimum(local - local.min(axis=0), local.max(axis=0) - local)
                assert ends.max() < 1e-6
                checked += 1
    assert checked > 5


def test_a_link_of_one_block_is_drawn_once() -> None:
    single = 0
    for seed in range(12):
        made = generated("abstract_machine", seed, solids=False)
        for draw in range(4):
            soup = of_blocks(made, np.random.default_rng(draw)).soup
            for link in range(1, len(soup.link_poses)):
                many = len(np.unique(made.soup.face_piece[made.soup.face_link == link]))
                if many > 1 and len(np.unique(soup.face_piece[soup.face_link == link])) == 1:
                    assert (soup.face_link == link).sum() == 12
                    single += 1
    assert single > 5


def test_wheels_of_blocks_stay_round_and_hollow_bodies_hollow() -> None:
    discs = 0
    for seed in range(12):
        made = generated("abstract_rolling", seed, solids=False)
        soup = of_blocks(made, np.random.default_rng(seed)).soup
        for piece in np.unique(soup.face_piece):
            changed = (soup.face_piece == piece).sum() != (made.soup.face_piece == piece).sum()
            discs += bool(changed and not soup.piece_is_box[piece])
    assert discs > 5
    made = generated("safe", 0)  # its base is one shell
    rng = np.random.default_rng(1)
    shell = np.bincount(made.soup.face_piece[made.soup.face_link == 0]).argmax()
    before = int((made.soup.face_piece == shell).sum())
    assert before > 12
    assert all(
        int((of_blocks(made, rng).soup.face_piece == shell).sum()) == before for _ in range(5)
    )


def test_a_share_of_the_examples_is_built_of_blocks(tmp_path: Path) -> None:
    wanted = [("nightstand", seed, False) for seed in range(10)] + [("nightstand", 200_000, True)]
    found = gather(wanted, tmp_path, 0.5, 0.5)
    manners = {p.stem.split("_", 2)[2] for p in found[:-1] if p.stem.count("_") > 1}
    assert len(found) == len(wanted) and found[-1].stem.endswith(FUSED)
    assert 0 < sum(BLOCKS in p.stem for p in found) < 10
    assert manners <= {"b", "l", "b_l"} and len(manners) > 1
    assert len({fold_of(p.stem) for p in found[:-1]}) == 1
