"""Features and exact labels of generated objects, from which the joint ranker is trained.

Only objects of `mam_pipeline.world` are used: never a benchmark. Three sorts of parts per object:
movable parts as they are, primitives of the base (they do not move), and small pieces of movable
parts taken alone, such as a handle without its door (they do not move against the rest either).
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mam_pipeline.geometry.boxes import angle_between
from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.geometry.sampling import face_geometry, unit
from mam_pipeline.joints.context import part_context
from mam_pipeline.joints.features import Hypothesis, enumerate_hypotheses, part_features
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint

AXIS_OK = 0.1
PIVOT_OK = 0.03


@dataclass(frozen=True)
class Example:
    """One part with its hypotheses and what is true of them.

    Attributes:
        name: object; category: its kind. kind: index into ranker.KINDS.
        part: row of PART_NAMES. hypotheses: with features.
        grade: (h,) 0 wrong, 1 near, 2 right; all 0 for parts that do not move.
        opens: (h,) +1 if the hypothesis's positive side is the truth's opening side, -1 if not, 0
            where that is unknown.
        reach: (2,) truth's travel from rest to open and to closed: radians, or share of the part's
            extent along the slide; infinite for endless joints.
    """

    name: str
    category: str
    kind: int
    subtype: str
    part: FloatArray
    hypotheses: list[Hypothesis]
    grade: IntArray
    opens: IntArray
    reach: FloatArray


def line_error(points: FloatArray, truth: Joint, axis: FloatArray, origin: FloatArray) -> float:
    """Mean distance between the true axis, over the part's extent along it, and another line."""
    a = unit(truth.axis)
    along = (points - truth.origin) @ a
    spots = truth.origin + np.linspace(along.min(), along.max(), 9)[:, None] * a
    offset = spots - origin
    offset = offset - (offset @ axis)[:, None] * axis
    return float(np.linalg.norm(offset, axis=1).mean())


def examples(
    truth: Articulation, name: str, category: str, seed: int, per_object: int = 3
) -> Iterator[Example]:
    """Examples of one object: up to `per_object` movable parts and one that does not."""
    rng = np.random.default_rng(seed)
    mesh, label = truth.mesh, truth.face_link
    frame = estimate_frame(mesh)
    moving = [j for j in truth.joints if j.type != "fixed" and (label == j.child).any()]
    if len(moving) > per_object:
        moving = [moving[i] for i in np.sort(rng.choice(len(moving), per_object, replace=False))]
    for joint in moving:
        group = _with_descendants(truth, joint.child)
        mask = np.isin(label, group)
        parent = np.flatnonzero(np.isin(label, _with_fixed(truth, joint.parent)) & ~mask)
        faces, static = np.flatnonzero(mask), np.flatnonzero(~mask)
        if not len(static):
            continue
        context = part_context(
            mesh, faces, static, frame, parent_faces=parent if len(parent) else static, seed=seed
        )
        hypotheses = enumerate_hypotheses(context)
        grade, opens = _labels(joint, hypotheses, context.scene.points, mesh.diagonal)
        kind = 1 if joint.type == "prismatic" else 2
        yield Example(name, category, kind, joint.subtype, part_features(context), hypotheses,
                      grade, opens, _reach(joint, context.scene.points))  # fmt: skip
    for faces in _still_pieces(truth, rng, 1):
        static = np.setdiff1d(np.arange(len(mesh.faces)), faces, assume_unique=True)
        if not len(static):
            continue
        context = part_context(mesh, faces, static, frame, seed=seed)
        hypotheses = enumerate_hypotheses(context)
        none = np.zeros(len(hypotheses), dtype=np.int64)
        yield Example(name, category, 0, "fixed", part_features(context), hypotheses, none, none,
                      np.zeros(2))  # fmt: skip


def _labels(
    joint: Joint, hypotheses: list[Hypothesis], points: FloatArray, diagonal: float
) -> tuple[IntArray, IntArray]:
    slide = joint.type == "prismatic"
    grade = np.zeros(len(hypotheses), dtype=np.int64)
    opens = np.zeros(len(hypotheses), dtype=np.int64)
    towards = joint.open if joint.open != 0.0 else -joint.closed
    for i, h in enumerate(hypotheses):
        if h.revolute == slide:
            continue
        turn = angle_between(h.axis, joint.axis)
        if turn > AXIS_OK:
            continue
        far = 0.0 if slide else line_error(points, joint, h.axis, h.origin) / diagonal
        if far < PIVOT_OK:
            grade[i] = 2 if far < 0.4 * PIVOT_OK and turn < 0.06 else 1
        if far < 2 * PIVOT_OK and np.isfinite(towards) and towards != 0.0:
            opens[i] = int(np.sign(float(h.axis @ joint.axis) * towards))
    return grade, opens


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


def _still_pieces(truth: Articulation, rng: np.random.Generator, count: int) -> Iterator[IntArray]:
    """Face sets that are no movable part: primitives of the base, small pieces of moving parts."""
    from mam_pipeline.segment.geometric import GeometricSegmenter

    labels = GeometricSegmenter().segment(truth.mesh).labels
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


def cached_examples(name: str, seed: int, cache: Path) -> list[Example]:
    """Examples of one generated object, kept in a cache folder.

    Fused styles are replaced by the same object unfused: fusing costs seconds per object, and the
    hypotheses come from the same boxes and contacts.
    """
    from mam_pipeline.world import make_object

    file = cache / f"{name}_{seed:06d}.pkl"
    if file.is_file():
        return list(pickle.loads(file.read_bytes()))
    made = make_object(name, seed)
    if made.style.fused:
        made = make_object(name, seed, replace(made.style, fused=False))
    found = list(examples(made.truth(), made.name, name, seed))
    cache.mkdir(parents=True, exist_ok=True)
    file.write_bytes(pickle.dumps(found))
    return found
