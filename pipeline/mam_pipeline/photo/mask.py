"""Which pixels belong to the object: alpha, the user's mask, a plain backdrop, or GrabCut."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from skimage import filters, graph

from mam_pipeline.errors import ConfigError
from mam_pipeline.photo.image import Photo

Array = NDArray[np.float64]
NO_RECT = (0, 0, 1, 1)  # unused when GrabCut starts from a mask
LIKE = 2.6  # standard deviations within which a colour is one of the middle's


@dataclass(frozen=True)
class ObjectMask:
    """(h, w) float 0..1 at the photo's small size, how it was made, and how far to trust it."""

    mask: Array
    method: str
    trust: float


def find_masks(
    photo: Photo, user: Path | None = None, bbox: tuple[float, ...] | None = None
) -> list[ObjectMask]:
    """Segment the object in one to five ways; `bbox` (small pixels) restricts all.

    One mask where the user or the file gives it; else plain backdrop, salient object, the colours
    of the picture's middle, centred GrabCut, and the whole picture where it seems cropped to its
    object: the box fitted to each tells which is right.
    """
    window = np.ones(photo.small.shape[:2])
    if bbox is not None:
        x0, y0, x1, y1 = (round(v) for v in bbox)
        window[:] = 0
        window[max(0, y0) : y1, max(0, x0) : x1] = 1
        if window.sum() < 400:
            raise ConfigError("the bounding box lies outside the picture or is tiny")
    if user is not None:
        mask = _user_mask(user, photo.size) * window
        if not 0.005 < mask.mean() <= 1.0:
            raise ConfigError(f"the mask {user.name} selects {mask.mean():.1%} of the picture")
        return [ObjectMask(mask, "user", 1.0)]
    if photo.alpha is not None and 0.01 < (photo.alpha > 0.5).mean() < 0.99:
        return [ObjectMask((photo.alpha > 0.5) * window, "alpha", 1.0)]
    out = []
    plain = plain_backdrop(photo.small)
    if plain is not None and (plain * window).mean() > 0.02:
        out.append(ObjectMask(plain * window, "plain backdrop", 0.9))
    if bbox is None:
        salient = ObjectMask(salient_mask(photo.small), "salient", 0.4)
        middle = middle_mask(photo.small)
        out += [salient] + ([] if middle is None else [ObjectMask(middle, "middle", 0.4)])
        if salient.mask.mean() > 0.5:  # the picture is likely cropped to its object
            out.append(ObjectMask(np.ones_like(window), "whole picture", 0.3))
        return [*out, ObjectMask(grabcut(photo.small, window, False), "grabcut", 0.4)]
    out.append(ObjectMask(grabcut(photo.small, window, True), "grabcut", 0.4))
    return out


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


