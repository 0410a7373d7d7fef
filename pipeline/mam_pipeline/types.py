"""The nouns that flow between the stages: frozen dataclasses with read-only arrays.

Frames and units: everything is in the asset frame (metres, Z up, front towards -X, floor at
z = 0) at the rest pose q = 0, unless a docstring says otherwise. Angles are radians.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mam_pipeline.holding import Balance, Catch

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
JointType = Literal["fixed", "revolute", "continuous", "prismatic"]
JointSubtype = Literal["fixed", "hinge", "spin", "slide"]
GraspKind = Literal["handle", "knob", "edge", "rim", "push"]
Provenance = Literal["observed", "inferred", "model", "assumed", "user"]
"""Who says something: what was measured or read, our own reasoning, a language model that was
asked, a rule, or a person."""
Axis = Literal["x", "-x", "y", "-y", "z", "-z"]  # of a file: which of them, and which way
RangeRule = Literal[
    "",
    "given",
    "usual",
    "depth",
    "twin",
    "collision",
    "contact_loss",
    "endless",
    "token",
    "paper",
    "drawer_box",
]
NEEDS_REVIEW = 0.7  # of joints of less confidence at least three in ten are wrong
MOVES = 0.25  # a joint by which the part goes less of the usual way is stuck
FAR_ENOUGH = 0.15  # of its own length: a part that goes less is hardly of use


def readonly(array: ArrayLike, dtype: Any, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return `array` as a read-only array of `dtype`, checked against `shape` (None = any)."""
    out = np.array(array, dtype=dtype)
    if out.ndim != len(shape) or any(w is not None and w != g for w, g in zip(shape, out.shape)):
        raise ValueError(f"expected shape {shape}, got {out.shape}")
    out.setflags(write=False)
    return out


@dataclass(frozen=True)
class Material:
    """Surface appearance of some faces; `image` holds the source's bytes, untouched."""

    name: str = "default"
    base_color: tuple[float, float, float, float] = (0.7, 0.7, 0.7, 1.0)
    image: bytes | None = None
    image_format: Literal["png", "jpeg"] | None = None
    metallic: float = 0.0
    roughness: float = 0.8


@dataclass(frozen=True)
class Mesh:
    """A static triangle mesh with its appearance; vertices are never welded or moved.

    Attributes:
        vertices: (V, 3) metres.
        faces: (F, 3) vertex indices; face order is that of the source.
        materials: one or more; `face_material` (F,) indexes them.
        uv: (V, 2) texture coordinates (glTF convention: v downwards), or None.
        colors: (V, 4) uint8 vertex colours, or None.
        face_group: (F,) index into `group_names`: the source file's nodes or objects. It serves
            hints and reports; the engine never reasons on names.
    """

    vertices: FloatArray
    faces: IntArray
    materials: tuple[Material, ...] = (Material(),)
    face_material: IntArray | None = None
    uv: NDArray[np.float32] | None = None
    colors: NDArray[np.uint8] | None = None
    face_group: IntArray | None = None
    group_names: tuple[str, ...] = ("mesh",)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "vertices", readonly(self.vertices, np.float64, (None, 3)))
        put(self, "faces", readonly(self.faces, np.int64, (None, 3)))
        v, f = len(self.vertices), len(self.faces)
        for name in ("face_material", "face_group"):
            value = getattr(self, name)
            put(self, name, readonly(np.zeros(f) if value is None else value, np.int64, (f,)))
        if self.uv is not None:
            put(self, "uv", readonly(self.uv, np.float32, (v, 2)))
        if self.colors is not None:
            put(self, "colors", readonly(self.colors, np.uint8, (v, 4)))

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) lower and upper corner of the axis-aligned box of the used vertices, metres."""
        points = self.vertices[self.faces.reshape(-1)]
        return readonly([points.min(axis=0), points.max(axis=0)], np.float64, (2, 3))

    @property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal, metres: the unit of every relative threshold."""
        low, high = self.bounds
        return float(np.linalg.norm(high - low))

    def submesh(self, face_mask: NDArray[Any]) -> Mesh:
        """Return the faces selected by a boolean mask or index array, with their vertices only."""
        faces = self.faces[face_mask]
        used, inverse = np.unique(faces.reshape(-1), return_inverse=True)
        assert self.face_material is not None and self.face_group is not None
        return replace(
            self,
            vertices=self.vertices[used],
            faces=inverse.reshape(-1, 3),
            face_material=self.face_material[face_mask],
            face_group=self.face_group[face_mask],
            uv=None if self.uv is None else self.uv[used],
            colors=None if self.colors is None else self.colors[used],
        )

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """Return the mesh moved by a (4, 4) similarity transform (target_T_source)."""
        m = np.asarray(matrix, dtype=np.float64)
        return replace(self, vertices=self.vertices @ m[:3, :3].T + m[:3, 3])


