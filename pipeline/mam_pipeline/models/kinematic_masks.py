"""Multi-view kinematic masks, whoever made them, as votes on primitives (paper 3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.models.views import View
from mam_pipeline.types import FloatArray, IntArray, Primitives


def votes(views: list[View], masks: IntArray, primitives: Primitives) -> FloatArray:
    """(P, C) pixels that each primitive shares with each mask label, over all views.

    Args:
        masks: (N, H, W) labels 0 .. C - 1, -1 background; N and the size are those of `views`.
    """
    count = max(int(masks.max()) + 1, 1)
    out = np.zeros((primitives.count, count))
    for view, mask in zip(views, masks):
        ids = view.ids(primitives.labels)
        both = (ids >= 0) & (mask >= 0)
        np.add.at(out, (ids[both], mask[both]), 1.0)
    return out


def prior_from_masks(
    views: list[View], masks: IntArray, primitives: Primitives, source: str
) -> KinematicPrior:
    """Affinity is the overlap of two primitives' label distributions; the largest label is base.

    Primitives that no view shows get affinity 0.5 and mobility 0.5: nothing is known of them.
    """
    count = votes(views, masks, primitives)
    seen = count.sum(axis=1)
    share = count / np.maximum(seen, 1.0)[:, None]
    affinity: NDArray[np.float64] = np.minimum(share[:, None, :], share[None, :, :]).sum(axis=2)
    base = int(count.sum(axis=0).argmax())
    mobility = 1.0 - share[:, base]
    hidden = seen < 10
    affinity[hidden, :] = affinity[:, hidden] = 0.5
    np.fill_diagonal(affinity, 1.0)
    mobility[hidden] = 0.5
    return KinematicPrior(
        mobility=mobility,
        affinity=affinity,
        masks=masks,
        views=np.stack([v.camera_T_asset for v in views]),
        source=source,
        evidence={"labels": int(count.shape[1]), "hidden": int(hidden.sum())},
    )
