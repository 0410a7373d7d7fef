"""Success in closed form: progress, contact's share of the motion, sequences."""

from __future__ import annotations

import pytest
import torch

from mam_envs.config import SuccessConfig
from mam_envs.tasks.base import JointGoal
from mam_envs.tasks.success import SuccessTracker

CPU = torch.device("cpu")
CONFIG = SuccessConfig()


def goal(**changes: float) -> JointGoal:
    rows: dict = {
        "joint": "j", "task": "open", "subtype": "slide", "q_start": 0.0, "q_goal": 0.3,
        "tolerance": 0.0, "closed": 0.0, "open": 0.4, "lower": 0.0, "upper": 0.4,
        "still_speed": 0.1,
    }  # fmt: skip
    return JointGoal(**(rows | changes))


def t(*values: float) -> torch.Tensor:
    return torch.tensor(values)


def test_progress_and_fraction_of_two_goals() -> None:
    tracker = SuccessTracker([[goal()], [goal(q_start=0.4, q_goal=0.1)]], CONFIG, CPU)
    torch.testing.assert_close(tracker.progress(t(0.15, 0.25)), t(0.5, 0.5))
    torch.testing.assert_close(tracker.open_fraction(t(0.1, 0.1)), t(0.25, 0.25))


def test_only_motion_with_contact_or_just_after_it_counts() -> None:
    tracker = SuccessTracker([[goal()]], CONFIG, CPU)
    tracker.reset(torch.tensor([0]), torch.zeros(1, 1))
    tracker.update(t(0.1), t(5.0))
    assert bool(tracker.by_contact[0]) and bool(tracker.touching[0])
    for k in range(CONFIG.grace_steps):
        tracker.update(t(0.1 + 0.01 * (k + 1)), t(0.0))
    assert float(tracker.untouched[0]) == 0.0
    tracker.update(t(0.35), t(0.0))  # 0.15 of it by contact, 0.2 by itself
    assert float(tracker.untouched[0]) == pytest.approx(0.2 / 0.4)
    assert not bool(tracker.by_contact[0])
    assert not bool(tracker.evaluate(t(0.35), t(0.0))[0][0])
    tracker.reset(torch.tensor([0]), torch.zeros(1, 1))
    tracker.update(t(0.35), t(5.0))
    assert bool(tracker.evaluate(t(0.35), t(0.05))[0][0])
    assert not bool(tracker.evaluate(t(0.35), t(0.2))[0][0])  # too fast


def test_too_much_force_is_a_failure_for_good() -> None:
    limits = SuccessConfig(part_force=60.0, link_force=None)
    tracker = SuccessTracker([[goal()], [goal()]], limits, CPU)
    tracker.load(t(61.0, 59.0), t(500.0, 500.0))
    tracker.load(t(0.0, 0.0), t(0.0, 0.0))
    tracker.update(t(0.35, 0.35), t(5.0, 5.0))
    assert tracker.overloaded.tolist() == [True, False]
    assert tracker.evaluate(t(0.35, 0.35), t(0.0, 0.0))[0].tolist() == [False, True]
    tracker.reset(torch.tensor([0]), torch.zeros(1, 1))
    assert not bool(tracker.overloaded[0])


def test_a_value_is_met_within_its_tolerance_only() -> None:
    tracker = SuccessTracker([[goal(tolerance=0.02)]], CONFIG, CPU)
    tracker.update(t(0.29), t(1.0))
    assert bool(tracker.evaluate(t(0.29), t(0.0))[0][0])
    assert not bool(tracker.evaluate(t(0.33), t(0.0))[0][0])


def test_sequences_succeed_with_their_last_joint() -> None:
    tracker = SuccessTracker([[goal(), goal(q_goal=0.2)]], CONFIG, CPU)
    tracker.update(t(0.3), t(1.0))
    success, done = tracker.evaluate(t(0.3), t(0.0))
    assert not bool(success[0]) and bool(done[0])
    tracker.advance(done, torch.tensor([[0.3, 0.1]]))
    assert tracker.stage.tolist() == [1]
    assert float(tracker.progress(t(0.15))[0]) == pytest.approx(0.5)
    assert not bool(tracker.by_contact[0])  # what was done to the first joint does not count here
    tracker.update(t(0.2), t(1.0))
    assert bool(tracker.evaluate(t(0.2), t(0.0))[0][0])
