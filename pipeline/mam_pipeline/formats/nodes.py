"""The nodes of a file and how its animations move them: what a flat mesh forgets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mam_pipeline.types import FloatArray, readonly


@dataclass(frozen=True)
class SceneNode:
    """One node of the file.

    Attributes:
        name: its own, or its mesh's; "" where neither has one. parent: index, -1 for a root.
        group: name that its faces have in `Mesh.group_names`; "" without faces.
        mesh: index of its mesh in the file, -1 without one.
        world: (4, 4) file_T_node at rest.
    """

    name: str
    parent: int
    group: str
    mesh: int
    world: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "world", readonly(self.world, np.float64, (4, 4)))


@dataclass(frozen=True)
class NodeMotion:
    """How an animation moves a node against its parent.

    Attributes:
        node: index. animation: name of the clip.
        poses: (K, 4, 4) parent_T_node at the keyframes. rest: (4, 4) parent_T_node as in the file.
    """

    node: int
    animation: str
    poses: FloatArray
    rest: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "poses", readonly(self.poses, np.float64, (None, 4, 4)))
        object.__setattr__(self, "rest", readonly(self.rest, np.float64, (4, 4)))


@dataclass(frozen=True)
class Scene:
    """Nodes in the order of the file, motions, and what was passed over, in words."""

    nodes: tuple[SceneNode, ...] = ()
    motions: tuple[NodeMotion, ...] = ()
    skins: int = 0
    notes: tuple[str, ...] = field(default_factory=tuple)

    def below(self, index: int) -> list[int]:
        """The node and all below it."""
        out = [index]
        for k in out:
            out += [i for i, n in enumerate(self.nodes) if n.parent == k]
        return out
