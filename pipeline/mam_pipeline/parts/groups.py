"""Candidate parts: groups of primitives that may be one rigid body, from several merge trees."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph
from mam_pipeline.types import FloatArray, IntArray

Masks = NDArray[np.bool_]


@dataclass(frozen=True)
class GroupSearch:
    """How many candidate parts are looked at, and what belongs to a front; shares of the front's
    extent unless said otherwise.

    Attributes:
        limit: candidates that are looked at closely.
        best: best candidates that are varied.
        steps: primitives tried on each of these.
        fresh: new candidates in all.
        beside: how far the box behind a front may reach beside it.
        fills: share of the front that this box fills at least.
        behind: diagonals between the front and this box, at most.
        small: up to this many primitives every connected group is tried.
    """

    limit: int = 150
    best: int = 12
    steps: int = 4
    fresh: int = 90
    beside: float = 0.2
    fills: float = 0.5
    behind: float = 0.1
    small: int = 8


SEARCH = GroupSearch()


def enumerate_groups(graph: Graph, same: FloatArray, move: FloatArray) -> Masks:
    """(C, P) distinct candidate groups.

    Args:
        same: (E,) probability that a pair is one rigid body. move: (P,) that a primitive moves.
    """
    count = graph.count
    found: dict[bytes, NDArray[np.bool_]] = {}

    def add(mask: NDArray[np.bool_]) -> None:
        mask, fronts = with_rigid(graph, mask)
        size = int(mask.sum())
        if fronts < 2 and (0 < size < count or size == count == 1):
            found.setdefault(np.packbits(mask).tobytes(), mask)

    for k in range(count):
        add(np.arange(count) == k)
    for power in (0.0, 1.0):
        both = np.minimum(move[graph.pairs[:, 0]], move[graph.pairs[:, 1]])
        for mask in merge_tree(graph, same * both**power):
            add(mask)
    for alive, bond in itertools.product((0.1, 0.3, 0.5), (0.2, 0.4, 0.6, 0.8)):
        for mask in components(graph, (same > bond), move > alive):
            add(mask)
    for mask in segmenter_groups(graph):
        add(mask)
    if count <= SEARCH.small:
        for mask in _connected(graph):
            add(mask)
    masks: Masks = np.array(list(found.values()), dtype=bool).reshape(-1, count)
    if len(masks) > SEARCH.limit:
        keep = np.argsort(-plausibility(graph, masks, same, move), kind="stable")[: SEARCH.limit]
        masks = masks[np.sort(keep)]
    return masks


def expand_groups(graph: Graph, masks: Masks, value: FloatArray, same: FloatArray) -> Masks:
    """(D, P) new groups beside the best ones: one primitive more, one fewer, or two groups joined.

    Args:
        masks: (C, P). value: (C,) what a first answer says of them. same: (E,) as above.
    """
    known = {np.packbits(m).tobytes() for m in masks}
    fresh: dict[bytes, NDArray[np.bool_]] = {}

    def add(mask: NDArray[np.bool_]) -> None:
        mask, fronts = with_rigid(graph, mask)
        key = np.packbits(mask).tobytes()
        if fronts < 2 and key not in known and 0 < mask.sum() < graph.count:
            fresh.setdefault(key, mask)

    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    best = [int(c) for c in np.argsort(-value, kind="stable")[: SEARCH.best]]
    for rank, c in enumerate(best):
        mask = masks[c]
        bond = np.zeros(graph.count)
        np.maximum.at(bond, i, np.where(mask[j], same, 0.0))
        np.maximum.at(bond, j, np.where(mask[i], same, 0.0))
        outside = np.where(mask, -1.0, bond)
        for p in np.argsort(-outside, kind="stable")[: SEARCH.steps]:
            if outside[p] > 0.05:
                add(mask | (np.arange(graph.count) == p))
        if mask.sum() > 1:
            inside = np.where(mask, bond, 2.0)
            for p in np.argsort(inside, kind="stable")[: min(SEARCH.steps, int(mask.sum()))]:
                add(mask & (np.arange(graph.count) != p))
        for d in best[:rank]:
            across = (mask[i] & masks[d][j]) | (mask[j] & masks[d][i])
            if not (mask & masks[d]).any() and (across * same).max(initial=0.0) > 0.15:
                add(mask | masks[d])
    new = list(fresh.values())[: SEARCH.fresh]
    return np.array(new, dtype=bool).reshape(-1, graph.count)


def with_rigid(graph: Graph, mask: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
    """The group (P,) with what moves with any of its primitives as one body, and how many fronts
    it has: two flats with a handle each are two. The box behind a front is its own.
    """
    if graph.rigid is None or graph.fronts is None:
        return mask, 0
    has = np.array((graph.rigid & mask).any(axis=1), dtype=bool)
    if not has[graph.fronts].any() and mask.any():
        low, high = graph.low[mask].min(axis=0), graph.high[mask].max(axis=0)
        boxed = np.array([_boxed(graph, body, low, high) for body in graph.rigid], dtype=bool)
        boxed &= graph.fronts
        has |= boxed & (boxed.sum() == 1)
    return mask | graph.rigid[has].any(axis=0), int(has[graph.fronts].sum())


def _boxed(graph: Graph, body: NDArray[np.bool_], low: FloatArray, high: FloatArray) -> bool:
    """Whether a box (corners) fills the space close before or behind a front, along x or y."""
    front = int(np.argmax(body * graph.area))
    thin = int(np.argmin(graph.high[front, :2] - graph.low[front, :2]))
    across = [1 - thin, 2]
    start, end = graph.low[front, across], graph.high[front, across]
    span = end - start
    inside = (low[across] > start - SEARCH.beside * span) & (
        high[across] < end + SEARCH.beside * span
    )
    if not inside.all() or (high[across] - low[across] < SEARCH.fills * span).any():
        return False
    gap = max(low[thin] - graph.high[front, thin], graph.low[front, thin] - high[thin])
    deep = high[thin] - low[thin] > graph.high[front, thin] - graph.low[front, thin]
    return bool(deep and -SEARCH.behind < gap < SEARCH.behind)


def plausibility(graph: Graph, masks: Masks, same: FloatArray, move: FloatArray) -> FloatArray:
    """(C,) mean log-likelihood of a group's inner and cut pairs and of its members moving."""
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    inner = (masks[:, i] & masks[:, j]).astype(np.float64)
    cut = (masks[:, i] ^ masks[:, j]).astype(np.float64)
    p = np.clip(same, 0.01, 0.99)
    pairs = (inner @ np.log(p) + cut @ np.log(1 - p)) / np.maximum((inner + cut).sum(axis=1), 1)
    weight = masks * np.sqrt(graph.area)[None]
    alive = weight @ np.log(np.clip(move, 0.01, 1)) / np.maximum(weight.sum(axis=1), 1e-9)
    out: FloatArray = pairs + alive
    return out


