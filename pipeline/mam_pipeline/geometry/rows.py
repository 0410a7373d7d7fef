"""Equal rows of tables, found by one integer per row: much faster than sorting whole rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.types import IntArray

_MOST = 2**62


def row_keys(rows: NDArray[Any]) -> IntArray:
    """One integer per row of (n, k), ordered as the rows are from their first column on.

    Equal rows have equal keys, so that `np.unique(row_keys(a), ...)` answers what
    `np.unique(a, axis=0, ...)` does, in the same order.
    """
    key: IntArray = np.zeros(len(rows), dtype=np.int64)
    if not len(rows):
        return key
    spread = 1
    for column in rows.T:
        rank, width = _ranks(column)
        if spread > _MOST // width:
            key = _dense(key)
            spread = int(key.max()) + 1
            if spread > _MOST // width:
                rank = _dense(rank)
                width = int(rank.max()) + 1
        key = key * width + rank
        spread *= width
    return key


def _ranks(column: NDArray[Any]) -> tuple[IntArray, int]:
    """Numbers (n,) from 0 in the order of a column's values, and one more than the largest."""
    if np.issubdtype(column.dtype, np.integer):
        low, high = int(column.min()), int(column.max())
        if high - low < 2**40:
            return column.astype(np.int64) - low, high - low + 1
    rank = _dense(column)
    return rank, int(rank.max()) + 1


def _dense(values: NDArray[Any]) -> IntArray:
    """Numbers 0, 1, ... in the order of the values, equal ones for equal values."""
    rank = np.unique(values, return_inverse=True)[1]
    return np.asarray(rank.reshape(-1), dtype=np.int64)
