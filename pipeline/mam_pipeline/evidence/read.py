"""From a file and what the user typed to a kinematic specification."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.evidence.kinds import ObjectKind, PartKind, Range, kinds
from mam_pipeline.evidence.kinds import usual_size as size_of_kind
from mam_pipeline.evidence.motions import AnimatedJoint, joint_of
from mam_pipeline.evidence.names import (
    counts_of,
    object_of,
    part_kind_of,
    shared_kind,
)
from mam_pipeline.evidence.pivots import hinge_axis, own_origin
from mam_pipeline.evidence.spec import (
    KindCount,
    KinematicSpec,
    ObjectWord,
    PartStatement,
    Said,
    told,
)
from mam_pipeline.evidence.words import words_of
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.nodes import Scene, SceneNode
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.hints import Hints
from mam_pipeline.types import FloatArray, Mesh


@dataclass(frozen=True)
class Certainties:
    """How far sources beside a person are believed, 0..1, and what is passed over.

    Attributes:
        name: of a node or object. material: of a material. file: the file's own name.
        model: of a language model that saw a photo of the object.
        animation: a motion that the file itself shows.
        pivot: a nameless node whose own origin lies on an edge of its box.
        habit: share of the nodes with own origins on edges from which that is the modeller's way
            and says nothing; of at least `few` nodes.
        still: weight of a name where such a thing never moves such a part.
        whole: share of the surface above which a node is the object and no part of it.
        usual: share of objects from which a part is told as usual.
        many: parts with one name beyond which the name is no part's.
    """

    name: float = 0.8
    material: float = 0.6
    file: float = 0.7
    model: float = 0.85
    animation: float = 0.95
    pivot: float = 0.6
    habit: float = 0.5
    few: int = 4
    still: float = 0.4
    whole: float = 0.95
    usual: float = 0.3
    many: int = 40


CERTAINTIES = Certainties()


def spec_of(
    mesh: Mesh,
    source: Path | None = None,
    mesh_T_file: FloatArray | None = None,
    what: str | None = None,
    hints: Hints | None = None,
    use_names: bool = True,
    seen: Sequence[str] = (),
) -> KinematicSpec:
    """All that is known of an object beside its geometry.

    Args:
        mesh: in the frame of the engine. source: the file; None where there is none.
        mesh_T_file: (4, 4) similarity that brought the file's coordinates into the mesh's frame.
        what: the user's words for the object. hints: of the user, obeyed.
        use_names: False passes over everything in the file itself.
        seen: what a language model calls the object, the best word first; the first that is known
            weighs, and is not obeyed.

    Raises:
        ConfigError: words for the object that no kind has.
    """
    scene = _scene(source) if source is not None and use_names else None
    objects: list[ObjectWord] = []
    notes: list[str] = [] if scene is None else list(scene.notes)
    counts: tuple[KindCount, ...] = ()
    if what:
        said = Said("user", what)
        word = object_of(what, said)
        counts = counts_of(what, said)
        if word is None and not counts:
            raise ConfigError(_unknown_words(what))
        objects += [word] if word is not None else []
    by_model = (object_of(w, Said("language model", w, CERTAINTIES.model)) for w in seen if w)
    objects += [word for word in by_model if word is not None][:1]
    if use_names:
        objects += _objects(mesh, source, scene)
        if source is not None and not counts:
            words = " ".join(words_of(source.stem))  # its numbers are mostly no counts
            counts = counts_of(words, Said("file name", source.stem, CERTAINTIES.file))
    parts: list[PartStatement] = []
    alike: tuple[tuple[str, ...], ...] = ()
    if use_names:
        parts = _named(mesh, scene)
        if scene is not None and mesh_T_file is not None:
            parts = with_pivots(mesh, scene, mesh_T_file, parts)
        if scene is not None:
            alike = _alike(mesh, scene)
    parts = [_of_object(p, objects) for p in parts]
    if scene is not None and mesh_T_file is not None:
        moved, why = _animated(mesh, scene, mesh_T_file)
        taken = {g for p in moved for g in p.groups}
        parts = moved + [p for p in parts if not taken & set(p.groups)]
        notes += why
    if scene is not None and scene.skins and not scene.motions:
        notes.append("the file has a skin without animation, which says nothing of joints")
    notes = [note for note in (told(parts), _object_note(objects)) if note] + notes
    return KinematicSpec(hints, tuple(objects), tuple(parts), counts, alike, tuple(notes))


def _scene(source: Path) -> Scene | None:
    """The nodes of a file, where its format has any and they can be read."""
    if source.suffix.lower() not in (".dae", ".glb", ".gltf"):
        return None
    try:
        return read_file(source).scene
    except InputError:
        return None


def _of_object(part: PartStatement, objects: Sequence[ObjectWord]) -> PartStatement:
    """A statement with what is known of such parts in such an object.

    A globe's globe spins, a bucket's handle swings, and a hammer's head stays where it is. A part
    without a name is taken for the most usual one that moves so.
    """
    if not objects:
        return part
    thing = kinds().objects[objects[0].word]
    kind = part.kind or _usual_kind(thing, part)
    usual = thing.part(kind)
    if usual is None:
        if part.movable and kind in thing.still:
            said = replace(part.said, certainty=CERTAINTIES.still * part.said.certainty)
            return replace(part, said=said, chance=CERTAINTIES.still * part.chance)
        return part
    slides = part.moves == "slide" and usual.moves == "hinge"  # its name says that it slides
    if slides:
        return replace(part, chance=max(part.chance, usual.often))
    certainty = CERTAINTIES.name * (
        max(CERTAINTIES.name, usual.often) if part.movable else usual.often
    )
    return replace(
        part, kind=kind, moves=part.moves if part.axis is not None else usual.moves,
        line=usual.line, side=usual.side, travel=usual.travel,
        chance=max(part.chance, usual.often) if part.movable else usual.often,
        said=replace(part.said, certainty=max(part.said.certainty, certainty)),
    )  # fmt: skip


def _usual_kind(thing: ObjectKind, part: PartStatement) -> str:
    """The kind of the most usual part that moves as a nameless one does; "" where none does."""
    upright = part.axis is not None and abs(part.axis[2]) > np.sqrt(0.5)
    line = "upright" if upright else "level"
    fitting = (p.kind for p in thing.parts if p.moves == part.moves and p.line in ("", line))
    return next(fitting, "")


def usual_size(source: Path, what: str | None = None, use_names: bool = True) -> Range | None:
    """Lowest, usual and highest largest side of such an object, metres; None where nobody says
    what it is."""
    name = kind_named(source, what, use_names)
    return size_of_kind(name) if name else None


def kind_named(source: Path, what: str | None = None, use_names: bool = True) -> str:
    """The kind of object that the user, or else the file's name, says; "" where neither does."""
    name = what or (source.stem if use_names else "")
    word = object_of(name, Said("file name", name)) if name else None
    return "" if word is None else word.word


