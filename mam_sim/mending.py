"""Mending of many files: each in a process of its own, which ends at a limit."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mam_pipeline.edited import read_json, validated
from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.forkserver import run_all
from mam_pipeline.formats.articulations import KINDS, SUFFIXES
from mam_pipeline.formats.suffixes import USD
from mam_pipeline.guarded import Limits
from mam_pipeline.mend import Mended, Order, mend
from mam_sim.batch.inputs import USUAL, Input, find_inputs, telling_name


@dataclass(frozen=True)
class Task:
    """One file, where its copy goes (None: nowhere), and the file that tells what became of it."""

    item: Input
    out: Path | None
    order: Order
    result: Path
    limits: Limits

    def warm(self) -> None:
        """Import what a check needs."""
        from mam_pipeline.check import drive  # noqa: F401

    def run(self) -> None:
        """Mend it, in the child."""
        try:
            found = mend(self.item.path, self.out, self.order)
        except (MamSimError, OSError) as error:
            found = Mended.refused(self.item.path, str(error))
        self.result.write_text(json.dumps(found.as_dict()), encoding="utf-8")


def found_files(words: Sequence[str]) -> list[Input]:
    """The URDF, MJCF and USD files that are meant.

    Raises:
        InputError: none is.
    """
    found = find_inputs(words)
    folders = [Path(w).resolve() for w in words if Path(w).is_dir()]
    files = [replace(i, label=telling_name(i.path)) if i.label in USUAL else i
             for i in found if i.fault or i.path.suffix.lower() in SUFFIXES]  # fmt: skip
    files = [  # a folder's USD files are layers and meshes, of which few are articulations
        i for i in files
        if i.path.suffix.lower() not in USD or not any(i.path.is_relative_to(f) for f in folders)
    ]  # fmt: skip
    if not files:
        raise InputError(f"{words[0]} is not {KINDS} ({', '.join(SUFFIXES)})")
    return files


def mended(tasks: Sequence[Task], jobs: int) -> Iterator[Mended]:
    """What became of the files, in their order."""
    left = [t for t in tasks if not t.item.fault]
    known: dict[int, Mended] = {
        i: Mended.refused(t.item.path, t.item.fault) for i, t in enumerate(tasks) if t.item.fault
    }
    place, at = {id(t): i for i, t in enumerate(tasks)}, 0
    for task, ending in run_all(left, jobs):
        if ending.how == "done" and task.result.is_file():
            found = validated(Mended, read_json(task.result))
        else:
            found = Mended.refused(task.item.path, ending.why or "its process ended early")
        known[place[id(task)]] = found
        while at in known:
            yield known.pop(at)
            at += 1
    while at in known:
        yield known.pop(at)
        at += 1
