"""The questions put to a vision-language model, and the shape that an answer must have.

Two questions, as the paper's two prompts (3.2 grouping, 3.3 tree and joint types). An answer is
data of a fixed schema: names are short words, numbers are primitive ids; nothing else is accepted.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Probability = Annotated[float, Field(ge=0, le=1)]

SYSTEM = (
    "You analyse a 3D object for a robot simulator. You see it from several sides, cut into "
    "numbered surface pieces, and beside each view a map of physical evidence: pieces of one "
    "colour were measured to move together, grey pieces were measured to be held fast. Trust what "
    "you see, use the maps to decide what belongs together, and answer in the JSON asked for."
)
GROUPING = (
    "Group the numbered pieces into rigid parts. The pieces are {ids}. Use every number exactly "
    "once. One part is the base: the body that stands, hangs or is held while the others move; "
    "everything that never moves against it belongs to it. A handle, its screws and the front it "
    "sits on are one part; so are a drawer's front and its box, a wheel and its hub. Do not split "
    "what is rigid, do not join what moves apart. Name the parts in lower case with underscores."
)
TREE = (
    "These are the rigid parts, each in one colour with its number: {parts}. For each part other "
    "than the base say on which part it is mounted (its parent, by name) and how it moves against "
    "it: hinge (turns about an edge, like a door or lid), spin (turns about its own axis, like a "
    "knob or wheel), slide (moves along a line, like a drawer or button) or fixed. Give how sure "
    "you are, and the second-best kind of motion."
)
CHALLENGE = (
    "The measurements contradict your answer: {evidence}. Look at the pictures again. If you were "
    "wrong, correct the answer; if you are sure, repeat it unchanged."
)
REPAIR = "Your answer cannot be used: {error}. Answer again, complete, in the same JSON."


class Group(BaseModel):
    """A rigid part: its pieces."""

    model_config = ConfigDict(extra="forbid")
    name: Name
    kind: Name
    is_base: bool
    pieces: Annotated[list[int], Field(min_length=1, max_length=400)]
    confidence: Probability


class Grouping(BaseModel):
    """Answer to the first question."""

    model_config = ConfigDict(extra="forbid")
    parts: Annotated[list[Group], Field(min_length=1, max_length=120)]


class Mount(BaseModel):
    """How one part is mounted."""

    model_config = ConfigDict(extra="forbid")
    name: Name
    parent: Name
    motion: Literal["fixed", "hinge", "spin", "slide"]
    confidence: Probability
    second_best: Literal["fixed", "hinge", "spin", "slide"]


class Mounting(BaseModel):
    """Answer to the second question."""

    model_config = ConfigDict(extra="forbid")
    mounts: Annotated[list[Mount], Field(max_length=120)]


def faults_of_grouping(answer: Grouping, ids: set[int]) -> str:
    """What is wrong with a grouping, in words; "" when every id is used exactly once."""
    used = [p for group in answer.parts for p in group.pieces]
    faults = []
    if missing := sorted(ids - set(used)):
        faults.append(f"pieces {missing[:30]} are in no part")
    if unknown := sorted(set(used) - ids):
        faults.append(f"pieces {unknown[:30]} do not exist")
    if twice := sorted({p for p in used if used.count(p) > 1}):
        faults.append(f"pieces {twice[:30]} are used more than once")
    names = [group.name for group in answer.parts]
    if len(set(names)) < len(names):
        faults.append("two parts have the same name")
    bases = [group.name for group in answer.parts if group.is_base]
    if len(bases) != 1:
        faults.append(f"exactly one part must be the base, not {len(bases)}")
    return "; ".join(faults)


def faults_of_mounting(answer: Mounting, names: list[str], base: str) -> str:
    """What is wrong with a mounting, in words; "" when it is a tree over all parts."""
    faults = []
    given = [m.name for m in answer.mounts]
    wanted = set(names) - {base}
    if missing := sorted(wanted - set(given)):
        faults.append(f"no mounting for {missing}")
    if unknown := sorted(set(given) - wanted):
        faults.append(f"{unknown} are no parts, or the base itself")
    if len(set(given)) < len(given):
        faults.append("a part is mounted twice")
    parents = {m.name: m.parent for m in answer.mounts}
    if strange := sorted(set(parents.values()) - set(names)):
        faults.append(f"parents {strange} are no parts")
    for name in parents:
        seen, at = set(), name
        while at in parents and at not in seen:
            seen.add(at)
            at = parents[at]
        if at in seen:
            faults.append(f"{name} is mounted on itself through its parents")
            break
    return "; ".join(faults)
