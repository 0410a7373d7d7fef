"""The questions put to a vision-language model, and the shape that an answer must have.

The paper's two prompts (3.2 grouping, 3.3 tree and joint types), both in one for simple objects,
and a third: is that how it moves? An answer is data of a fixed schema: names are short words,
numbers are primitive ids; nothing else is accepted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
MOST_CLOSER = 12  # pieces that are shown enlarged when they are asked for
Closer = Annotated[list[int], Field(max_length=MOST_CLOSER)]
Probability = Annotated[float, Field(ge=0, le=1)]
Motion = Literal["fixed", "hinge", "spin", "slide"]
Letter = Literal["x", "y", "z", "other"]
Side = Literal["-x", "+x", "-y", "+y", "-z", "+z", "middle"]
Way = Literal["-x", "+x", "-y", "+y", "-z", "+z", "either"]
Pieces = Annotated[list[int], Field(max_length=400)]
Nodes = Annotated[list[Annotated[str, Field(max_length=40)]], Field(max_length=40)]
Reach = Annotated[float, Field(ge=-720, le=720)]

SYSTEM = (
    "You analyse a 3D object for a robot simulator: which rigid parts it has and how they move. "
    "You see it from several sides, cut into numbered surface pieces. The small cross in each "
    "picture's corner shows the axes; z is up. Tags that stand beside a small piece are tied to "
    "it by a line that ends in a dot. First ask yourself what the object is and what a person "
    "would do with it. Answer in the JSON asked for, nothing else."
)
GROUPING = (
    "Group the numbered pieces into rigid parts. The pieces are {ids}. Use every number exactly "
    "once; of the base you may leave pieces [] and it gets all that no other part has.\n"
    "One part is the base: the body that stands, hangs or is held while the others move; "
    "everything that never moves against it belongs to it, hinges and fixed trim included. {same}"
    "\nThe pictures: 'object' is the object as it is; {views}.{measured}{close}{inside} 'apart' "
    "shows all pieces pulled away from the middle.{closer}\n{told}"
    "Where each piece lies and ends, in percent of the longest side, and what it touches:\n{facts}"
)
NODES = (
    "Where a node that the file names is a whole as it moves, put its name into nodes: it stands "
    "for its pieces, but those that you give to another part by number. "
)
SAME_PART = (
    "A handle, its screws and the front it sits on are one part; so are a drawer's front and its "
    "box, a wheel and its hub, a knob and its pointer. Mirrored or repeated pieces that are not "
    "joined to each other (two knobs, three drawers) are parts of their own. Do not split what is "
    "rigid, do not join what moves apart. {nodes}Name the parts in lower case with underscores; "
    "kind is the general word (door, drawer, lid, knob, button, lever, wheel, handle, panel, body)."
)
MEASURED = (
    " 'measured' repeats those views, in the same order and smaller, coloured by a measurement "
    "of how each piece could move: pieces of one bright colour were found to move together, grey "
    "ones to be held by the rest; of pale ones nothing is known. It is a hint and may be wrong."
)
CLOSE = " {names} enlarge places where small pieces crowd."
INSIDE = " 'inside' shows, in place, the pieces that cannot be seen from outside."
PARTS = (
    "The numbered pieces are {ids}. Say which of them form parts that a person moves against the "
    "rest, and how. All pieces that you name in no part are the base: the body that stands, hangs "
    "or is held, with all that never moves against it; give it a name too. Where nothing moves, "
    "parts is []. {same}\n{mounting}\n"
    "The pictures: 'object' is the object as it is; {views}.{measured}{close}{inside} 'apart' "
    "shows all pieces pulled away from the middle.{closer}\n{told}"
    "Where each piece lies and ends, in percent of the longest side, and what it touches:\n{facts}"
)
TREE = (
    "These are the rigid parts, each in one colour with its number: {parts}. {mounting}\n"
    "The pictures: 'object' is the object as it is; {views}; 'apart' shows the parts pulled away "
    "from the middle.\n"
    "Where each part lies, in percent of the object's longest side, and what it touches:\n{facts}"
)
MOUNTED = (
    "For each part other than the base say on which part it is mounted (its parent, by name) and "
    "how it moves against "
    "it: hinge (turns about an edge or a pin at its side, like a door, lid or lever), spin (turns "
    "about its own middle, like a knob or wheel), slide (moves along a line, like a drawer, sash "
    "or button) or fixed. Give how sure you are, and the second-best kind of motion.\n"
    "axis: the direction of the line it turns about or slides along (x, y, z, or other). side: "
    "where that line lies, seen from the middle of the part (for a door hinged at its -y edge: "
    "-y; for a knob or a slide: middle). Hinges sit away from the handle and towards what holds "
    "the part. opens: the direction in which the part starts to move when it is opened, pulled "
    "out or pressed as usual (for a hinge: its free end; for a spin: either).\n"
    "What is only lifted or pulled off (a cork, a loose lid, a cap) slides the way it comes off. "
    "What a motor turns (a drum, a turntable, blades) and what is drawn out on rails (a rack) "
    "moves, too, also behind a closed door. "
    "What turns about two axes (a gimbal, a universal joint) is two parts in a row where a piece "
    "lies between that carries the outer one; where none does, give the axis that matters more. "
    "What moves in the real object moves here too where its hinge, axle or rail is missing in the "
    "mesh: give the line where that would be.\n{lines}{ranges}"
)
LINES = (
    "Where a line is better said by pieces, give (else null) through: one piece, through whose "
    "middle it runs along the axis, or two, from the middle of one to that of the other, where it "
    "is inclined; or along: a piece along whose longest edge it runs (of its edges the one on that "
    "side, or its middle). "
)
RANGES = (
    "Where you know more of the range than that it is as usual, give (else null) lower and upper: "
    "from how it stands in the pictures of the object, in degrees, or for a slide in percent of "
    "the part's length along the way it slides (of: carrier, of the length of what carries it; of: "
    "object, of the object's longest side, as the places of pieces are given); "
    "positive opens. endless: it turns without end, as wheels, propellers, blades and knobs do "
    "unless you say false. usual: true takes the usual range of such a part, even where the mesh "
    "overlaps on the way."
)
MOVED = (
    "These joints were made. Each sheet shows some of them, a joint in two "
    "rows: from two sides, closed, half open and open, or as it stands and turned by 45 and 90 "
    "degrees where it turns without end. The part that moves is orange, what it carries is yellow, "
    "the magenta line is what it turns about, or the way it slides. {lines}'pieces' shows the "
    "pieces with their numbers, from two sides. Is that how it moves? "
    "Think of the real object: which edge is it hung on, does it turn or slide, does it go far "
    "enough and not too far, does it leave a piece behind, or take one along that should stay?\n"
    "{joints}\n"
    "Give each joint: ok true, or ok false with what is to be changed and null for the rest: "
    "motion (fixed: it does not move by itself), axis, side and opens as before, parent, or line: "
    "the number of another line that is shown for it. {words}{ranges}\n"
    "transfers: pieces, by their numbers in 'pieces', that belong to another part (or to the base, "
    "{base}); a new name makes a part of its own, whose joint you give under joints."
)
CHALLENGE = (
    "The measurements contradict your answer: {evidence}. Look at the pictures again. If you were "
    "wrong, correct the answer; if you are sure, repeat it unchanged."
)
REPAIR = "Your answer cannot be used: {error}. Answer again, complete, in the same JSON."


CLOSER = (
    " If pieces are too small to judge, name up to {most} of them in closer, with your answer as "
    "it is now: they are shown enlarged, and you answer again, once."
)
SHOWN_CLOSER = " You asked for {pieces}: {names} enlarge them."
OTHER_LINES = (
    "'lines' shows, by number, the part half open about other lines that were measured as likely. "
)


class Details(BaseModel):
    """What may be said of a motion beside its axis and side; None says nothing.

    Attributes:
        through: a piece through whose middle the line runs, or two that it joins.
        along: a piece along whose longest edge it runs.
        lower, upper: range from the pose of the file, degrees, or percent of a length for a slide.
        of: whose length that is, along the way; the part's own if None. "object": the longest side
            of all.
        endless: whether it turns without end. usual: whether the usual range of such a part is
            taken, whatever overlaps.
    """

    model_config = ConfigDict(extra="forbid")
    through: Annotated[list[int], Field(min_length=1, max_length=2)] | None = None
    along: int | None = None
    lower: Reach | None = None
    upper: Reach | None = None
    of: Literal["part", "carrier", "object"] | None = None
    endless: bool | None = None
    usual: bool | None = None

    @property
    def by_pieces(self) -> tuple[int, ...]:
        """The pieces by which the line is given."""
        return (*(self.through or ()), *(() if self.along is None else (self.along,)))

    def faults(self, name: str, ids: set[int]) -> list[str]:
        """What is wrong with them, in words; `ids` are the numbers of the pieces shown."""
        out = []
        if strange := sorted(set(self.by_pieces) - ids):
            out.append(f"the line of {name} runs by pieces {strange}, which are not shown")
        if self.through is not None and self.along is not None:
            out.append(f"the line of {name} runs through or along, not both")
        if self.through is not None and len(set(self.through)) < len(self.through):
            out.append(f"the line of {name} runs through one piece or two different ones")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            out.append(f"upper of {name} must be above its lower")
        return out


def schema_of(shape: type[BaseModel]) -> dict[str, Any]:
    """The JSON schema of an answer, with what may be left out last."""
    schema = shape.model_json_schema()
    for thing in (schema, *schema.get("$defs", {}).values()):
        rows = thing.get("properties", {}).items()
        thing["properties"] = dict(sorted(rows, key=lambda row: row[0] in Details.model_fields))
    return schema


class Group(BaseModel):
    """A rigid part: its pieces, and nodes of the file that stand for theirs."""

    model_config = ConfigDict(extra="forbid")
    name: Name
    kind: Name
    is_base: bool
    pieces: Pieces
    nodes: Nodes = []
    confidence: Probability


class Grouping(BaseModel):
    """Answer to the first question."""

    model_config = ConfigDict(extra="forbid")
    parts: Annotated[list[Group], Field(min_length=1, max_length=120)]
    closer: Closer = []

    def with_nodes(self, nodes: Mapping[str, Sequence[int]]) -> Grouping:
        """With the pieces of the named nodes."""
        found = zip(self.parts, _with_nodes(self.parts, nodes))
        return self.model_copy(update={"parts": [p.model_copy(update=own) for p, own in found]})

    def complete(self, ids: set[int]) -> Grouping:
        """With all pieces that are left in the base, if that names none; `ids` are those shown."""
        used = {p for group in self.parts for p in group.pieces}
        left = sorted(ids - used)
        return Grouping(
            parts=[g if g.pieces else g.model_copy(update={"pieces": left}) for g in self.parts]
        )


class Mount(Details):
    """How one part is mounted."""

    name: Name
    parent: Name
    motion: Motion
    confidence: Probability
    second_best: Motion
    axis: Letter
    side: Side
    opens: Way


class Mounting(BaseModel):
    """Answer to the second question."""

    model_config = ConfigDict(extra="forbid")
    mounts: Annotated[list[Mount], Field(max_length=120)]


class MountedPart(Details):
    """A part that moves, and how: both questions in one. Without a parent it is on the base."""

    name: Name
    kind: Name = "part"
    pieces: Pieces = []
    nodes: Nodes = []
    parent: Name | None = None
    motion: Motion
    axis: Letter
    side: Side
    opens: Way
    confidence: Probability = 0.9
    second_best: Motion = "fixed"


class MountedParts(BaseModel):
    """Answer to the one question that is asked of simple objects; the rest is the base."""

    model_config = ConfigDict(extra="forbid")
    base: Name
    parts: Annotated[list[MountedPart], Field(max_length=120)]
    closer: Closer = []

    def with_nodes(self, nodes: Mapping[str, Sequence[int]]) -> MountedParts:
        """With the pieces of the named nodes."""
        found = zip(self.parts, _with_nodes(self.parts, nodes))
        return self.model_copy(update={"parts": [p.model_copy(update=own) for p, own in found]})

    def grouping(self, ids: set[int]) -> Grouping:
        """The parts as an answer to the first of two questions; `ids` are all numbers shown."""
        left = sorted(ids - {p for part in self.parts for p in part.pieces})
        base = Group(name=self.base, kind="body", is_base=True, pieces=left, confidence=1.0)
        own = [
            Group(name=p.name, kind=p.kind, is_base=False, pieces=p.pieces, confidence=1.0)
            for p in self.parts
        ]
        return Grouping(parts=[base, *own])

    def mounting(self) -> Mounting:
        """Their mounts as an answer to the second."""
        rows = [p.model_dump(exclude={"kind", "pieces", "nodes"}) for p in self.parts]
        return Mounting(
            mounts=[Mount(**{**row, "parent": row["parent"] or self.base}) for row in rows]
        )


class JointCheck(Details):
    """What is to be changed of one joint; None leaves it as it is."""

    name: Name
    ok: bool
    motion: Motion | None = None
    axis: Letter | None = None
    side: Side | None = None
    opens: Way | None = None
    parent: Name | None = None
    line: Annotated[int, Field(ge=1, le=9)] | None = None

    @property
    def only_numbers(self) -> bool:
        """Whether what it changes is the range alone."""
        said = (self.motion, self.axis, self.side, self.opens, self.parent, self.line)
        return not self.by_pieces and all(word is None for word in said)

    def beside(self, mount: Mount | None) -> JointCheck:
        """Without the words that the part's mount has already, as some models repeat them all."""
        if mount is None or self.line is not None:
            return self
        words = ("motion", "axis", "side", "opens", "parent")
        same = {word for word in words if getattr(self, word) == getattr(mount, word)}
        return self.model_copy(update=dict.fromkeys(same))


