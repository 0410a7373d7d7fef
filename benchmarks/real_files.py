"""`mam-sim articulate` on files that people use, against what a person sees in them.

    python benchmarks/real_files.py DATASET --out docs/results/real_files.json

DATASET holds a MANIFEST.csv (columns id, file) and the files. What moves, the colour pictures, the
up axis and the front were noted by eye in `TRUTH`. A joint type is hinge, spin or slide; an axle
of two wheels may be one part. Nothing but the file is given to the command.
"""

from __future__ import annotations

import csv
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline.asset.card import Asset, AssetCard

SECONDS = 600.0
"""After this long a run counts as hung."""
QUIET = ("[", "report:", "asset:", "next:")
"""Beginnings of lines that say nothing about the object."""


@dataclass(frozen=True)
class Truth:
    """What a person sees in a file.

    Attributes:
        parts: ways in which the moving parts may be counted: number by joint type. The first is the
            most natural one.
        pictures: different colour pictures on its surface. up: its up axis.
        front: the file's axis out of its front; "" where it has none or any will do.
    """

    parts: tuple[Mapping[str, int], ...] = ({},)
    pictures: int = 0
    up: str = "z"
    front: str = ""

    @property
    def still(self) -> bool:
        """Whether nothing need move."""
        return not self.parts[0]


TRUTH: Mapping[str, Truth] = {
    "a_fridge": Truth(({"hinge": 2},), 2, front="-y"),
    "a_door": Truth(({"hinge": 1}, {"hinge": 2}, {"hinge": 1, "spin": 1}), 1),
    "a_wardrobe": Truth(({"hinge": 2},), 1, front="-y"),
    "a_nightstand": Truth(({"slide": 2},), 1, front="-y"),
    "a_kitchenCab": Truth(
        tuple({"hinge": h, "slide": s} for h in range(4, 12) for s in range(9) if 8 <= h + s <= 12),
        1,
    ),
    "a_trash": Truth(({},), 1),
    "n_sofa": Truth(({},), 1, front="+x"),
    "z_pickup": Truth(({"spin": 4}, {"spin": 2}), 2, front="+y"),
    "z_dumpster": Truth(({"hinge": 2, "spin": 4}, {"hinge": 2}), 1),
    "z_mailbox": Truth(({"hinge": 2},), 1, front="+y"),
    "x_hydrant": Truth(({}, {"spin": 1}), 1),
    "g_milkTruck": Truth(({"spin": 2}, {"spin": 4}), 1, "y", "+x"),
    "c_trayBottom": Truth(up="y"),
    "n_bunny": Truth(up="y"),
    "n_chairModel": Truth(up="y"),
    "i_desk": Truth(({"slide": 5},), 0, "y", "+z"),
    "i_globe": Truth(({"spin": 1},), 0, "y"),
    "i_officeTools": Truth(({"hinge": 1},), 1, "y"),
    "i_saltShaker": Truth(({"spin": 1},), 1, "y"),
    "p_chest": Truth(({"hinge": 1},), 0, "y", "-z"),
}


@dataclass(frozen=True)
class Row:
    """One file.

    Attributes:
        status: exit status of the command; None: hung. found: joints by type.
        right: number of parts right. types: parts and types right. pictures: different ones found.
        up, front: whether right; None where it does not apply or no asset was made.
        travel: joints that go less than a quarter of their usual way. silent: of these, those that
            no one is asked to review. passed: the check's verdict. said: what was printed.
    """

    id: str
    status: int | None
    seconds: float
    found: dict[str, int] = field(default_factory=dict)
    right: bool = False
    types: bool = False
    pictures: bool | None = None
    up: bool | None = None
    front: bool | None = None
    travel: int = 0
    silent: int = 0
    passed: bool | None = None
    said: str = ""


