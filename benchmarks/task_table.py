"""The scripted expert at every task, on generated objects: one row a task.

    python benchmarks/task_table.py --count 20 --seeds 1 --out FILE

The objects of a task are of some categories, as many of each. An object that the arm cannot serve
counts as failed episodes and is counted. What was done goes into --out as it comes; the same
command goes on. The table is docs/results/tasks.json.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import code_state
import results_page
import torch
import tyro
from common import load, machine, save
from expert_table import Row, measure, world_assets

from mam_pipeline.asset.card import Asset
from mam_policies.wilson import wilson

FIRST_OBJECT = 95_000
DRAWERS = ("chest_of_drawers", "nightstand", "filing_cabinet", "box_drawer", "storage_mixed")
DOORS = ("cabinet_one_door", "wardrobe", "fridge", "microwave", "safe")
KNOBS = ("knob_panel", "hob", "thermostat", "valve", "station_dial")


@dataclass(frozen=True)
class Trial:
    """One line: what is done, with which kind of part, of which categories, by which robot.

    Attributes:
        joints: how many are operated in sequence.
    """

    name: str
    task: str
    kind: str
    categories: tuple[str, ...]
    robot: str = "panda"
    joints: int = 1


TRIALS = (
    Trial("open a drawer", "open", "drawer", DRAWERS),
    Trial("open a door", "open", "door", DOORS),
    Trial("close a drawer", "close", "drawer", DRAWERS),
    Trial("close a door", "close", "door", DOORS),
    Trial("turn a knob to an angle", "turn_to", "", KNOBS),
    Trial("press a button", "press", "button", ("button_panel", "station_button", "remote")),
    Trial("slide a door or window", "open", "", ("door_sliding", "cabinet_sliding", "window_sash")),
    Trial("take a cube out of a closed drawer", "take_out", "drawer", DRAWERS),
    Trial("put a cube into a drawer and close it", "put_in", "drawer", DRAWERS),
    Trial("open two drawers, one after the other", "open", "drawer", DRAWERS, joints=2),
    Trial("drive there and open a drawer", "open", "drawer", DRAWERS, robot="fetch"),
    Trial("drive there and open a door", "open", "door", DOORS, robot="fetch"),
)


def rows_of(trial: Trial, path: Path) -> Row | None:
    """The joints of an object that a trial is for; None where it has too few of the kind."""
    card = Asset.load(path).card
    kinds = {part.link: part.kind for part in card.parts}
    found = [
        joint.name for joint in card.joints
        if joint.type != "fixed" and trial.kind in kinds.get(joint.child, "")
    ]  # fmt: skip
    if len(found) < trial.joints:
        return None
    return Row(card.name, " + ".join(found[: trial.joints]), trial.kind, trial.name)


def objects(trial: Trial, count: int, folder: Path) -> Iterator[tuple[Path, Row]]:
    """`count` objects with such joints, in turn of each category."""
    found, seed = 0, FIRST_OBJECT
    while found < count and seed < FIRST_OBJECT + 10 * count:
        for category in trial.categories:
            path = folder / f"{category}_{seed}"
            if not path.is_dir():
                world_assets([f"{category}:{seed}"], folder)
            row = rows_of(trial, path)
            if row is not None and found < count:
                found += 1
                yield path, row
        seed += 1


def row_of(trial: Trial, rows: list[Row], seeds: int, command: str) -> dict[str, Any]:
    """The row of the table; a refused object has failed all its episodes."""
    good, episodes = sum(row.successes for row in rows), seeds * len(rows)
    low, high = wilson(good, episodes)
    values = {
        "objects": len(rows),
        "refused": sum(bool(row.refused) for row in rows),
        "success": f"{good}/{episodes} = {100 * good / episodes:.0f} % "
        f"[{100 * low:.0f}, {100 * high:.0f}]",
    }
    name = trial.name if trial.robot == "panda" else f"{trial.name} ({trial.robot.capitalize()})"
    return {
        "id": trial.name, "name": name, "values": values, "command": command,
        "commit": code_state.head(), "machine": machine(),
    }  # fmt: skip


def main(
    count: int = 20, seeds: int = 1, only: str = "", keep: Path | None = None,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Measure and print the table.

    Args:
        count: objects of a task. seeds: episodes of an object. only: trials whose name has this.
        keep: folder for the objects. out: file for the rows, memory of an interrupted run.
    """
    torch.set_num_threads(1)
    known = {(r["subtype"], r["asset"]): Row(**r) for r in load(out) or []}
    command = f"python benchmarks/task_table.py --count {count} --seeds {seeds}"
    with tempfile.TemporaryDirectory() as scratch:
        for trial in TRIALS:
            if only not in trial.name:
                continue
            rows = []
            for path, fresh in objects(trial, count, keep or Path(scratch)):
                row = known.setdefault((trial.name, fresh.asset), fresh)
                if not row.refused and row.episodes < seeds:
                    measure(path, row, trial.robot, seeds, trial.task)
                    text = row.refused or f"{row.successes}/{row.episodes} {row.reasons or ''}"
                    said = f"{trial.name}: {row.asset} {row.joint} {row.seconds:.0f}s {text}"
                    print(said, file=sys.stderr, flush=True)
                    save(out, [asdict(r) for r in known.values()])
                rows.append(row)
            row_done = row_of(trial, rows, seeds, command)
            print(row_done["name"], row_done["values"], flush=True)
            results_page.put("tasks", [row_done])


if __name__ == "__main__":
    tyro.cli(main)
