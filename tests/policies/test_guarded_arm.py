"""What goes over the wire of LeRobot's own SO follower, whose bus is one that records."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("lerobot.robots.so_follower", reason="this LeRobot has no SO follower")

from lerobot.robots.robot import Robot
from lerobot.robots.so_follower import SO101Follower
from lerobot.robots.so_follower.config_so_follower import SOFollowerRobotConfig
from mam_sim_arm.guarded_arm import Lost, connected
from mam_sim_arm.held_key import NoKey
from mam_sim_arm.recording import checked_signs
from mam_sim_arm.safety import Guard, KeyReleased, SafetyConfig, StoppedForSafety
from mam_sim_arm.setup import guess_mapping

from mam_envs.robots import robot_spec
from mam_pipeline.errors import ConfigError

SPEC = robot_spec("so101")
MAPPING = guess_mapping(SPEC, None, "so101_follower")
NAMES = [*SPEC.arm, "gripper"]
PAN = np.array([0.1, 0, 0, 0, 0])
FAST = SafetyConfig(rate=100, speed=10, patience=3)


class Bus:
    """A bus of ideal motors: each is where it was sent last; every write is kept."""

    def __init__(self) -> None:
        real = MAPPING.to_real(NAMES, np.append(SPEC.rest_arm, SPEC.shut))
        self.motors = {n: SimpleNamespace(model="sts3215") for n in NAMES}
        self.at = dict(zip(NAMES, map(float, real)))
        self.writes: list[tuple[str, Any]] = []
        self.torque, self.raw, self.is_connected, self.is_calibrated = 0, 0, False, True
        self.dead = False
        self.stuck: set[str] = set()

    def connect(self) -> None:
        self.is_connected = True

    def disconnect(self, disable_torque: bool = True) -> None:
        if disable_torque:
            self.disable_torque()
        self.is_connected = False

    def sync_read(self, name: str, *_: Any, **__: Any) -> dict[str, Any]:
        if self.dead:
            raise ConnectionError("Failed to sync read\nno status packet")
        rows = {"Present_Current": self.raw, "Torque_Enable": self.torque}
        return dict(self.at) if name == "Present_Position" else dict.fromkeys(NAMES, rows[name])

    def sync_write(self, name: str, values: dict[str, float]) -> None:
        if self.dead:
            raise ConnectionError("Failed to sync write\nno status packet")
        self.writes.append((name, dict(values)))
        self.at.update({n: v for n, v in values.items() if n not in self.stuck})

    def write(self, name: str, _motor: str, value: Any) -> None:
        self.writes.append((name, value))

    def configure_motors(self) -> None:
        self.writes.append(("configure", None))

    def disable_torque(self) -> None:
        self.torque = 0
        self.writes.append(("Torque_Enable", 0))

    @contextmanager
    def torque_disabled(self) -> Iterator[None]:
        self.disable_torque()
        yield
        self.torque = 1
        self.writes.append(("Torque_Enable", 1))

    @property
    def goals(self) -> np.ndarray:
        """(K, 6) targets that were sent, simulated joints."""
        rows = [[v[n] for n in NAMES] for name, v in self.writes if name == "Goal_Position"]
        return MAPPING.to_sim(NAMES, np.array(rows).reshape(-1, len(NAMES)))


class Keys(NoKey):
    """A person who presses these keys one after the other, and holds each `held` steps."""

    person = True

    def __init__(self, keys: str, held: int = 10_000) -> None:
        self.keys, self.held, self.now, self.steps = list(keys), held, "", 0

    def down(self, only: str = "") -> bool:
        self.steps += 1
        return self.steps <= self.held and (not only or self.now in only)

    def wait(self) -> str:
        self.now, self.steps = self.keys.pop(0), 0
        return self.now


@pytest.fixture
def follower() -> Any:
    """LeRobot's driver, without a serial port."""
    robot = SO101Follower.__new__(SO101Follower)
    robot.config = SOFollowerRobotConfig(port="none")
    Robot.__init__(robot, robot.config)
    robot.bus, robot.cameras = Bus(), {}  # type: ignore[assignment]
    return robot


def arm_of(follower: Any, key: Any = None, say: Any = lambda _words: None, **more: Any) -> Any:
    return connected(follower, SPEC, MAPPING, SafetyConfig(**more) if more else FAST, key, say)


def test_looking_writes_nothing(follower: Any) -> None:
    with arm_of(follower) as arm:
        for _ in range(5):
            arm.look()
        np.testing.assert_allclose(arm.now()[:-1], SPEC.rest_arm, atol=1e-6)
        with pytest.raises(StoppedForSafety, match="nothing was sent"):
            arm.send(arm.now())
    assert follower.bus.writes == [] and not follower.bus.is_connected


@pytest.mark.parametrize("error", [RuntimeError("bug"), KeyboardInterrupt(), SystemExit(1)])
def test_however_it_ends_the_arm_holds_with_torque_on(follower: Any, error: BaseException) -> None:
    with pytest.raises(type(error)), arm_of(follower) as arm, arm.moving():
        arm.allow(arm.now()[None, :-1])
        arm.send(arm.now() + 0.02)
        raise error
    bus = follower.bus
    assert bus.torque == 1 and not bus.is_connected
    name, last = bus.writes[-1]
    assert name == "Goal_Position" and last == pytest.approx(bus.at)


