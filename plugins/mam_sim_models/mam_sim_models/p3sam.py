"""P3-SAM (Tencent Hunyuan3D-Part) as a segmenter: mesh in, one face id per face out (paper 3.2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from mam_pipeline.backends import Availability
from mam_pipeline.errors import BackendError
from mam_pipeline.folders import Scratch
from mam_pipeline.models import settings
from mam_pipeline.types import IntArray, Mesh, Primitives
from mam_sim_models import external

VARIABLE = "MAM_SIM_P3SAM"
LICENCE = "Tencent Hunyuan 3D-Part Community License; not in the EU, the UK and South Korea"


class P3SamSegmenter:
    """Runs P3-SAM through its runner (`mam_sim_models/runners/p3sam.py`)."""

    @classmethod
    def available(cls) -> Availability:
        """Whether a runner is named in MAM_SIM_P3SAM."""
        return external.availability(VARIABLE, LICENCE, "docs/guides/foundation-models.md")

    def segment(self, mesh: Mesh, seed: int = 0) -> Primitives:
        """Face ids from P3-SAM, mapped to our faces and healed; UVs are never touched.

        The runner gets an OBJ without appearance and writes `face_ids.npy`; where P3-SAM changed
        the faces (its clean_mesh rebuilds them) it also writes `centroids.npy` (n, 3), and ids
        come back by the nearest centroid.

        Raises:
            BackendError: the runner failed, or ids are missing or not integers.
        """
        with Scratch() as scratch:
            inbox, outbox = Path(scratch, "in"), Path(scratch, "out")
            inbox.mkdir()
            write_bare_obj(mesh, inbox / "mesh.obj")
            request = {
                "mesh": "mesh.obj",
                "seed": seed,
                "point_num": int(settings.number("MAM_SIM_P3SAM_POINTS", 100000)),
                "prompt_num": int(settings.number("MAM_SIM_P3SAM_PROMPTS", 400)),
                "prompt_bs": int(settings.number("MAM_SIM_P3SAM_BATCH", 32)),
                "threshold": settings.number("MAM_SIM_P3SAM_THRESHOLD", 0.95),
            }
            external.call(VARIABLE, "segment", request, inbox, outbox)
            ids = _read_ids(external.need(outbox, "face_ids.npy", "P3-SAM"))
            moved = outbox / "centroids.npy"
            centroids = _load(moved) if moved.is_file() else None
        return Primitives(compact(heal(mesh, to_source(mesh, ids, centroids))), method="p3sam")


def write_bare_obj(mesh: Mesh, path: Path) -> None:
    """Vertices and faces alone, in order."""
    with path.open("w", encoding="utf-8") as file:
        np.savetxt(file, mesh.vertices, fmt="v %.9g %.9g %.9g")
        np.savetxt(file, mesh.faces + 1, fmt="f %d %d %d")


def to_source(mesh: Mesh, ids: IntArray, centroids: np.ndarray | None) -> IntArray:
    """Bring ids of the model's faces to ours.

    Raises:
        BackendError: the counts differ and no centroids came with them.
    """
    if centroids is None:
        if len(ids) != len(mesh.faces):
            raise BackendError(
                f"P3-SAM sent {len(ids)} face ids for {len(mesh.faces)} faces and no centroids"
            )
        return ids
    if centroids.shape != (len(ids), 3) or not np.isfinite(centroids).all() or not len(ids):
        raise BackendError(f"P3-SAM sent {len(ids)} ids with centroids of {centroids.shape}")
    ours = mesh.vertices[mesh.faces].mean(axis=1)
    _, nearest = cKDTree(centroids).query(ours)
    return ids[nearest]


def heal(mesh: Mesh, ids: IntArray) -> IntArray:
    """Give every unassigned face (-1, -2) the id of its nearest assigned neighbour on the surface.

    The neighbourhood is that of faces sharing a welded edge; islands without any assigned face
    become primitives of their own.

    Raises:
        BackendError: no face is assigned at all.
    """
    ids = ids.copy()
    if (ids < 0).all():
        raise BackendError("P3-SAM assigned no face at all; try more points or prompts")
    graph = face_graph(mesh)
    _, island = sparse.csgraph.connected_components(graph, directed=False)
    fresh = ids.max() + 1
    for part in np.unique(island[ids < 0]):
        inside = island == part
        if (ids[inside] < 0).all():
            ids[inside] = fresh
            fresh += 1
    if (ids < 0).any():
        known = np.flatnonzero(ids >= 0)
        _, _, source = sparse.csgraph.dijkstra(
            graph, directed=False, indices=known, min_only=True, return_predecessors=True
        )
        ids = ids[np.where(source >= 0, source, np.arange(len(ids)))]
    return ids


def face_graph(mesh: Mesh) -> sparse.csr_matrix:
    """(F, F) distances between the centroids of faces that share an edge by position."""
    step = max(mesh.diagonal, 1e-12) * 1e-7
    _, welded = np.unique(np.round(mesh.vertices / step), axis=0, return_inverse=True)
    faces = welded.reshape(-1)[mesh.faces]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    a, b = owner[:-1][same], owner[1:][same]
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    length = np.linalg.norm(centre[a] - centre[b], axis=1) + step
    count = len(faces)
    return sparse.csr_matrix((length, (a, b)), shape=(count, count)).maximum(
        sparse.csr_matrix((length, (b, a)), shape=(count, count))
    )


def compact(ids: IntArray) -> IntArray:
    """Renumber 0 .. n - 1 in order of first appearance."""
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse.reshape(-1)]


def _load(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise BackendError(f"P3-SAM wrote a {path.name} that cannot be read: {error}") from error


def _read_ids(path: Path) -> IntArray:
    ids = _load(path)
    if ids.ndim != 1 or not np.issubdtype(ids.dtype, np.integer):
        raise BackendError(f"P3-SAM wrote ids of type {ids.dtype} and shape {ids.shape}")
    return ids.astype(np.int64)
