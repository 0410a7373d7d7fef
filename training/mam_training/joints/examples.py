"""Features and exact labels of generated objects, from which the joint ranker is trained.

Only objects of `mam_world` and the reasoner's abstract mechanisms are used: never a
benchmark. Parts come as they are, as an imperfect grouping would hand them over (a handle lost, a
neighbour swallowed), and as pieces that do not move at all.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mam_pipeline.geometry.frames import ObjectFrame, estimate_frame
from mam_pipeline.geometry.sampling import face_geometry, unit
from mam_pipeline.joints.context import part_context
from mam_pipeline.joints.features import Hypothesis, enumerate_hypotheses, part_features
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint
from mam_training.parts.corpus import as_met, object_name, relabelled

AXIS_OK = 0.1
PIVOT_OK = 0.03
REST_CLOSED = 0.25  # resting farther from its closed end, as a share of its range, a hinge is open
OTHERS_KNOWN = 0.65  # share of examples that know their siblings: a reasoner may ask without


@dataclass(frozen=True)
class Example:
    """One part with its hypotheses and what is true of them.

    Attributes:
        name: object; category: its kind; fused: whether the mesh is one surface. variant: "true",
            "less" (pieces lost), "more" (pieces of others swallowed) or "still".
        kind: index into ranker.KINDS. subtype: of the true joint, or "fixed".
        part: row of PART_NAMES. hypotheses: with features.
        axis_error: (h,) folded angle to the true axis, radians; pivot_error: (h,) mean distance of
            the true line in diagonals (0 for slides). Both infinite where the kind is wrong.
        opens: (h,) +1 if the hypothesis's positive side is the truth's opening side, -1 if not, 0
            where that is unknown.
        reach: (2,) truth's travel from rest to open and to closed: radians, or share of the part's
            extent along the slide; infinite for endless joints.
    """

    name: str
    category: str
    fused: bool
    variant: str
    kind: int
    subtype: str
    part: FloatArray
    hypotheses: list[Hypothesis]
    axis_error: FloatArray
    pivot_error: FloatArray
    opens: IntArray
    reach: FloatArray

    @property
    def grade(self) -> IntArray:
        """(h,) 0 wrong, 1 near, 2 right; all 0 for parts that do not move."""
        near = (self.axis_error < AXIS_OK) & (self.pivot_error < PIVOT_OK)
        right = near & (self.axis_error < 0.06) & (self.pivot_error < 0.4 * PIVOT_OK)
        return near.astype(np.int64) + right


def line_error(points: FloatArray, truth: Joint, axis: FloatArray, origin: FloatArray) -> float:
    """Mean distance between the true axis, over the part's extent along it, and another line."""
    a = unit(truth.axis)
    along = (points - truth.origin) @ a
    spots = truth.origin + np.linspace(along.min(), along.max(), 9)[:, None] * a
    offset = spots - origin
    offset = offset - (offset @ axis)[:, None] * axis
    return float(np.linalg.norm(offset, axis=1).mean())


def examples(
    truth: Articulation, labels: IntArray, name: str, category: str, seed: int, *,
    fused: bool = False, per_object: int = 3, spoiled: float = 0.45, still: float = 0.4,
) -> Iterator[Example]:  # fmt: skip
    """Examples of one object.

    Args:
        labels: (F,) primitive of every face.
        per_object: most movable parts taken. spoiled, still: chances of one imperfect part and of
            one piece that does not move.
    """
    rng = np.random.default_rng(seed)
    frame = estimate_frame(truth.mesh)
    joints = _pick(truth, rng, per_object)
    for joint in joints:
        faces = np.flatnonzero(np.isin(truth.face_link, _with_descendants(truth, joint.child)))
        found = _example(truth, frame, joint, faces, "true", rng)
        if found is not None:
            yield _named(found, name, category, fused)
    with_spoiled, with_still = bool(joints) and rng.random() < spoiled, rng.random() < still
    if not (with_spoiled or with_still):
        return
    if with_spoiled:
        joint = joints[int(rng.integers(len(joints)))]
        spoil = _spoiled(truth, joint, labels, rng)
        if spoil is not None:
            found = _example(truth, frame, joint, spoil[1], spoil[0], rng)
            if found is not None:
                yield _named(found, name, category, fused)
    if with_still:
        for faces in _still_pieces(truth, labels, rng, 1):
            found = _example(truth, frame, None, faces, "still", rng)
            if found is not None:
                yield _named(found, name, category, fused)


def _named(found: Example, name: str, category: str, fused: bool) -> Example:
    return replace(found, name=name, category=category, fused=fused)


