"""What the stages keep: how primitives, the prior, parts, joints and the photo's reconstruction are
written, read back and compared with what a person made of them.

`stage_store` decides when they are used again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
import yaml
from PIL import Image
from pydantic import Field

from mam_pipeline.arrays import Arrays
from mam_pipeline.backends import KinematicPrior, Reconstruction
from mam_pipeline.digests import text_digest
from mam_pipeline.doubt import Doubt
from mam_pipeline.edited import (
    STRICT,
    Direction,
    Finite,
    Index,
    Limit,
    NotNegative,
    Share,
    Text,
    Vector,
    Word,
    Wrong,
    no_cycle,
    no_doubles,
    read_yaml,
    validated,
)
from mam_pipeline.hints import load_hints, save_hints
from mam_pipeline.holding import Balance, Catch, wrong_of
from mam_pipeline.types import (
    Articulation,
    Coupling,
    DormantPart,
    Joint,
    JointCandidate,
    JointSubtype,
    JointType,
    KinematicTree,
    Link,
    Material,
    Mesh,
    PartNode,
    Primitives,
    Provenance,
    RangeBasis,
    UsualTravel,
)

MOST_ROWS = 2000
"""Parts, candidates, links or joints in one list."""
T = TypeVar("T")
Prints = dict[str, Any]


@dataclass(frozen=True)
class CandidateRow:
    """A joint hypothesis in parts.yaml; see `JointCandidate`."""

    __pydantic_config__ = STRICT
    subtype: JointSubtype
    axis: Direction
    origin: Vector
    score: Finite = 0.0
    evidence: dict[str, Any] = field(default_factory=dict)
    kind_probability: Share | None = None
    within_kind: Share | None = None
    travel: UsualTravel | None = None


@dataclass(frozen=True)
class PartRow:
    """A part in parts.yaml; see `PartNode`."""

    __pydantic_config__ = STRICT
    name: Word
    kind: Word
    primitives: tuple[Index, ...]
    parent: int
    subtype: JointSubtype
    confidence: Share = 1.0
    runner_up: Text = ""
    provenance: Provenance = "inferred"
    candidates: Annotated[tuple[CandidateRow, ...], Field(max_length=MOST_ROWS)] = ()
    limits: tuple[Limit, Limit] | None = None
    dormant: Text = ""
    evidence: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class LinkRow:
    """A link in joints.yaml; see `Link`."""

    __pydantic_config__ = STRICT
    name: Word
    kind: Word
    primitives: tuple[Index, ...] = ()


@dataclass(frozen=True)
class JointRow:
    """A joint in joints.yaml, its links by name; see `Joint`."""

    __pydantic_config__ = STRICT
    name: Word
    type: JointType
    subtype: JointSubtype
    parent: Word
    child: Word
    axis: Direction
    origin: Vector
    lower: Limit
    upper: Limit
    closed: Finite = 0.0
    open: Finite = 0.0
    damping: NotNegative = 0.0
    friction: NotNegative = 0.0
    friction_range: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    catch: Catch | None = None
    balance: Balance | None = None
    effort: NotNegative = 100.0
    velocity: NotNegative = 2.0
    confidence: Share = 1.0
    evidence: dict[str, Any] = field(default_factory=dict)
    basis: RangeBasis = field(default_factory=RangeBasis)
    provenance: Provenance = "inferred"
    coupling: Coupling | None = None
    dormant: Text = ""


@dataclass(frozen=True)
class JointFile:
    """What joints.yaml holds; of a dormant joint the child is a part in `dormant`."""

    __pydantic_config__ = STRICT
    links: Annotated[tuple[LinkRow, ...], Field(min_length=1, max_length=MOST_ROWS)]
    joints: Annotated[tuple[JointRow, ...], Field(max_length=MOST_ROWS)]
    dormant: Annotated[tuple[LinkRow, ...], Field(max_length=MOST_ROWS)] = ()


PartRows = Annotated[tuple[PartRow, ...], Field(min_length=1, max_length=MOST_ROWS)]
"""What parts.yaml holds."""


@dataclass(frozen=True)
class Codec(Generic[T]):
    """How the result of a stage is kept.

    Attributes:
        filename: of the artefact that a person may edit; `save` may write more beside it.
        save, load: write and read it; `load` takes the path that errors name as well, and raises
            ConfigError for what cannot be used.
        prints: what is remembered of the generated result, to find out what was edited.
        marked: the edited result with what differs from those prints marked as a person's.
    """

    filename: str
    save: Callable[[T, Path], None]
    load: Callable[[Path, Path], T]
    prints: Callable[[T], Prints] = lambda _value: {}
    marked: Callable[[T, Prints], T] = lambda value, _prints: value


def save_geometry(mesh: Mesh, folder: Path) -> None:
    """Keep the engine's input as <folder>/mesh.npz, for looking at later stages."""
    folder.mkdir(exist_ok=True)
    np.savez_compressed(
        folder / "mesh.npz",
        vertices=mesh.vertices.astype(np.float32),
        faces=mesh.faces.astype(np.int32),
    )


