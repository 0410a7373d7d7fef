"""Property tests of the mechanism families: closed solids, proper trees, free motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count

import numpy as np
import open3d as o3d
import pytest

from mam_pipeline.types import FloatArray, IntArray, JointType, joint_motion
from mam_world.core import JointSpec
from mam_world.kit import Builder
from mam_world.object import generator
from mam_world.registry import categories
from mam_world.style import Style

FAMILIES = (
    "electronics", "vessels", "bins", "controls", "plumbing", "panels", "desk", "instruments",
    "boxes", "luggage", "vehicles", "carts", "seats", "tools", "pocket", "machines", "stations",
    "primitive", "units", "gadgets", "hangings", "counter",
    "cooking", "workshop", "transport", "aircraft", "furnishing", "building", "devices",
    "handheld", "park",
)  # fmt: skip
NAMES = [name for name, c in categories().items() if c.family in FAMILIES]
DEEPER = 0.005  # of the diagonal: what executability allows beyond the rest pose


def build(name: str, seed: int) -> Builder:
    """One object as built: every joint closed, before the styles of the file."""
    gap = (0.002, 0.0, 0.001, 0.005, 0.01)[seed % 5]
    tessellation = ("normal", "coarse", "dense")[seed % 3]
    b = Builder(generator(name, seed), Style(gap=gap, tessellation=tessellation))  # type: ignore[arg-type]
    categories()[name].builder()(b)
    return b


@pytest.mark.parametrize("name", NAMES)
def test_pieces_are_closed_solids_on_a_tree_that_stands_on_the_floor(name: str) -> None:
    for seed in range(3):
        b = build(name, seed)
        for piece in b.pieces:
            v = np.asarray(piece.shape.vertices)
            _, weld = np.unique(np.round(v, 9), axis=0, return_inverse=True)
            f = weld.reshape(-1)[piece.shape.faces]
            edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
            _, uses = np.unique(edges, axis=0, return_counts=True)
            assert (uses % 2 == 0).all(), f"{b.links[piece.link]}: open surface"
            t = v[piece.shape.faces] - v.mean(axis=0)
            assert np.einsum("ij,ij->", np.cross(t[:, 0], t[:, 1]), t[:, 2]) > 0, "inside out"
        children = sorted(j.child for j in b.joints)
        assert children == list(range(1, len(b.links))), "one joint for every moving link"
        assert children, "something moves"
        assert {p.link for p in b.pieces} == set(range(len(b.links))), "no empty link"
        for j in b.joints:
            assert np.linalg.norm(j.axis) == pytest.approx(1.0)
            assert j.lower <= j.rest <= j.upper and j.upper - j.lower > 1e-4
        lowest = min(float(p.shape.vertices[:, 2].min()) for p in b.pieces)
        assert lowest == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_parts_move_through_their_range_without_collision(name: str) -> None:
    for seed in range(2):
        b = build(name, seed)
        for joint in b.joints[:8]:
            depth, at = deepest(b, joint)
            link = b.links[joint.child][0]
            assert depth < DEEPER, f"{name} {seed}: {link} at {at:.3f} goes {depth:.2%} into a part"


@dataclass
class Solid:
    """A closed piece with sample points, for depth queries."""

    key: int
    link: int
    vertices: FloatArray
    faces: IntArray

    @cached_property
    def scene(self) -> o3d.t.geometry.RaycastingScene:
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(self.vertices.astype(np.float32), self.faces.astype(np.uint32))  # type: ignore[call-overload]
        return scene

    @cached_property
    def box(self) -> FloatArray:
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @cached_property
    def points(self) -> FloatArray:
        """The vertices and 100 points of the surface."""
        t = self.vertices[self.faces]
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        rng = np.random.default_rng(0)
        k = rng.choice(len(t), 100, p=area / area.sum())
        r, s = np.sqrt(rng.random((100, 1))), rng.random((100, 1))
        inner = t[k, 0] * (1 - r) + t[k, 1] * r * (1 - s) + t[k, 2] * r * s
        return np.concatenate([self.vertices, inner])

    def depth(self, points: FloatArray) -> float:
        """How deep the deepest of the points lies inside, metres."""
        near = np.all((points > self.box[0]) & (points < self.box[1]), axis=1)
        if not near.any():
            return 0.0
        query = o3d.core.Tensor(points[near].astype(np.float32))  # type: ignore[call-overload]
        distance = self.scene.compute_signed_distance(query, nthreads=1, nsamples=3).numpy()
        return max(0.0, -float(distance.min()))


def deepest(b: Builder, joint: JointSpec) -> tuple[float, float]:
    """Worst penetration beyond the rest pose (share of the diagonal), and at which value."""
    numbers = count()
    poses = rest_poses(b)
    solids = []
    for p in b.pieces:
        pose = poses[p.link]
        v = p.shape.vertices @ pose[:3, :3].T + pose[:3, 3]
        solids.append(Solid(next(numbers), p.link, v, p.shape.faces))
    corners = np.concatenate([s.box for s in solids])
    diagonal = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    moving_links = set(_below(b, joint.child))
    moving = [s for s in solids if s.link in moving_links]
    still = [s for s in solids if s.link not in moving_links]
    low, high = joint.lower, joint.upper
    if not np.isfinite(low + high):
        low, high = -np.pi, np.pi
    parent = poses[joint.parent]
    axis, origin = parent[:3, :3] @ joint.axis, parent[:3, :3] @ joint.origin + parent[:3, 3]
    rest: dict[tuple[int, int], float] = {}
    worst, at = 0.0, 0.0
    for q in [0.0, *(np.linspace(low, high, 6) - joint.rest)]:
        motion = joint_motion(kind_of(joint), axis, origin, float(q))
        r, t = motion[:3, :3], motion[:3, 3]
        for a in moving:
            points = a.points @ r.T + t
            lower, upper = points.min(axis=0), points.max(axis=0)
            for c in still:
                if (lower > c.box[1]).any() or (upper < c.box[0]).any():
                    continue
                depth = max(c.depth(points), a.depth((c.points - t) @ r))
                before = rest.setdefault((a.key, c.key), depth if q == 0.0 else 0.0)
                if (depth - before) / diagonal > worst:
                    worst, at = (depth - before) / diagonal, float(q)
    return worst, at


def kind_of(joint: JointSpec) -> JointType:
    return "prismatic" if joint.subtype == "slide" else "revolute"


def rest_poses(b: Builder) -> dict[int, FloatArray]:
    """Motion of every link from its closed pose to the pose of the source."""
    poses = {0: np.eye(4)}
    left = list(b.joints)
    while left:
        for j in [j for j in left if j.parent in poses]:
            move = joint_motion(kind_of(j), j.axis, j.origin, j.rest)
            poses[j.child] = poses[j.parent] @ move
            left.remove(j)
    return poses


def _below(b: Builder, link: int) -> Iterator[int]:
    yield link
    for j in b.joints:
        if j.parent == link:
            yield from _below(b, j.child)
