"""Every simulator opens every kind of asset: nothing is lost, and everything is where it was."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mam_pipeline.asset.card import Asset
from tests.conformance.simulators import READERS, Missing, Opened, card

SLOW = ("photo's twin", "GLB of three materials", "fused mesh")
FAST = ("generated", "part on part")
BOX_TOLERANCE = 1e-3
"""Metres."""


@pytest.fixture(scope="session")
def references() -> dict[str, Opened]:
    return {}


@pytest.mark.parametrize("simulator", list(READERS))
@pytest.mark.parametrize("name", [*(pytest.param(n, marks=pytest.mark.slow) for n in SLOW), *FAST])
def test_an_asset_is_opened_whole(
    name: str,
    simulator: str,
    asset_named: Callable[[str], Asset],
    references: dict[str, Opened],
    rows: list[dict[str, Any]],
) -> None:
    asset = asset_named(name)
    wanted = references.get(name) or references.setdefault(name, card(asset))
    try:
        found = READERS[simulator](asset)
    except (Missing, ImportError) as error:
        pytest.skip(str(error))
    row = _row(found, wanted)
    told = {"version": found.version} if found.version else {}
    rows.append({"asset": name, "simulator": simulator, **row, **told})
    assert found.links == wanted.links and found.joints == wanted.joints
    assert found.visuals == wanted.visuals and found.textured in (None, wanted.textured)
    assert found.faces in (None, wanted.faces)
    assert row["mass"] < 1e-6 and row["limits"] < 1e-6 and row["kinematics"] < 1e-6
    assert set(found.limits) == set(wanted.limits)
    for key in ("visual_box", "collision_box"):
        assert row[key] is None or row[key] < 1e3 * BOX_TOLERANCE


def _row(found: Opened, wanted: Opened) -> dict[str, Any]:
    pairs = [("links", found.links, wanted.links), ("joints", found.joints, wanted.joints)]
    row: dict[str, Any] = {k: f"{len(a & b)}/{len(b)}" for k, a, b in pairs}
    for key in ("visuals", "textured", "faces"):
        value = getattr(found, key)
        row[key] = None if value is None else f"{value}/{getattr(wanted, key)}"
    row["mass"] = max(abs(found.masses[k] / m - 1) for k, m in wanted.masses.items())
    row["limits"] = max(
        (abs(a - b) for k, v in wanted.limits.items() for a, b in zip(found.limits[k], v)),
        default=0.0,
    )
    row["kinematics"] = float(
        max(np.abs(p[k] - q[k]).max() for p, q in zip(found.poses, wanted.poses) for k in q)
    )
    for key, mine, theirs in (
        ("visual_box", found.visual_boxes, wanted.visual_boxes),
        ("collision_box", found.collision_boxes, wanted.collision_boxes),
    ):
        row[key] = None
        if mine is not None and theirs is not None:
            row[key] = 1e3 * float(max(np.abs(mine[k] - theirs[k]).max() for k in theirs))
    return row