def load_geometry(folder: Path) -> Mesh:
    """Read back what `save_geometry` kept."""
    data = Arrays(folder / "mesh.npz")
    return Mesh(data["vertices"], data["faces"])


def _save_primitives(value: Primitives, path: Path) -> None:
    kept = {name: getattr(value, name) for name in ("labels", "merges", "method", "fronts")}
    np.savez_compressed(path, **kept)


def _load_primitives(path: Path, _shown: Path) -> Primitives:
    data = Arrays(path)
    fronts = data["fronts"] if "fronts" in data else np.zeros((0, 0), dtype=bool)
    return Primitives(data["labels"], data["merges"], str(data["method"]), fronts)


def _save_prior(value: KinematicPrior | None, path: Path) -> None:
    if value is None:
        np.savez_compressed(path, source="none")
        return
    np.savez_compressed(
        path,
        mobility=value.mobility,
        affinity=value.affinity,
        masks=value.masks.astype(np.int16),
        views=value.views,
        source=value.source,
        labels=value.labels,
        fov=value.fov,
    )


def _load_prior(path: Path, _shown: Path) -> KinematicPrior | None:
    data = Arrays(path)
    if "mobility" not in data:
        return None
    return KinematicPrior(
        data["mobility"],
        data["affinity"],
        data["masks"].astype(np.int64),
        data["views"],
        str(data["source"]),
        labels=data["labels"],
        fov=float(data["fov"]),
    )


def tree_codec(count: int) -> Codec[KinematicTree]:
    """Parts as YAML.

    Args:
        count: of the primitives; an edited tree must give each to one part.
    """

    def load(path: Path, shown: Path) -> KinematicTree:
        document = read_yaml(path, shown)
        rows: tuple[PartRow, ...] = validated(PartRows, document)
        try:
            tree = _tree(rows, count)
        except Wrong as wrong:
            raise document.wrong(wrong.place, str(wrong)) from wrong
        return tree

    return Codec("parts.yaml", _save_tree, load, _tree_prints, _marked_tree)


def _save_tree(tree: KinematicTree, path: Path) -> None:
    rows = [_node_row(node) for node in tree.nodes]
    header = "# Parts and joint types. Edit and run again: only what follows is computed anew.\n"
    path.write_text(
        header + yaml.safe_dump(rows, sort_keys=False, default_flow_style=None), encoding="utf-8"
    )


def _node_row(node: PartNode) -> dict[str, Any]:
    row: dict[str, Any] = _fields(node)
    row["confidence"] = round(float(node.confidence), 4)
    row["candidates"] = [_candidate_row(c) for c in node.candidates]
    row["evidence"] = row.pop("evidence")  # last: it is the longest
    return {k: v for k, v in row.items() if k not in ("limits", "dormant") or v}


def _candidate_row(candidate: JointCandidate) -> dict[str, Any]:
    return {k: v for k, v in _fields(candidate).items() if v is not None}


