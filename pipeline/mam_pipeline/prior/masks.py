"""Multi-view kinematic masks: the one form in which every prior shows what it found (paper 3.2).

SP4D paints them, the embedded prior draws them from its measurements, a file may hold them. The
reasoner's pictures, the report and the ablation need not know which it was. A label is 0 where a
piece is held fast or belongs to the base, and the same where pieces were found to move together.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.render import orbit_views as views
from mam_pipeline.render import pictures
from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives

SIZE = 128  # pixels a side of the masks that we draw
DIRECTIONS = (*views.CORNERS, *views.SIDES)
TOGETHER = 0.12  # mean affinity within a group that is drawn in one colour
HELD = 0.3  # mobility below which a single piece counts as held fast
GREY, PALE = 170, (240, 232, 205)
UNSEEN = 10  # pixels over all views below which nothing is said of a primitive


@dataclass(frozen=True)
class MaskFile:
    """Masks with the cameras that saw them, as kept in a masks.npz.

    Attributes:
        masks: (N, H, H) labels, -1 background. azimuth, elevation: (N,) degrees.
        fov: radians. distance: of the cameras in diagonals, None for `views.look`'s own.
        labels: (P,) of the primitives they were made with; empty if not told.
    """

    masks: IntArray
    azimuth: FloatArray
    elevation: FloatArray
    fov: float = float(views.FOV)
    distance: float | None = None
    labels: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def cast(self, mesh: Mesh) -> list[views.View]:
        """The views of `mesh` from the same cameras."""
        angles = [(float(a), float(e)) for a, e in zip(self.azimuth, self.elevation)]
        return views.look(mesh, angles, self.masks.shape[1], self.distance, self.fov)


def votes(cast: list[views.View], masks: IntArray, primitives: Primitives) -> FloatArray:
    """(P, C) pixels that each primitive shares with each mask label, over all views.

    Args:
        masks: (N, H, W) labels 0 .. C - 1, -1 background; N and the size are those of `cast`.
    """
    count = max(int(masks.max()) + 1, 1)
    out = np.zeros((primitives.count, count))
    for view, mask in zip(cast, masks):
        ids = view.ids(primitives.labels)
        both = (ids >= 0) & (mask >= 0)
        np.add.at(out, (ids[both], mask[both]), 1.0)
    return out


def prior_from_masks(
    cast: list[views.View], masks: IntArray, primitives: Primitives, source: str
) -> KinematicPrior:
    """Affinity is the overlap of two primitives' label distributions; the largest label is base.

    Primitives that no view shows get affinity 0.5 and mobility 0.5: nothing is known of them.
    """
    count = votes(cast, masks, primitives)
    seen = count.sum(axis=1)
    share = count / np.maximum(seen, 1.0)[:, None]
    affinity: NDArray[np.float64] = np.minimum(share[:, None, :], share[None, :, :]).sum(axis=2)
    base = int(count.sum(axis=0).argmax())
    mobility = 1.0 - share[:, base]
    hidden = seen < UNSEEN
    affinity[hidden, :] = affinity[:, hidden] = 0.5
    np.fill_diagonal(affinity, 1.0)
    mobility[hidden] = 0.5
    return KinematicPrior(
        mobility=mobility,
        affinity=affinity,
        masks=masks,
        views=np.stack([v.camera_T_asset for v in cast]),
        source=source,
        evidence={"labels": int(count.shape[1]), "hidden": int(hidden.sum())},
        labels=renumbered(np.where(hidden, base, share.argmax(axis=1)), base),
    )


def with_masks(
    prior: KinematicPrior, mesh: Mesh, primitives: Primitives, area: FloatArray
) -> KinematicPrior:
    """A prior that was measured on primitives, with the masks that show it.

    Args:
        area: (P,) of every primitive; the group with most of it is the base.
    """
    labels = groups(prior.mobility, prior.affinity, area)
    cast = views.look(mesh, DIRECTIONS, SIZE)
    masks = np.stack([v.ids(labels[primitives.labels]) for v in cast])
    poses = np.stack([v.camera_T_asset for v in cast])
    return replace(prior, masks=masks, views=poses, labels=labels)


def groups(mobility: FloatArray, affinity: FloatArray, area: FloatArray) -> IntArray:
    """(P,) kinematic label of every primitive by average linkage of the affinities."""
    count = len(mobility)
    if count < 2:
        return np.zeros(count, dtype=np.int64)
    apart = 1.0 - np.minimum((affinity + affinity.T) / 2, 1.0)
    np.fill_diagonal(apart, 0.0)
    tree = linkage(squareform(apart, checks=False), "average")
    found = fcluster(tree, 1.0 - TOGETHER, "distance") - 1
    alone = np.bincount(found)[found] == 1
    base = int(np.bincount(found, area).argmax())
    return renumbered(np.where(alone & (mobility < HELD), base, found), base)


def renumbered(labels: IntArray, base: int) -> IntArray:
    """Labels without gaps, the base's 0, the others in order of first appearance."""
    out = np.zeros(len(labels), dtype=np.int64)
    others = [int(k) for k in dict.fromkeys(labels.tolist()) if k != base]
    for new, old in enumerate(others, start=1):
        out[labels == old] = new
    return out


