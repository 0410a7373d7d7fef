"""How what is known beside geometry weighs on candidate parts.

A statement moves the log odds of the candidates that it is about: one that has exactly its faces
gains, one that cuts it or that is said to stand still loses. What the file's structure proposes is
at least as likely as the structure says: a low score by geometry does not forbid it, physics may.
How much names weigh on candidates that they are not about follows from how far geometry bears out
all names of the file together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from mam_pipeline.evidence.kinds import ObjectKind, kinds
from mam_pipeline.evidence.propose import chance_of, expected_of
from mam_pipeline.evidence.spec import CERTAIN, KinematicSpec, PartStatement, movable_kind
from mam_pipeline.geometry.motion import Motion
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.joints.estimate import faces_around
from mam_pipeline.joints.limits import Surroundings
from mam_pipeline.parts.groups import Masks
from mam_pipeline.types import (
    MOVES,
    FloatArray,
    JointCandidate,
    JointSubtype,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
    UsualTravel,
)


@dataclass(frozen=True)
class SaidWeights:
    """Log odds and shares by which statements weigh.

    Attributes:
        exact: of a candidate that is the part that a fully trusted name states; it falls with the
            certainty. cut: of one that cuts it. still: of one that is said to stand still.
        shown: of one that an animation shows. other: of those that nobody states where animations
            or nodes that stand on their hinges show some: who shows one joint shows all.
        doubt, something: at most of all candidates, by how often anything of such an object
            moves; a kind weighs, and what geometry found it cannot forbid.
        kind: of the subtypes that a statement names. rare: weight of a subtype that no part of
            such an object has.
        excess: of each part beyond the most that such an object has of parts that move so.
        line: of hinge lines that lie as those of such a part usually do.
        same: IoU of faces from which a candidate is the stated part; part: share from which it
            holds some of it.
        prior: log odds that the names of a file are meant. odds of each name's support are bounded
            by `most`. count: quality of a set of parts for each that is too many or too few.
        inside: share of a primitive's area from which it belongs to a stated part.
        firm: certainty, times trust, from which a stated part keeps the very faces it is said to
            have.
        decides: chance from which a stated part is one and moves as it is said to.
    """

    exact: float = 3.0
    cut: float = 2.0
    still: float = 2.5
    shown: float = 5.0
    other: float = 1.5
    doubt: float = 1.5
    something: float = 0.3
    kind: float = 1.5
    rare: float = 0.25
    excess: float = 6.0
    line: float = 1.5
    same: float = 0.9
    part: float = 0.1
    prior: float = 0.5
    most: float = 1.2
    count: float = 1.0
    inside: float = 0.6
    firm: float = 0.3
    decides: float = 0.5


SAID = SaidWeights()


@dataclass(frozen=True)
class Heard:
    """Statements in terms of an object's primitives.

    Attributes:
        spec: they come from. parts: statements with primitives, in order. masks: (S, P) of these.
        area: (P,) of the primitives. copies: masks (n, P) of nodes that show one and the same mesh.
    """

    spec: KinematicSpec
    parts: tuple[PartStatement, ...]
    masks: Masks
    area: FloatArray
    copies: tuple[Masks, ...] = ()

    @staticmethod
    def of(spec: KinematicSpec, mesh: Mesh, primitives: Primitives) -> Heard | None:
        """Statements about these primitives; None where nothing is said."""
        if spec.empty:
            return None
        areas = face_geometry(mesh.vertices, mesh.faces)[1] + 1e-15
        total: FloatArray = np.bincount(
            primitives.labels, areas, minlength=primitives.count
        ).astype(np.float64)

        def members(faces: np.ndarray) -> np.ndarray:
            inside = np.bincount(primitives.labels, areas * faces, minlength=primitives.count)
            return np.asarray(inside >= SAID.inside * total)

        found = [(part, members(part.faces(mesh))) for part in spec.parts]
        told = [(part, mask) for part, mask in found if mask.any() and not mask.all()]
        table = np.array([m for _, m in told], dtype=bool).reshape(-1, primitives.count)
        assert mesh.face_group is not None
        index = {name: k for k, name in enumerate(mesh.group_names)}
        copies = tuple(
            np.array([members(mesh.face_group == index[g]) for g in groups if g in index])
            for groups in spec.alike
        )
        return Heard(spec, tuple(p for p, _ in told), table, total, copies)

    @property
    def stated(self) -> Masks:
        """(M, P) what is said to move, or is there more than once: candidates in any case."""
        movable = self.masks[[k for k, p in enumerate(self.parts) if p.movable]]
        return np.concatenate([movable, *self.copies])

    def overlap(self, masks: Masks) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(C, S) IoU, share of the statement and share of the candidate, by area."""
        a = masks.astype(np.float64) * self.area
        both = a @ self.masks.T.astype(np.float64)
        mine = a.sum(axis=1)[:, None]
        theirs = (self.masks * self.area).sum(axis=1)[None]
        return both / np.maximum(mine + theirs - both, 1e-15), both / theirs, both / mine

    def trust(self, masks: Masks, value: FloatArray) -> float:
        """Chance that the file's names are meant, by how far geometry bears them out, 0..1."""
        if not self.parts:
            return 0.0
        iou, _, inside = self.overlap(masks)
        total = SAID.prior
        for k, part in enumerate(self.parts):
            if part.said.origin not in ("name", "material"):
                continue
            if part.movable:
                best = float(np.where(iou[:, k] >= SAID.same, value, 0.0).max(initial=0.0))
                support = np.log((best + 0.05) / 0.3)
            else:
                best = float(np.where(inside[:, k] > 0.5, value, 0.0).max(initial=0.0))
                support = np.log((1.05 - best) / 0.7)
            total += float(np.clip(support, -SAID.most, SAID.most)) * part.said.certainty
        return float(expit(total))

    def odds(self, masks: Masks, value: FloatArray) -> FloatArray:
        """(C,) log odds that what is said adds to every candidate."""
        out = np.full(len(masks), self._of_object())
        if not self.parts:
            return out
        trust = self.trust(masks, value)
        iou, held, inside = self.overlap(masks)
        shown = [p.said.origin == "animation" for p in self.parts]
        movable = [k for k, p in enumerate(self.parts) if p.movable]
        sure = max((chance_of(p) for p in self.parts if p.axis is not None), default=0.0)
        out -= SAID.other * sure * (iou[:, movable] < SAID.same).all(axis=1)
        for k, part in enumerate(self.parts):
            believed = part.said.certainty * (1.0 if shown[k] else trust)
            exact = iou[:, k] >= SAID.same
            if part.movable:
                gain = SAID.shown if shown[k] else SAID.exact
                cuts = ~exact & (held[:, k] > SAID.part) & (held[:, k] < SAID.same)
                out += believed * (gain * exact - SAID.cut * cuts)
            elif part.moves == "fixed":
                still = (inside[:, k] > 0.5) | (held[:, k] > 0.5)
                out -= believed * SAID.still * still
        return out

    def proposed(self, masks: Masks) -> FloatArray:
        """(C,) chance of the candidates that are a stated part, by the statement alone; else 0."""
        out = np.zeros(len(masks))
        if self.parts:
            iou = self.overlap(masks)[0]
            chance = np.array([chance_of(part) for part in self.parts])
            out = np.where(iou >= SAID.same, chance, 0.0).max(axis=1)
        return out

    def with_stated(self, masks: Masks, chance: FloatArray, best: Sequence[int]) -> list[int]:
        """A set of candidates with all that the file states, in place of what overlaps them.

        Args:
            chance: (C,) of `proposed`. best: candidates of the set, best first.
        """
        out = list(best)
        for c in np.argsort(-chance, kind="stable"):
            if chance[c] < SAID.decides:
                break
            rivals = [k for k in out if k != c and (masks[k] & masks[c]).any()]
            if c in out or any(chance[k] >= SAID.decides for k in rivals):
                continue
            out = [k for k in out if k not in rivals] + [int(c)]
        return out

    def firm(self, masks: Masks, value: FloatArray) -> np.ndarray:
        """(C,) candidates whose faces the file delimits: no rule adds to them.

        Args:
            value: by geometry alone.
        """
        out = np.zeros(len(masks), dtype=bool)
        if not self.parts:
            return out
        trust, iou = self.trust(masks, value), self.overlap(masks)[0]
        for k, part in enumerate(self.parts):
            shown = part.said.origin == "animation"
            if part.movable and part.said.certainty * (1.0 if shown else trust) >= SAID.firm:
                out |= iou[:, k] >= SAID.same
        return out

    def _of_object(self) -> float:
        """Log odds that anything moves, by the object's word and by counts."""
        if any(c.count and c.said.certainty >= CERTAIN for c in self.spec.counts):
            return 2.0 * SAID.something
        known = self._object
        if known is None or any(p.movable and p.said.certainty > 0.5 for p in self.parts):
            return 0.0
        odds = float(logit(np.clip(known.moves, 1e-3, 1.0 - 1e-3)))
        return float(np.clip(odds, -SAID.doubt, SAID.something)) * self._certainty

    @property
    def _object(self) -> ObjectKind | None:
        """What the thing most likely is; None where nobody says."""
        return kinds().objects[self.spec.objects[0].word] if self.spec.objects else None

    @property
    def _certainty(self) -> float:
        """How certain the word for the object is, 0..1."""
        return self.spec.objects[0].said.certainty if self.spec.objects else 0.0

    def by_kind(self, odds: FloatArray, names: Sequence[str]) -> FloatArray:
        """(C,) log odds that the object's kind adds: less where none of its parts moves so.

        Args:
            odds: (C, 3) of the subtypes in `names`, by geometry.
        """
        usual = self._usual(names)
        return np.zeros(len(odds)) if usual is None else np.log(odds @ usual)

    def heard(self, masks: Masks, value: FloatArray, more: FloatArray) -> FloatArray:
        """(C,) values with what is said.

        Args:
            more: (C,) log odds of `odds` and `by_kind`.
        """
        sure = logit(np.clip(value, 1e-3, 1.0 - 1e-3))
        for copies in self.copies:
            same = [np.flatnonzero((masks == copy).all(axis=1)) for copy in copies]
            known = [int(s[0]) for s in same if len(s)]
            if len(known) > 1:  # copies of one mesh move alike or not at all
                sure[known] = sure[known].mean()
        out: FloatArray = np.maximum(expit(sure + more), self.proposed(masks))
        return np.where(value <= 0.0, 0.0, out)

    def subtypes(self, masks: Masks, odds: FloatArray, names: Sequence[str]) -> FloatArray:
        """(C, 3) odds of the subtypes with what is said of them."""
        out = odds.copy()
        usual = self._usual(names)
        if usual is not None:
            out = out * usual
        if self.parts:
            iou = self.overlap(masks)[0]
            for k, part in enumerate(self.parts):
                subtype = movable_kind(part.moves)
                if subtype is None:
                    continue
                much = SAID.shown if part.said.origin == "animation" else SAID.kind
                factor = np.ones(len(names))
                factor[list(names).index(subtype)] = np.exp(much * part.said.certainty)
                out = np.where((iou[:, k] >= SAID.same)[:, None], out * factor, out)
        return out / np.maximum(out.sum(axis=1, keepdims=True), 1e-12)

    def _usual(self, names: Sequence[str]) -> FloatArray | None:
        """(3,) factors of the subtypes, by how many parts of each such an object usually moves."""
        expected = expected_of(self.spec)
        if expected is None or not any(expected.often.values()):
            return None
        share = np.array([expected.share(movable_kind(n) or "fixed") for n in names])
        share /= share.max()
        return np.asarray((SAID.rare + share) / (SAID.rare + 1.0)) ** expected.certainty

    def quality(self, sizes: Sequence[int]) -> FloatArray:
        """(M,) what the number of parts of every set adds to its quality, where it was told."""
        told = sum(c.count for c in self.spec.counts)
        if not told:
            return np.zeros(len(sizes))
        certainty = min(c.said.certainty for c in self.spec.counts)
        return -SAID.count * certainty * np.abs(np.asarray(sizes, float) - told)

    @property
    def told(self) -> int:
        """How many parts a person said there are; 0 where nobody did."""
        return sum(c.count for c in self.spec.counts if c.said.certainty >= CERTAIN)

    def noted(self, tree: KinematicTree, masks: Masks, odds: FloatArray) -> KinematicTree:
        """The tree whose parts tell what was said of them, with lines and ranges that are known.

        Args:
            masks: (N - 1, P) of the nodes but the base. odds: (N - 1,) that they were given.
        """
        if len(tree.nodes) < 2:
            return tree
        iou = self.overlap(masks)[0] if self.parts else np.zeros((len(masks), 0))
        odds = odds - SAID.excess * self._certainty * self._beyond(tree)
        nodes = [tree.nodes[0]]
        for node, row, more in zip(tree.nodes[1:], iou, odds):
            same = [k for k in np.flatnonzero(row >= SAID.same) if self.parts[k].movable]
            surest = max(same, key=lambda k: self.parts[k].said.certainty, default=None)
            part = None if surest is None else self.parts[surest]
            said: dict[str, object] = {"odds": round(float(more), 3)}
            chance = 0.0 if part is None else chance_of(part)
            candidates = node.candidates
            limits = node.limits
            if part is not None:
                said |= {
                    "name": part.name, "kind": part.kind, "by": part.said.origin,
                    "chance": round(chance, 3),
                }  # fmt: skip
                subtype = movable_kind(part.moves)
                if subtype is not None and chance >= SAID.decides:
                    node, candidates = as_stated(node, subtype)
                if part.axis is not None and part.origin is not None:
                    assert subtype is not None
                    best = max((c.score for c in candidates), default=0.0)
                    first = JointCandidate(
                        subtype, part.axis, part.origin, best + SAID.shown, {"shown": 1.0},
                        kind_probability=1.0, within_kind=part.said.certainty,
                    )  # fmt: skip
                    # an origin says the line, and not which way it opens
                    back = replace(first, axis=-part.axis, within_kind=0.0)
                    candidates = (first,) if part.limits is not None else (first, back)
                    limits = part.limits
                    shown = part.said.origin == "animation"
                    node = replace(
                        node, subtype=subtype, provenance="observed" if shown else node.provenance
                    )
            line = self._line(part)
            if line and node.subtype == "hinge" and limits is None:
                candidates = with_line(candidates, line)
            evidence = {**node.evidence, "said": said}
            if part is not None and part.travel is not None and node.subtype == "hinge":
                candidates = with_travel(candidates, part.travel)
                low, high = part.travel
                usual = f"{low:g} to {high:g} degrees are usual for a {part.kind}"
                evidence["range"] = f"assumed where nothing is in the way: {usual}"
            nodes.append(replace(node, candidates=candidates, limits=limits, evidence=evidence))
        return replace(tree, nodes=tuple(nodes))

    def _beyond(self, tree: KinematicTree) -> np.ndarray:
        """(N - 1,) parts, the least confident first, beyond the most that move so in such a thing.

        A microwave has one door: a second panel is likelier to stand still. What no part of such a
        thing does at all is `by_kind`'s to weigh.
        """
        out = np.zeros(len(tree.nodes) - 1, dtype=bool)
        known = self._object
        if known is None or self.told:
            return out
        for subtype in {p.moves for p in known.parts}:
            most = sum(p.most for p in known.parts if p.moves == subtype)
            alike = [k for k, n in enumerate(tree.nodes[1:]) if n.subtype == subtype]
            out[sorted(alike, key=lambda k: -tree.nodes[k + 1].confidence)[most:]] = True
        return out

    def _line(self, part: PartStatement | None) -> str:
        """How hinge lines lie, where the part's name or all of the object's parts agree on it."""
        if part is not None:
            return part.line
        known = self._object
        hinges = [] if known is None else [p for p in known.parts if p.moves == "hinge"]
        lines = {p.line for p in hinges}
        return lines.pop() if len(lines) == 1 else ""


