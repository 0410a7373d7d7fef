"""From a filled builder to an object with exact truth: posing, meshes, links, joints, grasps."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mam_pipeline.types import (
    Articulation,
    CollisionShape,
    FloatArray,
    Grasp,
    IntArray,
    Joint,
    Link,
    Mesh,
    joint_motion,
)
from mam_world import collide
from mam_world.core import JointSpec
from mam_world.fuse_style import fused_static
from mam_world.kit import Builder
from mam_world.materials import TILE, to_material
from mam_world.registry import category
from mam_world.static import Soup, file_transform, restyle, soup_mesh
from mam_world.style import Style, draw_style
from mam_world.surround import surround


@dataclass(frozen=True)
class WorldObject:
    """One generated object with exact truth.

    Attributes:
        name: category and seed.
        articulation: the exact object in the asset frame, q = 0 being the source's pose.
        collision: exact convex pieces of every link, by link name.
        soup: the pieces as built, before the styles of the file.
        static: what a user would hand over (made on first use: fused files take seconds).
        static_face_link: (F,) truth link of every face of `static`.
        static_T_asset: (4, 4) similarity transform, asset frame -> coordinates of the file.
    """

    name: str
    category: str
    seed: int
    style: Style
    articulation: Articulation
    collision: Mapping[str, tuple[CollisionShape, ...]]
    static_T_asset: FloatArray
    soup: Soup

    @cached_property
    def _static(self) -> tuple[Mesh, IntArray]:
        rng = generator(self.category, self.seed, stream=2)
        names = tuple(link.name for link in self.articulation.links)
        if self.style.fused:
            exact, labels = restyle(self.soup, replace(self.style, double_sided=False), rng, names)
            mesh, labels = fused_static(exact, labels, self.style, self.seed)
        else:
            mesh, labels = restyle(self.soup, self.style, rng, names)
        return mesh.transformed(self.static_T_asset), labels

    @property
    def static(self) -> Mesh:
        """The file's mesh in the file's coordinates."""
        return self._static[0]

    @property
    def static_face_link(self) -> IntArray:
        """(F,) truth link of every face of `static`."""
        return self._static[1]

    def truth(self) -> Articulation:
        """The articulation whose mesh is `static`, brought back to the asset frame.

        This is what a prediction on `static` is to be compared with: it has the same surfaces
        (drawers without boxes, sheets, one fused skin) under the exact links and joints.
        """
        mesh = self.static.transformed(np.linalg.inv(self.static_T_asset))
        label = self.static_face_link
        links = tuple(
            replace(link, faces=np.flatnonzero(label == i))
            for i, link in enumerate(self.articulation.links)
        )
        return replace(self.articulation, mesh=mesh, links=links)


def generator(name: str, seed: int, stream: int = 0) -> np.random.Generator:
    """The random numbers of one object.

    Args:
        stream: 0 shapes, 1 style, 2 file, 3 rest, 4 setting; in training 5 whether it is modelled
            loosely, 6 how, 8 whether it is built of blocks, 7 how.
    """
    return np.random.default_rng([zlib.crc32(name.encode()), seed, stream])


def make_object(name: str, seed: int, style: Style | None = None) -> WorldObject:
    """Build the object of category `name` that belongs to `seed`.

    Args:
        name: a category, see `mam_world.CATEGORIES`.
        seed: any whole number >= 0; the same seed gives the same object, byte for byte.
        style: None draws one from the seed.

    Raises:
        ConfigError: no such category.
    """
    build = category(name).builder()
    style = style or draw_style(generator(name, seed, stream=1))
    b = Builder(generator(name, seed), style)
    build(b)
    surround(b, generator(name, seed, stream=4))
    return finish(b, name, seed)


def finish(b: Builder, name: str, seed: int) -> WorldObject:
    """Pose the builder's parts, and turn them into an articulation with its collision pieces."""
    _drop_empty_links(b)
    order = _topological(b)
    rest = _rest_values(b, generator(name, seed, stream=3))
    closed = [_joint(b, s, 0.0) for s in order]
    poses = np.tile(np.eye(4), (len(b.links), 1, 1))
    joints = []
    for spec, joint in zip(order, closed):
        parent = poses[spec.parent]
        q = rest[spec.child]
        joints.append(replace(
            _joint(b, spec, q), axis=parent[:3, :3] @ spec.axis,
            origin=parent[:3, :3] @ spec.origin + parent[:3, 3],
        ))  # fmt: skip
        poses[spec.child] = parent @ joint_motion(joint.type, spec.axis, spec.origin, q)
    soup = _soup(b, poses)
    mesh = soup_mesh(soup, tuple(n for n, _ in b.links))
    links = tuple(
        Link(n, kind, np.flatnonzero(soup.face_link == i)) for i, (n, kind) in enumerate(b.links)
    )
    articulation = Articulation(mesh, links, tuple(joints), _grasps(b, joints, poses))
    collision: dict[str, tuple[CollisionShape, ...]] = {n: () for n, _ in b.links}
    for piece in b.pieces:
        link = b.links[piece.link][0]
        moved = piece.collision
        if not np.array_equal(poses[piece.link], np.eye(4)):
            moved = collide.all_moved(moved, poses[piece.link])
        collision[link] += moved
    return WorldObject(f"{name}_{seed:06d}", name, seed, b.style, articulation, collision,
                       file_transform(b.style), soup)  # fmt: skip


