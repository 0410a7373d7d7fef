"""A URDF as the offline sweep sees it: surfaces and convex collision pieces in one rest frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.formats.urdf.geometry import origin_of, shape_triangles
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.types import Articulation, FloatArray


@dataclass(frozen=True)
class Hull:
    """A convex piece at rest, root frame: `points` (n, 3), `planes` (m, 4) rows (normal, offset)
    with normal . x + offset <= 0 inside."""

    points: FloatArray
    planes: FloatArray

    def depth(self, points: FloatArray) -> FloatArray:
        """(n,) how deep points (n, 3) lie inside; negative outside."""
        return np.asarray(-(points @ self.planes[:, :3].T + self.planes[:, 3]).max(axis=1))

    def moved(self, pose: FloatArray) -> Hull:
        """The piece after the rigid motion `pose` (4, 4)."""
        normals = self.planes[:, :3] @ pose[:3, :3].T
        offsets = self.planes[:, 3] - normals @ pose[:3, 3]
        points = self.points @ pose[:3, :3].T + pose[:3, 3]
        return Hull(points, np.column_stack([normals, offsets]))


@dataclass(frozen=True)
class CheckModel:
    """Surfaces, joints and collision pieces of one URDF.

    Attributes:
        articulation: links merged over fixed joints, root frame at q = 0.
        hulls: per link of the articulation, its collision pieces as a simulator uses them.
        friction: joint name -> (friction, damping) of the URDF's <dynamics>.
    """

    articulation: Articulation
    hulls: tuple[tuple[Hull, ...], ...]
    friction: dict[str, tuple[float, float]]

    @staticmethod
    def read(urdf: Path) -> CheckModel:
        """Read a URDF that has passed the lint.

        Raises:
            InputError: no readable surface or no joint that moves one.
        """
        articulation = read_urdf(urdf)
        tree = UrdfTree.read(urdf)
        index = {link.name: i for i, link in enumerate(articulation.links)}
        hulls: list[list[Hull]] = [[] for _ in index]
        for link in tree.robot.links:
            owner = tree.body_of(link.name, index) if link.name in tree.frames else None
            if owner is None:
                continue
            for shape in link.collisions:
                hull = _hull(shape, urdf.parent, tree.frames[link.name])
                if hull is not None:
                    hulls[index[owner]].append(hull)
        friction = {}
        for joint in tree.robot.joints:
            d = joint.dynamics
            friction[joint.name] = (
                0.0 if d is None else float(d.friction or 0.0),
                0.0 if d is None else float(d.damping or 0.0),
            )
        return CheckModel(articulation, tuple(tuple(h) for h in hulls), friction)

    def at(self, values: Mapping[str, float]) -> CheckModel:
        """The same object in another pose: joint name -> value; others stay at rest (0)."""
        if not any(abs(v) > 1e-9 for v in values.values()):
            return self
        from mam_pipeline.render.mesh_pictures import posed

        old = self.articulation
        poses = old.link_poses(values)
        joints = []
        for j in old.joints:
            turn, shift = poses[j.parent][:3, :3], poses[j.parent][:3, 3]
            joints.append(replace(j, axis=turn @ j.axis, origin=turn @ j.origin + shift))
        moved = replace(old, mesh=posed(old, dict(values)), joints=tuple(joints))
        hulls = tuple(tuple(h.moved(m) for h in own) for own, m in zip(self.hulls, poses))
        return CheckModel(moved, hulls, self.friction)


def _hull(shape: Any, folder: Path, frame: FloatArray) -> Hull | None:
    """One convex hull for a collision element: what SAPIEN makes of a mesh file."""
    surface = shape_triangles(shape.geometry, folder, sections=24, subdivisions=2)
    if surface is None:
        return None
    placed = frame @ origin_of(shape)
    found = hull_of(surface[0] @ placed[:3, :3].T + placed[:3, 3])
    if found is None:
        return None
    vertices, faces = found
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    keep = length > 1e-14
    normals = normals[keep] / length[keep, None]
    offsets = -np.einsum("ij,ij->i", normals, a[keep])
    planes = np.unique(np.round(np.column_stack([normals, offsets]), 9), axis=0)
    return Hull(vertices, planes)