class Transfer(BaseModel):
    """Pieces that belong to another part."""

    model_config = ConfigDict(extra="forbid")
    pieces: Annotated[list[int], Field(min_length=1, max_length=400)]
    to: Name


class MotionCheck(BaseModel):
    """Answer to the third question; a joint that is left out is as it should be."""

    model_config = ConfigDict(extra="forbid")
    joints: Annotated[list[JointCheck], Field(max_length=120)]
    transfers: Annotated[list[Transfer], Field(max_length=120)] = []

    @property
    def all_right(self) -> bool:
        """Whether nothing is to be changed."""
        return not self.transfers and all(joint.ok for joint in self.joints)

    @property
    def only_numbers(self) -> bool:
        """Whether ranges alone are to be changed: no part, line, side or kind of motion."""
        return not self.transfers and all(j.ok or j.only_numbers for j in self.joints)

    def beside(self, mounts: Mapping[str, Mount]) -> MotionCheck:
        """With what differs from the parts' mounts alone."""
        joints = [joint.beside(mounts.get(joint.name)) for joint in self.joints]
        return self.model_copy(update={"joints": joints})


def _with_nodes(
    parts: Sequence[Group | MountedPart], nodes: Mapping[str, Sequence[int]]
) -> list[dict[str, list[int]]]:
    """The pieces of each part with those of its nodes, but what a part has by number."""
    own = {p for part in parts for p in part.pieces}
    return [
        {"pieces": [*part.pieces, *sorted({p for n in part.nodes for p in nodes.get(n, ())} - own)]}
        for part in parts
    ]


