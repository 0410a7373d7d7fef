"""The one way from a verb to a motor: every command passes the key, the limits and this file.

An arm that stops holds where it is, with torque on. On one key it then returns to rest, slowly; on
another its torque is switched off, and only then is it disconnected.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from mam_envs.robots import RobotSpec
from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.types import FloatArray
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_sim_arm.held_key import Key, NoKey
from mam_sim_arm.safety import (
    Guard,
    KeyReleased,
    LittleTurn,
    SafetyConfig,
    StoppedForSafety,
    Workspace,
)

Say = Callable[[str], None]
TORQUE = "disable_torque_on_disconnect"
"""Field of LeRobot's robots: whether disconnecting lets the arm fall."""
AMPERES = {"sts3215": 0.0065}
"""What one count of Present_Current is, by the motor's model."""
TRIES = 3
"""Times that a reading or a hold is tried: single packets get lost on a serial bus."""
BEYOND = 0.35
"""Radians beyond its range at which a joint's mapping must be wrong."""
CALIBRATE = "run `mam-sim calibrate`"
"""What to do about a joint mapping that is wrong."""
REST_SHARE, BACK_OFF = 0.25, 0.1
"""Of the usual speed, on the way to rest; and of the reach, to leave what the hand held."""


class Lost(StoppedForSafety):
    """The arm or its camera does not answer."""


