"""Which pixels belong to the object where that is told: a mask, alpha, or a plain backdrop."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from mam_pipeline.errors import ConfigError
from mam_pipeline.photo.image import Photo

Array = NDArray[np.float64]


def told_mask(photo: Photo, user: Path | None = None) -> Array | None:
    """(h, w) 0 or 1 at the small size: the user's mask or the file's alpha, None without either.

    Raises:
        ConfigError: the user's mask cannot be read or selects next to nothing.
    """
    if user is not None:
        mask = _user_mask(user, photo.size)
        if mask.mean() < 0.005:
            raise ConfigError(f"the mask {user.name} selects {mask.mean():.1%} of the picture")
        return mask
    if photo.alpha is not None and 0.01 < (photo.alpha > 0.5).mean() < 0.99:
        return np.asarray(photo.alpha > 0.5, float)
    return None


def _user_mask(path: Path, size: tuple[int, int]) -> Array:
    try:
        with Image.open(path) as file:
            grey = np.asarray(file.convert("L"), dtype=np.float64) / 255.0
    except Exception as error:
        raise ConfigError(f"the mask {path} cannot be read as a picture") from error
    return (cv2.resize(grey, size, interpolation=cv2.INTER_AREA) > 0.5).astype(float)


def _smooth_backdrop(lab: Array) -> tuple[Array, Array] | None:
    """Fit a quadratic colour model to the picture's border; None if the border is not plain."""
    h, w = lab.shape[:2]
    y, x = np.mgrid[0:h, 0:w]
    x, y = x / w - 0.5, y / h - 0.5
    band = max(3, round(0.02 * max(h, w)))
    border = np.zeros((h, w), bool)
    border[:band] = border[:, :band] = border[:, -band:] = True
    border[-band:] = True
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    a, b = basis[border], lab[border]
    weight = np.ones(len(a))
    for _ in range(6):  # iteratively reweighted: an object that touches the border is an outlier
        coefficients, *_ = np.linalg.lstsq(a * weight[:, None], b * weight[:, None], rcond=None)
        residual = np.linalg.norm(b - a @ coefficients, axis=1)
        weight = 1 / (1 + (residual / 4.0) ** 2)
    difference = lab - basis @ coefficients
    plain = np.linalg.norm(difference, axis=2) < 9.0
    sides = (plain[:band], plain[-band:], plain[:, :band], plain[:, -band:])
    share = sorted(float(s.mean()) for s in sides)
    if (residual < 9.0).mean() < 0.75 or share[1] < 0.8:  # the object may touch one side
        return None
    return difference, border


def plain_backdrop(rgb: NDArray[np.uint8]) -> Array | None:
    """Mask of an object before a plain (possibly graded) backdrop with soft shadow, or None."""
    soft = cv2.GaussianBlur(rgb, (0, 0), 1.2)
    lab = cv2.cvtColor(soft.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB).astype(np.float64)
    fitted = _smooth_backdrop(lab)
    if fitted is None:
        return None
    difference, border = fitted
    chroma = np.linalg.norm(difference[..., 1:], axis=2)
    total = np.linalg.norm(difference, axis=2)
    gx = np.abs(cv2.Sobel(lab, cv2.CV_64F, 1, 0)).max(axis=2) / 4
    gy = np.abs(cv2.Sobel(lab, cv2.CV_64F, 0, 1)).max(axis=2) / 4
    gradient = np.hypot(gx, gy)
    floor = np.median(gradient[border])
    calm = gradient < max(1.6, 3.0 * floor)
    near = total < 5.0
    shadow = (chroma < 6.0) & (difference[..., 0] < 2.0) & (difference[..., 0] > -45.0)
    passable = (near & (gradient < max(4.0, 4 * floor))) | (calm & shadow)
    passable = ndimage.binary_erosion(passable, iterations=1, border_value=1)
    labels, count = ndimage.label(passable)
    if count == 0:
        return None
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    outside = np.isin(labels, np.unique(edge[edge > 0]))
    outside = ndimage.binary_dilation(outside, iterations=2)
    blob = _main_blob(~outside)
    if blob is None or _lines_outside(rgb, blob) > 0.3:
        return None  # the backdrop ran into an object of its own colour
    return blob


def _lines_outside(rgb: NDArray[np.uint8], blob: Array) -> float:
    """Share of straight-line length that lies off the mask: a plain backdrop has none."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0]
    if found is None:
        return 0.0
    ends = found.reshape(-1, 4)
    length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    length = np.where(length > 0.02 * max(rgb.shape[:2]), length, 0.0)
    wide = ndimage.binary_dilation(blob[::4, ::4] > 0.5, iterations=4)
    x = np.clip((ends[:, 0] + ends[:, 2]) / 8, 0, wide.shape[1] - 1).astype(int)
    y = np.clip((ends[:, 1] + ends[:, 3]) / 8, 0, wide.shape[0] - 1).astype(int)
    return float((length * ~wide[y, x]).sum() / max(length.sum(), 1e-9))


def _main_blob(mask: NDArray[np.bool_]) -> Array | None:
    mask = ndimage.binary_opening(mask, iterations=2)
    labels, count = ndimage.label(mask)
    if count == 0:
        return None
    area = np.bincount(labels.ravel())
    area[0] = 0
    keep = labels == area.argmax()
    keep = ndimage.binary_fill_holes(keep)
    if keep is None or keep.mean() < 0.02 or keep.mean() > 0.97:
        return None
    return keep.astype(float)
