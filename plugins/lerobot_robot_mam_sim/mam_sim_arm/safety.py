"""Limits that every target passes before it goes to a motor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mam_envs.robots import RobotSpec
from mam_pipeline.edited import Range
from mam_pipeline.errors import MamSimError
from mam_pipeline.types import FloatArray


class StoppedForSafety(MamSimError):
    """A limit was passed and the arm was stopped; the message says which, and what to do."""

    exit_code = 1


class KeyReleased(StoppedForSafety):
    """The key that lets the arm move was let go."""


@dataclass(frozen=True, kw_only=True)
class SafetyConfig:
    """When the arm is slowed down or stopped."""

    rate: Annotated[float, Range(1, 100)] = 10.0
    """Control steps a second on a real arm; policies learn at 20, so that 10 is half as fast."""
    speed: Annotated[float, Range(0, 10, above=True)] = 1.0
    """Radians a second that a joint may turn (metres a second that it may slide); more is cut."""
    margin: Annotated[float, Range(0, 1)] = 0.08
    """Metres round the planned way of each link, gripper included; a step out is held back."""
    lag: Annotated[float, Range(0, 3, above=True)] = 0.25
    """Radians that a joint may stay behind its target; more means that the arm presses on
    something, or that a motor is dead."""
    asked: Annotated[float, Range(0, 100, above=True)] = 1.0
    """Radians that a joint may be asked for, summed over the steps in which it moves less than a
    twentieth of it; more names the joint where the goal is not reached. A policy that asks for
    small steps from where the joint is never makes it lag."""
    current: Annotated[float, Range(0, 100, above=True)] = 1.5
    """Amperes that an arm's motor may take, where the driver reads them (stall is 2.7)."""
    moved: Annotated[float, Range(0, 1, above=True)] = 0.03
    """Metres that the object may move while the policy runs."""
    shifted: Annotated[float, Range(0, 1000, above=True)] = 5.0
    """Pixels that a tag on the object may move in the picture while the arm is calibrated; more
    means that the object or the camera was moved."""
    sunk: Annotated[float, Range(0, 3)] = 0.015
    """Metres that the arm may be read below the ground when it shall come to rest; more means that
    a sign or zero of the joint mapping is wrong."""
    patience: Annotated[int, Range(1, 1000)] = 10
    """Control steps in a row outside a limit after which the arm is stopped."""


@dataclass(frozen=True)
class Box:
    """A box that stands in the way: `bounds` (2, 3) in its own frame, `pose` (4, 4) base_T_box."""

    bounds: FloatArray
    pose: FloatArray

    def depth(self, points: FloatArray) -> FloatArray:
        """(...) metres that points (..., 3) of the base frame are inside; negative outside."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        inside = np.minimum(local - self.bounds[0], self.bounds[1] - local)
        return np.asarray(inside.min(axis=-1))


@dataclass(frozen=True)
class Workspace:
    """Where each link may be, by its collision shapes; the robot's base frame, metres.

    Attributes:
        points: (P, 3) of each link's surface, link frame; links that only turn on the base are
            left out.
        low, high: (L, 3) box of each link. floor: height below which none may be.
        barred: the object. shut_out: (L,) links that must stay out of it, because
            the planned way does not bring them there.
    """

    spec: RobotSpec
    points: dict[str, FloatArray]
    low: FloatArray
    high: FloatArray
    floor: float
    barred: Box | None
    shut_out: list[bool]

    @staticmethod
    def around(
        spec: RobotSpec, way: FloatArray, margin: float, trusted: FloatArray | None = None,
        obstacle: Box | None = None, held: FloatArray | None = None,
    ) -> Workspace:  # fmt: skip
        """The space that a planned way needs, and a margin.

        Args:
            way: (N, n) arm joints. trusted: (M, n) those of them that are known to be off the
                ground and the object (default: all): where the arm is, where the twin has been.
            obstacle: the object. held: (P, 3) what the hand holds, tool frame.
        """
        points = {k: v for k, v in spec.surface.items() if k in spec.swinging}
        if held is not None:
            tool = spec.chain.tool
            inside = held @ tool[:3, :3].T + tool[:3, 3]
            points[spec.tip] = np.concatenate([points.get(spec.tip, inside[:0]), inside])
        count = len(points)
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        reached, floor = [False] * count, 0.0  # what the arm stands on
        plans = [(way, True)] if trusted is None else [(way, False), (trusted, True)]
        for grip in (spec.opened, spec.shut):
            for rows, sure in plans:
                for part in np.array_split(rows, max(1, len(rows) // 32)):
                    for k, at in enumerate(_placed(spec, points, part, grip)):
                        low[k] = np.minimum(low[k], at.min(axis=(0, 1)))
                        high[k] = np.maximum(high[k], at.max(axis=(0, 1)))
                        if sure:
                            floor = min(floor, float(at[..., 2].min()))
                            reached[k] |= obstacle is None or bool((obstacle.depth(at) > 0).any())
        shut_out = [not k for k in reached]
        return Workspace(spec, points, low - margin, high + margin, floor, obstacle, shut_out)

    def away(self, arm: FloatArray, gripper: float) -> tuple[FloatArray, str]:
        """(N,) metres that the farthest point is outside at arm joints (N, n), 0 inside; and what
        is wrong at the last of them, in words."""
        worst, why, low = np.zeros(len(arm)), "", self.low.copy()
        low[:, 2] = np.maximum(low[:, 2], self.floor)
        for k, at in enumerate(_placed(self.spec, self.points, arm, gripper)):
            out = np.maximum(low[k] - at, at - self.high[k]).max(axis=2).max(axis=1)
            if self.barred is not None and self.shut_out[k]:
                out = np.maximum(out, self.barred.depth(at).max(axis=1))
            if out[-1] > worst[-1]:
                x, y, z = at[-1].mean(axis=0)
                below = at[-1, :, 2].min() < self.floor
                name = list(self.points)[k]
                where = "below the ground" if below else "outside the planned workspace"
                why = f"{name} would go {where}, to {x:.2f}, {y:.2f}, {z:.2f} m"
            worst = np.maximum(worst, out)
        return worst, why


@dataclass(frozen=True)
class LittleTurn:
    """The room of an arm whose joints' signs are not known yet: no joint far from where it stands.

    Where its links are cannot be told, nor whether they would go below the ground.

    Attributes:
        start: (n,) arm joints where it stands. most: radians that a joint may turn from there.
    """

    start: FloatArray
    most: float

    def away(self, arm: FloatArray, _gripper: float) -> tuple[FloatArray, str]:
        """As of a workspace; (N,) radians instead of metres."""
        off = np.abs(arm - self.start).max(axis=1) - self.most
        why = "a joint would turn further than it may while its sign is not known"
        return np.maximum(off, 0.0), why


def _placed(
    spec: RobotSpec, points: dict[str, FloatArray], arm: FloatArray, gripper: float
) -> list[FloatArray]:
    """(N, P, 3) each link's points in the base frame at arm joints (N, n)."""
    poses = spec.link_poses(np.asarray(arm, dtype=float), gripper)
    out = []
    for name, rows in points.items():
        pose = np.broadcast_to(poses[name], (len(arm), 4, 4))
        out.append(np.einsum("nij,pj->npi", pose[:, :3, :3], rows) + pose[:, None, :3, 3])
    return out


