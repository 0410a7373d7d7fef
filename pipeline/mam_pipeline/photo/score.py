"""Scores of the photo reconstructor against truth: fronts, sizes, panels, handles, kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from shapely.geometry import Polygon

from mam_pipeline.photo.camera import apply_homography, quad_homography
from mam_pipeline.photo.truth import PhotoTruth, Rect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FoundPanel:
    """A predicted panel on the predicted front (0..1 front coordinates of that front)."""

    kind: str
    rect: Rect
    handles: tuple[Rect, ...] = ()


@dataclass(frozen=True)
class PhotoScore:
    """Scores of one photo; sizes are relative errors, None where not measurable."""

    front_iou: float
    aspect_error: float
    depth_error: float | None
    panels: int
    found: int
    matched75: int
    matched50: int
    handles: int
    handles_hit: int
    handles_found: int
    handles_right: int
    kinds_right: int
    confidence: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    stopped: str = ""


def polygon_iou(a: Array, b: Array) -> float:
    """IoU of two convex quadrilaterals (4, 2); 0 where the sides of one cross."""
    one, two = Polygon(a), Polygon(b)
    if not (one.is_valid and two.is_valid):
        return 0.0
    common = one.intersection(two).area
    return float(common / max(one.area + two.area - common, 1e-12))


def rect_quad(rect: Rect, front: Array) -> Array:
    """(4, 2) pixels of a front-coordinate rectangle on a front quad."""
    u0, v0, u1, v1 = rect
    back = np.linalg.inv(quad_homography(front, 1.0, 1.0))
    return apply_homography(back, [(u0, v0), (u1, v0), (u1, v1), (u0, v1)])


def match(iou: Array, threshold: float) -> list[tuple[int, int]]:
    """One-to-one (truth, found) pairs of greatest total IoU, of at least `threshold`."""
    if iou.size == 0:
        return []
    rows, columns = linear_sum_assignment(-np.where(iou >= threshold, iou, 0.0))
    return [(int(r), int(c)) for r, c in zip(rows, columns) if iou[r, c] >= threshold]


def score_photo(
    truth: PhotoTruth,
    front: Array,
    shape: tuple[float, float, float],
    panels: Sequence[FoundPanel],
    depth_observed: bool,
    confidence: Mapping[str, str],
    seconds: float = 0.0,
    stopped: str = "",
) -> PhotoScore:
    """Score one prediction; all comparisons are made in the picture, as a viewer would.

    Args:
        front: (4, 2) predicted front corners, pixels of the picture.
        shape: predicted (width, depth, height), any unit.
    """
    w, d, h = truth.size
    ours = [rect_quad(p.rect, front) for p in panels]
    theirs = [rect_quad(p.rect, truth.front) for p in truth.panels]
    iou = np.array([[polygon_iou(t, o) for o in ours] for t in theirs]).reshape(len(theirs), -1)
    pairs = match(iou, 0.5)
    kinds = sum(truth.panels[t].kind == panels[o].kind for t, o in pairs)
    truth_handles = [rect_quad(k, truth.front) for p in truth.panels for k in p.handles]
    our_handles = [rect_quad(k, front) for p in panels for k in p.handles]
    hit, right = handle_hits(truth_handles, our_handles)
    aspect = (shape[0] / shape[2]) / (w / h)
    deep = (shape[1] / shape[2]) / (d / h)
    return PhotoScore(
        polygon_iou(front, truth.front),
        abs(aspect - 1),
        abs(deep - 1) if depth_observed else None,
        len(theirs), len(ours), len(match(iou, 0.75)), len(pairs),
        len(truth_handles), hit, len(our_handles), right, kinds, dict(confidence), seconds, stopped,
    )  # fmt: skip


def handle_hits(truth: Sequence[Array], ours: Sequence[Array]) -> tuple[int, int]:
    """(truth handles hit, our handles right): our centre lies inside the truth's box, grown by
    3 pixels or a fifth of its size, and the sizes agree within a factor of four."""
    ok = np.zeros((len(truth), len(ours)), bool)
    for i, t in enumerate(truth):
        low, high = t.min(axis=0), t.max(axis=0)
        grow = np.maximum(3.0, 0.2 * (high - low))
        for j, o in enumerate(ours):
            c = o.mean(axis=0)
            big = np.ptp(o, axis=0).max() / max(np.ptp(t, axis=0).max(), 1.0)
            ok[i, j] = bool((c > low - grow).all() and (c < high + grow).all() and 0.25 < big < 4)
    return int(ok.any(axis=1).sum()), int(ok.any(axis=0).sum())


def summary(scores: Sequence[PhotoScore]) -> dict[str, Any]:
    """The table of the benchmark: one number per measure."""

    def total(name: str) -> int:
        return sum(getattr(s, name) for s in scores)

    def share(a: float, b: float) -> float | None:
        return round(a / b, 4) if b else None

    aspect = np.array([s.aspect_error for s in scores if s.front_iou > 0.5])
    depth = np.array([s.depth_error for s in scores if s.depth_error is not None])
    sure = [s for s in scores if s.confidence.get("cuboid") == "high"]
    sure_panels = [s for s in scores if s.confidence.get("panels") == "high"]
    return {
        "photos": len(scores),
        "front_iou_90": share(sum(s.front_iou >= 0.9 for s in scores), len(scores)),
        "front_iou_80": share(sum(s.front_iou >= 0.8 for s in scores), len(scores)),
        "aspect_error_median": _q(aspect, 50),
        "aspect_error_p90": _q(aspect, 90),
        "depth_error_median": _q(depth, 50),
        "panel_recall_75": share(total("matched75"), total("panels")),
        "panel_precision_75": share(total("matched75"), total("found")),
        "panel_recall_50": share(total("matched50"), total("panels")),
        "panel_precision_50": share(total("matched50"), total("found")),
        "handle_recall": share(total("handles_hit"), total("handles")),
        "handle_precision": share(total("handles_right"), total("handles_found")),
        "kind_accuracy": share(total("kinds_right"), total("matched50")),
        "cuboid_high": len(sure),
        "cuboid_right_when_high": share(sum(s.front_iou >= 0.8 for s in sure), len(sure)),
        "panels_high": len(sure_panels),
        "panels_right_when_high": share(
            sum(s.matched50 == s.panels == s.found for s in sure_panels), len(sure_panels)
        ),
        "stopped": sum(bool(s.stopped) for s in scores),
        "seconds_median": _q(np.array([s.seconds for s in scores]), 50),
    }


def _q(values: Array, percentile: float) -> float | None:
    return round(float(np.percentile(values, percentile)), 4) if len(values) else None