def _drop_empty_links(b: Builder) -> None:
    """Forget links that a family announced and left empty; they would be no bodies."""
    used = {p.link for p in b.pieces} | {0}
    if len(used) == len(b.links):
        return
    keep = sorted(used)
    index = {old: new for new, old in enumerate(keep)}
    b.links = [b.links[i] for i in keep]
    for piece in b.pieces:
        piece.link = index[piece.link]
    b.joints = [s for s in b.joints if s.child in index and s.parent in index]
    for spec in b.joints:
        spec.child, spec.parent = index[spec.child], index[spec.parent]
    b.grasps = [(index[i], g) for i, g in b.grasps if i in index]


def _topological(b: Builder) -> list[JointSpec]:
    children = [s.child for s in b.joints]
    if sorted(children) != list(range(1, len(b.links))):
        missing = [n for i, (n, _) in enumerate(b.links) if i and i not in children]
        raise ValueError(f"every link needs exactly one joint; without or with several: {missing}")
    done, order, left = {0}, [], list(b.joints)
    while left:
        ready = [s for s in left if s.parent in done]
        if not ready:
            raise ValueError("the joints do not form a tree")
        order += ready
        done |= {s.child for s in ready}
        left = [s for s in left if s.child not in done]
    return order


def _rest_values(b: Builder, rng: np.random.Generator) -> dict[int, float]:
    """Source pose by child link: what the family says, else partly open where the style says."""
    rest = {}
    for spec in b.joints:
        u, part = rng.random(), rng.uniform(0.15, 0.9)
        rest[spec.child] = spec.rest
        if spec.ajar and spec.rest == 0.0 and u < b.style.ajar:
            low, high = spec.lower, spec.upper
            if not np.isfinite(low + high):
                low, high = -np.pi, np.pi
            if spec.subtype == "hinge":  # wider, and it would stand in its neighbour's way
                high = min(high, low + 1.0)
            rest[spec.child] = float(low + part * (high - low))
    return rest


def _joint(b: Builder, spec: JointSpec, rest: float) -> Joint:
    """The joint with its range counted from the source's pose; axis as at the closed pose."""
    endless = spec.subtype == "spin" and not np.isfinite(spec.lower + spec.upper)
    kind = {"slide": "prismatic", "fixed": "fixed"}.get(
        spec.subtype, "continuous" if endless else "revolute"
    )
    closed = 0.0 if spec.closed is None else spec.closed
    far = spec.upper if abs(spec.upper) >= abs(spec.lower) else spec.lower
    opened = (0.0 if endless else far) if spec.open is None else spec.open
    return Joint(
        f"{b.links[spec.child][0]}_joint", kind, spec.subtype, spec.parent, spec.child,  # type: ignore[arg-type]
        spec.axis, spec.origin, spec.lower - rest, spec.upper - rest,
        closed - rest, opened - rest, evidence=spec.evidence,
    )  # fmt: skip


def _soup(b: Builder, poses: FloatArray) -> Soup:
    """All pieces in one table of arrays, moved to the source's pose."""
    roles = sorted({p.role for p in b.pieces})
    paints = sorted({p.material for p in b.pieces})
    counts = np.array([len(p.shape.vertices) for p in b.pieces])
    faces = np.array([len(p.shape.faces) for p in b.pieces])
    vertices = np.concatenate([p.shape.vertices for p in b.pieces])
    link = np.array([p.link for p in b.pieces])
    posed = np.flatnonzero([not np.array_equal(poses[i], np.eye(4)) for i in range(len(poses))])
    vertex_link = np.repeat(link, counts)
    for i in posed:
        mask = vertex_link == i
        vertices[mask] = vertices[mask] @ poses[i][:3, :3].T + poses[i][:3, 3]
    start = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return Soup(
        vertices=vertices,
        faces=np.concatenate([p.shape.faces for p in b.pieces]) + np.repeat(start, faces)[:, None],
        uv=np.concatenate([p.shape.uv for p in b.pieces]) / TILE,
        face_piece=np.repeat(np.arange(len(b.pieces)), faces),
        piece_link=link,
        piece_material=np.array([paints.index(p.material) for p in b.pieces]),
        piece_role=tuple(p.role for p in b.pieces) if roles else (),
        piece_is_box=np.array([p.is_box for p in b.pieces]),
        materials=tuple(to_material(n, b.palette[n], b.style.textures) for n in paints),
        link_poses=poses,
    )


def _grasps(b: Builder, joints: list[Joint], poses: FloatArray) -> tuple[Grasp, ...]:
    """Grasps on moving links, moved to the source's pose, named after the link's joint."""
    by_child = {j.child: j.name for j in joints}
    out = []
    for i, grasp in b.grasps:
        if i not in by_child:
            continue
        r, t = poses[i][:3, :3], poses[i][:3, 3]
        out.append(replace(
            grasp, joint=by_child[i], link=b.links[i][0], position=r @ grasp.position + t,
            approach=r @ grasp.approach, closing=r @ grasp.closing,
        ))  # fmt: skip
    return tuple(out)