def mask_colors(labels: IntArray) -> NDArray[np.uint8]:
    """(labels, 3): grey for what is held fast, pale for a piece tied to no other, else distinct.

    Args:
        labels: (P,) kinematic label of every primitive.
    """
    colors = pictures.distinct_colors(int(labels.max(initial=0)) + 1)
    colors[np.bincount(labels, minlength=len(colors)) < 2] = PALE
    colors[0] = GREY
    return colors


def mask_sheet(file: MaskFile) -> NDArray[np.uint8]:
    """The masks as one picture, four in a row, on white."""
    count = int(file.masks.max(initial=0)) + 1
    colors = pictures.distinct_colors(count)
    colors[0] = GREY
    if len(file.labels):
        own = mask_colors(file.labels)[:count]
        colors[: len(own)] = own
    rows = [np.where(m[..., None] >= 0, colors[np.maximum(m, 0)], 255) for m in file.masks]
    return pictures.sheet([r.astype(np.uint8) for r in rows], min(len(rows), 4))


def save_masks(prior: KinematicPrior, mesh: Mesh, path: Path) -> None:
    """Write a prior's masks as a file that `--prior file` reads."""
    forward = prior.views[:, 2, :3]
    eye = -np.einsum("nji,nj->ni", prior.views[:, :3, :3], prior.views[:, :3, 3])
    away = np.linalg.norm(eye - mesh.bounds.mean(axis=0), axis=1).mean() / mesh.diagonal
    np.savez_compressed(
        path,
        masks=prior.masks.astype(np.int16),
        azimuth=np.degrees(np.arctan2(forward[:, 1], forward[:, 0])),
        elevation=np.degrees(-np.arcsin(np.clip(forward[:, 2], -1, 1))),
        fov=prior.fov,
        distance=away,
        labels=prior.labels,
    )


def load_masks(path: Path) -> MaskFile:
    """Read a masks.npz.

    Raises:
        ValueError, OSError, KeyError: no such file, no such arrays, or other shapes.
    """
    with np.load(path, allow_pickle=False) as data:
        masks = np.asarray(data["masks"], dtype=np.int64)
        azimuth, elevation = (np.asarray(data[k], dtype=float) for k in ("azimuth", "elevation"))
        fov = float(data["fov"]) if "fov" in data else float(views.FOV)
        distance = float(data["distance"]) if "distance" in data else None
        labels = np.asarray(data.get("labels", []), dtype=np.int64)
    if masks.ndim != 3 or masks.shape[1] != masks.shape[2]:
        raise ValueError(f"masks of shape {masks.shape}, not (N, H, H)")
    if azimuth.shape != (len(masks),) or elevation.shape != (len(masks),):
        raise ValueError(f"{len(masks)} masks for {azimuth.size} views")
    return MaskFile(masks, azimuth, elevation, fov, distance, labels)
