"""What goes to the arm when something goes wrong: every command of every verb, with every fault.

    python benchmarks/drills.py RUN --setup FOLDER --out FILE.json

The arm is the simulated one; its wire is kept in FOLDER/wire.jsonl. For each drill the table says
how the verb ended, how many commands were sent, how many of them after the stop, and what the
wire shows of speed, height and torque. A drill is safe when the arm ends holding with torque on,
no command is faster than the limit, no link goes below the ground, and all that is sent after the
stop is one place to hold, as often as a lost packet needs.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
import tyro
from common import save
from mam_sim_arm.guarded_arm import TRIES, GuardedArm, connected
from mam_sim_arm.held_key import NoKey
from mam_sim_arm.pilot import calibrate_setup, open_pilot, plan_space
from mam_sim_arm.robot_file import open_robot
from mam_sim_arm.rollout import rehearse
from mam_sim_arm.safety import SafetyConfig, StoppedForSafety, Workspace
from mam_sim_arm.setup import MAPPING, ROBOT, Twin, guess_mapping, write_setup

from mam_pipeline.errors import MamSimError
from mam_policies.run import few_objects

FAULTS = (
    "", "dead_motor", "wrong_sign", "slipped_gripper", "moved_object", "hidden_tag", "lost_camera",
    "frozen_camera", "lost_arm", "key released",
)  # fmt: skip
BOARD = 420
"""Commands of a calibration after which its arm goes through the poses with the board."""
BEGINS = {
    "calibrate": {
        "": (0,), "dead_motor": (5, BOARD), "wrong_sign": (0,), "key released": (25, BOARD),
    },
    "deploy": {"dead_motor": (5,), "slipped_gripper": (50,), "key released": (25,)},
    "park": {"key released": (25,)},
}  # fmt: skip
"""Commands after which a fault begins, where that is neither BOARD (calibrate) nor 30."""


class Person(NoKey):
    """Somebody who reads what is said, holds the key for some commands, and leaves the arm."""

    person = True

    def __init__(self, wrong: str, commands: int) -> None:
        """`wrong`: the joint that turns the wrong way. `commands`: after which the key is let go
        for good."""
        self.wrong, self.left, self.said = wrong, commands, ""

    def say(self, words: str) -> None:
        """What the verb says to the person."""
        self.said = words

    def down(self, only: str = "") -> bool:
        """Held until it is let go for good."""
        self.left -= 1
        return self.left >= 0

    def wait(self) -> str:
        """The key that was asked for; Ctrl-C in the place of the space bar that was let go."""
        if self.said.endswith("y or n"):
            return "n" if self.wrong and self.said.startswith(self.wrong) else "y"
        if "q:" in self.said or self.said.endswith("q?"):  # the arm holds, and asks what to do
            return "q"
        if self.left < 0:
            raise KeyboardInterrupt
        return " "


def drill(
    verb: str, run: Path, setup: Path, fault: str, begins: int, plan: np.ndarray
) -> dict[str, Any]:
    """Play one; what happened and what the wire shows."""
    twin, wire = Twin.load(run), setup / "wire.jsonl"
    wire.unlink(missing_ok=True)
    released, second = fault == "key released", twin.spec.arm[1]
    changes: dict[str, Any] = {"wire": str(wire), "fault": "" if released else fault}
    changes["fault_step"] = begins
    if fault == "dead_motor":
        changes["fault_joint"] = twin.spec.arm[len(twin.spec.arm) // 2]  # the elbow
    person = Person(second if fault == "wrong_sign" else "", begins if released else 10**9)
    ended = "done"
    with marked(wire):
        try:
            VERBS[verb](twin, setup, person, plan, changes)
        except (MamSimError, KeyboardInterrupt) as error:
            ended = str(error) or "interrupted"
    turned = 1 if fault == "wrong_sign" else None  # the joint that the robot turns
    named = {"verb": verb, "fault": fault or "none", "begins": begins, "ended": ended}
    return {**named, **shown(twin, wire, turned)}


@contextmanager
def marked(wire: Path) -> Iterator[None]:
    """Write down between the commands where the arm begins to hold, and where a session ends."""

    def noted(name: str) -> Any:
        known = getattr(GuardedArm, name)

        def noting(arm: GuardedArm, *given: Any) -> None:
            with wire.open("a") as file:
                file.write(json.dumps({"kind": name}) + "\n")
            known(arm, *given)

        return patch.object(GuardedArm, name, noting)

    with noted("hold"), noted("stand_down"):
        yield


def _calibrate(
    twin: Twin, setup: Path, person: Person, _plan: Any, changes: dict[str, Any]
) -> None:
    robot = open_robot(setup / ROBOT, board=True, max_steps=100_000, **changes)
    guess = guess_mapping(twin.spec, None, "mam_sim")
    before = (setup / MAPPING).read_text() if (setup / MAPPING).is_file() else None
    try:
        calibrate_setup(twin, setup, robot, guess, 10, key=person, say=person.say)
    finally:
        if before is not None and changes["fault"]:
            (setup / MAPPING).write_text(before)


def _perceive(
    twin: Twin, setup: Path, _person: Person, _plan: Any, changes: dict[str, Any]
) -> None:
    with open_pilot(twin.run, setup, **{**changes, "fault_step": 0}) as pilot:
        pilot.find()


def _dry_run(twin: Twin, setup: Path, _person: Person, _plan: Any, changes: dict[str, Any]) -> None:
    with open_pilot(twin.run, setup, **{**changes, "fault_step": 0}) as pilot:
        rehearse(twin.run, pilot.find(), pilot.arm.now()[:-1])


def _deploy(twin: Twin, setup: Path, person: Person, plan: Any, changes: dict[str, Any]) -> None:
    with open_pilot(twin.run, setup, key=person, say=person.say, **changes) as pilot:
        seen = pilot.find()
        plan_space(pilot, twin, seen, plan)
        with pilot.arm.moving():
            found = pilot.run(seen, 200)
    if found.stopped:
        raise StoppedForSafety(found.stopped)
    if not found.success:
        raise StoppedForSafety(f"no success: opened {100 * found.opened:.0f} %")


def _park(twin: Twin, setup: Path, person: Person, _plan: Any, changes: dict[str, Any]) -> None:
    mapping = guess_mapping(twin.spec, setup / MAPPING, "mam_sim")
    robot = open_robot(setup / ROBOT, **changes)
    with connected(robot, twin.spec, mapping, key=person, say=person.say) as arm:
        arm.engage()
        away = arm.now()[:-1] + 0.3
        arm.allow(np.linspace(arm.now()[:-1], away, 8))
        arm.move(away, twin.spec.opened)
        arm.rest()


VERBS: dict[str, Callable[..., None]] = {
    "perceive": _perceive, "dry run": _dry_run, "calibrate": _calibrate, "deploy": _deploy,
    "park": _park,
}  # fmt: skip


def shown(twin: Twin, wire: Path, turned: int | None = None) -> dict[str, Any]:
    """What a file of the wire says, by the arm as it is simulated; a joint may be `turned`."""
    rows = [json.loads(line) for line in wire.read_text().splitlines()] if wire.exists() else []
    torque = [r["torque"] for r in rows if r["kind"] == "disconnect"]
    out: dict[str, Any] = {
        "commands": sum(r["kind"] == "action" for r in rows), "after_stop": 0,
        "torque_at_end": bool(torque and torque[-1]), "safe": bool(torque and torque[-1]),
        "configured": sum(r["kind"] == "configure" for r in rows),
    }  # fmt: skip
    sent: list[list[float]] = []
    fastest, holds, after = 0.0, False, None
    for r in rows:
        if r["kind"] == "action":
            target = list(r["targets"].values())
            if sent and not holds:  # a hold lies beside the last target by what the arm is behind
                fastest = max(fastest, *np.abs(np.subtract(target, sent[-1]))[:-1])
            sent, holds = [*sent, target], False
        holds |= r["kind"] == "hold"
        after = len(sent) if r["kind"] == "stand_down" else after
    if not sent:
        return out
    arm, limits = np.array(sent)[:, :-1], SafetyConfig()
    if turned is not None:
        arm[:, turned] *= -1
    floor = Workspace.around(twin.spec, arm[:1], 9.0).floor
    lowest = float(Workspace.around(twin.spec, arm, 0.0).low[:, 2].min())
    speed, end = fastest * limits.rate, arm[after:]
    out |= {"fastest_rad_s": float(speed), "lowest_m": lowest, "after_stop": len(end)}
    held = len(end) <= TRIES and all((row == end[0]).all() for row in end)
    out["safe"] &= bool(lowest >= floor - 0.01 and speed <= limits.speed + 1e-6 and held)
    return out


def main(
    run: tyro.conf.Positional[Path], /, setup: Path, out: Path | None = None,
    verbs: tuple[str, ...] = tuple(VERBS), faults: tuple[str, ...] = FAULTS,
) -> None:  # fmt: skip
    """Play the drills and print the table. `setup`: a calibrated one, or a new folder."""
    torch.set_num_threads(1)
    twin, rows = Twin.load(run), []
    write_setup(twin, setup)
    with few_objects():
        if not (setup / MAPPING).is_file():
            _calibrate(twin, setup, Person("", 10**9), None, {"fault": ""})
        with open_pilot(run, setup) as pilot:
            _, plan = rehearse(run, pilot.find(), pilot.arm.now()[:-1])
        for verb in verbs:
            usual = (BOARD if verb == "calibrate" else 30,)
            for fault in faults:
                for begins in BEGINS.get(verb, {}).get(fault, usual):
                    rows.append(drill(verb, run, setup, fault, begins, plan))
                    print(json.dumps(rows[-1]), flush=True)
                    save(out, {"drills": rows})
    print(
        "| verb | fault | from command | commands | after the stop | fastest, rad/s | lowest, m "
        "| safe | ends |\n|---|---|---|---|---|---|---|---|---|"
    )
    for r in rows:
        fast, low = (f"{r[k]:.2f}" if k in r else "" for k in ("fastest_rad_s", "lowest_m"))
        count = f"{r['commands']} | {r['after_stop']}"
        safe = "yes" if r["safe"] else "no"
        what = f"{r['verb']} | {r['fault']} | {r['begins']}"
        print(f"| {what} | {count} | {fast} | {low} | {safe} | {r['ended']} |")
    print(f"{sum(r['safe'] for r in rows)} of {len(rows)} safe")


if __name__ == "__main__":
    tyro.cli(main)
