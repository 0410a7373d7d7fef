"""Makes the gallery that the site shows: objects, each with its page.

    python docs/make_gallery.py                                  # 30 objects, in about an hour
    python docs/make_gallery.py --count 3 --others FOLDER

The pictures of examples/, the files of a folder that is named, and generated objects go through
`mam-sim batch` as static files, as anybody's would; what the engine makes of them is what is shown.
A folder of others' files holds credits.csv, with the columns file and credit (author, licence,
address). The same command goes on where a killed one was. `mkdocs build` takes build/gallery up.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import subprocess
import sys
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_world.dataset import write_dataset
from mam_world.registry import categories

ROOT = Path(__file__).resolve().parent.parent
OWN = "made by mam-sim, Apache-2.0"


def generated(count: int, seed: int, folder: Path) -> dict[Path, str]:
    """Static files of generated objects, as evenly as may be from all categories, with credits."""
    names = list(categories())
    found = {}
    for k in range(count):
        category = names[k * len(names) // count]
        ((name, *_),) = write_dataset(category, 1, seed, folder / "generated")
        static = folder / "inputs" / f"{name}.glb"
        static.parent.mkdir(exist_ok=True)
        shutil.copy(folder / "generated" / str(name) / "static.glb", static)
        found[static] = f"generated: {category}, seed {seed}; {OWN}"
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


def main(args: list[str] | None = None) -> int:
    """Make what is not made yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=30, help="objects in all, at least")
    parser.add_argument("--seed", type=int, default=0, help="of the generated ones")
    parser.add_argument("--others", type=Path, help="folder with files of others")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "gallery")
    said = parser.parse_args(args)
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
        made = {row["name"] for row in csv.DictReader(stream)}
    for folder in (run / "assets").iterdir():
        if folder.name not in made:  # of an earlier choice of files: nobody credits it now
            shutil.rmtree(folder)
    pages = ("--credits", said.out / "credits.csv", "--out", said.out / "gallery.html")
    return mam_sim("view", run / "assets", "--html", *pages)


def mam_sim(*words: object) -> int:
    """Run a verb; returns its exit status."""
    return subprocess.call([sys.executable, "-m", "mam_sim.cli", *map(str, words)])


if __name__ == "__main__":
    raise SystemExit(main())