class Guard:
    """Holds targets against the limits; frames and units of the simulated robot."""

    def __init__(self, spec: RobotSpec, config: SafetyConfig) -> None:
        self.spec, self.config = spec, config
        self.space: Workspace | LittleTurn | None = None
        self.span = abs(spec.opened - spec.shut)
        self.reset()

    def reset(self) -> None:
        """Forget what was sent: the next target is held against where the arm is."""
        self.last: FloatArray | None = None
        self.outside = self.behind = self.strained = self.cut = 0
        self._stood: FloatArray | None = None
        self._asked: FloatArray = np.zeros(len(self.spec.arm))

    def unmoved(self) -> str | None:
        """The joint that was asked to move for long and has not, in a sentence, or None."""
        k = int(self._asked.argmax())
        if self._asked[k] < self.config.asked:
            return None
        return (
            f"the goal was not reached, and {self.spec.arm[k]} did not move, though it was asked "
            f"for {self._asked[k]:.1f} rad in all: it presses on something or its motor is dead. "
            "Free the arm, and check the motor's cable"
        )

    def pass_on(
        self, target: FloatArray, now: FloatArray, currents: Sequence[float] = ()
    ) -> FloatArray:
        """What may be sent, (n + 1,) arm and gripper, for a wanted target and joints as they are.

        Raises:
            StoppedForSafety: out of the workspace, behind the targets, or under too much current
                for too long; or no workspace has been given.
        """
        config = self.config
        if self.space is None:
            raise StoppedForSafety("no workspace was planned, so that nothing may move")
        before = now if self.last is None else self.last
        self._strain(before[:-1], now[:-1], currents)
        limit = np.full(len(target), config.speed / config.rate)
        limit[-1] = 0.5 * self.span
        out = before + np.clip(target - before, -limit, limit)
        # the gripper presses no harder than its range allows
        out[-1] = np.clip(out[-1], now[-1] - self.span, now[-1] + self.span)
        self.cut += bool(np.abs(target - before)[:-1].max() > limit[0] + 1e-9)
        away, why = self.space.away(np.stack([before, out])[:, :-1], float(out[-1]))
        leaving = away[1] > 0 and away[1] > away[0] - 1e-9  # coming back is allowed
        self.outside = self.outside + 1 if leaving else 0
        if self.outside >= config.patience:
            raise StoppedForSafety(
                f"{why}. See whether the object stands where `mam-sim perceive` says, and "
                "calibrate again, or give more --margin"
            )
        if leaving:
            out[:-1] = before[:-1]
        self.last = out
        return out

    def _strain(self, sent: FloatArray, now: FloatArray, currents: Sequence[float]) -> None:
        """Count steps behind the target and under current, and stop when there are too many; sum up
        what joints that stand are asked for."""
        config, off = self.config, np.abs(sent - now)
        stood: FloatArray = now if self._stood is None else self._stood
        moved = np.abs(now - stood) > config.asked / 20
        self._stood = np.where(moved, now, stood)
        self._asked = np.where(moved, 0.0, self._asked + off)
        self.behind = self.behind + 1 if float(off.max()) > config.lag else 0
        if self.behind >= config.patience:
            raise StoppedForSafety(
                f"{self.spec.arm[int(off.argmax())]} does not follow its target: it presses on "
                "something or its motor is dead. Free the arm, and check the motor's cable"
            )
        most = max(currents, default=0.0)
        self.strained = self.strained + 1 if most > config.current else 0
        if self.strained >= config.patience:
            raise StoppedForSafety(
                f"a motor takes {most:.1f} A, more than {config.current:.1f} A: the arm presses on "
                "something. Free it, and let the motors cool"
            )