def _tree(rows: Sequence[PartRow], count: int) -> KinematicTree:
    """The tree of all rows.

    Raises:
        Wrong: they are none: its place is in the list of rows.
    """
    no_doubles([row.name for row in rows], (), "part")
    owner: dict[int, str] = {}
    for i, row in enumerate(rows):
        if not (row.parent == -1 if i == 0 else 0 <= row.parent < len(rows)):
            least = "-1: the first part is the base" if i == 0 else f"from 0 to {len(rows) - 1}"
            raise Wrong((i, "parent"), f"of part {row.name!r} must be {least}, not {row.parent}")
        if i == 0 and row.subtype != "fixed":
            raise Wrong((i, "subtype"), f"of the base must be fixed, not {row.subtype!r}")
        if row.limits is not None and not row.limits[0] <= row.limits[1]:
            raise Wrong((i, "limits"), f"of part {row.name!r} must be the lower, then the upper")
        for piece in row.primitives:
            if piece >= count:
                text = f"of part {row.name!r}: no primitive {piece} (0 to {count - 1})"
                raise Wrong((i, "primitives"), text)
            if piece in owner:
                text = f"of part {row.name!r}: primitive {piece} is in {owner[piece]!r} too"
                raise Wrong((i, "primitives"), text)
            owner[piece] = row.name
    missing = [k for k in range(count) if k not in owner]
    if missing:
        said = f"{', '.join(map(str, missing[:10]))}{' ...' if len(missing) > 10 else ''}"
        raise Wrong((), f"primitives {said} are in no part; what does not move is the base's")
    no_cycle({r.name: None if r.parent < 0 else rows[r.parent].name for r in rows}, ())
    return KinematicTree(tuple(_node(row) for row in rows))


def _node(row: PartRow) -> PartNode:
    data = {f.name: getattr(row, f.name) for f in fields(row)}
    data["candidates"] = tuple(
        JointCandidate(**{f.name: getattr(c, f.name) for f in fields(c)}) for c in row.candidates
    )
    return PartNode(**data)


def _tree_prints(tree: KinematicTree) -> Prints:
    rows = [_node_row(node) for node in tree.nodes]
    return {
        "parts": {row["name"]: _print(row) for row in rows},
        "candidates": sorted({_print(row["candidates"]) for row in rows}),
    }


def _marked_tree(tree: KinematicTree, prints: Prints) -> KinematicTree:
    """Parts that a person edited are the person's; hypotheses for the former part go.

    Candidates that the person wrote stay: they are obeyed.
    """
    nodes = []
    for node in tree.nodes:
        row = _node_row(node)
        if prints["parts"].get(node.name) != _print(row):
            own = () if _print(row["candidates"]) in prints["candidates"] else node.candidates
            node = replace(node, provenance="user", candidates=own)
        nodes.append(node)
    return replace(tree, nodes=tuple(nodes))


def articulation_codec(mesh: Mesh) -> Codec[Articulation]:
    """Joints as YAML, in the engine's frame; which face is whose lies beside it."""

    def save(value: Articulation, path: Path) -> None:
        asleep = [part.link for part in value.dormant]
        own: dict[str, Any] = {f"dormant_{k}": link.faces for k, link in enumerate(asleep)}
        np.savez_compressed(path.with_name("links.npz"), face_link=value.face_link, **own)

        def listed(links: Sequence[Link]) -> list[dict[str, Any]]:
            return [
                {"name": l.name, "kind": l.kind, "primitives": [int(p) for p in l.primitives]}
                for l in links
            ]

        rows = {"links": listed(value.links), "joints": _joint_rows(value)}
        if asleep:
            rows["dormant"] = listed(asleep)
        text = yaml.safe_dump(rows, sort_keys=False, default_flow_style=None)
        path.write_text(
            "# Joints in the engine's frame (metres, radians). Edit freely.\n" + text,
            encoding="utf-8",
        )

    def load(path: Path, shown: Path) -> Articulation:
        document = read_yaml(path, shown)
        file = validated(JointFile, document)
        kept = Arrays(path.with_name("links.npz"))
        face_link = kept["face_link"]
        own = [kept[name] for name in kept if name != "face_link"]
        try:
            _check_joints(file, int(face_link.max()) + 1, len(own))
        except Wrong as wrong:
            raise document.wrong(wrong.place, str(wrong)) from wrong
        links = tuple(
            Link(row.name, row.kind, np.flatnonzero(face_link == i), row.primitives)
            for i, row in enumerate(file.links)
        )
        index = {link.name: i for i, link in enumerate(links)}
        joints, asleep = [], {}
        for row in file.joints:
            data = {f.name: getattr(row, f.name) for f in fields(row)}
            ends = {"parent": index[row.parent], "child": index.get(row.child, -1)}
            if row.dormant:
                asleep[row.child] = Joint(**data | ends)
            else:
                joints.append(Joint(**data | ends))
        dormant = tuple(
            DormantPart(Link(row.name, row.kind, faces, row.primitives), asleep[row.name])
            for row, faces in zip(file.dormant, own)
        )
        return Articulation(mesh, links, tuple(joints), dormant=dormant)

    return Codec("joints.yaml", save, load, _joint_prints, _marked_joints)