def run(file: Path, out: Path) -> tuple[int | None, float, str]:
    """(exit status, seconds, what was printed) of the command on one file."""
    words = [sys.executable, "-m", "mam_sim.cli", "articulate", str(file), "--out", str(out)]
    began = time.perf_counter()
    try:
        done = subprocess.run(
            words, timeout=SECONDS, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "COLUMNS": "200"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None, SECONDS, ""
    lines = [s for s in done.stdout.splitlines() if s and not s.startswith(QUIET)]
    return done.returncode, time.perf_counter() - began, "\n".join(lines)


def scored(name: str, truth: Truth, file: Path, out: Path) -> Row:
    """Run one file and compare what came out with the truth."""
    status, seconds, said = run(file, out)
    row: dict[str, Any] = {"id": name, "status": status, "seconds": round(seconds, 1), "said": said}
    if not (out / "asset.json").is_file():
        return Row(**row)
    card = Asset.load(out).card
    joints = card.movable
    found = Counter(str(j.subtype) for j in joints)
    short = [j for j in joints if j.basis.share < 0.25]
    return Row(
        **row,
        found=dict(found),
        right=any(sum(found.values()) == sum(p.values()) for p in truth.parts),
        types=any(found == Counter({k: n for k, n in p.items() if n}) for p in truth.parts),
        pictures=_pictures(out) == truth.pictures,
        up=_file_axis(card, (0, 0, 1)) == f"+{truth.up}",
        front=_file_axis(card, (-1, 0, 0)) == truth.front if truth.front else None,
        travel=len(short),
        silent=sum(not j.review for j in short),
        passed=bool(card.checks["executability"]["passed"]),
    )


def _pictures(folder: Path) -> int:
    """Different pictures on the visuals of an asset."""
    kinds = (".png", ".jpg", ".jpeg")
    files = [p for p in (folder / "visual").rglob("*") if p.suffix.lower() in kinds]
    return len({hashlib.sha256(p.read_bytes()).digest() for p in files})


def _file_axis(card: AssetCard, asset_axis: tuple[int, int, int]) -> str:
    """The file's axis that lies along an axis of the asset."""
    matrix = np.asarray(card.source_to_asset, dtype=float)[:3, :3]
    along = np.linalg.inv(matrix) @ np.asarray(asset_axis, dtype=float)
    k = int(np.argmax(np.abs(along)))
    return f"{'+' if along[k] > 0 else '-'}{'xyz'[k]}"


def totals(rows: list[Row]) -> dict[str, Any]:
    """Counts over all files, as (right, of)."""
    still = [r for r in rows if TRUTH[r.id].still]
    moving = [r for r in rows if not TRUTH[r.id].still]
    joints = sum(sum(r.found.values()) for r in rows)

    def of(name: str) -> tuple[int, int]:
        told = [getattr(r, name) for r in rows if getattr(r, name) is not None]
        return sum(told), len(told)

    return {
        "parts right, of those that move": (sum(r.right for r in moving), len(moving)),
        "parts and types right, of those that move": (sum(r.types for r in moving), len(moving)),
        "false joints, of those that stand still": (
            sum(bool(r.found) and not r.types for r in still), len(still),
        ),
        "pictures": of("pictures"), "up": of("up"), "front": of("front"),
        "joints that are stuck": (sum(r.travel for r in rows), joints),
        "stuck and not reviewed": sum(r.silent for r in rows),
        "pass the check": of("passed"),
        "median seconds": round(float(np.median([r.seconds for r in rows])), 1),
    }  # fmt: skip


def main(
    dataset: Positional[Path],
    /,
    only: tuple[str, ...] = (),
    keep: Path | None = None,
    out: Path | None = None,
) -> None:
    """Run the command on every file and print the table.

    Args:
        dataset: folder with a MANIFEST.csv. only: ids. keep: folder in which the assets stay.
        out: JSON file for the rows and totals.
    """
    rows: list[Row] = []
    with (dataset / "MANIFEST.csv").open(encoding="utf-8", newline="") as stream:
        told = [r for r in csv.DictReader(stream) if r["id"] in TRUTH]
    for entry in told:
        if only and entry["id"] not in only:
            continue
        with tempfile.TemporaryDirectory() as scratch:
            folder = (Path(scratch) if keep is None else keep) / entry["id"]
            row = scored(entry["id"], TRUTH[entry["id"]], dataset / entry["file"], folder)
        rows.append(row)
        marks = {True: "ok", False: "NO", None: "-"}
        print(
            f"{row.id:<14} {row.seconds:5.1f} s  exit {row.status}  parts {marks[row.right]}  "
            f"types {marks[row.types]}  pictures {marks[row.pictures]}  up {marks[row.up]}  "
            f"front {marks[row.front]}  check {marks[row.passed]}  {row.found}",
            flush=True,
        )
    result = totals(rows)
    for name, value in result.items():
        print(f"{name}: {' of '.join(map(str, value)) if isinstance(value, tuple) else value}")
    save(out, {"totals": result, "files": [vars(r) for r in rows]})


if __name__ == "__main__":
    tyro.cli(main)
