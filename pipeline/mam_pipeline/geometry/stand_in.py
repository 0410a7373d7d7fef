"""A lighter mesh that stands for a heavy one where the answer does not need every triangle.

Parts, joints, collision pieces and masses of an object depend on its shape, not on how finely it is
cut. Meshes up to a size are left as they are, and so are the pieces of a heavy one that are light.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import fast_simplification
import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.surface import Triangles, edge_labels, weld
from mam_pipeline.types import Articulation, FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class Weight:
    """When a mesh is heavy, and how light its stand-in is.

    Attributes:
        heavy: faces beyond which a mesh gets a stand-in.
        light: about so many faces has the stand-in.
        piece: connected pieces of at most so many faces are kept whole.
        tolerance: corners nearer than this are one vertex, as a share of the diagonal.
    """

    heavy: int = 100_000
    light: int = 50_000
    piece: int = 400
    tolerance: float = 1e-5


WEIGHT = Weight()


@dataclass(frozen=True)
class StandIn:
    """A light mesh, and how its faces and those of the heavy one belong together.

    Attributes:
        mesh: the light one; its materials and groups are those of the heavy one.
        nearest: (F,) for every heavy face the light face that stands for it.
        source: (f,) for every light face a heavy face of the same piece, group and part.
    """

    mesh: Mesh
    nearest: IntArray
    source: IntArray


def stand_in(
    mesh: Mesh, parts: IntArray | None = None, weight: Weight | None = None
) -> StandIn | None:
    """The mesh with fewer triangles, piece by piece, by quadric decimation; borders stay.

    Args:
        mesh: any. parts: (F,) labels across which no piece reaches.
        weight: when a mesh is heavy; default: `WEIGHT`.

    Returns:
        None where the mesh is not heavy.
    """
    weight = weight or WEIGHT
    if len(mesh.faces) <= weight.heavy:
        return None
    assert mesh.face_group is not None and mesh.face_material is not None
    small, pieces = _pieces(mesh, parts, weight)
    sizes = np.array([len(rows) for rows, _, _ in pieces])
    large = sizes > weight.piece
    room = max(weight.light - int(len(mesh.faces) - sizes[large].sum()), 0)
    share = min(room / max(int(sizes[large].sum()), 1), 1.0)
    nearest = np.full(len(mesh.faces), -1, dtype=np.int64)
    kept, whole = mesh.submesh(small), np.flatnonzero(small)
    points, corners, source = [kept.vertices], [kept.faces], [whole]
    nearest[whole] = np.arange(len(whole))
    begun, offset = len(whole), len(kept.vertices)
    for rows, vertices, faces in pieces:
        if len(rows) > weight.piece:
            target = max(int(share * len(rows)), weight.piece)
            vertices, faces = _decimated(vertices, faces, target)
            middles = mesh.vertices[mesh.faces[rows]].mean(axis=1)
            nearest[rows] = begun + RayScene(vertices, faces).closest(middles).faces
            source.append(np.full(len(faces), rows[0], dtype=np.int64))
        else:
            nearest[rows] = begun + np.arange(len(rows))
            source.append(rows)
        points.append(vertices)
        corners.append(faces + offset)
        begun, offset = begun + len(faces), offset + len(vertices)
    of = np.concatenate(source)
    light = Mesh(
        np.concatenate(points), np.concatenate(corners), mesh.materials, mesh.face_material[of],
        face_group=mesh.face_group[of], group_names=mesh.group_names,
    )  # fmt: skip
    alone = np.flatnonzero(nearest < 0)  # without area, or a copy of another face
    if len(alone):
        middles = mesh.vertices[mesh.faces[alone]].mean(axis=1)
        nearest[alone] = RayScene(light.vertices, light.faces).closest(middles).faces
    return StandIn(light, nearest, of)


def _pieces(
    mesh: Mesh, parts: IntArray | None, weight: Weight
) -> tuple[NDArray[np.bool_], list[tuple[IntArray, FloatArray, IntArray]]]:
    """Mask (F,) of the faces of labels with few, and the connected pieces of the other labels.

    A label is a group, material and part; what touches across labels is not joined. A piece is its
    heavy faces, and a welded surface of theirs without copies and faces that have no area.
    """
    label: IntArray = np.zeros(len(mesh.faces), dtype=np.int64)
    for labels in (mesh.face_group, mesh.face_material, parts):
        if labels is not None:
            _, label = np.unique(label * (labels.max() + 1) + labels, return_inverse=True)
    out = []
    small = np.bincount(label)[label] <= weight.piece
    for mine in _split(label):
        if small[mine[0]]:
            continue
        triangles = mesh.vertices[mesh.faces[mine]]
        vertices, faces, index = weld(triangles, weight.tolerance * mesh.diagonal)
        if not len(faces):
            continue
        for rows in _split(edge_labels(faces, mesh.faces[mine[index]])):
            used, local = np.unique(faces[rows], return_inverse=True)
            own: IntArray = local.reshape(-1, 3).astype(np.int64)
            out.append((mine[index[rows]], vertices[used], own))
    return small, out


def _split(label: IntArray) -> list[IntArray]:
    """Indices of the items of every label."""
    counts = np.bincount(label)
    order: IntArray = np.argsort(label, kind="stable").astype(np.int64)
    return [rows for rows in np.split(order, np.cumsum(counts)[:-1]) if len(rows)]


def lightened(articulation: Articulation, weight: Weight | None = None) -> Articulation:
    """The same links and joints on a lighter mesh; itself where the mesh is not heavy."""
    label = _body(articulation)
    made = stand_in(articulation.mesh, label, weight)
    if made is None:
        return articulation
    return _on(articulation, made.mesh, label[made.source])


def restored(articulation: Articulation, mesh: Mesh, made: StandIn) -> Articulation | None:
    """An articulation of the light mesh on the heavy one; None where a link would be empty."""
    whole = _on(articulation, mesh, _body(articulation)[made.nearest])
    bodies = (*whole.links, *(d.link for d in whole.dormant))
    return whole if all(len(link.faces) for link in bodies) else None


def _body(articulation: Articulation) -> IntArray:
    """(F,) number of every face's link, or, after those of the links, of its dormant part."""
    out = articulation.face_link
    for k, part in enumerate(articulation.dormant, start=len(articulation.links)):
        out[part.link.faces] = k
    return out


