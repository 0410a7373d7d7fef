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
    "You analyse a 3D object for a robot simulator: which rigid parts it has and how they move. "
    "You see it from several sides, cut into numbered surface pieces. The small cross in each "
    "picture's corner shows the axes; z is up. Tags that stand beside a small piece are tied to "
    "it by a line that ends in a dot. First ask yourself what the object is and what a person "
    "would do with it. Answer in the JSON asked for, nothing else."
)
GROUPING = (
    "Group the numbered pieces into rigid parts. The pieces are {ids}. Use every number exactly "
    "once.\n"
    "One part is the base: the body that stands, hangs or is held while the others move; "
    "everything that never moves against it belongs to it, hinges and fixed trim included. "
    "A handle, its screws and the front it sits on are one part; so are a drawer's front and its "
    "box, a wheel and its hub, a knob and its pointer. Mirrored or repeated pieces that are not "
    "joined to each other (two knobs, three drawers) are parts of their own. Do not split what is "
    "rigid, do not join what moves apart. Name the parts in lower case with underscores; kind is "
    "the general word (door, drawer, lid, knob, button, lever, wheel, handle, panel, body).\n"
    "The pictures: 'object' is the object as it is; {views}.{measured}{close}{inside} 'apart' "
    "shows all pieces pulled away from the middle.\n"
    "Where each piece lies and ends, in percent of the longest side, and what it touches:\n{facts}"
)
MEASURED = (
    " 'measured' repeats those views, in the same order and smaller, coloured by a measurement "
    "of how each piece could move: pieces of one bright colour were found to move together, grey "
    "ones to be held by the rest; of pale ones nothing is known. It is a hint and may be wrong."
)
CLOSE = " {names} enlarge places where small pieces crowd."
INSIDE = " 'inside' shows, in place, the pieces that cannot be seen from outside."
TREE = (
    "These are the rigid parts, each in one colour with its number: {parts}. For each part other "
    "than the base say on which part it is mounted (its parent, by name) and how it moves against "
    "it: hinge (turns about an edge or a pin at its side, like a door, lid or lever), spin (turns "
    "about its own middle, like a knob or wheel), slide (moves along a line, like a drawer, sash "
    "or button) or fixed. Give how sure you are, and the second-best kind of motion.\n"
    "axis: the direction of the line it turns about or slides along (x, y, z, or other). side: "
    "where that line lies, seen from the middle of the part (for a door hinged at its -y edge: "
    "-y; for a knob or a slide: middle). Hinges sit away from the handle and towards what holds "
    "the part. opens: the direction in which the part starts to move when it is opened, pulled "
    "out or pressed as usual (for a hinge: its free end; for a spin: either).\n"
    "The pictures: 'object' is the object as it is; {views}; 'apart' shows the parts pulled away "
    "from the middle.\n"
    "Where each part lies, in percent of the object's longest side, and what it touches:\n{facts}"
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
    axis: Literal["x", "y", "z", "other"]
    side: Literal["-x", "+x", "-y", "+y", "-z", "+z", "middle"]
    opens: Literal["-x", "+x", "-y", "+y", "-z", "+z", "either"]


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
