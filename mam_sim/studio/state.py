"""What is on the screen of one object, and the check's word on its joints, as the card has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.asset.card import AssetCard, CardJoint
from mam_pipeline.check.asleep import put_to_sleep
from mam_pipeline.dormant import ALL, index_of
from mam_pipeline.dormant import put_to_sleep as nodes_put_to_sleep
from mam_pipeline.hints import Hints
from mam_pipeline.run import Source
from mam_pipeline.types import (
    Articulation,
    FloatArray,
    Joint,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)

Words = Mapping[tuple[object, ...], CardJoint]
"""The card's row of each joint, by the joint that the engine found (`_key`)."""


@dataclass(frozen=True)
class Ground:
    """The object as it stands, before anything is said of its parts.

    Attributes:
        read: the source in the engine's frame. mesh: what is worked on; a lighter copy where the
            file is heavy. cut: its primitives; primitives: the same, along the hints' nodes.
    """

    read: Source
    mesh: Mesh
    cut: Primitives
    primitives: Primitives


@dataclass(frozen=True)
class State:
    """What a person said, and the tree and the joints that come of it.

    Attributes:
        tree, articulation: with the check's word, where it was given.
        found_tree, found: without it.
        ground: what they are of. primitives: of the faces, cut as the person said.
        turn: (3, 3) rotation about Z that brings the front to -X.
    """

    hints: Hints
    tree: KinematicTree
    articulation: Articulation
    found_tree: KinematicTree
    found: Articulation
    ground: Ground
    primitives: Primitives
    turn: FloatArray


def as_it_is(articulation: Articulation) -> State:
    """An articulation that nobody can edit: a link is a primitive."""
    mesh, primitives = articulation.mesh, Primitives(articulation.face_link)
    ground = Ground(Source("urdf", mesh, np.eye(4), 1.0, "urdf"), mesh, primitives, primitives)
    above = {j.child: j for j in articulation.joints}
    tree = KinematicTree(tuple(
        PartNode(
            link.name, link.kind, (i,), above[i].parent if i in above else -1,
            above[i].subtype if i in above else "fixed",
        )
        for i, link in enumerate(articulation.links)
    ))  # fmt: skip
    return State(
        Hints(), tree, articulation, tree, articulation, ground, primitives, np.eye(3)
    )  # fmt: skip


def words_of(found: Articulation, card: AssetCard) -> Words:
    """What the card says of the joints from which its asset was made."""
    rows = {row.name: row for row in (*card.joints, *card.dormant)}
    return {_key(found, j): rows[j.name] for j in found.joints if j.name in rows}


def as_checked(state: State, words: Words) -> State:
    """The state with the check's word on every joint that is still as it was when it was checked.

    The check cuts a way that meets something, and puts a joint to sleep that physics stops; what a
    person has woken since stays awake.
    """
    if not words:
        return state
    found, tree = state.found, state.found_tree
    joints, why, asleep = list[Joint](), dict[str, str](), dict[int, str]()
    for joint in found.joints:
        row = words.get(_key(found, joint))
        joints.append(joint if row is None else _with_range(joint, row))
        part = found.links[joint.child].name
        index = index_of(tree, part)
        woken = {joint.name, part, ALL} & {*state.hints.accept}
        if row is not None and row.dormant and index is not None and not woken:
            why[joint.name] = asleep[index] = row.dormant
    shown = replace(found, joints=tuple(joints))
    if asleep:
        shown, tree = put_to_sleep(shown, why), nodes_put_to_sleep(tree, asleep)
    return replace(state, tree=tree, articulation=shown)


def _with_range(joint: Joint, row: CardJoint) -> Joint:
    """The joint with the range that was written."""
    lower = -np.inf if row.lower is None else row.lower
    upper = np.inf if row.upper is None else row.upper
    return replace(
        joint, type=row.type, lower=lower, upper=upper, closed=row.closed, open=row.open,
        basis=row.basis,
    )  # fmt: skip


def _key(found: Articulation, joint: Joint) -> tuple[object, ...]:
    """What must be as it was for a word on a joint to hold: place, motion, and who says so."""
    numbers = (*joint.axis, *joint.origin, joint.lower, joint.upper)
    return (
        joint.name, found.links[joint.parent].name, joint.subtype, joint.provenance,
        *(round(float(number), 9) for number in numbers),
    )  # fmt: skip
