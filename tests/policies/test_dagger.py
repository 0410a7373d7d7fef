"""DAgger's labels: the expert's plan at the pace of the learner."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_policies.dagger import dagger_steps
from mam_policies.expert import Expert
from mam_policies.run import EnvChoice


class Learner:
    """Acts by a function of the environment, the expert's plan and the number of the step."""

    def __init__(self, env: Any, act: Callable[[Any, Expert, int], np.ndarray]) -> None:
        self.env, self._act = env, act

    def reset(self) -> None:
        """Plan as the teacher does."""
        self.expert, self.step = Expert(self.env, attempts=1), -1
        self.expert.reset()

    def act(self, _: Any) -> np.ndarray:
        """The function's action."""
        self.step += 1
        return self._act(self.env.unwrapped, self.expert, self.step)


@pytest.fixture(scope="module")
def env(drawer: Path) -> Iterator[Any]:
    """The drawer before a Panda."""
    env = EnvChoice((str(drawer),), max_steps=150).make()
    yield env
    env.close()


def at_row(env: Any, expert: Expert, row: int, gripper: float | None = None) -> np.ndarray:
    """The action towards a row of the plan."""
    row = min(row, len(expert.plan) - 1)
    closed = float(expert.plan.gripper[row]) if gripper is None else gripper
    return env.robot_spec.action(expert.plan.arm[row], closed)


def labels(env: Any, act: Callable[[Any, Expert, int], np.ndarray]) -> tuple[Any, Expert, bool]:
    """All labels of an episode, the plan behind them, and whether it succeeded."""
    learner = Learner(env, act)
    rows = list(dagger_steps(env, learner, 3, 0.5))
    return np.stack([label for _, label, _ in rows]), learner.expert, rows[-1][2]


def test_a_learner_that_follows_is_told_the_plan_to_its_success(env: Any) -> None:
    told, expert, success = labels(env, at_row)
    assert success
    assert np.allclose(told[:5, :-1], expert.plan.arm[:5])
    assert told[-1, -1] == env.unwrapped.robot_spec.closed


def test_a_learner_that_stands_still_is_told_the_next_row_only(env: Any) -> None:
    told, expert, success = labels(env, lambda e, x, _: at_row(e, x, 0))
    assert not success and len(told) == 150
    ahead = np.abs(told[-1, :-1] - env.unwrapped.planner_state().arm).max()
    assert ahead < 0.3 < np.abs(expert.plan.arm[-1] - told[-1, :-1]).max()
    assert (told[:, -1] == expert.plan.gripper[0]).all()


def test_a_hand_that_does_not_close_is_told_to_close_not_to_pull(env: Any) -> None:
    told, expert, success = labels(
        env, lambda e, x, k: at_row(e, x, min(k, x.plan.phase.index("close")), e.robot_spec.opened)
    )
    assert not success
    assert np.allclose(told[-20:, :-1], expert.plan.path.approach[-1])
    assert (told[-20:, -1] == env.unwrapped.robot_spec.closed).all()


def test_where_a_grasp_slipped_the_labels_end(env: Any) -> None:
    def slips(e: Any, expert: Expert, step: int) -> np.ndarray:
        opened = step >= expert.plan.phase.index("follow")
        return at_row(e, expert, step, e.robot_spec.opened if opened else None)

    # the hand closes as it should, lets go when it is to pull, and moves on without the drawer
    told, expert, success = labels(env, slips)
    assert not success
    assert expert.plan.phase.index("follow") < len(told) < len(expert.plan)
