"""The judge in closed form: progress, contact's share of the motion, sequences."""

from __future__ import annotations

import pytest
import torch

from mam_envs.config import JointGoal
from mam_envs.tasks.success import GRACE_STEPS, Judge

CPU = torch.device("cpu")


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
    judge = Judge([[goal()], [goal(q_start=0.4, q_goal=0.1)]], 0.5, CPU)
    torch.testing.assert_close(judge.progress(t(0.15, 0.25)), t(0.5, 0.5))
    torch.testing.assert_close(judge.open_fraction(t(0.1, 0.1)), t(0.25, 0.25))


def test_only_motion_with_contact_or_just_after_it_counts() -> None:
    judge = Judge([[goal()]], 0.5, CPU)
    judge.forget(torch.tensor([0]), torch.zeros(1, 1))
    judge.count(t(0.1), t(5.0))
    assert bool(judge.by_contact[0]) and bool(judge.touching[0])
    for k in range(GRACE_STEPS):
        judge.count(t(0.1 + 0.01 * (k + 1)), t(0.0))
    assert float(judge.untouched[0]) == 0.0
    judge.count(t(0.35), t(0.0))  # 0.15 of it by contact, 0.2 by itself
    assert float(judge.untouched[0]) == pytest.approx(0.2 / 0.4)
    assert not bool(judge.by_contact[0])
    assert not bool(judge.verdict(t(0.35), t(0.0))[0][0])
    judge.forget(torch.tensor([0]), torch.zeros(1, 1))
    judge.count(t(0.35), t(5.0))
    assert bool(judge.verdict(t(0.35), t(0.05))[0][0])
    assert not bool(judge.verdict(t(0.35), t(0.2))[0][0])  # too fast


def test_a_value_is_met_within_its_tolerance_only() -> None:
    judge = Judge([[goal(tolerance=0.02)]], 0.5, CPU)
    judge.count(t(0.29), t(1.0))
    assert bool(judge.verdict(t(0.29), t(0.0))[0][0])
    assert not bool(judge.verdict(t(0.33), t(0.0))[0][0])


def test_sequences_succeed_with_their_last_joint() -> None:
    judge = Judge([[goal(), goal(q_goal=0.2)]], 0.5, CPU)
    judge.count(t(0.3), t(1.0))
    success, done = judge.verdict(t(0.3), t(0.0))
    assert not bool(success[0]) and bool(done[0])
    judge.advance(done, torch.tensor([[0.3, 0.1]]))
    assert judge.stage.tolist() == [1] and float(judge.progress(t(0.15))[0]) == pytest.approx(0.5)
    assert not bool(judge.by_contact[0])  # what was done to the first joint does not count here
    judge.count(t(0.2), t(1.0))
    assert bool(judge.verdict(t(0.2), t(0.0))[0][0])