def salient_mask(rgb: NDArray[np.uint8], side: int = 220) -> Array:
    """Salient object: far in colour and along paths from the picture's border, then GrabCut.

    Colour: Mahalanobis distance to each border side's colours, the most object-like side left
    out (Zhang et al., minimum barrier salient object detection, 2015). Paths: geodesic distance
    to the border over colour steps (Wei et al., geodesic saliency, 2012).
    """
    h, w = rgb.shape[:2]
    small, lab = _flattened(rgb, side, 4, 10)
    n = max(3, round(0.06 * side))
    sides = [lab[:n], lab[-n:], lab[:, :n], lab[:, -n:]]
    far = np.stack([_unlike(lab, s.reshape(-1, 3)) for s in sides])
    colour = far.sum(axis=0) - far.max(axis=0)
    step = np.linalg.norm(np.stack(np.gradient(lab, axis=(0, 1))), axis=(0, 3))
    paths = graph.MCP_Geometric(0.02 + np.clip(step - 1.5, 0, None) / 10.0)
    edge = np.zeros(lab.shape[:2], bool)
    edge[0] = edge[:, 0] = edge[:, -1] = edge[-1] = True
    distance, _ = paths.find_costs(np.argwhere(edge).tolist())
    y, x = np.mgrid[0 : lab.shape[0], 0 : lab.shape[1]]
    r = np.hypot(x / lab.shape[1] - 0.5, y / lab.shape[0] - 0.5)
    salience = (_unit(colour) + _unit(distance)) * np.exp(-((r / 0.55) ** 2))
    salience = _unit(cv2.GaussianBlur(salience, (0, 0), 2.0))
    level = float(filters.threshold_otsu(salience))
    state = np.where(salience > level, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    state[salience > 0.5 * (level + 1)] = cv2.GC_FGD
    state[salience < 0.35 * level] = cv2.GC_BGD
    blob = _cut(small, state, 3)
    if blob is None:
        blob = (salience > level).astype(float)
    return (cv2.resize(blob, (w, h), interpolation=cv2.INTER_LINEAR) > 0.5).astype(float)


def middle_mask(rgb: NDArray[np.uint8], side: int = 220) -> Array | None:
    """What has the colours of the picture's middle and hangs together with it, then GrabCut.

    Furniture is mostly of one or two materials, which its neighbours and the floor rarely share;
    None where all of the picture has them.
    """
    h, w = rgb.shape[:2]
    small, lab = _flattened(rgb, side, 6, 14)
    y, x = np.mgrid[0 : lab.shape[0], 0 : lab.shape[1]]
    r = np.maximum(np.abs(x / lab.shape[1] - 0.5), np.abs(y / lab.shape[0] - 0.5))
    sample = lab[r < 0.18].astype(np.float32)
    cv2.setRNGSeed(1)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.5)
    labels = cv2.kmeans(sample, 3, np.empty(0), stop, 3, cv2.KMEANS_PP_CENTERS)[1].ravel()
    usual = [g for k in range(3) if len(g := sample[labels == k]) >= len(sample) / 4]
    far = np.min([_deviation(lab, g, np.diag([30.0, 6.0, 6.0])) for g in usual], axis=0)
    like = ndimage.binary_opening(far < LIKE)
    blobs, _ = ndimage.label(like)
    area = np.bincount(blobs[r < 0.25], minlength=blobs.max() + 1)
    area[0] = 0
    if not area.max():
        return None
    core = blobs == area.argmax()
    if core.mean() > 0.9:
        return None
    state = np.where(core, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    state[ndimage.binary_erosion(core, iterations=3)] = cv2.GC_FGD
    state[((far > 2.5 * LIKE) & (r > 0.3)) | (r > 0.485)] = cv2.GC_BGD
    blob = _cut(small, state, 2)
    if blob is None:
        return None
    return (cv2.resize(blob, (w, h), interpolation=cv2.INTER_LINEAR) > 0.5).astype(float)


def _flattened(
    rgb: NDArray[np.uint8], side: int, space: int, colour: int
) -> tuple[NDArray[np.uint8], Array]:
    """The picture at `side` pixels, and its smoothed Lab colours (mean shift)."""
    h, w = rgb.shape[:2]
    k = side / max(h, w)
    size = (max(24, round(w * k)), max(24, round(h * k)))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    flat = cv2.pyrMeanShiftFiltering(np.ascontiguousarray(small[..., ::-1]), space, colour)
    lab = cv2.cvtColor(flat.astype(np.float32) / 255.0, cv2.COLOR_BGR2LAB)
    return np.asarray(small, np.uint8), np.asarray(lab, np.float64)


def _cut(small: NDArray[np.uint8], state: NDArray[np.uint8], rounds: int) -> Array | None:
    """The main blob of GrabCut from a state of its own; None where it has none."""
    cv2.setRNGSeed(1)
    back, fore = np.zeros((1, 65)), np.zeros((1, 65))
    try:
        cv2.grabCut(small, state, NO_RECT, back, fore, rounds, cv2.GC_INIT_WITH_MASK)
    except cv2.error:  # one colour only: no two models can be fitted
        return None
    return _main_blob((state == cv2.GC_FGD) | (state == cv2.GC_PR_FGD))


def _deviation(lab: Array, sample: Array, least: Array) -> Array:
    """(h, w) Mahalanobis distance of colours to a sample, whose spread `least` (3, 3) widens."""
    spread = np.linalg.inv(np.cov(sample.T) + least)
    d = lab - sample.mean(axis=0)
    return np.sqrt(np.einsum("ijk,kl,ijl->ij", d, spread, d))


def _unlike(lab: Array, sample: Array) -> Array:
    """(h, w) 0..1 Mahalanobis distance of colours to a sample's distribution."""
    return _unit(_deviation(lab, sample, 4.0 * np.eye(3)))


def _unit(values: Array) -> Array:
    low, high = np.percentile(values, [1, 99])
    return np.clip((values - low) / max(high - low, 1e-9), 0, 1)


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


def grabcut(rgb: NDArray[np.uint8], window: Array, boxed: bool) -> Array:
    """GrabCut with a centred prior at a quarter of the size; falls back to the prior itself."""
    h, w = rgb.shape[:2]
    size = (max(16, w // 4), max(16, h // 4))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    win = cv2.resize(window, size, interpolation=cv2.INTER_NEAREST) > 0
    y, x = np.mgrid[0 : size[1], 0 : size[0]]
    if boxed:
        ys, xs = np.nonzero(win)
        cx, cy = (xs.min() + xs.max()) / 2, (ys.min() + ys.max()) / 2
        rx, ry = np.ptp(xs) / 2 + 1, np.ptp(ys) / 2 + 1
        r = np.maximum(np.abs(x - cx) / rx, np.abs(y - cy) / ry)
        state = np.full(r.shape, cv2.GC_BGD, np.uint8)
        state[r < 1.0] = cv2.GC_PR_FGD
        state[r < 0.4] = cv2.GC_FGD
    else:
        r = np.maximum(np.abs(x / size[0] - 0.5), np.abs(y / size[1] - 0.5)) * 2
        state = np.full(r.shape, cv2.GC_PR_BGD, np.uint8)
        state[r < 0.78] = cv2.GC_PR_FGD
        state[r < 0.25] = cv2.GC_FGD
        state[r > 0.985] = cv2.GC_BGD
    try:
        cv2.setRNGSeed(1)
        cv2.grabCut(
            small, state, NO_RECT, np.zeros((1, 65)), np.zeros((1, 65)), 3, cv2.GC_INIT_WITH_MASK
        )
    except cv2.error:  # one colour only: no two models can be fitted
        return window * 1.0
    mask = (state == cv2.GC_FGD) | (state == cv2.GC_PR_FGD)
    blob = _main_blob(mask & win)
    if blob is None:
        blob = ((r < 0.8) & win).astype(float)
    return (cv2.resize(blob, (w, h), interpolation=cv2.INTER_LINEAR) > 0.5).astype(float) * window