def faults_of_nodes(answer: Grouping | MountedParts, nodes: Collection[str]) -> str:
    """Names in an answer that no node of the file has, in words."""
    unknown = sorted({name for part in answer.parts for name in part.nodes} - set(nodes))
    return f"the file names no nodes {unknown}; it names {sorted(nodes)}" if unknown else ""


def faults_of_check(
    answer: MotionCheck, parents: Mapping[str, str], ids: set[int], lines: Mapping[str, int]
) -> str:
    """What is wrong with a check, in words.

    Args:
        parents: of all parts by name, the base (whose parent is "") first. ids: the numbers shown.
        lines: how many other lines are shown for a part.
    """
    faults, names = [], list(parents)
    new = {t.to for t in answer.transfers} - set(names)
    given = [joint.name for joint in answer.joints]
    if unknown := sorted(set(given) - set(names[1:]) - new):
        faults.append(f"{unknown} are no parts with a joint; there are {names[1:]}")
    if len(set(given)) < len(given):
        faults.append("a joint is given twice")
    if strange := sorted({p for t in answer.transfers for p in t.pieces} - ids):
        faults.append(f"pieces {strange[:30]} do not exist")
    for joint in answer.joints:
        if joint.line is not None and joint.line > lines.get(joint.name, 0):
            faults.append(f"no line {joint.line} is shown for {joint.name}")
        if joint.parent is not None and joint.parent not in names:
            faults.append(f"parent {joint.parent} of {joint.name} is no part")
        faults += joint.faults(joint.name, ids)
    for name in sorted(new):
        own = next((joint for joint in answer.joints if joint.name == name), None)
        if own is None or None in (own.motion, own.axis, own.side, own.opens):
            faults.append(f"{name} is a new part: give its motion, axis, side and opens in joints")
    faults += _loops({**parents, **{j.name: j.parent for j in answer.joints if j.parent}})
    return "; ".join(faults)