def _pick(truth: Articulation, rng: np.random.Generator, count: int) -> list[Joint]:
    """Up to `count` moving joints, one of every subtype first."""
    label = truth.face_link
    moving = [j for j in truth.joints if j.type != "fixed" and (label == j.child).sum() > 2]
    moving = [moving[i] for i in rng.permutation(len(moving))]
    first: dict[str, Joint] = {}
    for joint in moving:
        first.setdefault(joint.subtype, joint)
    chosen = list(first.values()) + [j for j in moving if first[j.subtype] is not j]
    return chosen[: max(count, 1)]


def _example(
    truth: Articulation, frame: ObjectFrame, joint: Joint | None, faces: IntArray, variant: str,
    rng: np.random.Generator,
) -> Example | None:  # fmt: skip
    """Measure one part; None if nothing stands still around it."""
    mesh, label = truth.mesh, truth.face_link
    mask = np.zeros(len(mesh.faces), dtype=bool)
    mask[faces] = True
    static = np.flatnonzero(~mask)
    if not len(static) or not len(faces):
        return None
    parent = static
    own: list[int] = []
    if joint is not None:
        own = _with_descendants(truth, joint.child)
        held = np.flatnonzero(np.isin(label, _with_fixed(truth, joint.parent)) & ~mask)
        parent = held if len(held) else static
    others = None
    if rng.random() < OTHERS_KNOWN:
        others = [
            np.flatnonzero((label == j.child) & ~mask) for j in truth.joints
            if j.type != "fixed" and j.child not in own and rng.random() < 0.9
        ]  # fmt: skip
    context = part_context(mesh, faces, static, frame, parent_faces=parent, others=others)
    hypotheses = enumerate_hypotheses(context)
    part = part_features(context)
    none = np.full(len(hypotheses), np.inf)
    if joint is None:
        zero = np.zeros(len(hypotheses), dtype=np.int64)
        return Example(
            "", "", False, variant, 0, "fixed", part, hypotheses, none, none, zero, np.zeros(2)
        )
    points = context.scene.points
    axis, pivot, opens = _labels(joint, hypotheses, points, mesh.diagonal)
    kind = 1 if joint.type == "prismatic" else 2
    return Example(
        "", "", False, variant, kind, joint.subtype, part, hypotheses, axis, pivot, opens,
        _reach(joint, points),
    )  # fmt: skip


