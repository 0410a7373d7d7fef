"""Stand-ins that speak the protocols of external models, for the tests of their adapters."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.types import Mesh, Primitives


@pytest.fixture
def boxes() -> tuple[Mesh, Primitives]:
    """A body, a door before it and a knob on the door: three primitives."""
    places = (
        ((0.4, 0.5, 0.6), (0, 0, 0.3)),
        ((0.02, 0.46, 0.5), (-0.215, 0, 0.3)),
        ((0.04, 0.05, 0.05), (-0.245, 0.18, 0.3)),
    )
    parts = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        .subdivide()
        .subdivide()
        for size, at in places
    ]
    labels = np.concatenate([np.full(len(p.faces), i) for i, p in enumerate(parts)])
    joined: Any = trimesh.util.concatenate(parts)
    return Mesh(joined.vertices, joined.faces), Primitives(labels)


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], str]:
    """A command whose Python code finds its folders in `inbox` and `out`."""

    def write(code: str) -> str:
        path = tmp_path / "runner.py"
        path.write_text(
            "import json, pathlib, sys, time\n"
            "import numpy as np\n"
            "out = pathlib.Path(sys.argv[sys.argv.index('--output') + 1])\n"
            "inbox = pathlib.Path(sys.argv[sys.argv.index('--input') + 1])\n" + code
        )
        return f"{sys.executable} {path}"

    return write


@pytest.fixture
def grouping() -> dict[str, Any]:
    """A right answer to the first question about `boxes`."""
    body = {"name": "body", "kind": "body", "is_base": True, "pieces": [0], "confidence": 0.9}
    door = {"name": "door", "kind": "door", "is_base": False, "pieces": [1, 2], "confidence": 0.8}
    return {"parts": [body, door]}


@pytest.fixture
def mounting() -> dict[str, Any]:
    """A right answer to the second question about `boxes`."""
    door = {
        "name": "door", "parent": "body", "motion": "hinge", "confidence": 0.9,
        "second_best": "slide", "axis": "z", "side": "-y", "opens": "-x",
    }  # fmt: skip
    return {"mounts": [door]}