def faults_of_parts(answer: MountedParts, ids: set[int]) -> str:
    """What is wrong with an answer to both questions in one, in words."""
    grouping = answer.grouping(ids)
    faults = [faults_of_grouping(grouping, ids)]
    if not grouping.parts[0].pieces:
        faults.append("no piece is left for the base")
    names = [group.name for group in grouping.parts]
    faults.append(faults_of_mounting(answer.mounting(), names, answer.base, ids))
    return "; ".join(fault for fault in faults if fault)


def faults_of_grouping(answer: Grouping, ids: set[int]) -> str:
    """What is wrong with a grouping, in words; "" when every id is used exactly once."""
    used = [p for group in answer.parts for p in group.pieces]
    faults = []
    empty = [group for group in answer.parts if not group.pieces]
    rest = len(empty) == 1 and empty[0].is_base  # the base has what no other part has
    if empty and not rest:
        faults.append(f"{empty[0].name} has no pieces")
    if rest and not ids - set(used):
        faults.append("no piece is left for the base")
    if not rest and (missing := sorted(ids - set(used))):
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


def faults_of_mounting(
    answer: Mounting, names: list[str], base: str, ids: Collection[int] = ()
) -> str:
    """What is wrong with a mounting, in words; "" when it is a tree over all parts.

    Args:
        ids: numbers of the pieces that are shown with the question.
    """
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
    for mount in answer.mounts:
        faults += mount.faults(mount.name, set(ids))
    return "; ".join([*faults, *_loops(parents)])


def _loops(parents: Mapping[str, str]) -> list[str]:
    """The first part that hangs on itself, in words."""
    for name in parents:
        seen, at = set(), name
        while at in parents and at not in seen:
            seen.add(at)
            at = parents[at]
        if at in seen:
            return [f"{name} is mounted on itself through its parents"]
    return []