def _labels(
    joint: Joint, hypotheses: list[Hypothesis], points: FloatArray, diagonal: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Axis error, pivot error and opening side of every hypothesis."""
    slide = joint.type == "prismatic"
    axis, pivot = np.full(len(hypotheses), np.inf), np.full(len(hypotheses), np.inf)
    opens = np.zeros(len(hypotheses), dtype=np.int64)
    direction = unit(joint.axis)
    towards = joint.open if joint.open != 0.0 else -joint.closed
    if not slide and abs(joint.closed) > REST_CLOSED * (abs(joint.open) + abs(joint.closed)):
        towards = 0.0  # it rests half open, or swings both ways: nobody can say which side opens
    for i, h in enumerate(hypotheses):
        if h.revolute == slide:
            continue
        axis[i] = np.arccos(np.clip(abs(float(h.axis @ direction)), 0.0, 1.0))
        if axis[i] < 0.5:  # beyond, nobody asks how far
            pivot[i] = 0.0 if slide else line_error(points, joint, h.axis, h.origin) / diagonal
        if axis[i] > AXIS_OK or pivot[i] > 2 * PIVOT_OK:
            continue
        if np.isfinite(towards) and towards != 0.0:
            opens[i] = int(np.sign(float(h.axis @ joint.axis) * towards))
    return axis, pivot, opens


def _reach(joint: Joint, points: FloatArray) -> FloatArray:
    if joint.type == "continuous" or not np.isfinite(joint.lower + joint.upper):
        return np.array([np.inf, np.inf])
    extent = float(np.ptp(points @ unit(joint.axis))) if joint.type == "prismatic" else 1.0
    ends = np.array([joint.lower, joint.upper]) / max(extent, 1e-9)
    towards = joint.open if joint.open != 0.0 else -joint.closed
    out, back = (ends[1], -ends[0]) if towards >= 0 else (-ends[0], ends[1])
    return np.array([max(out, 0.0), max(back, 0.0)])


def _with_descendants(truth: Articulation, link: int) -> list[int]:
    out = [link]
    for joint in truth.joints:
        if joint.parent in out:
            out.append(joint.child)
    return out


def _with_fixed(truth: Articulation, link: int) -> list[int]:
    """A link and those fixed to it."""
    out = [link]
    for joint in truth.joints:
        if joint.type == "fixed" and joint.parent in out:
            out.append(joint.child)
    return out


def _spoiled(
    truth: Articulation, joint: Joint, labels: IntArray, rng: np.random.Generator
) -> tuple[str, IntArray] | None:
    """A part as an imperfect grouping gives it: "less" or "more" of it, still mostly itself."""
    mesh = truth.mesh
    mask = np.isin(truth.face_link, _with_descendants(truth, joint.child))
    area = face_geometry(mesh.vertices, mesh.faces)[1]
    inside = np.bincount(labels[mask], area[mask], minlength=labels.max() + 1)
    whole = np.bincount(labels, area, minlength=labels.max() + 1)
    total = float(area[mask].sum())
    mine = np.flatnonzero(inside > 0.5 * whole)
    if rng.random() < 0.5 and len(mine) > 1:
        budget = 0.4 * total
        lost: list[int] = []
        for p in rng.permutation(mine):
            if inside[p] < budget and len(lost) < max(1, len(mine) // 2):
                lost.append(int(p))
                budget -= inside[p]
        if lost:
            return "less", np.flatnonzero(mask & ~np.isin(labels, lost))
    corners = mesh.vertices[mesh.faces[mask]].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    gap = np.linalg.norm(np.maximum(np.maximum(low - centres, centres - high), 0.0), axis=1)
    far = np.full(len(whole), np.inf)
    np.minimum.at(far, labels, gap)
    near = np.flatnonzero((inside < 0.5 * whole) & (whole < 0.6 * total) & (whole > 0.01 * total)
                          & (far < 0.05 * mesh.diagonal))  # fmt: skip
    if not len(near):
        return None
    taken = rng.permutation(near)[: int(rng.integers(1, 3))]
    return "more", np.flatnonzero(mask | np.isin(labels, taken))


def _still_pieces(
    truth: Articulation, labels: IntArray, rng: np.random.Generator, count: int
) -> Iterator[IntArray]:
    """Face sets that are no movable part: primitives of the base, small pieces of moving parts."""
    area = face_geometry(truth.mesh.vertices, truth.mesh.faces)[1]
    share = np.bincount(labels, area) / max(area.sum(), 1e-300)
    link = truth.face_link
    base = _with_fixed(truth, 0)
    whole = np.bincount(link[link >= 0], area[link >= 0], minlength=len(truth.links))
    found = []
    for p in rng.permutation(np.flatnonzero(share > 2e-4)):
        faces = np.flatnonzero(labels == p)
        owner = int(np.bincount(link[faces], area[faces]).argmax())
        pure = area[faces][link[faces] == owner].sum() / max(area[faces].sum(), 1e-300)
        if pure < 0.95:
            continue
        small = area[faces].sum() < 0.3 * whole[owner]
        if owner in base or (small and rng.random() < 0.3):
            found.append(faces)
        if len(found) >= count:
            break
    yield from found


def make_examples(
    kind: str, seed: int, fused: bool, loose: bool = False, blocks: bool = False
) -> list[Example]:
    """Examples of one generated object: a category of the world or an abstract kind.

    Of a fused mesh a reasoner can take only whole primitives, so these are the parts there.
    `loose`, `blocks`: see `mam_training.parts.corpus.as_met`.
    """
    truth, primitives = as_met(kind, seed, fused, loose, blocks)
    if fused:
        truth = of_whole_primitives(truth, primitives.labels)
    name = object_name(kind, seed, fused, loose, blocks)
    return list(examples(truth, primitives.labels, name, kind, seed, fused=fused))


def of_whole_primitives(truth: Articulation, labels: IntArray) -> Articulation:
    """The truth with every primitive (`labels`: (F,)) given to the link that owns most of it."""
    area = face_geometry(truth.mesh.vertices, truth.mesh.faces)[1]
    inside = np.zeros((int(labels.max()) + 1, len(truth.links)))
    np.add.at(inside, (labels, truth.face_link), area)
    return relabelled(truth, inside.argmax(axis=1)[labels])


def cached_examples(
    kind: str, seed: int, fused: bool, cache: Path, loose: bool = False, blocks: bool = False
) -> list[Example]:
    """Examples of one generated object, kept in a cache folder."""
    file = cache / f"{object_name(kind, seed, fused, loose, blocks)}.pkl"
    if file.is_file():
        return list(pickle.loads(file.read_bytes()))
    found = make_examples(kind, seed, fused, loose, blocks)
    cache.mkdir(parents=True, exist_ok=True)
    temporary = file.with_suffix(".part")
    temporary.write_bytes(pickle.dumps(found))
    temporary.rename(file)
    return found
