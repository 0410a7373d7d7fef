"""SP4D (Stable Part Diffusion 4D) as the kinematic prior: one view in, part maps around out.

The model wants four frames and gives, for every frame, twelve novel views whose left half is the
colour picture and whose right half is the part map in a continuous colour code. Its cameras are
undocumented: they are found by laying our own mesh's silhouette over the colour halves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.errors import BackendError
from mam_pipeline.folders import Scratch
from mam_pipeline.prior.masks import prior_from_masks
from mam_pipeline.render import orbit_views as views
from mam_pipeline.render import pictures
from mam_pipeline.types import IntArray, Mesh, Primitives
from mam_sim_models import external

VARIABLE = "MAM_SIM_SP4D"
LICENCE = "Stability AI Community License: free below US$ 1 M of yearly revenue"
STEP = 360.0 / 13.0  # degrees between neighbouring views, the input view included
REFERENCE = (-30.0, 10.0)  # azimuth, elevation of the view that is shown to the model
SMALLEST_IOU = 0.6


class Sp4dPrior:
    """Runs SP4D through its runner (`mam_sim_models/runners/sp4d.py`)."""

    @classmethod
    def available(cls) -> Availability:
        """Whether a runner is named in MAM_SIM_SP4D."""
        return external.availability(VARIABLE, LICENCE, "docs/guides/foundation-models.md")

    def observe(self, mesh: Mesh, primitives: Primitives, seed: int = 0) -> KinematicPrior:
        """Ask for part maps, calibrate the cameras, cluster the colours, vote on primitives.

        Raises:
            BackendError: the runner failed, its answer has another shape, or its views do not
                show our object.
        """
        picture = pictures.lit(views.look(mesh, [REFERENCE], 576)[0], pictures.own_colors(mesh))
        with Scratch() as scratch:
            inbox, outbox = Path(scratch, "in"), Path(scratch, "out")
            (inbox / "frames").mkdir(parents=True)
            for t in range(4):
                Image.fromarray(picture).save(inbox / "frames" / f"{t}.png")
            external.call(VARIABLE, "parts", {"frames": "frames", "seed": seed}, inbox, outbox)
            frames = _frames(external.need(outbox, "maps.npz", "SP4D"))
        return prior_from_frames(mesh, primitives, frames, seed)


def prior_from_frames(
    mesh: Mesh, primitives: Primitives, frames: NDArray[np.uint8], seed: int
) -> KinematicPrior:
    """(T, V, H, 2W, 3) frames of SP4D to a prior; see `Sp4dPrior.observe`."""
    half = frames.shape[3] // 2
    color, parts = frames[:, :, :, :half], frames[:, :, :, half:]
    silhouettes = (color[0].min(axis=-1) < 245) | (parts[0].min(axis=-1) < 245)
    camera = calibrate(mesh, silhouettes)
    if camera.iou < SMALLEST_IOU:
        raise BackendError(
            f"SP4D's views do not show this object (silhouette overlap {camera.iou:.2f}, "
            f"needed {SMALLEST_IOU})"
        )
    size = parts.shape[2]
    cast = views.look(mesh, camera.directions(len(silhouettes)), size, camera.distance, camera.fov)
    labels = cluster(parts, seed)  # (T, V, H, W)
    repeated = [view for _ in range(len(labels)) for view in cast]
    found = prior_from_masks(repeated, labels.reshape(-1, size, half), primitives, "sp4d")
    evidence = {**found.evidence, "silhouette_iou": round(camera.iou, 3), "sense": camera.sense}
    poses = np.stack([v.camera_T_asset for v in cast])
    return replace(found, masks=labels[0], views=poses, evidence=evidence, fov=camera.fov)


@dataclass(frozen=True)
class Camera:
    """Sense of rotation (+1 or -1), field of view (rad), distance (diagonals), overlap found."""

    sense: int
    fov: float
    distance: float
    iou: float

    def directions(self, count: int) -> list[tuple[float, float]]:
        """(azimuth, elevation) of views 1 .. count."""
        azimuth, elevation = REFERENCE
        return [(azimuth + self.sense * STEP * k, elevation) for k in range(1, count + 1)]


def calibrate(mesh: Mesh, silhouettes: NDArray[np.bool_], size: int = 72) -> Camera:
    """Grid search over sense, field of view and distance for the best mean silhouette IoU."""
    small = np.stack(
        [
            cv2.resize(s.astype(np.uint8), (size, size), interpolation=cv2.INTER_AREA) > 0
            for s in silhouettes
        ]
    )
    best = Camera(1, views.FOV, 2.0, -1.0)
    for sense in (1, -1):
        for degrees in (20.0, 34.0, 50.0):
            fov = np.radians(degrees)
            for fill in np.linspace(0.5, 1.15, 9):
                distance = 0.5 / (np.tan(fov / 2) * fill)
                trial = Camera(sense, float(fov), float(distance), 0.0)
                cast = views.look(mesh, trial.directions(len(small)), size, distance, float(fov))
                ours = np.stack([v.faces >= 0 for v in cast])
                overlap = (ours & small).sum(axis=(1, 2))
                union = (ours | small).sum(axis=(1, 2))
                iou = float(np.mean(overlap / np.maximum(union, 1)))
                if iou > best.iou:
                    best = Camera(sense, float(fov), float(distance), iou)
    return best


def cluster(parts: NDArray[np.uint8], seed: int) -> IntArray:
    """Part maps (T, V, H, W, 3) to labels (T, V, H, W): mean shift in Lab over all maps at once."""
    from sklearn.cluster import MeanShift

    t, v, h, w, _ = parts.shape
    lab = cv2.cvtColor(parts.reshape(t * v * h, w, 3), cv2.COLOR_RGB2LAB).reshape(-1, 3)
    front = parts.reshape(-1, 3).min(axis=1) < 245
    if not front.any():
        raise BackendError("SP4D's part maps are empty")
    rows = lab[front].astype(np.float64)
    rng = np.random.default_rng(seed)
    few = rows[rng.choice(len(rows), min(3000, len(rows)), replace=False)]
    centres = MeanShift(bandwidth=18.0, bin_seeding=True, min_bin_freq=3).fit(few).cluster_centers_
    labels = np.full(t * v * h * w, -1, dtype=np.int64)
    nearest = np.empty(len(rows), dtype=np.int64)
    for start in range(0, len(rows), 200_000):
        block = rows[start : start + 200_000]
        gap = ((block[:, None, :] - centres[None]) ** 2).sum(axis=2)
        nearest[start : start + 200_000] = gap.argmin(axis=1)
    labels[front] = nearest
    return labels.reshape(t, v, h, w)


def _frames(path: Path) -> NDArray[np.uint8]:
    try:
        with np.load(path, allow_pickle=False) as data:
            frames = np.asarray(data["frames"])
    except (OSError, KeyError, ValueError) as error:
        raise BackendError(f"SP4D wrote a maps.npz that cannot be read: {error}") from error
    good = frames.ndim == 5 and frames.shape[4] == 3 and frames.shape[3] == 2 * frames.shape[2]
    if not good or frames.dtype != np.uint8:
        raise BackendError(f"SP4D sent frames of shape {frames.shape} and type {frames.dtype}")
    return frames