def as_stated(node: PartNode, subtype: JointSubtype) -> tuple[PartNode, tuple[JointCandidate, ...]]:
    """The node as it moves by its statement, with its hypotheses; unchanged where it has none."""
    rotary = ("hinge", "spin")
    same = ("slide",) if subtype == "slide" else rotary
    fitting = [c for c in node.candidates if c.subtype in same]
    if not fitting:
        return node, node.candidates
    exact = [c for c in fitting if c.subtype == subtype]
    kept = exact or [replace(c, subtype=subtype) for c in fitting]
    return replace(node, subtype=subtype), tuple(kept)


def with_line(candidates: Sequence[JointCandidate], line: str) -> tuple[JointCandidate, ...]:
    """Hinge hypotheses in the order that they have when their lines usually lie so."""
    gain = [
        SAID.line
        if c.subtype in ("hinge", "spin") and (abs(c.axis[2]) > 0.7) == (line == "upright")
        else 0.0
        for c in candidates
    ]
    share = np.array([(c.within_kind or 0.0) * np.exp(g) for c, g in zip(candidates, gain)])
    rotary = np.array([c.subtype in ("hinge", "spin") for c in candidates])
    total = max(float(share[rotary].sum()), 1e-12) if len(share) else 1.0
    out = [
        replace(
            c, score=c.score + g,
            within_kind=float(s / total) if r and c.within_kind is not None else c.within_kind,
        )
        for c, g, s, r in zip(candidates, gain, share, rotary)
    ]  # fmt: skip
    return tuple(sorted(out, key=lambda c: -c.score))


