"""Puts weights that a trainer made into the package; trainers themselves write to `build/` only.

    python -m mam_training.publish build/weights                     # all that lie there
    python -m mam_training.publish build/weights parts/abstention      # some of them

What is published can be made again: the working tree is clean, and so was the one that the weights
were made from; every file is the one that its manifest describes.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import tyro
from tyro.conf import Positional

import mam_pipeline
import mam_policies
from mam_pipeline import folders
from mam_pipeline.errors import ConfigError
from mam_training import manifest

PACKAGE = Path(mam_pipeline.__file__).parent
POLICIES = Path(mam_policies.__file__).parent


def published_place(room: str, package: Path = PACKAGE) -> Path:
    """Where the weights of a room (`parts/abstention`, `joints`) lie in the package."""
    wing, _, rest = room.partition("/")
    if wing == "policies":
        return (POLICIES if package == PACKAGE else package / wing) / "weights" / rest
    return package / wing / "weights" / rest


def rooms_of(folder: Path) -> list[str]:
    """Rooms of which a folder holds weights: those with a manifest."""
    found = sorted(p.parent.relative_to(folder) for p in folder.rglob(manifest.NAME))
    return [room.as_posix() for room in found]


def check_tree(repository: Path) -> None:
    """Refuse a working tree with changes.

    Raises:
        ConfigError: there are some, or there is no repository.
    """
    command = ["git", "status", "--porcelain"]
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    if done.returncode or done.stdout.strip():
        what = done.stdout.strip().splitlines()[0] if done.stdout.strip() else done.stderr.strip()
        raise ConfigError(
            f"weights are published from a clean working tree only, here is: {what}; commit first"
        )


def check_weights(folder: Path) -> None:
    """Refuse weights that cannot be made again as they are.

    Raises:
        ConfigError: the manifest is wrong, or its code is no commit.
    """
    wrong = manifest.faults(folder)
    if wrong:
        raise ConfigError(wrong[0])
    kept = json.loads((folder / manifest.NAME).read_text(encoding="utf-8"))
    code = str(kept.get("code", manifest.UNKNOWN))
    if code == manifest.UNKNOWN or code.endswith(manifest.DIRTY):
        raise ConfigError(
            f"{folder} was made by code {code!r}, which is no commit; "
            f"commit, then train again: {kept.get('command', 'see its trainer')}"
        )


def publish(source: Path, rooms: Sequence[str], package: Path = PACKAGE) -> list[Path]:
    """Copy the weights of rooms into the package; either a room's folder is whole or untouched.

    Raises:
        ConfigError: some weights cannot be made again; nothing is copied then.
    """
    for room in rooms:
        check_weights(source / room)
    places = [published_place(room, package) for room in rooms]
    for room, place in zip(rooms, places):
        with folders.new_folder(place) as work:
            shutil.copytree(source / room, work, dirs_exist_ok=True)
    return places


def main(source: Positional[Path], rooms: Positional[tuple[str, ...]] = ()) -> None:
    """Publish weights.

    Args:
        source: folder that the trainers wrote to. rooms: some of what lies in it; all, if none.
    """
    check_tree(PACKAGE)
    for place in publish(source, rooms or rooms_of(source)):
        print(f"wrote {place}")


if __name__ == "__main__":
    tyro.cli(main)
