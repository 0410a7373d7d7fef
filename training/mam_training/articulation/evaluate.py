"""How good the network's parts are on items: by area of primitives, as the bench by faces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mam_training.articulation.answers import Answers
from mam_training.articulation.batches import NOTHING, Draw, batch_of
from mam_training.articulation.items import Item


def score(item: Item, masks: Sequence[NDArray], answers: Answers) -> dict[str, float]:
    """mIoU, whether the count is right, type error, axis error (rad) of one object."""
    movable = np.flatnonzero((item.subtype >= 0) & (item.overlap.sum(0) > 0))
    number = max(len(masks), len(movable))
    if number == 0:
        return {"miou": 1.0, "count": 1.0, "type": 0.0, "axis": 0.0}
    table = np.zeros((len(masks), len(movable)))
    for k, mask in enumerate(masks):
        inside = item.overlap[mask].sum(0)
        union = item.overlap[mask].sum() + item.overlap.sum(0) - inside
        table[k] = (inside / np.maximum(union, 1e-12))[movable]
    rows, columns = linear_sum_assignment(-table)
    wrong, axis = float(len(movable)), np.pi / 2 * len(movable)
    for r, c in zip(rows, columns):
        if table[r, c] <= 0:
            continue
        kind = int(np.argmax(answers.odds(masks[r][None])[0]))
        link = movable[c]
        slide = kind == 2
        if slide == (item.subtype[link] == 2):
            wrong -= 1
        turn = abs(float(answers.axis(masks[r]) @ item.axis[link]))
        axis -= np.pi / 2 - float(np.arccos(min(turn, 1.0)))
    n = max(len(movable), 1)
    return {
        "miou": float(table[rows, columns].sum() / number),
        "count": float(len(masks) == len(movable)),
        "type": wrong / n, "axis": axis / n,
    }  # fmt: skip


def best_groups(answers: Answers, bar: float) -> list[NDArray]:
    """Disjoint groups whose expected overlaps, less `bar` for each, sum to the most; (P,) each.

    A group of the agglomeration holds those that it was joined from, which come before it.
    """
    masks = answers.groups()
    value = answers.value(masks) - bar
    best: list[tuple[float, list[int]]] = []
    inside = masks.astype(int) @ masks.T.astype(int) == masks.sum(axis=1)[None]  # [k, j]: j in k
    for k in range(len(masks)):
        below = [j for j in np.flatnonzero(inside[k]) if j < k]
        top = [j for j in below if not any(inside[m, j] for m in below if m > j)]
        total = sum(best[j][0] for j in top)
        own = float(value[k])
        best.append((own, [k]) if own > total else (total, [c for j in top for c in best[j][1]]))
    roots = [k for k in range(len(masks)) if not inside[k + 1 :, k].any()]
    return [masks[c] for k in roots for c in best[k][1]]


@torch.no_grad()
def evaluate(net: Any, items: Sequence[Item], prior: Sequence[NDArray],
             draw: Draw = NOTHING, bar: float = 0.4) -> dict[str, float]:  # fmt: skip
    """Mean scores of items."""
    net.eval()
    rows = []
    for item in items:
        batch = batch_of([item], np.random.default_rng(0), draw, prior, turn=False)
        move, same, motion = (x[0].numpy().astype(np.float64) for x in net(*batch.inputs))
        answers = Answers(move, same, motion, item.area.astype(np.float64))
        rows.append(score(item, best_groups(answers, bar), answers))
    return {k: float(np.mean([r[k] for r in rows])) for k in rows[0]}