def with_travel(
    candidates: Sequence[JointCandidate], degrees: tuple[float, float]
) -> tuple[JointCandidate, ...]:
    """Hinge hypotheses that go as far as such parts usually do, from closed to open."""
    low, high = np.radians(degrees)

    def of(known: UsualTravel | None) -> UsualTravel:
        if known is None:
            return UsualTravel(float(low + high) / 2.0, 0.0, 0.0)
        return replace(known, open=float(np.clip(known.open, low - known.back, high)))

    return tuple(
        replace(c, travel=of(c.travel)) if c.subtype == "hinge" else c for c in candidates
    )  # fmt: skip


def with_masks(masks: Masks, more: Masks) -> Masks:
    """Candidates with those added that are not among them; none that is empty or everything."""
    known = {np.packbits(m).tobytes() for m in masks}
    fresh = []
    for mask in more:
        key = np.packbits(mask).tobytes()
        if mask.any() and not mask.all() and key not in known:
            known.add(key)
            fresh.append(mask)
    return np.concatenate([masks, np.array(fresh)]) if fresh else masks


def against_physics(
    tree: KinematicTree, mesh: Mesh, primitives: Primitives, seed: int = 0
) -> KinematicTree:
    """The tree in which a range that the file shows is dropped where the part runs into something
    at once; its line stays, and the range is found as ever."""
    nodes = list(tree.nodes)
    for i, node in enumerate(nodes):
        if node.provenance != "observed" or node.limits is None or not node.candidates:
            continue
        faces = faces_around(tree, primitives, i)
        if not len(faces.moving) or not len(faces.static):
            continue
        line = node.candidates[0]
        motion: Motion = "prismatic" if node.subtype == "slide" else "revolute"
        around = Surroundings.of(mesh, faces.moving, faces.static, seed)
        low, high = (float(np.clip(v, -np.pi, np.pi)) if motion == "revolute" else v
                     for v in node.limits)  # fmt: skip
        free = sum(abs(around.free(motion, line.axis, line.origin, end)[0])
                   for end in (low, high) if end != 0.0)  # fmt: skip
        share = free / max(high - low, 1e-12)
        said = {**node.evidence.get("said", {}), "free": round(share, 3)}
        endless = not np.isfinite(sum(node.limits))
        limits = node.limits if share >= MOVES or endless else None
        nodes[i] = replace(node, limits=limits, evidence={**node.evidence, "said": said})
    return replace(tree, nodes=tuple(nodes))


def said_notes(tree: KinematicTree) -> list[str]:
    """A sentence for each part whose motion the file shows."""
    out = []
    for node in tree.nodes:
        said = node.evidence.get("said", {})
        if said.get("by") != "animation":
            continue
        free = said.get("free")
        checked = "" if free is None else f"; of its range {100 * min(free, 1.0):.0f} % is free"
        out.append(f"{node.name}: joint from the file's animation of {said['name']!r}{checked}")
    return out
