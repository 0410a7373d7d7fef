"""`mam-sim mend`: anybody's URDF, MJCF or USD repaired by the check's reasons, line by line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from mam_pipeline.claims import MENDED, claim_entries, claim_folder
from mam_pipeline.edited import Count, Positive
from mam_pipeline.errors import ConfigError
from mam_sim.console import Screen
from mam_sim.options import Verb

if TYPE_CHECKING:
    from mam_pipeline.mend import Change, Mended


@dataclass(frozen=True, kw_only=True)
class Mend(Verb):
    """Repair what `check` finds, where that leaves the object what it is; a line for each change.

    Exit status 0 when every mended file passes the check, 1 when something is left, 2 when a file
    cannot be read.
    """

    files: Positional[tuple[str, ...]]
    """URDF, MJCF or USD files, folders of URDFs, quoted patterns, or a list (.txt) of these."""
    out: Path | None = None
    """Folder for the mended copy, as an asset, and mend.json; of several files, for a folder
    each."""
    only: tuple[str, ...] = ()
    """Mend these reasons alone (their codes are those of `check`)."""
    profile: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Mend also what this simulator would refuse or ignore: sapien, mujoco, pybullet, isaac,
    newton, gazebo, drake (in strict mode) or physx-gpu."""
    dry_run: bool = False
    """Say what would be changed, and write nothing."""
    allow_outside: bool = False
    """Let files of your own name others outside their folder; they are copied."""
    drive: bool = True
    """Drive the joints in the simulator too."""
    jobs: Count = 1
    """Files at once, each in a process of its own."""
    time_limit: Positive = 600.0
    """Seconds after which a file is given up."""
    memory_limit: Positive = 8.0
    """Gigabytes of memory at which a file is given up."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Mend; print the changes and what is left."""
        from mam_pipeline.folders import Scratch
        from mam_pipeline.guarded import Limits
        from mam_pipeline.mend import Order
        from mam_sim.mending import Task, found_files, mended

        if (self.out is None) != self.dry_run:
            raise ConfigError("mend needs --out DIR, or --dry-run, which writes nothing")
        order = Order(self.only, self.profile, self.drive, self.allow_outside)
        order.check()
        items = found_files(self.files)
        screen = Screen(self.quiet or self.json)
        several = len(items) > 1
        names = {item.name for item in items}
        if self.out is not None and several:
            claim_entries(self.out, "result of mend", lambda name: name in names)
        with Scratch() as scratch:
            limits, tasks = Limits(self.time_limit, self.memory_limit), list[Task]()
            for item in items:
                place = None if self.out is None else self.out.absolute()
                place = place / item.name if place is not None and several else place
                if place is not None:
                    claim_folder(place, MENDED)
                result = Path(scratch) / f"{len(tasks)}.json"
                tasks.append(Task(item, place, order, result, limits))
            results = []
            for found in mended(tasks, self.jobs):
                results.append(found)
                _print(screen, found)
        if self.json:
            screen.json([f.as_dict() for f in results])
        read = [f for f in results if not f.fault]
        if several:
            before, now = (sum(getattr(f, k) for f in read) for k in ("before", "passed"))
            screen.say(f"{len(results)} files: {before} passed before, {now} pass now")
        if self.out is not None:
            self._next(screen, read)
        if len(read) < len(results):
            return 2
        return 0 if all(f.passed for f in read) else 1

    def _next(self, screen: Screen, read: Sequence[Mended]) -> None:
        """What takes the result: it is an asset folder, or one that holds some."""
        if any(f.asset for f in read):
            screen.say(f"asset:  {self.out}; rank, train, collect, view and export take it")
        if len(read) == 1 and not read[0].passed:
            screen.next("check", read[0].urdf)
        elif any(f.asset for f in read):
            screen.next("rank", str(self.out))


def _print(screen: Screen, found: Mended) -> None:
    """The verdict before and after, the changes, and what is left."""
    from mam_pipeline.mend.work import counted

    if found.fault:
        screen.say(f"{found.source}: cannot be mended: {found.fault}")
        return
    why = f" ({', '.join(found.reasons_before)})" if found.reasons_before else ""
    before = "passes the check already" if found.before else f"fails the check{why}"
    now = ("now it passes" if found.passed else "it still fails") if not found.before else (
        "it still passes" if found.passed else "now it fails")  # fmt: skip
    screen.say(f"{found.source}: {before}; {counted(len(found.changes), 'change')}; {now}")
    for line in lines(found.changes):
        screen.say(f"  {line}")
    for line in found.left:
        screen.say(f"  left: {line}")
    if found.urdf:
        screen.say(f"written: {found.urdf}")


def lines(changes: Sequence[Change]) -> list[str]:
    """A line for each change; those of one reason stand below it, and equal ones are one."""
    groups: dict[tuple[str, str], dict[tuple[str, str], list[str]]] = {}
    for c in changes:
        group = groups.setdefault((c.reason, c.why), {})
        group.setdefault((c.before, c.after), []).append(c.where)
    out = []
    for (reason, why), group in groups.items():
        rows = [f"{_places(where)}: {before} -> {after}"
                for (before, after), where in group.items()]  # fmt: skip
        if len(rows) == 1:
            out.append(f"{reason}: {rows[0]} ({why})")
        else:
            out += [f"{reason}: {why}", *(f"  {row}" for row in rows)]
    return out


def _places(where: Sequence[str]) -> str:
    """A few places by name; one that was changed several times says how often."""
    often = Counter(where)
    where = [name if n == 1 else f"{name} ({n} times)" for name, n in often.items()]
    if len(where) <= 3:
        return ", ".join(where)
    return f"{where[0]}, {where[1]} and {len(where) - 2} more"
