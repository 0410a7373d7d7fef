"""How a joint handles in the simulator is what Coulomb and Newton say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.check.correct import written_and_checked
from mam_pipeline.check.drive import STEP, Handling, drive_urdf
from mam_pipeline.thresholds import HANDLING
from mam_sim.facts import joint_facts
from tests.pipeline.fault_cases import SLIDE, case
from tests.pipeline.test_check import cabinet

pytestmark = pytest.mark.sim

G, MASS, ARM, WAY = 9.81, 2.0, 0.2, 0.2
"""The door of `fault_cases.PASS`: kg, its middle from the hinge and the way as a slide, metres."""
UP = ('axis xyz="-1 0 0"', 'axis xyz="0 0 1"')
RESOLUTION = HANDLING.beyond / 2**HANDLING.rounds


def handling(folder: Path, friction: float, *changes: tuple[str, str]) -> Handling:
    driven = drive_urdf(case(folder / "x", *changes), {"hinge": (friction, 0.0)})
    found = driven.joints["hinge"].handling
    assert found is not None
    return found


@pytest.mark.parametrize("friction", [0.5, 3.0])
def test_a_slide_starts_and_slips_at_its_friction(tmp_path: Path, friction: float) -> None:
    found = handling(tmp_path, friction, SLIDE)
    tilt = np.degrees(np.arcsin(friction / (MASS * G)))
    assert found.breakaway == pytest.approx(friction, rel=2 * RESOLUTION)
    assert [found.tilt_closed, found.tilt_half] == pytest.approx([tilt, tilt], abs=0.6)
    assert found.let_go == 0.0


def test_a_door_starts_at_its_friction_and_opens_by_itself_when_tilted(tmp_path: Path) -> None:
    found = handling(tmp_path, 1.0)
    assert found.breakaway == pytest.approx(1.0, rel=2 * RESOLUTION)
    tilt = np.degrees(np.arcsin(1.0 / (MASS * G * ARM)))
    assert found.tilt_closed == pytest.approx(tilt, abs=0.6)


def test_what_is_lifted_asks_for_its_weight_too_and_falls_without_friction(tmp_path: Path) -> None:
    held = handling(tmp_path, 1.5 * MASS * G, SLIDE, UP)
    assert held.breakaway == pytest.approx(2.5 * MASS * G, rel=2 * RESOLUTION)
    assert held.let_go == 0.0
    assert held.tilt_half == HANDLING.tilt  # a tilt only takes weight from it
    free = handling(tmp_path, 0.0, SLIDE, UP)
    assert free.breakaway == pytest.approx(MASS * G, rel=2 * RESOLUTION)
    assert free.let_go == pytest.approx(np.sqrt(G * WAY), abs=G * STEP)
    assert free.tilt_half < 1.0


def test_card_and_report_say_what_was_measured(tmp_path: Path) -> None:
    from mam_pipeline.asset.writer import write_asset

    asset, _ = written_and_checked(cabinet(), lambda a: write_asset(a, tmp_path / "a", name="a"))
    rows = {row["joint"]: row for row in asset.card.checks["executability"]["measured"]}
    for joint in asset.card.movable:
        assert rows[joint.name]["breakaway"] == pytest.approx(joint.friction, rel=2 * RESOLUTION)
    words = {row.joint.name: row.handling for row in joint_facts(asset.card, asset.card.movable)}
    assert words["slide"].startswith("starts at 2.4 N, stays up to a tilt of 3 ° closed")
