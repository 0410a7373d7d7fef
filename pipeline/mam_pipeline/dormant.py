"""Dormant parts: what may move and is too unlikely to; kept still, with all that is known of it.

A dormant part stays a node of the tree, with its faces. The tree as it moves (`awake`) has it as
part of what it hangs on, so that nothing else depends on it. A name in `--accept`, or `accept` in a
hints file, wakes it (`woken`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from mam_pipeline.errors import unknown_name
from mam_pipeline.types import KinematicTree, PartNode

ALL = "all"  # the name that wakes every dormant part


def put_to_sleep(
    tree: KinematicTree, why: Mapping[int, str], chance: Mapping[int, float] | None = None
) -> KinematicTree:
    """The tree in which some nodes are dormant.

    Args:
        why: the reason in words, by index of the node. chance: that the part is one, 0..1, which
            becomes the node's confidence; unchanged where none is given.
    """
    known = chance or {}
    return replace(tree, nodes=tuple(
        replace(node, dormant=why[i], confidence=known.get(i, node.confidence))
        if i in why else node
        for i, node in enumerate(tree.nodes)
    ))  # fmt: skip


def hosts(tree: KinematicTree) -> list[int]:
    """For every node the one that it moves with: itself, or what a dormant part lies in."""
    out = []
    for i in range(len(tree.nodes)):
        while i > 0 and tree.nodes[i].dormant:
            i = tree.nodes[i].parent
        out.append(i)
    return out


def awake(tree: KinematicTree) -> KinematicTree:
    """The tree as it moves: a dormant part belongs to what it hangs on, and so does what it
    carries."""
    host = hosts(tree)
    if all(i == h for i, h in enumerate(host)):
        return tree
    kept = [i for i, h in enumerate(host) if i == h]
    new = {old: k for k, old in enumerate(kept)} | {-1: -1}
    own: dict[int, list[int]] = {i: [] for i in kept}
    for i, node in enumerate(tree.nodes):
        own[host[i]] += node.primitives
    return replace(tree, nodes=tuple(
        replace(
            tree.nodes[i],
            primitives=tuple(sorted(own[i])),
            parent=new[host[tree.nodes[i].parent] if i else -1],
        )
        for i in kept
    ))  # fmt: skip


def woken(tree: KinematicTree, names: Collection[str]) -> KinematicTree:
    """The tree in which the named parts move.

    Args:
        names: of parts or of their joints, or `ALL`. A part that is awake already stays so.

    Raises:
        ConfigError: a part that is not in the tree.
    """
    chosen = set()
    for name in names:
        if name == ALL:
            continue
        index = index_of(tree, name)
        if index is None:
            asleep = [n.name for n in tree.nodes if n.dormant]
            known = asleep or [n.name for n in tree.nodes[1:]]
            raise unknown_name("dormant part", name, [*known, ALL])
        chosen.add(index)

    def woke(i: int, node: PartNode) -> PartNode:
        if not node.dormant or not (i in chosen or ALL in names):
            return node
        # who names a part says that it is one; "all" says nothing of any
        confidence = 1.0 if i in chosen else node.confidence
        evidence = {**node.evidence, "accepted": node.dormant}
        return replace(node, dormant="", confidence=confidence, evidence=evidence)

    return replace(tree, nodes=tuple(woke(i, node) for i, node in enumerate(tree.nodes)))


def index_of(tree: KinematicTree, name: str) -> int | None:
    """The node of a part that is named by itself or by its joint; None where there is none."""
    known = {node.name: i for i, node in enumerate(tree.nodes) if i}
    return known.get(name, known.get(name.removesuffix("_joint")))


def with_dormant(tree: KinematicTree, more: Sequence[PartNode]) -> KinematicTree:
    """The tree with further dormant parts, whose primitives are taken from their parents.

    One that would leave its parent nothing is left out.
    """
    nodes = list(tree.nodes)
    for node in more:
        host = nodes[node.parent]
        left = tuple(p for p in host.primitives if p not in node.primitives)
        if left and set(node.primitives) <= set(host.primitives):
            nodes[node.parent] = replace(host, primitives=left)
            nodes.append(node)
    return replace(tree, nodes=tuple(nodes))