def _check_joints(file: JointFile, count: int, asleep: int) -> None:
    """Raise `Wrong` where the joints do not hold `count` links together as a tree, and `asleep`
    dormant parts to them."""
    awake = [link.name for link in file.links]
    for place, rows, expected in (("links", awake, count), ("dormant", file.dormant, asleep)):
        if len(rows) != expected:
            raise Wrong((place,), f"must be the {expected} that the parts make, not {len(rows)}")
    names = [*awake, *(row.name for row in file.dormant)]
    no_doubles(names, ("links",), "link")
    no_doubles([joint.name for joint in file.joints], ("joints",), "joint")
    held = {names[0]}
    for i, joint in enumerate(file.joints):
        for key, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in names:
                raise Wrong(("joints", i, key), f"names no link: {link!r} ({', '.join(names)})")
        if joint.child in held:
            text = f"is {joint.child!r}, which another joint holds or which is the base"
            raise Wrong(("joints", i, "child"), text)
        if joint.parent not in held.intersection(awake):
            text = f"is {joint.parent!r}, which no joint before this one holds"
            raise Wrong(("joints", i, "parent"), text)
        if bool(joint.dormant) != (joint.child not in awake):
            raise Wrong(
                ("joints", i, "dormant"), "is for the parts in 'dormant': wake one by --accept NAME"
            )
        held.add(joint.child)
        bad = wrong_of(joint)
        if bad is not None:
            raise Wrong(("joints", i, *bad[0]), bad[1])
        finite = joint.type == "continuous" or np.isfinite(joint.upper - joint.lower)
        if not (joint.lower <= joint.upper and finite):
            text = f"must be finite and not below lower, {joint.lower:g}, not {joint.upper:g}"
            raise Wrong(("joints", i, "upper"), text)
    loose = [name for name in names if name not in held]
    if loose:
        raise Wrong(("joints",), f"hold no {', '.join(loose)}: every link but the first needs one")


def _joint_rows(value: Articulation) -> list[dict[str, Any]]:
    """The joints as joints.yaml has them, the dormant ones last."""
    names = [link.name for link in value.links]

    def row(joint: Joint, child: str) -> dict[str, Any]:
        out = {**_fields(joint), "parent": names[joint.parent], "child": child}
        return {k: v for k, v in out.items() if k not in ("catch", "dormant") or v}

    rows = [row(joint, names[joint.child]) for joint in value.joints]
    return rows + [row(part.joint, part.link.name) for part in value.dormant]


def _joint_prints(value: Articulation) -> Prints:
    return {row["name"]: _print(row) for row in _joint_rows(value)}


def _marked_joints(value: Articulation, prints: Prints) -> Articulation:
    """Joints that a person edited are the person's, range included."""
    now = _joint_prints(value)

    def marked(joint: Joint) -> Joint:
        if prints.get(joint.name) == now[joint.name]:
            return joint
        return replace(joint, provenance="user", basis=RangeBasis("given"))

    return replace(
        value,
        joints=tuple(marked(joint) for joint in value.joints),
        dormant=tuple(replace(d, joint=marked(d.joint)) for d in value.dormant),
    )