def test_torque_comes_on_where_the_arm_is_and_a_held_arm_is_not_let_down(follower: Any) -> None:
    bus = follower.bus
    with arm_of(follower) as arm:
        arm.engage()
    names = [name for name, _ in bus.writes]
    assert names[0] == "Goal_Position" and names.index("configure") > 0
    np.testing.assert_allclose(bus.goals, np.tile(bus.goals[0], (len(bus.goals), 1)))
    bus.writes.clear()  # the arm holds; the next command comes
    with arm_of(follower) as arm:
        arm.engage()
    assert {name for name, _ in bus.writes} == {"Goal_Position"}


def test_one_key_brings_it_to_rest_slowly_and_another_switches_torque_off(follower: Any) -> None:
    bus, said = follower.bus, []  # type: ignore[var-annotated]
    with arm_of(follower, Keys(" rt"), said.append, speed=1.0) as arm, arm.moving():
        arm._pause = 0.0
        away = arm.now()
        away[1] += 0.4
        arm.allow(np.stack([arm.now()[:-1], away[:-1]]))
        arm.move(away[:-1], away[-1])
        sent = len(bus.goals)
    steps = np.abs(np.diff(bus.goals[sent:], axis=0))[:, :-1]
    assert 0 < steps.max() <= 0.25 * SPEC.step + 1e-6
    np.testing.assert_allclose(bus.goals[-1, :-1], SPEC.rest_arm, atol=0.01)
    assert bus.writes[-1] == ("Torque_Enable", 0) and not bus.is_connected
    assert sum(w == ("Torque_Enable", 0) for w in bus.writes) == 2  # once by configure
    assert "t: torque off" in " ".join(said)


def test_a_key_let_go_sends_a_hold_and_nothing_else(follower: Any) -> None:
    bus = follower.bus
    with pytest.raises(KeyReleased), arm_of(follower, Keys(" q", 4)) as arm, arm.moving():
        arm.allow(arm.now()[None, :-1])
        for _ in range(10):
            arm.send(arm.now() + 0.01)
    moved = np.abs(np.diff(bus.goals, axis=0)).max(axis=1) > 1e-6
    assert moved.sum() == 4 and not moved[-1] and bus.torque == 1


def test_a_lost_arm_says_so_and_is_left_with_torque(follower: Any) -> None:
    said: list[str] = []
    stopped = pytest.raises(Lost, match="does not answer")
    with stopped, arm_of(follower, say=said.append) as arm, arm.moving():
        arm.allow(arm.now()[None, :-1])
        follower.bus.dead = True
        arm.send(arm.now())
    assert follower.bus.torque == 1 and "hold their last target" in said[0]


def test_a_motor_under_too_much_current_stops_the_arm(follower: Any) -> None:
    follower.bus.raw = 0x8000 | 400  # 2.6 A, backwards
    with (
        pytest.raises(StoppedForSafety, match="the motors cool"),
        arm_of(follower) as arm,
        arm.moving(),
    ):
        arm.allow(arm.now()[None, :-1])
        for _ in range(5):
            arm.send(arm.now())


def test_a_joint_that_small_steps_do_not_move_is_named() -> None:
    guard, at = Guard(SPEC, SafetyConfig()), np.array(SPEC.rest_arm)
    for k in range(60):  # it creeps after its target
        guard._strain(at + 0.002 * k + 0.02, at + 0.002 * k, ())
    assert guard.unmoved() is None
    guard.reset()
    for _ in range(60):
        guard._strain(np.add(at, [0, 0, 0.02, 0, 0]), at, ())
    told = guard.unmoved()
    assert told is not None and f"{SPEC.arm[2]} did not move, though it was asked for 1.2" in told


def test_links_and_gripper_stay_above_the_ground_and_near_the_way(follower: Any) -> None:
    low = np.add(SPEC.rest_arm, [0, 0.9, 0.3, 0, 0])  # the hand would go below the table
    stopped = pytest.raises(StoppedForSafety, match="below the ground")
    with stopped, arm_of(follower) as arm, arm.moving():
        space = arm.allow(np.stack([SPEC.rest_arm, low]), SPEC.rest_arm[None])
        arm.move(low, SPEC.opened)
    away, _ = space.away(follower.bus.goals[:, :-1], SPEC.opened)
    assert away.max() == 0.0
    side = np.add(SPEC.rest_arm, [1.2, 0, 0, 0, 0])
    stopped = pytest.raises(StoppedForSafety, match="outside the planned workspace")
    with stopped, arm_of(follower) as arm, arm.moving():
        arm.allow(SPEC.rest_arm[None])
        arm.move(side, SPEC.opened)


