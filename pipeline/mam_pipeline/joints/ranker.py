"""Scores of joint hypotheses by a learned model.

Each question is answered from the features of `joints.features`: which line, which slide; does the
part move; and if it does, does it slide (both from the part and the best hypotheses of each kind).
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError
from mam_pipeline.joints.features import LINE_NAMES, PART_NAMES, SLIDE_NAMES, Hypothesis
from mam_pipeline.types import FloatArray, UsualTravel
from mam_pipeline.weights import loaded

KINDS = ("fixed", "slide", "revolute")
WEIGHTS = "joints"
FILE = "ranker.json.xz"
_LEAST = (
    "free_30", "free_60", "free_90", "line_part", "line_static", "near_gap", "spin_match",
    "contact_mean", "contact_centred", "free_0", "free_2", "free_4", "contact_normal",
    "leaves_object", "static_max",
)  # fmt: skip
_MOST = (
    "other_30", "other_90", "handle_far", "along_share", "contact_near", "contact_span",
    "other_0", "other_2", "free_exposure", "free_front", "handle_along", "keep", "keep_other",
    "snug_more", "snug_less", "far_gap",
)  # fmt: skip


def model_rows(part: FloatArray, rows: FloatArray, names: Sequence[str]) -> FloatArray:
    """Rows (n, d') the rankers see: own features, those against the part's best, and the part.

    A line is not good by itself but better than the others of its part: what is least or most
    among all hypotheses is subtracted.
    """
    if not len(rows):
        return np.zeros((0, rows.shape[1] + len(part)))
    columns = [rows]
    for chosen, best in ((_LEAST, np.min), (_MOST, np.max)):
        index = [i for i, n in enumerate(names) if n in chosen]
        columns.append(rows[:, index] - best(rows[:, index], axis=0))
    columns.append(np.broadcast_to(part, (len(rows), len(part))))
    return np.concatenate(columns, axis=1)


def kind_features(part: FloatArray, hypotheses: Sequence[Hypothesis], lines: FloatArray,
                  slides: FloatArray) -> FloatArray:  # fmt: skip
    """One row: the part, the two best lines and slides by their scores (n,), and what the freest
    line and slide leave blocked."""
    row = [part]
    least = []
    for revolute, scores, names in ((True, lines, LINE_NAMES), (False, slides, SLIDE_NAMES)):
        rows = np.array([h.features for h in hypotheses if h.revolute == revolute])
        rows = rows.reshape(-1, len(names))
        order = np.argsort(-scores, kind="stable")[:2]
        for k in range(2):
            row.append(rows[order[k]] if k < len(order) else np.full(len(names), np.nan))
        top = np.sort(scores)[::-1]
        row.append(np.array([top[0] if len(top) else np.nan,
                             top[0] - top[1] if len(top) > 1 else np.nan]))  # fmt: skip
        half = 4 if revolute else 5  # columns that start with free_ and other_
        free, other = rows[:, :half].mean(axis=1), rows[:, half : 2 * half].mean(axis=1)
        least += [free.min(initial=1.0), (other - free).max(initial=-1.0)]
    least.append(min((float(h.features[_MATCH]) for h in hypotheses if h.revolute), default=1.0))
    return np.concatenate([*row, np.array(least)])


_MATCH = LINE_NAMES.index("spin_match")


class Bag:
    """Boosters trained on different draws of the same data; their mean is steadier than any."""

    def __init__(self, boosters: Sequence[Any]) -> None:
        self.boosters = tuple(boosters)

    def predict(self, rows: FloatArray, **options: Any) -> FloatArray:
        """Mean prediction (n,) for rows (n, d); options as of LightGBM's own `predict`."""
        found = [np.asarray(b.predict(rows, **options)) for b in self.boosters]
        return np.asarray(np.mean(found, axis=0))

    def num_feature(self) -> int:
        """How many columns the boosters were trained on."""
        return int(self.boosters[0].num_feature())


@dataclass(frozen=True)
class Model:
    """The learned bags of boosters and their temperatures.

    Besides the rankings: does the part move, does it slide if it moves, does the positive side open
    (`*_side`), how far from rest to open and back to closed (`*_open`, `*_back`), and does a
    revolute joint turn without end. The last may be None when the training data held too few cases.
    """

    line: Any
    slide: Any
    moves: Any
    slides: Any
    line_temperature: float
    slide_temperature: float
    moves_temperature: float
    slides_temperature: float
    line_side: Any
    slide_side: Any
    line_open: Any
    line_back: Any
    slide_open: Any
    slide_back: Any
    endless: Any


def learned(fused: bool = False) -> Model:
    """The trained model.

    Args:
        fused: the one for parts of fused meshes.

    Raises:
        ConfigError: the weights were made for other features than the code computes.
    """
    return loaded(WEIGHTS, _read_model, fused)


def _read_model(folder: Traversable, fused: bool) -> Model:
    return unpack(json.loads(lzma.decompress((folder / FILE).read_bytes())), fused)


def unpack(data: dict[str, Any], fused: bool = False) -> Model:
    """A model from plain data, as `train_ranker` packs it.

    Args:
        fused: with what `of_fused` sets, if it is there: which `share` of every bag is asked, its
            first ones, and their temperatures.

    Raises:
        ConfigError: the weights were made for other features than the code computes.
    """
    import lightgbm

    names = {"line_names": LINE_NAMES, "slide_names": SLIDE_NAMES, "part_names": PART_NAMES}
    for key, expected in names.items():
        if tuple(data.get(key, ())) != tuple(expected):
            raise ConfigError(
                f"the joint ranker's weights were made for other features ({key} differ); "
                "train again: python -m mam_training.joints.train configs/train/joints.yaml"
            )
    values: dict[str, Any] = {}
    own = data.get("of_fused", {}) if fused else {}
    for field in fields(Model):
        value = own.get(field.name, data[field.name])
        if isinstance(value, list):
            texts = value[: round(len(value) * own.get("share", 1.0))]
            value = Bag([lightgbm.Booster(model_str=text) for text in texts])
        values[field.name] = value
    return Model(**values)


@dataclass(frozen=True)
class Ranking:
    """Probabilities of one part's hypotheses.

    Attributes:
        kind: (3,) over KINDS. line: (n,) within lines. slide: (m,) within slides; each sums to 1.
        line_side, slide_side: (n,), (m,) +1 where a hypothesis's positive side opens, else -1.
    """

    kind: FloatArray
    line: FloatArray
    slide: FloatArray
    line_side: FloatArray
    slide_side: FloatArray


def without_slides(ranking: Ranking, blocked: NDArray[np.bool_]) -> Ranking:
    """The ranking when the slides of the mask (m,) are impossible: the rest share what they had."""
    slide = np.where(blocked, 0.0, ranking.slide)
    left = float(slide.sum())
    kind = ranking.kind * [left if name == "slide" else 1.0 for name in KINDS]
    return replace(
        ranking, kind=kind / max(float(kind.sum()), 1e-12), slide=slide / max(left, 1e-12)
    )


def softmax(scores: FloatArray, temperature: float = 1.0) -> FloatArray:
    """Probabilities (n,) from scores (n,)."""
    if not len(scores):
        return np.zeros(0)
    z = np.exp((scores - scores.max()) / temperature)
    return np.asarray(z / z.sum())


def rank(part: FloatArray, hypotheses: Sequence[Hypothesis], *, fused: bool = False) -> Ranking:
    """Rank one part's hypotheses with the learned model.

    Args:
        fused: by the boosters that know parts of fused meshes.
    """
    lines = np.array([h.features for h in hypotheses if h.revolute]).reshape(-1, len(LINE_NAMES))
    ways = np.array([h.features for h in hypotheses if not h.revolute])
    ways = ways.reshape(-1, len(SLIDE_NAMES))
    model = learned(fused)
    line_rows = model_rows(part, lines, LINE_NAMES)
    slide_rows = model_rows(part, ways, SLIDE_NAMES)
    a = model.line.predict(line_rows, num_threads=1) if len(lines) else np.zeros(0)
    b = model.slide.predict(slide_rows, num_threads=1) if len(ways) else np.zeros(0)
    row = kind_features(part, hypotheses, a, b)
    moves = _odds(model.moves, row, model.moves_temperature)
    slides = _odds(model.slides, row, model.slides_temperature)
    return Ranking(
        np.array([1.0 - moves, moves * slides, moves * (1.0 - slides)]),
        softmax(a, model.line_temperature),
        softmax(b, model.slide_temperature),
        _side(model.line_side, part, lines),
        _side(model.slide_side, part, ways),
    )


def agreed(views: Sequence[Sequence[Hypothesis]], rankings: Sequence[Ranking]) -> Ranking:
    """One ranking of what was measured in several samplings: geometric means, and most votes.

    Args:
        views: the same hypotheses in every sampling, in the same order. rankings: one of each.
    """

    def mean(rows: Sequence[FloatArray]) -> FloatArray:
        return softmax(np.mean([np.log(np.maximum(r, 1e-12)) for r in rows], axis=0))

    def side(sides: Sequence[FloatArray], revolute: bool) -> FloatArray:
        axes = [np.array([h.axis for h in v if h.revolute == revolute]).reshape(-1, 3)
                for v in views]  # fmt: skip
        votes = [s * np.sign((a * axes[0]).sum(axis=1)) for s, a in zip(sides, axes)]
        return np.where(np.mean(votes, axis=0) < 0, -1.0, 1.0)

    return Ranking(
        mean([r.kind for r in rankings]),
        mean([r.line for r in rankings]),
        mean([r.slide for r in rankings]),
        side([r.line_side for r in rankings], True),
        side([r.slide_side for r in rankings], False),
    )


def _odds(booster: Any, row: FloatArray, temperature: float) -> float:
    """Probability from a binary booster's margin at a temperature."""
    margin = float(booster.predict(row[None], raw_score=True, num_threads=1)[0])
    return float(1.0 / (1.0 + np.exp(-margin / temperature)))


def _side(booster: Any, part: FloatArray, rows: FloatArray) -> FloatArray:
    """+1 or -1 (n,): keep or turn the opening direction of each hypothesis."""
    if booster is None or not len(rows):
        return np.ones(len(rows))
    wide = np.concatenate([rows, np.broadcast_to(part, (len(rows), len(part)))], axis=1)
    return np.where(np.asarray(booster.predict(wide, num_threads=1)) >= 0.5, 1.0, -1.0)


def usual_travel(
    part: FloatArray, hypothesis: Hypothesis, fused: bool = False
) -> UsualTravel | None:
    """Typical travel of a joint, or None where the model knows none of its kind."""
    model = learned(fused)
    row = np.concatenate([hypothesis.features, part])[None]
    word = "line" if hypothesis.revolute else "slide"
    endless = model.endless if hypothesis.revolute else None
    boosters = (getattr(model, f"{word}_open"), getattr(model, f"{word}_back"), endless)
    if boosters[0] is None or boosters[1] is None:
        return None
    found = [0.0 if b is None else float(b.predict(row, num_threads=1)[0]) for b in boosters]
    return UsualTravel(found[0], max(found[1], 0.0), found[2])