def _on(articulation: Articulation, mesh: Mesh, body: IntArray) -> Articulation:
    """The same links, joints and dormant parts on another mesh, of whose faces `body` is known."""
    count = len(articulation.links)
    hosts = np.array([*range(count), *(d.joint.parent for d in articulation.dormant)])
    links = tuple(
        replace(link, faces=np.flatnonzero(hosts[body] == i))
        for i, link in enumerate(articulation.links)
    )
    dormant = tuple(
        replace(d, link=replace(d.link, faces=np.flatnonzero(body == k)))
        for k, d in enumerate(articulation.dormant, start=count)
    )
    return replace(articulation, mesh=mesh, links=links, dormant=dormant)


def _decimated(points: FloatArray, faces: IntArray, target: int) -> Triangles:
    """Quadric decimation in single precision; all there was where nothing would be left."""
    middle = points.mean(axis=0)
    size = max(float(np.abs(points - middle).max()), 1e-12)
    local = ((points - middle) / size).astype(np.float32)
    small, cut = fast_simplification.simplify(local, faces.astype(np.int32), target_count=target)
    if target * 1.5 < len(cut) <= WEIGHT.light:  # it leaves slivers alone
        fine = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(small.astype(np.float64)), o3d.utility.Vector3iVector(cut)
        ).simplify_quadric_decimation(target)
        small, cut = np.asarray(fine.vertices), np.asarray(fine.triangles)
    if not len(cut):
        return points, faces
    return small.astype(np.float64) * size + middle, np.asarray(cut, dtype=np.int64)
