"""Small pieces that stand in a part's way although they sit on it: they go along with the part.

Seen from outside, the runner's clip on a drawer's side or the plate behind a door's knob looks like
the body. Motion tells: if a part is stuck early, if what stops it is small, lies within the part's
own outline and rests on it more than on the body, and if the part runs freer once that goes along,
then it belongs to the part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.geometry.motion import Motion
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import face_geometry, sample_surface
from mam_pipeline.joints.estimate import Estimate
from mam_pipeline.joints.limits import Surroundings
from mam_pipeline.types import IntArray, KinematicTree, Mesh


@dataclass(frozen=True)
class BlockerThresholds:
    """Which pieces that stop a part go along with it.

    Attributes:
        stuck: a part that goes less than this share of its usual way is looked at.
        piece: largest area of a piece that goes along, as a share of the part's own.
        carried: largest area of a part that is carried, as a share of the part's own.
        near: diagonals: nearer than this two pieces touch.
        around: diagonals that such a piece may reach beyond the part's box.
    """

    stuck: float = 0.75
    piece: float = 0.15
    carried: float = 0.7
    near: float = 0.004
    around: float = 0.02


BLOCKER = BlockerThresholds()


def take_along(
    mesh: Mesh, labels: IntArray, tree: KinematicTree, index: int, found: Estimate,
    around: Surroundings,
) -> KinematicTree | None:  # fmt: skip
    """The tree in which small pieces that stop a part go along with it; None if none do.

    Args:
        labels: (F,) primitive of every face. index: of the part. found: its joint.
        around: the part and what stands still.
    """
    limits, chosen = found.limits, found.chosen
    if limits.type == "continuous":  # nothing stops it
        return None
    motion: Motion = "prismatic" if limits.type == "prismatic" else "revolute"
    wanted = limits.upper if limits.wanted is None else limits.wanted
    stop = around.free(motion, chosen.axis, chosen.origin, wanted)[1]
    faces = around.paths.obstacles(motion, chosen.axis, chosen.origin, stop)
    node = tree.nodes[index]
    box = _Box(mesh, np.flatnonzero(np.isin(labels, node.primitives)))
    room = BLOCKER.around * mesh.diagonal
    nodes = list(tree.nodes)
    moved = False
    static = np.flatnonzero(~np.isin(labels, node.primitives))
    body = static[~np.isin(labels[static], np.unique(labels[faces]))]
    scenes = [RayScene(mesh.vertices, mesh.faces[f]) for f in (box.faces, body)]
    trunk = RayScene(mesh.vertices, mesh.faces[np.isin(labels, nodes[node.parent].primitives)])
    for piece in np.unique(labels[faces]):
        owner = next((i for i, n in enumerate(nodes) if piece in n.primitives), None)
        if owner is None or owner == index or nodes[owner].provenance == "user":
            continue
        whole = owner != node.parent and nodes[owner].parent == node.parent
        group = nodes[owner].primitives if whole else (int(piece),)
        small = _Box(mesh, np.flatnonzero(np.isin(labels, group)))
        if whole and not (
            small.area <= BLOCKER.carried * box.area and small.rests_on(scenes[0], trunk)
        ):
            continue
        if not whole and not (small.fits(box, room) and small.rests_on(*scenes)):
            continue
        if whole:  # a knob on a door: it keeps its own joint and is carried
            nodes[owner] = replace(nodes[owner], parent=index)
        elif owner == node.parent and len(nodes[owner].primitives) > 1:
            rest = tuple(p for p in nodes[owner].primitives if p != piece)
            nodes[owner] = replace(nodes[owner], primitives=rest)
            more = (*nodes[index].primitives, int(piece))
            nodes[index] = replace(nodes[index], primitives=more)
        else:
            continue
        moved = True
    return replace(tree, nodes=tuple(nodes)) if moved else None


class _Box:
    """Axis-aligned box and area of some faces."""

    def __init__(self, mesh: Mesh, faces: IntArray) -> None:
        self.mesh, self.faces = mesh, faces
        self.points = mesh.vertices[mesh.faces[faces].reshape(-1)]
        self.low, self.high = self.points.min(axis=0), self.points.max(axis=0)
        self.area = float(face_geometry(mesh.vertices, mesh.faces[faces])[1].sum())

    def fits(self, part: _Box, room: float) -> bool:
        """Whether this piece is small and lies within a part's box."""
        low, high = part.low - room, part.high + room
        inside = bool((self.low >= low).all() and (self.high <= high).all())
        return inside and self.area <= BLOCKER.piece * part.area

    def rests_on(self, part: RayScene, body: RayScene) -> bool:
        """Whether more of this piece's surface touches the part than touches the body."""
        points = sample_surface(self.mesh.vertices, self.mesh.faces[self.faces], 400).points
        near = BLOCKER.near * self.mesh.diagonal
        held = [int((scene.distance(points) < near).sum()) for scene in (part, body)]
        return held[0] > held[1]