class GuardedArm:
    """A connected robot of LeRobot in the simulated robot's joints: (n + 1,) arm and gripper.

    Until `engage`, nothing is sent.

    Attributes:
        seen: the robot's last observation. target: what was sent last. sent: commands so far.
        watched: name of the camera that must not stand still while the arm moves.
        signs_known: whether the mapping can be trusted with more than a little turn of a joint.
        late: commands that came later than the rate allows.
    """

    def __init__(
        self, robot: Any, spec: RobotSpec, mapping: JointMapping,
        config: SafetyConfig | None = None, key: Key | None = None,
        say: Say = lambda _words: None,
    ) -> None:  # fmt: skip
        """Read a connected robot once.

        Raises:
            ConfigError: it does not report what the mapping names, or is not calibrated.
        """
        self._robot, self.spec, self.say = robot, spec, say
        self.config, self.key = config or SafetyConfig(), key or NoKey()
        self.guard = Guard(spec, self.config)
        # simulated time does not wait
        self._pause = 0.0 if robot.name == "mam_sim" else 1.0 / self.config.rate
        self._due, self._still, self.late, self.sent = 0.0, 0, 0, 0
        self.engaged, self.watched, self.signs_known = False, "", True
        self.target: FloatArray | None = None
        self.joints = [*spec.arm, spec.gripper[0]]
        self.seen: Mapping[str, Any] = {}
        self.remap(mapping)
        missing = [n for n in self.names if n not in robot.observation_features]
        if missing:
            raise ConfigError(
                f"the robot reports no {', '.join(missing)}; it reports "
                f"{', '.join(robot.observation_features)}. The mapping names its motors"
            )
        if not robot.is_calibrated:
            raise ConfigError(
                "LeRobot has not calibrated this arm, or its motors say otherwise than the file; "
                "run lerobot-calibrate first"
            )
        self.look()

    def remap(self, mapping: JointMapping) -> None:
        """Count motors by another mapping from now on."""
        self.mapping, self.names = mapping, mapping.names(self.joints)
        self.guard.reset()
        self.target = None

    # what the arm says

    def look(self) -> None:
        """Read motors and pictures.

        Raises:
            Lost: they do not answer, a value is no number, or the watched picture stands still.
        """
        error: Exception | None = None
        for _ in range(TRIES):
            try:
                seen = self._robot.get_observation()
                break
            except Exception as found:  # each driver raises its own
                error = found
        else:
            raise self._lost(error)
        if not np.isfinite([float(seen[n]) for n in self.names]).all():
            raise Lost("a motor reports no number; check its cable and its power")
        if self.engaged and self.watched:
            same = np.array_equal(seen[self.watched], self.seen.get(self.watched, ()))
            self._still = self._still + 1 if same else 0
            if self._still >= self.config.patience:
                raise Lost(
                    f"the picture of camera {self.watched!r} stands still; unplug the camera, plug "
                    "it in again, and see with `mam-sim perceive`"
                )
        self.seen = seen

    def read(self, names: Sequence[str]) -> FloatArray:
        """(n,) what motors said last, their units."""
        return np.array([float(self.seen[n]) for n in names])

    def now(self) -> FloatArray:
        """(n + 1,) arm and gripper as the motors said last."""
        return self.mapping.to_sim(self.joints, self.read(self.names))

    # what is sent to it

    def engage(self) -> None:
        """Let commands through: torque on, at the place where the arm is.

        Raises:
            StoppedForSafety: a joint is where it cannot be, and signs are said to be known.
        """
        if self.engaged:
            return
        if self.signs_known:
            self.check_ranges()
        self.engaged = True
        if not _powered(self._robot):  # one that holds since an earlier stop is not let down
            if hasattr(self._robot, "bus"):
                self._write(self.now())  # where it will be when LeRobot switches torque on
            self._robot.configure()
        self.hold()

    def check_ranges(self, way_out: str = CALIBRATE) -> None:
        """Raise StoppedForSafety, with what to do, where a joint is read where it cannot be."""
        now, limits = self.now()[:-1], self.spec.chain.limits
        off = np.maximum(limits[:, 0] - now, now - limits[:, 1])
        if off.max() > BEYOND:
            k = int(off.argmax())
            raise StoppedForSafety(
                f"{self.spec.arm[k]} is read at {now[k]:.2f} rad, outside its range of "
                f"{limits[k, 0]:.2f} to {limits[k, 1]:.2f}: its sign or zero in the joint mapping "
                f"is wrong; {way_out}"
            )

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Within it the arm may move, as long as the key is held down."""
        with self.key:
            if self.key.person:
                self.say("Hold the space bar down: the arm moves as long as you do.")
                self.key.wait()
            self.engage()
            yield

    def allow(self, way: FloatArray, trusted: FloatArray | None = None, **more: Any) -> Workspace:
        """Plan the workspace round a way (N, n); see Workspace.around."""
        self.guard.reset()
        space = Workspace.around(self.spec, way, self.config.margin, trusted, **more)
        self.guard.space = space
        return space

    def allow_turn(self, most: float) -> None:
        """Let each joint turn so many radians from where it is, and no further."""
        self.guard.reset()
        self.guard.space = LittleTurn(self.now()[:-1], most)

    def send(self, target: FloatArray, only: str = "") -> None:
        """One control step towards a target (n + 1,), held against the limits; then read.

        Args:
            only: the keys that let it move; "": any.

        Raises:
            StoppedForSafety: a limit, a lost arm, or KeyReleased; or the arm is only looked at.
        """
        if not self.engaged:
            raise StoppedForSafety("the arm was only to be looked at; nothing was sent")
        currents = self._currents()
        out = self.guard.pass_on(np.asarray(target, dtype=float), self.now(), currents)
        left = self._due - time.perf_counter()
        self.late += self._due > 0 and left < 0
        if self._due and left > 0:
            time.sleep(left)
        if not self.key.down(only):
            raise KeyReleased("the key was let go; the arm holds where it is")
        try:
            self._write(out)
        except Exception as error:
            raise self._lost(error) from None
        self._due = time.perf_counter() + self._pause if self._pause else 0.0
        self.look()

    def go(self, target: FloatArray, only: str = "") -> None:
        """Send a target; where the key is let go, hold and wait for it.

        Raises:
            KeyReleased: it must be one of `only`, or nobody holds it. Others: see `send`.
        """
        while True:
            try:
                return self.send(target, only)
            except KeyReleased:
                self.hold()
                if only or not self.key.person:
                    raise
                self.say("The arm holds. Hold the key down to go on, or press Ctrl-C.")
                self.key.wait()

    def hold(self) -> None:
        """Stay where the arm is, torque on: the one command that needs no key."""
        if not self.engaged:
            return
        target, error = self.now(), None
        if self.target is not None:
            target[-1] = self.target[-1]  # what the hand holds is not let go
        for _ in range(TRIES):
            try:
                self._write(target)
                break
            except Exception as found:
                error = found
        else:
            self.say(
                f"the arm cannot be reached ({_line(error)}): its motors hold their last target as "
                "long as they have power. Support it before you switch that off"
            )
        self.guard.reset()
        self._due = 0.0
        with suppress(Lost):
            self.look()

    def move(
        self, arm: FloatArray, gripper: float, share: float = 0.5, settle: int = 8, only: str = ""
    ) -> None:
        """Go straight to arm joints (n,) and a gripper value, and come to rest there, as `go` does.

        Args:
            share: of the arm's usual motion in a control step.
        """
        goal = np.append(arm, gripper)
        begin = self.now() if self.target is None else self.target
        step = share * min(self.spec.step, self.config.speed / self.config.rate)
        steps = max(1, int(np.ceil(np.abs(goal - begin)[:-1].max() / step)))
        way = np.linspace(begin, goal, steps + 1)[1:]
        way[:, -1] = gripper
        for row in (*way, *[goal] * settle):
            self.go(row, only)

    def rest(self, only: str = "") -> None:
        """Let go, leave what the hand held, and return to the pose of rest, slowly.

        Raises:
            StoppedForSafety: as `send`; or the arm is read where it cannot be, or not known.
        """
        if not self.signs_known:
            raise StoppedForSafety(
                "the way to rest is not known before all joints have been asked about: support "
                "the arm and switch its torque off"
            )
        spec, start = self.spec, self.now()[:-1]
        rotation, position, _ = spec.chain.forward(start[None])
        back = np.tile(np.eye(4), (5, 1, 1))
        shifts = np.linspace(0, BACK_OFF * spec.reach, 6)[1:, None]
        back[:, :3, :3], back[:, :3, 3] = rotation, position - shifts * rotation[0, :, 2]
        found = spec.chain.solve(back, np.tile(start, (5, 1)), spec.rotation_weight)
        good = found.good(0.01, spec.rotation_tolerance).all() and back[-1, 2, 3] > 0
        stops = [*(found.q if good else []), spec.rest_arm]
        ways = [np.linspace(a, b, 12) for a, b in zip([start, *stops], stops)]
        floor = self.allow(np.concatenate(ways), start[None]).floor
        if floor < -self.config.sunk:
            raise StoppedForSafety(
                f"the arm is read {-100 * floor:.0f} cm below the ground it stands on: a sign or "
                "zero in the joint mapping is wrong. Support it, switch its torque off, and "
                f"{CALIBRATE}; if it really hangs there, give more --sunk"
            )
        self.move(start, spec.opened, REST_SHARE, only=only)
        for stop in stops:
            self.move(stop, spec.opened, REST_SHARE, settle=0, only=only)
        self.move(spec.rest_arm, spec.opened, REST_SHARE, only=only)

    def begin(self) -> None:
        """Start anew after somebody has put arm and object back. Read twice: to a simulated robot
        that means that the scene was reset."""
        for _ in range(2):
            self.look()
        self.target, self.late = None, 0
        self.guard.reset()

    # how it ends

    def attend(self, last: str = "leave it so") -> bool:
        """Hold, and do what a person at the terminal asks; whether the arm is still connected."""
        self.say(
            "The arm holds, with torque on. Keep r down: it returns to rest, slowly. t: torque off "
            f"(support the arm first). q: {last}."
        )
        with self.key:
            while True:
                pressed = self.key.wait()
                if pressed == "q":
                    return True
                if pressed == "t":
                    self.release()
                    return False
                if pressed == "r":
                    try:
                        self.rest("r")
                        self.say("The arm is at rest and holds. t: torque off. q: leave it so.")
                    except StoppedForSafety as error:
                        self.hold()
                        self.say(f"{error}. r, t or q?")

    def stand_down(self, ask: bool) -> None:
        """The end of a session: hold; where somebody is there, do what they ask."""
        if not self.engaged:
            return
        self.hold()
        if ask and self.key.person:
            self.attend()
        if self._robot.is_connected:
            self.say("The arm holds where it is, with torque on; `mam-sim park` brings it to rest.")

    def release(self) -> None:
        """Switch torque off, and disconnect."""
        if not hasattr(self._robot.config, TORQUE):
            self.say("This robot's driver says nothing of torque; disconnecting may switch it off.")
        self.disconnect(torque_off=True)

    def disconnect(self, torque_off: bool = False) -> None:
        """Close the connection; torque stays as it is unless it shall be off."""
        robot = self._robot
        if hasattr(robot.config, TORQUE):
            setattr(robot.config, TORQUE, torque_off)
        try:
            if robot.is_connected:
                robot.disconnect()
            elif hasattr(robot, "bus") and robot.bus.is_connected:  # a camera is gone
                robot.bus.disconnect(torque_off)
        except Exception as error:
            self.say(f"the arm could not be disconnected ({_line(error)}); its motors hold")

    def _write(self, target: FloatArray) -> None:
        """The only line that sends a command."""
        real = self.mapping.to_real(self.joints, target)
        self._robot.send_action({n: float(v) for n, v in zip(self.names, real)})
        self.target, self.sent = np.array(target), self.sent + 1

    def _currents(self) -> list[float]:
        """Amperes of the arm's motors, where they are known."""
        bus = getattr(self._robot, "bus", None)
        arm = {n.removesuffix(".pos") for n in self.names[:-1]}
        motors = getattr(bus, "motors", {})
        units = {k: AMPERES[m.model] for k, m in motors.items() if k in arm and m.model in AMPERES}
        if not units or bus is None:
            return []
        try:
            raw = bus.sync_read("Present_Current", list(units), normalize=False, num_retry=TRIES)
        except Exception as error:
            raise self._lost(error) from None
        return [unit * (abs(int(raw[k])) & 0x7FFF) for k, unit in units.items()]

    def _lost(self, error: Exception | None) -> Lost:
        cameras = getattr(self._robot, "cameras", {})
        gone = [k for k, c in cameras.items() if not getattr(c, "is_connected", True)]
        what = f"camera {', '.join(gone)}" if gone else "the arm or its camera"
        return Lost(
            f"{what} does not answer ({_line(error)}); check power and cables, then run "
            "`mam-sim perceive`"
        )