@dataclass(frozen=True)
class Primitives:
    """A disjoint over-segmentation of the faces (paper 3.2: P = {p_1 .. p_m}).

    Attributes:
        labels: (F,) primitive index of every face, 0 .. count - 1, none missing.
        merges: (count - 1 or fewer, 2) greedy merge order for fused meshes: row k joins the two
            nodes named into node count + k (as in a SciPy linkage), cheapest first. Empty for
            authored meshes, whose components are final.
        method: which segmenter made them.
        fronts: (T, count) the primitives of each front of several whose gaps have closed, with its
            handle: what moves as one body, and apart from the others.
    """

    labels: IntArray
    merges: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    method: str = "geometric"
    fronts: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", readonly(self.labels, np.int64, (None,)))
        object.__setattr__(self, "merges", readonly(self.merges, np.int64, (None, 2)))
        fronts = self.fronts if len(self.fronts) else np.zeros((0, self.count))
        object.__setattr__(self, "fronts", readonly(fronts, np.bool_, (None, self.count)))

    @property
    def count(self) -> int:
        """Number of primitives."""
        return int(self.labels.max()) + 1 if len(self.labels) else 0

    @property
    def is_fused(self) -> bool:
        """Whether it was cut out of one surface, see `fused_by_cuts`."""
        return fused_by_cuts(self.merges, self.count)


FUSED_CUTS = 0.8  # share of the cuts that undo merges: above it a mesh is fused


def fused_by_cuts(merges: IntArray | None, count: int) -> bool:
    """Whether (nearly) all primitives were cut out of one surface: generated and scanned ones.

    What separates parts there is the cuts' creases, not gaps: other weights judge such objects.

    Args:
        merges: (M, 2) as in `Primitives`. count: of primitives.
    """
    return merges is not None and len(merges) > FUSED_CUTS * max(count - 1, 1)


@dataclass(frozen=True)
class UsualTravel:
    """How far such joints go: radians, or shares of the part's extent along a slide.

    Attributes:
        open: from rest to open. back: from rest to closed; 0 when rest is closed.
        endless: probability that a revolute joint has no limits.
    """

    open: float
    back: float
    endless: float


@dataclass(frozen=True)
class JointCandidate:
    """One hypothesis for a part's joint.

    Attributes:
        subtype: hinge, spin, slide (or fixed).
        axis: (3,) unit vector, asset frame; positive motion opens where that is known.
        origin: (3,) a point on the axis, asset frame.
        score: higher is better; comparable only among the candidates of one part.
        evidence: named terms that make up the score, for the report alone.
        kind_probability: that the part moves in this kind of way (fixed, slide or revolute);
            None where nobody ranked.
        within_kind: probability among the candidates of its kind; None where nobody ranked.
        travel: how far such joints usually go; None where it is not known.
    """

    subtype: JointSubtype
    axis: FloatArray
    origin: FloatArray
    score: float = 0.0
    evidence: Mapping[str, float] = field(default_factory=dict)
    kind_probability: float | None = None
    within_kind: float | None = None
    travel: UsualTravel | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", readonly(self.axis, np.float64, (3,)))
        object.__setattr__(self, "origin", readonly(self.origin, np.float64, (3,)))