def _save_photo(made: Reconstruction, path: Path) -> None:
    save_hints(made.hints, path)
    save_mesh(made.mesh, path.with_name("mesh.npz"))
    for label, picture in made.pictures.items():
        Image.fromarray(picture).save(path.with_name(f"{label}.png"))
    told: dict[str, Any] = {"confidence": dict(made.confidence), "summary": made.summary}
    told |= {"assumed": list(made.assumed), "details": dict(made.details)}
    told["doubt"] = None if made.doubt is None else asdict(made.doubt)
    path.with_name("report.json").write_text(json.dumps(told, indent=1, default=str))


def _load_photo(path: Path, shown: Path) -> Reconstruction:
    told = json.loads(path.with_name("report.json").read_text(encoding="utf-8"))
    pictures = {p.stem: np.asarray(Image.open(p)) for p in sorted(path.parent.glob("*.png"))}
    doubt = told.get("doubt")
    return Reconstruction(
        load_mesh(path.with_name("mesh.npz")), load_hints(path, shown), told["confidence"],
        told["summary"], tuple(told["assumed"]), pictures, told["details"],
        None if doubt is None else Doubt(**{**doubt, "notes": tuple(doubt["notes"])}),
    )  # fmt: skip


def _photo_prints(made: Reconstruction) -> Prints:
    def numbers(value: Any) -> Any:  # a file does not tell 1 from 1.0
        if isinstance(value, dict):
            return {k: numbers(v) for k, v in value.items()}
        if isinstance(value, list):
            return [numbers(v) for v in value]
        return float(value) if isinstance(value, int) else value

    return {part.name: _print(numbers(_fields(part))) for part in made.hints.parts}


def _marked_photo(made: Reconstruction, prints: Prints) -> Reconstruction:
    """Parts of the hints that a person edited are the person's."""
    now = _photo_prints(made)
    parts = tuple(
        part if prints.get(part.name) == now[part.name] else replace(part, provenance="user")
        for part in made.hints.parts
    )
    return replace(made, hints=replace(made.hints, parts=parts))


def save_mesh(mesh: Mesh, path: Path) -> None:
    """Keep a mesh exactly, with materials and pictures, as one .npz."""
    arrays: dict[str, Any] = {"vertices": mesh.vertices, "faces": mesh.faces}
    arrays |= {"face_material": mesh.face_material, "face_group": mesh.face_group}
    arrays |= {k: v for k in ("uv", "colors") if (v := getattr(mesh, k)) is not None}
    arrays["group_names"] = np.array(mesh.group_names)
    for i, material in enumerate(mesh.materials):
        if material.image is not None:
            arrays[f"image_{i}"] = np.frombuffer(material.image, dtype=np.uint8)
    rows = [{**_fields(replace(m, image=None))} for m in mesh.materials]
    np.savez_compressed(path, materials=json.dumps(rows), **arrays)


def load_mesh(path: Path) -> Mesh:
    """Read back what `save_mesh` kept."""
    data = Arrays(path)
    materials = []
    for i, row in enumerate(json.loads(str(data["materials"]))):
        image = data[f"image_{i}"].tobytes() if f"image_{i}" in data else None
        row["base_color"] = tuple(row["base_color"])
        materials.append(Material(**{**row, "image": image}))
    given = {k: data[k] for k in ("face_material", "face_group", "uv", "colors") if k in data}
    names = tuple(str(n) for n in data["group_names"])
    return Mesh(data["vertices"], data["faces"], tuple(materials), group_names=names, **given)


def _fields(value: Any) -> dict[str, Any]:
    """A dataclass as YAML and JSON hold it; dataclasses within it are mappings."""

    def held(inner: Any) -> Any:
        return _fields(inner) if is_dataclass(inner) else plain(inner)

    return {f.name: held(getattr(value, f.name)) for f in fields(value)}


def _print(value: Any) -> str:
    return text_digest(json.dumps(value))[:16]


def plain(value: Any) -> Any:
    """Numpy values and tuples as what YAML and JSON hold; infinities become strings."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)


PRIMITIVES = Codec("primitives.npz", _save_primitives, _load_primitives)
PRIOR = Codec("prior.npz", _save_prior, _load_prior)
PHOTO = Codec("hints.yaml", _save_photo, _load_photo, _photo_prints, _marked_photo)