def merge_tree(graph: Graph, bond: FloatArray) -> list[NDArray[np.bool_]]:
    """Groups of an average-linkage agglomeration over neighbouring pairs, strongest bond first."""
    count = graph.count
    member = {k: np.arange(count) == k for k in range(count)}
    links: list[dict[int, tuple[float, int]]] = [{} for _ in range(count)]
    for (i, j), w in zip(graph.pairs, bond):
        links[i][int(j)] = links[j][int(i)] = (float(w), 1)
    nodes = dict(enumerate(links))
    out = []

    def strength(k: int, m: int) -> float:
        return nodes[k][m][0] / nodes[k][m][1]

    def strongest(k: int) -> int:
        return max(nodes[k], key=partial(strength, k), default=-1)

    best = {k: strongest(k) for k in nodes}
    while len(nodes) > 1:
        a = max(
            (k for k in nodes if best[k] >= 0),
            key=lambda k: strength(k, best[k]),
            default=-1,
        )
        if a < 0:
            break
        b = best[a]
        if strength(a, b) < 1e-3:
            break
        gone = nodes.pop(b)
        best.pop(b)
        nodes[a].pop(b)
        for k, (w, n) in gone.items():
            if k == a:
                continue
            w0, n0 = nodes[a].get(k, (0.0, 0))
            nodes[a][k] = nodes[k][a] = (w0 + w, n0 + n)
            nodes[k].pop(b, None)
        member[a] = member[a] | member.pop(b)
        out.append(member[a])
        for k in {a, *nodes[a]}:
            best[k] = strongest(k)
    return out


def segmenter_groups(graph: Graph) -> list[NDArray[np.bool_]]:
    """The nodes of the segmenter's own hierarchy: how a fused surface wants to hang together."""
    nodes = list(np.eye(graph.count, dtype=bool))
    for a, b in () if graph.merges is None else graph.merges:
        nodes.append(nodes[int(a)] | nodes[int(b)])
    return nodes[graph.count :]


def components(graph: Graph, joined: Masks, alive: Masks) -> list[NDArray[np.bool_]]:
    """Connected groups of the primitives that are `alive`, over the pairs that are `joined`."""
    label = np.arange(graph.count)

    def root(k: int) -> int:
        while label[k] != k:
            label[k] = label[label[k]]
            k = int(label[k])
        return k

    for e in np.flatnonzero(joined):
        i, j = graph.pairs[e]
        if alive[i] and alive[j]:
            a, b = root(int(i)), root(int(j))
            label[max(a, b)] = min(a, b)
    roots = np.array([root(k) if alive[k] else -1 for k in range(graph.count)])
    return [roots == r for r in np.unique(roots[roots >= 0])]


def _connected(graph: Graph) -> list[NDArray[np.bool_]]:
    """All connected groups of a small graph."""
    count = graph.count
    reach = np.zeros(count, dtype=np.int64)
    for i, j in graph.pairs:
        reach[i] |= 1 << int(j)
        reach[j] |= 1 << int(i)
    seen: set[int] = set()
    stack = [1 << k for k in range(count)]
    while stack:
        bits = stack.pop()
        if bits in seen:
            continue
        seen.add(bits)
        around = 0
        for k in range(count):
            if bits >> k & 1:
                around |= int(reach[k])
        around &= ~bits
        stack.extend(bits | 1 << k for k in range(count) if around >> k & 1)
    shifts: IntArray = np.arange(count)
    return [(np.int64(bits) >> shifts & 1).astype(bool) for bits in sorted(seen)]
