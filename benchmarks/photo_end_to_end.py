"""Real photos all the way: make-env, check, and the expert opening a drawer or door of each twin.

For every photo of a folder: `mam-sim make-env` without any hint; where it stops and asks (exit 3),
the same again with --accept-low-confidence, and the row says so. Then the verdict of `mam-sim
check`, and the scripted expert on the asset's joints, surest first, until one is opened. Rows are
saved as they come; assets stay in --keep with their reports.

    python benchmarks/photo_end_to_end.py PHOTOS --keep FOLDER [--only NAME ...] [--out FILE.json]
"""

from __future__ import annotations

import contextlib
import io
import shutil
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import MamSimError
from mam_sim.cli import main as mam_sim

PICTURES = (".jpg", ".jpeg", ".png", ".webp")


@dataclass
class Row:
    """One photo's way through the house."""

    photo: str
    status: int = 0  # exit status of make-env without help
    said: str = ""  # what it said where it stopped
    accepted: bool = False  # whether low confidence had to be accepted
    joints: int = 0
    passed: bool = False
    reasons: list[str] = field(default_factory=list)
    opened: str = ""  # the joint that the expert opened
    tried: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0


def make(photo: Path, out: Path) -> tuple[int, str, bool]:
    """(exit status, message, whether low confidence was accepted) of make-env on a photo."""
    words = io.StringIO()
    with contextlib.redirect_stderr(words):
        status = mam_sim(["make-env", str(photo), "--out", str(out), "--quiet"])
    if status != 3:
        return status, words.getvalue().strip(), False
    accept = ["--accept-low-confidence"]
    with contextlib.redirect_stderr(io.StringIO()):
        again = mam_sim(["make-env", str(photo), "--out", str(out), "--quiet", *accept])
    return status, words.getvalue().strip(), again == 0


def open_one(asset: Asset, row: Row, most: int, episodes: int) -> None:
    """Let the expert try the joints, surest first, until one opens."""
    from mam_policies.evaluate import evaluate_expert
    from mam_policies.run import EnvChoice

    for joint in sorted(asset.card.joints, key=lambda j: -j.confidence)[:most]:
        try:
            result = evaluate_expert(EnvChoice((str(asset.folder),), joint.name), episodes)
        except MamSimError as error:
            row.tried[joint.name] = str(error).split(" was raised from")[0][:160]
            continue
        row.tried[joint.name] = f"{result.successes}/{result.episodes} {result.reasons or ''}"
        if result.successes:
            row.opened = joint.name
            return


def run(photo: Path, out: Path, most: int, episodes: int) -> Row:
    """One photo, all the way."""
    started = time.perf_counter()
    row = Row(photo.name)
    folder = out / photo.stem
    if folder.exists():
        shutil.rmtree(folder)
    row.status, row.said, row.accepted = make(photo, folder)
    if row.status == 0 or row.accepted:
        asset = Asset.load(folder)
        verdict: dict[str, Any] = asset.card.checks.get("executability", {})
        row.joints = len(asset.card.joints)
        row.passed, row.reasons = bool(verdict.get("passed")), list(verdict.get("reasons", []))
        open_one(asset, row, most, episodes)
    row.seconds = round(time.perf_counter() - started, 1)
    return row


def main(
    photos: Positional[Path],
    /,
    keep: Path,
    only: tuple[str, ...] = (),
    joints: int = 4,
    episodes: int = 1,
    out: Path | None = None,
) -> None:
    """Run and print the table.

    Args:
        photos: folder of photos. keep: folder for the assets. only: names with these words.
        joints: that the expert tries at most. episodes: of each.
        out: JSON file for the rows.
    """
    keep.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    found = sorted(p for p in photos.iterdir() if p.suffix.lower() in PICTURES)
    if only:  # in the order asked for
        found = [p for word in only for p in found if word in p.name]
    for photo in found:
        row = run(photo, keep, joints, episodes)
        rows.append(row)
        save(out, [asdict(r) for r in rows])
        how = "asked, accepted" if row.accepted else f"exit {row.status}"
        check = "passes" if row.passed else f"fails {row.reasons}" if row.joints else "-"
        print(
            f"{row.photo:<32} {how:<16} {row.joints} joints  check {check:<24} "
            f"opened {row.opened or '-'}  {row.seconds:.0f} s",
            flush=True,
        )
    good = [r for r in rows if r.passed and r.opened]
    free = sum(not r.accepted for r in good)
    print(
        f"{len(rows)} photos: {sum(r.joints > 0 for r in rows)} assets, "
        f"{sum(r.passed for r in rows)} pass the check, {len(good)} of these opened by the expert "
        f"({free} without accepting low confidence)"
    )


if __name__ == "__main__":
    tyro.cli(main)
