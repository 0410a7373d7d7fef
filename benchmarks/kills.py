"""Kills verbs at random moments, and runs each command again.

    python benchmarks/kills.py --kill 15 --term 5 [--seed 0] [--only rank studio] [--out kills.json]

After SIGTERM a command must end within two seconds and leave no half-made file or temporary folder
of its own. After either signal no process of its own may be left, and the same command must end as
an unkilled one does, leave nothing half-made, and keep every episode that had ended before the
signal, byte for byte. Moments are drawn evenly over the time that an unkilled run took.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import tyro
from common import save

SOON = 2.5
"""Seconds after SIGTERM in which a command ends, on a busy machine."""
HALF_MADE = re.compile(r"\..*\.(partial|old)-\d+.*|.*\.part(ial)?\.\w+|mam-sim-\d+-.*")


@dataclass
class Case:
    """One verb: its command, where it writes, and which of its files must outlive a signal.

    `needs` are the verbs whose results it takes. One that `serves` ends by a signal alone: moments
    are of its first `seconds`.
    """

    name: str
    command: list[str]
    out: Path
    kept: str = ""
    needs: tuple[str, ...] = ()
    serves: bool = False
    seconds: float = 0.0
    rows: list[dict[str, object]] = field(default_factory=list)

    def ended(self) -> dict[str, bytes]:
        """What a signal may not take: episodes that have ended."""
        if not self.kept:
            return {}
        return {str(p): p.read_bytes() for p in sorted(self.out.glob(self.kept))}


def half_made(folder: Path) -> list[str]:
    """Names of files and folders that were never finished."""
    found = [p for p in folder.rglob("*") if HALF_MADE.fullmatch(p.name)]
    return sorted(str(p.relative_to(folder)) for p in found)


def run(command: list[str], root: Path, after: float | None = None, number: int = 9) -> int | None:
    """Run a verb; its status, or None where it was signalled `after` seconds."""
    words = [sys.executable, "-m", "mam_sim.cli", *command, "--quiet"]
    (root / "tmp").mkdir(exist_ok=True)
    process = subprocess.Popen(
        words, cwd=root, stdout=subprocess.DEVNULL, stderr=(root / "said.txt").open("w"),
        env={**os.environ, "TMPDIR": str(root / "tmp")},
    )  # fmt: skip
    try:
        return process.wait(timeout=after)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
        process.wait(timeout=60)
        return None


def processes(root: Path) -> list[str]:
    """Command lines of the processes that have our temporary folder, a second later at most."""
    mark = f"TMPDIR={root / 'tmp'}".encode()
    for _ in range(10):
        found = []
        for place in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if mark in (place / "environ").read_bytes().split(b"\0"):
                    found.append((place / "cmdline").read_bytes().replace(b"\0", b" ").decode())
        if not found:
            break
        time.sleep(0.1)
    return found


def cases(root: Path, category: str) -> list[Case]:
    """The verbs in an order in which each finds what it needs."""
    assert run(["generate", "--category", category, "--out", "made"], root) == 0
    asset = next((root / "made").glob("*/asset.json")).parent
    urdf, drawer = str(asset / "object.urdf"), str(asset)
    return [
        Case("make-env", ["make-env", urdf, "--out", "env"], root / "env"),
        Case("collect", ["collect", drawer, "--episodes", "3", "--out", "demos"], root / "demos",
             "attempts/[0-9]*.json"),
        Case("train", ["train", drawer, "--episodes", "2", "--epochs", "60", "--test", "0",
                       "--deployable", "--out", "run"], root / "run", "demos/[0-9]*.npz"),
        Case("export", ["export", "run", "--out", "policy"], root / "policy", needs=("train",)),
        Case("articulate", ["articulate", urdf, "--out", "asset"], root / "asset"),
        Case("batch", ["batch", urdf, "--out", "batch"], root / "batch"),
        Case("rank", ["rank", drawer, "--episodes", "2", "--out", "ranked"], root / "ranked",
             "rows/*.json"),
        Case("studio", ["studio", drawer, "--no-open"], root / "made", serves=True, seconds=20.0),
        Case("calibrate", ["calibrate", "run", "--setup", "arm", "--init"], root / "arm",
             needs=("train",)),
        Case("deploy", ["deploy", "run", "--setup", "arm", "--nominal", "--yes"], root / "arm",
             needs=("train", "calibrate")),
    ]  # fmt: skip


def strike(case: Case, root: Path, number: int, rng: random.Random) -> None:
    """Signal a run of the case at a random moment and note what it left."""
    before, older = case.ended(), set(half_made(root))  # of a run that was killed before
    while True:
        after, began = rng.uniform(0.0, case.seconds), time.monotonic()
        if run(case.command, root, after, number) is None:
            break
        before = case.ended()  # it had ended before the signal came
    late = time.monotonic() - began - after
    case.rows.append({
        "verb": case.name,
        "signal": signal.Signals(number).name,
        "after": round(after, 2),
        "late": round(late, 2),
        "half_made": [name for name in half_made(root) if name not in older],
        "processes": processes(root),
        "lost": [k for k, v in before.items() if case.ended().get(k) != v],
    })  # fmt: skip
    print(case.rows[-1], flush=True)


def main(
    kill: int = 15,
    term: int = 5,
    seed: int = 0,
    category: str = "nightstand",
    only: tuple[str, ...] = (),
    out: Path | None = None,
) -> None:
    """Signal the verbs in turn.

    Args:
        kill, term: how many SIGKILLs and SIGTERMs in all.
        seed: of the moments.
        category: of the generated object that all is done with.
        only: these verbs; default: all.
        out: JSON file for all rows.
    """
    rng = random.Random(seed)
    numbers = [signal.SIGKILL] * kill + [signal.SIGTERM] * term
    rng.shuffle(numbers)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        todo = cases(root, category)
        chosen = [c for c in todo if not only or c.name in only]
        good = True
        needed = {name for c in chosen for name in c.needs}
        for case in todo:
            if case not in chosen and case.name not in needed:
                continue
            mine = numbers[chosen.index(case) :: len(chosen)] if case in chosen else []
            good &= measure(case, root, mine, rng)
        rows = [row for case in todo for row in case.rows]
    bad = [r for r in rows if r["lost"] or r["processes"] or (
        r["signal"] == "SIGTERM" and (r["half_made"] or float(str(r["late"])) > SOON))]  # fmt: skip
    print(f"{len(rows)} signals, {len(bad)} of them lost, left or took something")
    save(out, rows)
    raise SystemExit(0 if good and not bad else 1)


def measure(case: Case, root: Path, numbers: list[signal.Signals], rng: random.Random) -> bool:
    """One verb: an unkilled run, the signals, and the same command to its end."""
    if case.serves:
        for number in numbers:
            strike(case, root, number, rng)
        run(case.command, root, case.seconds, signal.SIGTERM)  # clears away what others left
        return not half_made(root)
    began = time.monotonic()
    status = run(case.command, root)
    case.seconds = time.monotonic() - began
    assert status in (0, 1), (root / "said.txt").read_text()
    if not numbers:
        return True
    files = {str(p.relative_to(case.out)) for p in case.out.rglob("*") if p.is_file()}
    if case.kept:  # what is there already would not be made again
        case.out.rename(root / f"unkilled_{case.name}")
    for number in numbers:
        strike(case, root, number, rng)
    kept = case.ended()
    again = run(case.command, root)
    now = {str(p.relative_to(case.out)) for p in case.out.rglob("*") if p.is_file()}
    steady = {f for f in files ^ now if "events.out" not in f}  # TensorBoard names them by the time
    lost = [k for k, v in kept.items() if case.ended().get(k) != v]
    good = again == status and not half_made(root) and not lost and not steady
    print(f"{case.name}: {len(numbers)} signals over {case.seconds:.0f} s; the same command again "
          f"ends with {again} (unkilled {status}), half-made {half_made(root)}, lost {lost}, "
          f"files that differ {sorted(steady)}", flush=True)  # fmt: skip
    return good


if __name__ == "__main__":
    tyro.cli(main)
