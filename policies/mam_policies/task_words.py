"""What an environment asks for in plain language: "open the top drawer"."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mam_envs.object_model import ObjectModel
from mam_pipeline.types import FloatArray

VERBS = {"turn_to": "turn", "push": "press", "take_out": "take the cube out of",
         "put_in": "put the cube into and close"}  # fmt: skip
ROWS = {1: [""], 2: ["top", "bottom"], 3: ["top", "middle", "bottom"]}
COLUMNS = {1: [""], 2: ["left", "right"], 3: ["left", "middle", "right"]}
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")


def task_words(base: Any) -> str:
    """The task of an unwrapped environment; the parts of a sequence stand one after another."""
    layout = base.layout(0)
    said = []
    for goal in layout.goals:
        verb = VERBS.get(goal.task, goal.task.replace("_", " "))
        said.append(f"{verb} the {part_words(layout.model, goal.joint)}")
    return ", then ".join(said)


def part_words(model: ObjectModel, joint: str) -> str:
    """The part that a joint moves, told from its like by where it is as seen from the front: "top
    left drawer", "second drawer from the top". The link's name where place does not tell."""
    kinds = {p.link: p.kind.replace("_", " ") for p in model.asset.card.parts}
    movable = model.asset.card.movable
    own = model.card_joint(joint).child
    kind = kinds.get(own, "part")
    alike = [j.child for j in movable if kinds.get(j.child, "part") == kind]
    if len(alike) == 1:
        return kind
    boxes = np.array([_box(model, link) for link in alike])
    at = alike.index(own)
    rows = _groups(boxes[:, :, 2], falling=True)
    same_row = [i for i in range(len(alike)) if rows[i] == rows[at]]
    # left of the front, which looks towards -x, is +y
    columns = _groups(boxes[same_row][:, :, 1], falling=True)
    column = columns[same_row.index(at)]
    if sum(c == column for c in columns) > 1:
        return f"{kind} {own.replace('_', ' ')}"
    down, ahead = _place(rows[at], max(rows) + 1, ROWS, "from the top"), ""
    if len(same_row) > 1:
        ahead = _place(column, max(columns) + 1, COLUMNS, "from the left")
    before = [w for w in (down, ahead) if "from" not in w]
    after = [w for w in (down, ahead) if "from" in w]
    words = [*before, *(w.split(" ", 1)[0] for w in after), kind]
    words += [w.split(" ", 1)[1] for w in after]
    return " ".join(w for w in words if w)


def _place(index: int, count: int, names: dict[int, list[str]], end: str) -> str:
    """Of `count` in a line: a name, or an ordinal with the end that it counts from."""
    if count in names:
        return names[count][index]
    line = names[2]
    if index in (0, count - 1):
        return line[0 if index == 0 else 1]
    return f"{ORDINALS[index] if index < len(ORDINALS) else f'{index + 1}th'} {end}"


def _groups(spans: FloatArray, falling: bool) -> Sequence[int]:
    """(n,) group of every (low, high) span: those overlap whose middles are within half the lesser
    length."""
    middles, lengths = spans.mean(axis=1), spans[:, 1] - spans[:, 0]
    order = np.argsort(-middles if falling else middles, kind="stable")
    out = np.zeros(len(spans), dtype=int)
    for before, now in pairwise(order):
        apart = abs(middles[now] - middles[before]) > 0.5 * min(lengths[now], lengths[before])
        out[now] = out[before] + apart
    return [int(g) for g in out]


def _box(model: ObjectModel, link: str) -> FloatArray:
    """(2, 3) box of a link's collision pieces at rest, asset frame."""
    pose = model.kinematics.link_poses({})[link][0]
    rows = [piece.points @ pose[:3, :3].T + pose[:3, 3] for piece in model.pieces[link]]
    points = np.concatenate(rows) if rows else pose[None, :3, 3]
    return np.stack([points.min(axis=0), points.max(axis=0)])