@dataclass(frozen=True)
class PartNode:
    """One rigid part in the kinematic tree, before its joint is estimated.

    Attributes:
        name: unique, a valid link name.
        kind: drawer, door, lid, knob, wheel, handle, button, lever, panel, body ... (free word).
        primitives: indices into Primitives.
        parent: index of the parent node; -1 for the base, which is node 0.
        subtype: how it moves against its parent; "fixed" for the base.
        confidence: calibrated probability that part, parent and subtype are right, 0..1.
        runner_up: the second-best explanation in words, or "".
        provenance: who says so; what a person said or edited is `user` and is never changed, and
            what a language model answered is `model`.
        candidates: joint hypotheses, best first; may be empty (the solver then makes its own).
        limits: (lower, upper) that a person or the reasoner set, radians or metres; else None.
        dormant: why the part is kept still though it may move, in words; "" for one that is awake.
        evidence: what explains the part, for the report alone.
    """

    name: str
    kind: str
    primitives: tuple[int, ...]
    parent: int
    subtype: JointSubtype
    confidence: float = 1.0
    runner_up: str = ""
    provenance: Provenance = "inferred"
    candidates: tuple[JointCandidate, ...] = ()
    limits: tuple[float, float] | None = None
    dormant: str = ""
    evidence: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class KinematicTree:
    """The articulation tree (paper 3.3): parts, parents, joint subtypes; node 0 is the base.

    Dormant parts are nodes too; `dormant.awake` is the tree as it moves.
    """

    nodes: tuple[PartNode, ...]

    def __post_init__(self) -> None:
        if not self.nodes or self.nodes[0].parent != -1:
            raise ValueError("node 0 must be the base, with parent -1")
        for i, node in enumerate(self.nodes[1:], start=1):
            if not 0 <= node.parent < len(self.nodes) or node.parent == i:
                raise ValueError(f"part {node.name!r} has no valid parent")


@dataclass(frozen=True)
class RangeBasis:
    """What the range of a joint rests on.

    Attributes:
        rule: what ended it: `given` by a person, the reasoner or a file; the `usual` way; a share
            of its own or the body's `depth`, which is assumed; the way of a `twin`; a `collision`;
            `contact_loss` of a slide; `endless`, a free whole turn; `token`, for nothing is free;
            the `paper`'s rule; an assumed `drawer_box`; "" where nobody says.
        share: of the usual way that is free, 0..1; 1 where nobody measured.
        after_another: another part must move first, as the door before a drawer.
        of_part: the way over the part's own length along it: extent of a slide, radius of a turn;
            1 where nobody measured.
    """

    rule: RangeRule = ""
    share: float = 1.0
    after_another: bool = False
    of_part: float = 1.0

    @property
    def short(self) -> str:
        """Why the range is hardly of use, in words; empty where it is."""
        if self.share < MOVES:
            return f"stuck after {100 * self.share:.0f} % of the usual way"
        if self.of_part < FAR_ENOUGH:
            return f"goes only {100 * self.of_part:.0f} % of its own length"
        return ""

    def cut(self, share: float) -> RangeBasis:
        """What it is of a range that was cut to a share."""
        return replace(self, share=self.share * share, of_part=self.of_part * share)