def named_size(what: str) -> tuple[str, Range | None]:
    """The kind of object that words name, and its usual size (see `usual_size`)."""
    word = object_of(what, Said("user", what)) if what else None
    return ("", None) if word is None else (word.word, size_of_kind(word.word))


def _unknown_words(what: str) -> str:
    known = [w for w in kinds().object_words if w.isascii()]
    near = difflib.get_close_matches(what.casefold().split()[-1] if what.split() else "", known, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"--what {what!r}: no object or number of parts in it that is known here{hint}"


def _object_note(objects: Sequence[ObjectWord]) -> str:
    if not objects:
        return ""
    first = objects[0]
    known = kinds().objects[first.word]
    moving = [p.kind for p in known.parts if p.often >= CERTAINTIES.usual]
    usual = f"usually moves: {', '.join(moving)}" if moving else "nothing usually moves"
    by = {"user": "as told", "language model": "as a language model says"}
    source = by.get(first.said.origin, f"by its {first.said.origin}")
    article = "an" if first.word[:1] in "aeiou" else "a"
    return f"taken for {article} {first.word} ({source}: {first.said.detail!r}): {usual}"


def _objects(mesh: Mesh, source: Path | None, scene: Scene | None) -> list[ObjectWord]:
    """What the file's own name and its topmost node say that it is."""
    names: list[tuple[str, Said]] = []
    if source is not None:
        names.append((source.stem, Said("file name", source.stem, CERTAINTIES.file)))
    roots = [] if scene is None else [n.name for n in scene.nodes if n.parent < 0]
    if len(roots) == 1:
        names.append((roots[0], Said("name", roots[0], CERTAINTIES.file)))
    if len(mesh.group_names) == 1:
        only = mesh.group_names[0]
        names.append((only, Said("name", only, CERTAINTIES.file)))
    found = [object_of(name, said) for name, said in names]
    out: dict[str, ObjectWord] = {}
    for word in found:
        if word is not None:
            out.setdefault(word.word, word)
    return list(out.values())


def _named(mesh: Mesh, scene: Scene | None) -> list[PartStatement]:
    """Statements by the names of nodes and groups, else by those of materials."""
    groups = _present(mesh)
    if len(groups) > 1:
        if shared_kind(groups) is not None:
            return []
        out = _by_nodes(mesh, scene) if scene is not None else _by_groups(groups)
        if out:
            return _sensible(out, mesh)
    names = [m.name for m in mesh.materials]
    assert mesh.face_material is not None
    used = [names[k] for k in np.unique(mesh.face_material)]
    if len(used) < 2 or shared_kind(used) is not None:
        return []
    found = [
        _statement(name, kind, Said("material", name, CERTAINTIES.material), materials=(name,))
        for name, kind in ((n, part_kind_of(n)) for n in dict.fromkeys(used)) if kind is not None
    ]  # fmt: skip
    return _sensible(found, mesh)


def _present(mesh: Mesh) -> list[str]:
    """Names of the groups that have faces."""
    assert mesh.face_group is not None
    return [mesh.group_names[k] for k in np.unique(mesh.face_group)]


def _statement(
    name: str, kind: PartKind, said: Said, groups: tuple[str, ...] = (),
    materials: tuple[str, ...] = (),
) -> PartStatement:  # fmt: skip
    return PartStatement(
        name, kind.kind, kind.moves, Said(said.origin, said.detail, said.certainty * _clear(kind)),
        groups, materials, kind.line, kind.side, kind.travel, kind.sure,
    )  # fmt: skip


def _clear(kind: PartKind) -> float:
    """How clear a kind is on whether it moves: 1 for a drawer or a wall, 0 for either."""
    return abs(2.0 * kind.sure - 1.0)


def _by_groups(groups: Sequence[str]) -> list[PartStatement]:
    found = ((name, part_kind_of(name)) for name in groups)
    return [
        _statement(name, kind, Said("name", name, CERTAINTIES.name), (name,))
        for name, kind in found if kind is not None
    ]  # fmt: skip


def _by_nodes(mesh: Mesh, scene: Scene) -> list[PartStatement]:
    """A named node with all below it, but for what below has a name of its own that counts."""
    own = {i: part_kind_of(n.name) for i, n in enumerate(scene.nodes)}
    present = set(_present(mesh))
    out = []
    for i, node in enumerate(scene.nodes):
        kind = own[i]
        above = scene.nodes[i].parent
        if kind is None or (above >= 0 and _same(own.get(above), kind)):
            continue
        if kind.moves in ("fixed", "with") and _in_movable(scene, above, own):
            continue  # the frame of a door goes with the door
        groups = tuple(g for g in _groups_below(scene, i, own) if g in present)
        if groups:
            said = Said("name", node.name, CERTAINTIES.name)
            out.append(_statement(node.name, kind, said, groups))
    return out


def _in_movable(scene: Scene, index: int, own: Mapping[int, PartKind | None]) -> bool:
    """Whether a node or one above it is said to move."""
    while index >= 0:
        kind = own[index]
        if kind is not None and kind.moves in ("hinge", "spin", "slide"):
            return True
        index = scene.nodes[index].parent
    return False


def _same(above: PartKind | None, kind: PartKind) -> bool:
    return above is not None and above.kind == kind.kind


def _groups_below(scene: Scene, index: int, own: Mapping[int, PartKind | None]) -> list[str]:
    """Groups of a node and of those below it that belong to it.

    What moves takes all along but what moves by itself; what stands still only the nameless.
    """
    top = own[index]
    out, todo = [], [index]
    while todo:
        k = todo.pop()
        kind = own[k]
        if k != index and kind is not None and top is not None and kind.kind != top.kind:
            moves_alone = kind.moves in ("hinge", "spin", "slide")
            if moves_alone or top.moves == "fixed":
                continue
        if scene.nodes[k].group:
            out.append(scene.nodes[k].group)
        todo += [i for i, n in enumerate(scene.nodes) if n.parent == k]
    return out


def _sensible(parts: list[PartStatement], mesh: Mesh) -> list[PartStatement]:
    """Without what is the whole object, and without words that far too many things have."""
    area = face_geometry(mesh.vertices, mesh.faces)[1]
    total = max(float(area.sum()), 1e-15)
    number: dict[str, int] = {}
    for part in parts:
        number[part.kind] = number.get(part.kind, 0) + 1
    return [
        p for p in parts
        if number[p.kind] <= CERTAINTIES.many
        and not (p.movable and float(area[p.faces(mesh)].sum()) > CERTAINTIES.whole * total)
    ]  # fmt: skip


def with_pivots(
    mesh: Mesh, scene: Scene, mesh_T_file: FloatArray, parts: Sequence[PartStatement]
) -> list[PartStatement]:
    """Statements with the hinge lines that their nodes' own origins show, and those of nameless
    nodes that show one.

    Args:
        mesh_T_file: (4, 4) similarity. parts: by names.
    """
    origins = np.array([(mesh_T_file @ node.world)[:3, 3] for node in scene.nodes]).reshape(-1, 3)
    out, present = list(parts), set(_present(mesh))
    taken = {g for p in parts for g in p.groups}
    area = face_geometry(mesh.vertices, mesh.faces)[1]
    fresh, own = [], 0
    shown = {motion.node for motion in scene.motions}
    for i, node in enumerate(scene.nodes):
        below = scene.below(i)
        groups = tuple(g for g in (scene.nodes[k].group for k in below) if g in present)
        if i in shown or not groups or not _own_origin(scene, i, groups, origins, mesh.diagonal):
            continue
        k = next((k for k, p in enumerate(parts) if p.name == node.name and p.groups
                  and set(p.groups) <= set(groups)), -1)  # fmt: skip
        known = parts[k] if k >= 0 else PartStatement(
            node.name, "", "hinge", Said("hierarchy", node.name, CERTAINTIES.pivot), groups,
            chance=CERTAINTIES.pivot,
        )  # fmt: skip
        own += 1
        faces = known.faces(mesh)
        whole = area[faces].sum() > CERTAINTIES.whole * area.sum()
        if known.moves != "hinge" or whole or (k < 0 and taken & set(groups)):
            continue
        points = mesh.vertices[mesh.faces[faces].reshape(-1)]
        axis = hinge_axis(points, origins[i], known.line)
        if axis is None:
            continue
        placed = replace(known, axis=axis, origin=origins[i])
        if k >= 0:
            out[k] = placed
        else:
            fresh.append(placed)
    many = len(fresh) >= CERTAINTIES.few and len(fresh) > CERTAINTIES.habit * own
    return out if many else out + fresh


def _own_origin(
    scene: Scene, index: int, groups: Sequence[str], origins: FloatArray, diagonal: float
) -> bool:
    """Whether nothing but a node itself, what is below it, and what has it alone stands there."""
    mine = {*scene.below(index)}
    above = scene.nodes[index].parent
    while above >= 0:
        if {scene.nodes[k].group for k in scene.below(above)} - {""} <= set(groups):
            mine.add(above)
        above = scene.nodes[above].parent
    others = [k for k in range(len(scene.nodes)) if k not in mine]
    return len(others) > 0 and own_origin(origins[index], origins[others], diagonal)


def _alike(mesh: Mesh, scene: Scene) -> tuple[tuple[str, ...], ...]:
    """Groups of nodes that show one and the same mesh."""
    present = set(_present(mesh))
    by_mesh: dict[int, list[str]] = {}
    for node in scene.nodes:
        if node.mesh >= 0 and node.group in present:
            by_mesh.setdefault(node.mesh, []).append(node.group)
    return tuple(tuple(groups) for groups in by_mesh.values() if len(groups) > 1)


def _animated(
    mesh: Mesh, scene: Scene, mesh_T_file: FloatArray
) -> tuple[list[PartStatement], list[str]]:
    """Joints that animations show, and what of them is no joint, in words."""
    area = face_geometry(mesh.vertices, mesh.faces)[1]
    present = set(_present(mesh))
    out: dict[int, PartStatement] = {}
    notes = []
    for motion in scene.motions:
        node = scene.nodes[motion.node]
        below = (scene.nodes[k].group for k in scene.below(motion.node))
        groups = tuple(g for g in below if g in present)
        if not groups or motion.node in out:
            continue
        part = _shown(node, groups, joint_of(scene, motion, mesh_T_file, mesh.diagonal))
        name = node.name or f"node {motion.node}"
        if isinstance(part, str):
            if part != "it does not move":
                notes.append(f"the animation of {name!r} is no joint: {part}")
        elif area[part.faces(mesh)].sum() > CERTAINTIES.whole * area.sum():
            notes.append(f"the animation of {name!r} moves the whole object and says no joint")
        else:
            out[motion.node] = part
    return _own_faces(scene, out), notes


def _own_faces(scene: Scene, moved: Mapping[int, PartStatement]) -> list[PartStatement]:
    """Statements without the groups of animated nodes below them, which move by themselves."""
    out = []
    for node, part in moved.items():
        inner = {
            scene.nodes[k].group
            for other in moved if other != node and other in scene.below(node)
            for k in scene.below(other)
        }  # fmt: skip
        groups = tuple(g for g in part.groups if g not in inner)
        if groups:
            out.append(replace(part, groups=groups))
    return out


def _shown(
    node: SceneNode, groups: tuple[str, ...], joint: AnimatedJoint | str
) -> PartStatement | str:
    if isinstance(joint, str):
        return joint
    kind = part_kind_of(node.name)
    usual = {"hinge": "flap", "spin": "wheel", "slide": "slider"}[joint.subtype]
    moves = joint.subtype
    return PartStatement(
        node.name or groups[0], kind.kind if kind is not None and kind.moves == moves else usual,
        moves, Said("animation", joint.animation, CERTAINTIES.animation), groups, chance=1.0,
        axis=joint.axis, origin=joint.origin, limits=joint.limits,
    )  # fmt: skip