def test_no_step_is_faster_than_the_limit(follower: Any) -> None:
    goal = np.add(SPEC.rest_arm, [1, 0, 0, 0, 0])
    with arm_of(follower, rate=50, speed=1.0, patience=1000) as arm, arm.moving():
        arm.allow(np.linspace(SPEC.rest_arm, goal, 9))
        for _ in range(3):
            arm.send(np.append(goal, SPEC.opened))
    steps = np.abs(np.diff(follower.bus.goals, axis=0))
    assert steps[:, :-1].max() == pytest.approx(0.02)
    assert steps[:, -1].max() <= 0.5 * arm.guard.span + 1e-9


def test_a_joint_out_of_its_range_is_a_wrong_mapping(follower: Any) -> None:
    follower.bus.at["elbow_flex"] += 180.0
    with pytest.raises(StoppedForSafety, match="elbow_flex is read"), arm_of(follower) as arm:
        arm.engage()
    assert follower.bus.writes == []


def test_an_arm_that_is_read_below_the_ground_does_not_go_to_rest(follower: Any) -> None:
    """As a joint with a wrong sign is; torque can still be switched off."""
    low = MAPPING.to_real(NAMES, np.append([0, 1.0, 0.5, 0.5, 0], SPEC.shut))
    follower.bus.at = dict(zip(NAMES, map(float, low)))
    said: list[str] = []
    with arm_of(follower, Keys("rt"), said.append) as arm:
        arm.engage()
    assert "cm below the ground it stands on: a sign" in said[1]
    goals = follower.bus.goals
    np.testing.assert_allclose(goals, np.tile(goals[0], (len(goals), 1)))  # holds alone
    assert follower.bus.writes[-1] == ("Torque_Enable", 0)


def test_a_person_turns_a_sign_that_is_wrong(follower: Any) -> None:
    said: list[str] = []
    key = Keys(" " + "y " + "n " + "y " * 3 + "q")
    with arm_of(follower, key, said.append) as arm, arm.moving():
        found = checked_signs(arm, said.append)
    signs = np.sign(found.arrays(SPEC.arm)[0]) * np.sign(MAPPING.arrays(SPEC.arm)[0])
    assert signs.tolist() == [1, -1, 1, 1, 1]
    asked = [words for words in said if words.endswith("y or n")]
    before, after = SPEC.chain.forward(np.stack([SPEC.rest_arm, SPEC.rest_arm + PAN]))[1]
    assert ("left" if after[1] > before[1] else "right") in asked[0]  # +x is ahead, +y left
    assert "clockwise" in asked[4]


def test_a_joint_that_is_asked_about_turns_a_little_whatever_its_sign(follower: Any) -> None:
    """Read far out of its range, or below the ground, the arm is still asked about."""
    bus, said = follower.bus, []  # type: ignore[var-annotated]
    bus.at["shoulder_lift"] *= 1.5  # as with a wrong sign or zero: 0.7 rad out of the range
    key = Keys(" " + "y " * 5 + "q")
    stopped = pytest.raises(StoppedForSafety, match=r"outside its range .* lerobot-calibrate again")
    with stopped, arm_of(follower, key, said.append, speed=1.0, rate=1000) as arm:
        arm.signs_known = False
        with arm.moving():
            checked_signs(arm, said.append)
    assert sum(words.endswith("y or n") for words in said) == 5
    off = np.abs(bus.goals - bus.goals[0])[:, :-1]
    assert 0.1 < off.max() < 0.13 and ((off > 1e-6).sum(axis=1) <= 1).all()
    with arm_of(follower) as arm:
        arm.signs_known = False
        arm.engage()
        arm.allow_turn(0.1)
        with pytest.raises(StoppedForSafety, match="while its sign is not known"):
            arm.move(arm.now()[:-1] + 0.3, SPEC.shut)


def test_a_dead_motor_is_not_taken_for_a_wrong_sign(follower: Any) -> None:
    follower.bus.stuck.add("elbow_flex")
    said: list[str] = []
    stopped = pytest.raises(StoppedForSafety, match="elbow_flex was to turn by 7 degrees and is")
    with stopped, arm_of(follower, Keys(" y y rq"), said.append) as arm:
        arm.signs_known = False
        with arm.moving():
            checked_signs(arm, said.append)
    assert "the way to rest is not known" in said[-2]  # r, pressed before all were asked about
    assert sum(words.endswith("y or n") for words in said) == 2


def test_an_arm_that_lerobot_has_not_calibrated_is_refused(follower: Any) -> None:
    follower.bus.is_calibrated = False
    with pytest.raises(ConfigError, match="lerobot-calibrate"), arm_of(follower):
        pass
    assert follower.bus.writes == [] and not follower.bus.is_connected


def test_a_calibration_waits_for_the_key_and_goes_on(follower: Any) -> None:
    said: list[str] = []
    with arm_of(follower, Keys("    q", 5), said.append) as arm, arm.moving():
        goal = SPEC.rest_arm + PAN
        arm.allow(np.stack([SPEC.rest_arm, goal]))
        arm.move(goal, SPEC.shut)
    assert sum("Hold the key down to go on" in words for words in said) >= 1
    held = np.flatnonzero(np.abs(np.diff(follower.bus.goals[:, 0])) < 1e-9)
    assert len(held) and follower.bus.goals[-1, 0] == pytest.approx(goal[0], abs=0.01)
