"""Whole answers side by side: sets of disjoint candidates, and what a model sees of each set.

A candidate's own value cannot say whether a panel and its handle are two parts or one, or whether
one of four equal fronts was left out; that is a property of the set. So several sets are drawn up
and the one that ranks first is taken (by mIoU and count, design section 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.parts import solid
from mam_pipeline.parts.features import Table, table
from mam_pipeline.parts.graph import CONTACT, Graph
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.select import select_groups
from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class SetSearch:
    """How many sets of candidates are looked at.

    Attributes:
        further: worth of a further part, times the logarithm of their number.
        leaders: candidates that are tried alone with all that is like them.
        rivals: replacements tried for a chosen candidate.
        newcomers: candidates tried as an addition to a set.
        most: sets looked at.
        thresholds: expected overlaps above which candidates form a set.
        spread: the sets of these thresholds are varied.
    """

    further: float = 0.1
    leaders: int = 6
    rivals: int = 3
    newcomers: int = 6
    most: int = 90
    thresholds: tuple[float, ...] = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)
    spread: tuple[float, ...] = (0.3, 0.5, 0.7)


SETS = SetSearch()
MEASURED = (
    "area", "solid", "revolve", "members", "thin", "hanging", "held", "see", "low", "move",
    "move_low", "inner_low", "cut_high", "weakest", "proud", "free_best", "near_thin_more",
    "mobility", "affinity_cut", "travel_best", "has_lead", "size0",
)  # fmt: skip


@dataclass(frozen=True)
class Sets:
    """Sets of candidates: `member` (M, C) bool; every row is disjoint, none is empty."""

    member: Masks

    def rows(self) -> list[list[int]]:
        """The candidates of every set."""
        return [[int(c) for c in np.flatnonzero(row)] for row in self.member]


def enumerate_sets(masks: Masks, groups: Table, value: FloatArray) -> Sets:
    """Sets of several thresholds and their neighbours: one dropped, added, exchanged or joined.

    Args:
        masks: (C, P). groups: (C, .) their features. value: (C,) expected overlap with a true part.
    """
    count = len(masks)
    found: dict[bytes, Masks] = {}
    if count == 0:
        return Sets(np.zeros((0, 0), dtype=bool))
    clash = masks.astype(np.float32) @ masks.T.astype(np.float32) > 0

    def add(chosen: list[int]) -> None:
        row = np.zeros(count, dtype=bool)
        row[chosen] = True
        if chosen and len(found) < SETS.most:
            found.setdefault(np.packbits(row).tobytes(), row)

    seeds = {t: select_groups(masks, value, t) for t in {*SETS.thresholds, *SETS.spread}}
    for t in SETS.thresholds:
        add(seeds[t])
    best = int(np.argmax(value))
    add([best])
    like = _alike(groups, 0.15) & ~clash
    for c in np.argsort(-value, kind="stable")[: SETS.leaders]:
        add(_with_twins([int(c)], int(c), like, clash, value))
    order = np.argsort(-value, kind="stable")[: 4 * SETS.newcomers]
    for t in SETS.spread:
        chosen = seeds[t] or [best]
        for c in chosen:
            add(_with_twins(chosen, c, like, clash, value))
        for variant in _variants(masks, value, clash, chosen, order):
            add(variant)
    return Sets(np.array(list(found.values()), dtype=bool))


def promise(sets: Table) -> FloatArray:
    """(M,) what the candidates' own values promise of every set.

    The expected mIoU, as if the object had as many parts as the largest total of values, and a
    little more for every further part.

    Args:
        sets: all sets of one object, as `set_features` gives them.
    """
    number, total = (sets.column(n).astype(np.float64) for n in ("number", "value_sum"))
    parts = np.maximum(number, max(total.max(initial=0.0), 1.0))
    out: FloatArray = total / parts + SETS.further * np.log(number)
    return out


def _alike(groups: Table, tolerance: float) -> Masks:
    """(C, C) whether two candidates have the same extents."""
    extent = np.stack([groups.column(n) for n in ("size0", "size1", "size2")], axis=1)
    ratio = np.abs(np.log((extent[:, None] + 5e-3) / (extent[None] + 5e-3))).max(axis=2)
    out: Masks = ratio < tolerance
    np.fill_diagonal(out, False)
    return out


def _with_twins(
    chosen: list[int], c: int, like: Masks, clash: Masks, value: FloatArray
) -> list[int]:
    """A set with all that is like one of its candidates, best first, wherever nothing clashes."""
    out = list(chosen)
    twins = np.flatnonzero(like[c])
    for t in twins[np.argsort(-value[twins], kind="stable")]:
        if not clash[t, out].any():
            out.append(int(t))
    return out


def _variants(
    masks: Masks, value: FloatArray, clash: Masks, chosen: list[int], order: IntArray
) -> list[list[int]]:
    """The neighbours of one set."""
    out: list[list[int]] = []
    for c in chosen:
        rest = [k for k in chosen if k != c]
        out.append(rest)
        rivals = np.flatnonzero(clash[c] & (np.arange(len(masks)) != c))
        for r in rivals[np.argsort(-value[rivals], kind="stable")][: SETS.rivals]:
            out.append([k for k in chosen if not clash[k, r]] + [int(r)])
    for i, a in enumerate(chosen):
        for b in chosen[i + 1 :]:
            both = masks[a] | masks[b]
            over = np.flatnonzero((masks & both).sum(axis=1) == both.sum())
            if len(over):
                c = int(over[np.argmax(value[over])])
                out.append([k for k in chosen if not clash[k, c]] + [c])
    new = [int(c) for c in order if c not in chosen][: SETS.newcomers]
    out += [[k for k in chosen if not clash[k, c]] + [c] for c in new]
    return out


def set_features(
    graph: Graph, masks: Masks, groups: Table, value: FloatArray, odds: FloatArray, sets: Sets,
    same: FloatArray, move: FloatArray,
) -> Table:  # fmt: skip
    """(M, F) features of sets of candidates.

    Args:
        groups: (C, .) features of the candidates. value: (C,). odds: (C, 3) type probabilities.
        same: (E,), move: (P,) from the pair and primitive models.
    """
    k = sets.member
    number = k.sum(axis=1).astype(np.float64)
    sure = np.log(np.clip(value, 0.01, 0.99) / (1 - np.clip(value, 0.01, 0.99)))
    columns: dict[str, np.ndarray] = {
        "number": number, "single": number == 1, "value_sum": k @ value,
        "value_mean": k @ value / number, "gain50": k @ (value - 0.5), "gain70": k @ (value - 0.7),
        "sure_sum": k @ sure, "sure_mean": k @ sure / number,
        "value_low": np.where(k, value, 2.0).min(axis=1),
        "value_high": np.where(k, value, -1.0).max(axis=1),
    }  # fmt: skip
    for name in ("gain50", "gain70", "sure_sum", "value_mean"):
        columns[f"{name}_lag"] = columns[name].max(initial=-99.0) - columns[name]
    columns |= _left_over(graph, masks, groups, value, k, move)
    columns |= _between(graph, masks, groups, k, same)
    for name in MEASURED:
        column = np.nan_to_num(groups.column(name).astype(np.float64), nan=-1.0)
        columns[f"{name}_mean"] = k @ column / number
        columns[f"{name}_least"] = np.where(k, column, np.inf).min(axis=1)
        columns[f"{name}_most"] = np.where(k, column, -np.inf).max(axis=1)
    for n, name in enumerate(("hinge", "spin", "slide")):
        columns[f"{name}_share"] = k @ odds[:, n] / number
    columns["type_sure"] = k @ odds.max(axis=1) / number
    for name in ("object_n", "object_border", "object_tall", "object_largest"):
        columns[name] = np.full(len(k), groups.column(name)[0])
    columns["prior"] = np.isfinite(k @ groups.column("mobility").astype(np.float64))
    return table(columns)


def _left_over(
    graph: Graph, masks: Masks, groups: Table, value: FloatArray, k: Masks, move: FloatArray
) -> dict[str, np.ndarray]:
    """What a set leaves in the base: good candidates, twins of what it takes, mobile primitives."""
    taken = (k.astype(np.float32) @ masks.astype(np.float32)) > 0  # (M, P)
    free = ~((taken.astype(np.float32) @ masks.T.astype(np.float32)) > 0)  # (M, C)
    like = _alike(groups, 0.1)
    apart = masks.astype(np.float32) @ masks.T.astype(np.float32) == 0
    twin = (like & apart).astype(np.float32)
    has_twin = k.astype(np.float32) @ twin > 0  # (M, C) like some chosen one
    weight = np.sqrt(graph.area)
    rest = ~taken
    return {
        "free_high": np.where(free, value, 0.0).max(axis=1, initial=0.0),
        "free_strong": (free & (value > 0.5)).sum(axis=1),
        "twins_taken": (has_twin & k).sum(axis=1) / k.sum(axis=1),
        "twins_left": np.where(free & has_twin, value, 0.0).max(axis=1, initial=0.0),
        "twins_left_n": (free & has_twin & (value > 0.3)).sum(axis=1),
        "twins_left_faint": (free & has_twin & (value > 0.1)).sum(axis=1),
        "twins_value": np.where(has_twin & k, value, 1.0).min(axis=1, initial=1.0),
        "rest_move": (rest * weight) @ move / np.maximum(rest @ weight, 1e-9),
        "rest_most": np.where(rest, move, 0.0).max(axis=1, initial=0.0),
        "rest_most_area": (rest * graph.area * (move > 0.5)).sum(axis=1),
        "rest_n": rest.sum(axis=1), "rest_area": rest @ graph.area,
        "taken_still": np.where(taken, 1 - move, 0.0).max(axis=1, initial=0.0),
    }  # fmt: skip


def _between(
    graph: Graph, masks: Masks, groups: Table, k: Masks, same: FloatArray
) -> dict[str, np.ndarray]:
    """How the chosen parts of a set stand to each other: bonds, contact, one within another."""
    used = np.flatnonzero(k.any(axis=0))
    m, chosen = masks[used], k[:, used].astype(np.float32)
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    size = len(used)
    bond: FloatArray = np.zeros((size, size))
    close = graph.gap < CONTACT.touch
    shared = graph.touch[:, 0] * graph.area[i] + graph.touch[:, 1] * graph.area[j]
    a, b = m[:, i].astype(np.float32), m[:, j].astype(np.float32)
    one_way = (a * (shared * close)) @ b.T
    touch: FloatArray = one_way + one_way.T
    for r in range(size):
        across = np.maximum(a[r] * b, b[r] * a)  # pairs between r and every other
        bond[r] = (across * same).max(axis=1, initial=0.0)
    low = np.where(m[:, :, None], graph.low[None], np.inf).min(axis=1)
    high = np.where(m[:, :, None], graph.high[None], -np.inf).max(axis=1)
    margin = 0.01
    inside = np.all(low[:, None] > low[None] - margin, axis=2) & np.all(
        high[:, None] < high[None] + margin, axis=2
    )
    for matrix in (bond, touch, inside):
        np.fill_diagonal(matrix, 0)
    number = np.maximum(chosen.sum(axis=1), 1.0)
    area = groups.column("area")[used]
    smaller = np.minimum(area[:, None], area[None])
    held = touch / np.maximum(smaller, 1e-9)
    out: dict[str, np.ndarray] = {}
    for name, matrix in (("bond", bond), ("contact", held)):
        rows = np.array([
            matrix[np.ix_(c, c)].max() if len(c) > 1 else 0.0
            for c in (np.flatnonzero(row) for row in chosen)
        ])  # fmt: skip
        out[f"{name}_high"] = rows
        out[f"{name}_sum"] = np.einsum("ma,ab,mb->m", chosen, matrix, chosen) / number
    out["inside"] = np.einsum("ma,ab,mb->m", chosen, inside.astype(np.float32), chosen) / number
    out |= solid.between_columns(graph, m, chosen)
    spread = np.where(chosen > 0, area, np.nan)
    out["area_ratio"] = np.log(np.nanmax(spread, axis=1) / np.nanmin(spread, axis=1))
    return out