@contextmanager
def connected(
    robot: Any, spec: RobotSpec, mapping: JointMapping, config: SafetyConfig | None = None,
    key: Key | None = None, say: Say = lambda _words: None,
) -> Iterator[GuardedArm]:  # fmt: skip
    """A robot of LeRobot, connected; however it ends, an arm that has moved holds, torque on.

    Raises:
        ConfigError: it cannot be reached. Others: see GuardedArm.
    """
    if hasattr(robot.config, TORQUE):
        setattr(robot.config, TORQUE, False)
    robot.configure = lambda: None  # LeRobot's connect() calls it: it writes, and drops the arm
    try:
        robot.connect(calibrate=False)
    except MamSimError:
        raise
    except Exception as error:
        raise ConfigError(
            f"the robot cannot be reached ({_line(error)}); check its power, its port and its "
            "cameras in robot.yaml"
        ) from None
    finally:
        del robot.configure
    arm: GuardedArm | None = None
    ask = False
    try:
        arm = GuardedArm(robot, spec, mapping, config, key, say)
        yield arm
        ask = True
    except (Exception, KeyboardInterrupt) as error:  # a signal to stop waits for nobody
        ask = True
        if arm is not None and arm.engaged and arm.key.person:
            say(f"stopped: {_line(error) or 'interrupted'}")
        raise
    finally:
        if arm is None:
            robot.disconnect()
        else:
            try:
                arm.stand_down(ask)
            finally:
                arm.disconnect()


def _powered(robot: Any) -> bool:
    """Whether all motors have torque, as after an earlier stop; False where it cannot be asked."""
    try:
        return all(robot.bus.sync_read("Torque_Enable", normalize=False).values())
    except Exception:
        return False


def _line(error: BaseException | None) -> str:
    """The first line of an error's message that says something."""
    return next((row for row in str(error or "").splitlines() if row.strip()), "")
