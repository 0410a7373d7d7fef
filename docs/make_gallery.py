"""Makes the gallery that the site shows: objects, each with its page.

    python docs/make_gallery.py                                  # 30 objects
    python docs/make_gallery.py --count 3 --others FOLDER --films 2

The pictures of examples/, the files of a folder that is named, and generated objects go through
`mam-sim batch` as static files, as anybody's would; what the engine makes of them is what is shown.
A folder of others' files holds credits.csv, with the columns file and credit (author, licence,
address). With --films, the scripted expert tries some of those that pass their check, evenly
chosen and not by what came of it, and is filmed (needs the simulator); failures are shown as
failures. The same command goes on where a killed one was. `mkdocs build` takes build/gallery up.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_world.dataset import write_dataset
from mam_world.registry import categories

ROOT = Path(__file__).resolve().parent.parent
OWN = "made by mam-sim, Apache-2.0"
ROBOT = "panda"
FILM_SECONDS = 600
"""After which an attempt is given up; one takes about a minute on a CPU."""


def generated(count: int, seed: int, folder: Path) -> dict[Path, str]:
    """Static files of generated objects, as evenly as may be from all categories, with credits."""
    names = list(categories())
    found, times = {}, Counter[str]()
    for k in range(count):
        category = names[k * len(names) // count]
        drawn = seed + times[category]
        ((name, *_),) = write_dataset(category, 1, drawn, folder / "generated")
        suffix = f"_{times[category]}" if times[category] else ""
        times[category] += 1
        static = folder / "inputs" / f"{category}{suffix}.glb"
        static.parent.mkdir(exist_ok=True)
        shutil.copy(folder / "generated" / str(name) / "static.glb", static)
        found[static] = f"generated: {category}, seed {drawn}; {OWN}"
    return found


def of_others(folder: Path) -> dict[Path, str]:
    """Files of a folder with the credit that its credits.csv gives to each.

    Raises:
        InputError: one of them is none, or lies outside the folder.
    """
    table, door, found = folder / "credits.csv", Door(folder), {}
    with table.open(newline="", encoding="utf-8-sig") as stream:
        for row in csv.DictReader(stream):
            path = door.find(row["file"], table)
            if path is None:
                raise InputError(f"{table} names {row['file']}, which does not exist")
            found[path] = row["credit"]
    return found


def in_turn(rows: list[dict[str, str]], count: int) -> list[str]:
    """Names of the objects that pass their check: first `count` evenly from all, then the rest."""
    good = [row["name"] for row in rows if row["status"] == "passes"]
    count = min(count, len(good))
    first = [good[k * len(good) // count] for k in range(count)]
    return [*first, *(name for name in good if name not in first)]


def film(folder: Path) -> None:
    """Let the expert try the surest joint of an asset that the arm can reach; demo.mp4 stays in
    its folder, and what came of it on its card."""
    from mam_envs.trial import reachable
    from mam_pipeline.asset.card import Asset
    from mam_pipeline.errors import MamSimError
    from mam_policies.demonstrate import demonstrate

    asset = Asset.load(folder)
    found = reachable(asset, ROBOT)
    row = next((r for r in found if r.ok), found[0])
    told = {"robot": ROBOT, "task": "operate", "joint": row.joint, "ok": False, "why": row.why}
    if row.ok:
        try:
            made = demonstrate(folder, row.joint, folder, robot=ROBOT)
            told |= {"task": made.task, "ok": made.success, "attempts": made.attempts,
                     "why": made.reason}  # fmt: skip
        except MamSimError as error:
            told |= {"why": str(error)}
    keep(folder, told)


def keep(folder: Path, told: dict[str, object]) -> None:
    """Put what came of an attempt on the card of an asset."""
    from mam_pipeline.asset.card import Asset

    card = Asset.load(folder).card
    replace(card, checks={**card.checks, "attempt": told}).save(folder)


def films(folders: list[Path], count: int) -> None:
    """Let the expert try one object after the other until there are `count` films.

    What the arm refuses, as too heavy, is told on the object's page and has no film. Each is a
    process of its own: the simulator may crash.
    """
    from mam_pipeline.asset.card import Asset

    for folder in folders:
        if sum((f / "demo.mp4").is_file() for f in folders) >= count:
            return
        if "attempt" in Asset.load(folder).card.checks:
            continue
        print(f"film: {folder.name}", file=sys.stderr, flush=True)
        why = "the simulator ended without a result"
        try:
            subprocess.call([sys.executable, __file__, "--film", str(folder)], timeout=FILM_SECONDS)
        except subprocess.TimeoutExpired:
            why = f"it took more than {FILM_SECONDS} s"
        if "attempt" not in Asset.load(folder).card.checks:
            keep(folder, {"robot": ROBOT, "task": "operate", "joint": "the object", "why": why})


def main(args: list[str] | None = None) -> int:
    """Make what is not made yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=30, help="objects in all, at least")
    parser.add_argument("--seed", type=int, default=0, help="of the generated ones")
    parser.add_argument("--others", type=Path, help="folder with files of others")
    parser.add_argument("--films", type=int, default=0, help="robot attempts that are filmed")
    parser.add_argument("--film", type=Path, help=argparse.SUPPRESS)  # the process of one of them
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "gallery")
    said = parser.parse_args(args)
    if said.film:
        film(said.film)
        return 0
    files = of_others(said.others) if said.others else {}
    pictures = sorted((ROOT / "examples").glob("*.jpg"))[: max(said.count - len(files), 0)]
    files |= {path: f"picture: {OWN}" for path in pictures}
    files |= generated(said.count - len(files), said.seed, said.out)
    credits = {path.name: credit for path, credit in files.items()}
    if len(credits) < len(files):
        raise InputError("two files of the gallery have one name; rename one: credits go by names")
    said.out.mkdir(exist_ok=True, parents=True)
    with (said.out / "credits.csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([("file", "credit"), *credits.items()])
    run = said.out / "run"
    mam_sim("batch", *files, "--out", run)  # status 1: some are no asset
    with (run / "manifest.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    made = {row["name"] for row in rows}
    for folder in (run / "assets").iterdir():
        if folder.name not in made:  # of an earlier choice of files: nobody credits it now
            shutil.rmtree(folder)
    films([run / "assets" / name for name in in_turn(rows, said.films)], said.films)
    pages = ("--credits", said.out / "credits.csv", "--out", said.out / "gallery.html")
    return mam_sim("view", run / "assets", "--html", *pages)


def mam_sim(*words: object) -> int:
    """Run a verb; returns its exit status."""
    return subprocess.call([sys.executable, "-m", "mam_sim.cli", *map(str, words)])


if __name__ == "__main__":
    raise SystemExit(main())
