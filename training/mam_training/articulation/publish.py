"""A trained network as the file that the engine reads: what it needs, in half precision."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

KEPT = ("enter", "object", "part", "count", "fused", "link", "blocks", "last", "move")


def publish(weights: Mapping[str, Tensor], about: Mapping[str, Any], path: Path) -> None:
    """Write an .npz for `mam_pipeline.parts.mobility_network`.

    Args:
        weights: of `PartNetwork`. about: the description of the corpus.
    """
    arrays: dict[str, Any] = {
        name: value.cpu().numpy().astype(np.float16)
        for name, value in weights.items()
        if name.split(".")[0] in KEPT
    }
    for name in ("object", "part", "count"):  # nothing is told: the first rows
        arrays[f"{name}.weight"] = arrays[f"{name}.weight"][:1]
    for name, columns, scale in zip(("primitive", "pair"), about["columns"], about["scales"]):
        arrays[f"{name}_names"] = np.array(columns)
        arrays[f"{name}_scale"] = np.asarray(scale, np.float32)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, **arrays)