@dataclass(frozen=True)
class Coupling:
    """What a joint follows (`<mimic>` in a URDF): value = multiplier * leader's value + offset.

    Attributes:
        joint: name of the leader, which follows none.
        multiplier: rad or m of this joint for each rad or m of the leader. offset: rad or m.
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0

    def value(self, leader: float) -> float:
        """Value of the joint that follows."""
        return self.multiplier * leader + self.offset


def coupled(
    values: Mapping[str, float], couplings: Mapping[str, Coupling | None]
) -> dict[str, float]:
    """Joint values that agree with their couplings: of each group one value moves all.

    Args:
        values: of some joints; the last one that is named of a group decides.
        couplings: of all joints by name; None for those that follow none.
    """
    out = dict(values)
    leaders = {}
    for name, value in values.items():
        own = couplings.get(name)
        if own is None:
            leaders[name] = value
        elif own.multiplier:
            leaders[own.joint] = (value - own.offset) / own.multiplier
    for name, own in couplings.items():
        if own is not None and own.joint in leaders:
            out[own.joint] = leaders[own.joint]
            out[name] = own.value(leaders[own.joint])
    return out


@dataclass(frozen=True)
class Joint:
    """One estimated joint between two links.

    Attributes:
        parent, child: link indices.
        axis: (3,) unit vector, asset frame at q = 0; positive q opens.
        origin: (3,) point on the axis, asset frame (for a slide: the child's contact centroid).
        lower, upper: range of q (radians or metres) with q = 0 the source's pose; infinite
            for continuous joints.
        closed, open: which joint values are called closed and open (within the range).
        damping, friction, effort, velocity: SI; friction is Coulomb (SAPIEN ignores the URDF's).
        friction_range: from the easiest such bearing to the stiffest; (0, 0) where nobody knows.
        catch: what keeps it closed besides friction; None where nobody says.
        balance: what carries its weight; None where friction holds it.
        confidence: 0..1; below `NEEDS_REVIEW` the report says so.
        evidence: anything that explains the choice, for asset.json and the report alone.
        basis: why the range is what it is. provenance: who says that the part moves so.
        coupling: what the joint follows; None where it moves on its own.
        dormant: why it is kept fixed, in words; "" for a joint that moves.
    """

    name: str
    type: JointType
    subtype: JointSubtype
    parent: int
    child: int
    axis: FloatArray
    origin: FloatArray
    lower: float
    upper: float
    closed: float = 0.0
    open: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    effort: float = 100.0
    velocity: float = 2.0
    friction_range: tuple[float, float] = (0.0, 0.0)
    catch: Catch | None = None
    balance: Balance | None = None
    confidence: float = 1.0
    evidence: Mapping[str, Any] = field(default_factory=dict)
    basis: RangeBasis = field(default_factory=RangeBasis)
    provenance: Provenance = "inferred"
    coupling: Coupling | None = None
    dormant: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", readonly(self.axis, np.float64, (3,)))
        object.__setattr__(self, "origin", readonly(self.origin, np.float64, (3,)))


@dataclass(frozen=True)
class Link:
    """One rigid body: `faces` (n,) index the articulation's mesh."""

    name: str
    kind: str
    faces: IntArray
    primitives: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", readonly(self.faces, np.int64, (None,)))


@dataclass(frozen=True)
class Grasp:
    """Where a gripper takes hold of, or pushes, a link, at the rest pose in the asset frame.

    Attributes:
        joint, link: names.
        kind: handle | knob | edge | rim | push.
        position: (3,) point between the fingertips (for push: the contact point).
        approach: (3,) unit vector in which the hand travels towards the object.
        closing: (3,) unit vector along which the fingers close (for push: any perpendicular).
        width: opening needed between the fingers, metres.
        depth: how far the fingertips may reach past `position` along `approach`, metres.
    """

    joint: str
    link: str
    kind: GraspKind
    position: FloatArray
    approach: FloatArray
    closing: FloatArray
    width: float
    depth: float = 0.02
    confidence: float = 1.0
    provenance: Provenance = "inferred"

    def __post_init__(self) -> None:
        for name in ("position", "approach", "closing"):
            object.__setattr__(self, name, readonly(getattr(self, name), np.float64, (3,)))


@dataclass(frozen=True)
class CollisionShape:
    """One convex collision piece of a link, asset frame at rest.

    Attributes:
        kind: box | cylinder | sphere | convex.
        pose: (4, 4) asset_T_shape; identity for convex.
        size: box: full extents x, y, z; cylinder: radius, length (along local z), 0;
            sphere: radius, 0, 0. Metres.
        vertices, faces: (n, 3), (m, 3) hull of a convex piece, asset frame.
    """

    kind: Literal["box", "cylinder", "sphere", "convex"]
    pose: FloatArray = field(default_factory=lambda: np.eye(4))
    size: FloatArray = field(default_factory=lambda: np.zeros(3))
    vertices: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    faces: IntArray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", readonly(self.pose, np.float64, (4, 4)))
        object.__setattr__(self, "size", readonly(self.size, np.float64, (3,)))
        object.__setattr__(self, "vertices", readonly(self.vertices, np.float64, (None, 3)))
        object.__setattr__(self, "faces", readonly(self.faces, np.int64, (None, 3)))


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass (3,) and inertia (3, 3) about it, asset frame axes at rest.

    Attributes:
        material: the assumption in words. source: where its figures come from.
        mass_range: that such a body may weigh, kg; (0, 0) where nobody knows.
        friction: Coulomb's coefficient of contacts. restitution: share of the speed after a hit.
    """

    mass: float
    center: FloatArray
    inertia: FloatArray
    material: str = ""
    source: str = ""
    mass_range: tuple[float, float] = (0.0, 0.0)
    friction: float = 0.4
    restitution: float = 0.3

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", readonly(self.center, np.float64, (3,)))
        object.__setattr__(self, "inertia", readonly(self.inertia, np.float64, (3, 3)))


@dataclass(frozen=True)
class DormantPart:
    """A part that may move and is kept still: it is part of another link until it is woken.

    Attributes:
        link: its faces; the link that carries them has them too.
        joint: as it would be; `parent` is the carrying link, and `child` names none (-1).
    """

    link: Link
    joint: Joint


@dataclass(frozen=True)
class Articulation:
    """A mesh cut into links and the joints between them; link 0 is the base.

    Every face belongs to exactly one link. Joints come in topological order (parents first), one
    per link other than the base. Dormant parts are beside these: nothing else depends on them.
    """

    mesh: Mesh
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    grasps: tuple[Grasp, ...] = ()
    dormant: tuple[DormantPart, ...] = ()

    @property
    def face_link(self) -> IntArray:
        """(F,) link index of every face."""
        out = np.full(len(self.mesh.faces), -1, dtype=np.int64)
        for i, link in enumerate(self.links):
            out[link.faces] = i
        return out

    def joint_of(self, link: int) -> Joint | None:
        """The joint whose child is `link`, or None for the base."""
        return next((j for j in self.joints if j.child == link), None)

    def carried_links(self, joint: Joint) -> list[int]:
        """The joint's child and every link behind it."""
        out = [joint.child]
        for other in self.joints:  # topological order: parents come first
            if other.parent in out:
                out.append(other.child)
        return out

    def link_poses(self, q: Mapping[str, float] | Sequence[float]) -> FloatArray:
        """Forward kinematics: (L, 4, 4) `asset_T_link` against the rest pose at joint values q."""
        values = q if isinstance(q, Mapping) else {j.name: v for j, v in zip(self.joints, q)}
        out = np.tile(np.eye(4), (len(self.links), 1, 1))
        for joint in self.joints:
            out[joint.child] = out[joint.parent] @ joint_motion(
                joint.type, joint.axis, joint.origin, values.get(joint.name, 0.0)
            )
        return out


def joint_motion(type_: JointType, axis: ArrayLike, origin: ArrayLike, value: float) -> FloatArray:
    """(4, 4) rigid motion of a child when its joint moves to `value` (rad or m) from rest.

    The frame is that in which `axis` and `origin` are given (the paper's T(x; v, q, phi)).
    """
    out = np.eye(4)
    a = np.asarray(axis, dtype=np.float64)
    if type_ == "prismatic":
        out[:3, 3] = a * value
    elif type_ in ("revolute", "continuous"):
        from scipy.spatial.transform import Rotation  # slow to import: not for reading --help

        out[:3, :3] = Rotation.from_rotvec(value * a).as_matrix()
        o = np.asarray(origin, dtype=np.float64)
        out[:3, 3] = o - out[:3, :3] @ o
    return out
