"""A policy that comes with mam-sim, on generated objects of other seeds than it was trained on.

    python benchmarks/generalist_unseen.py configs/train/generalist_drawer.yaml --out FILE.json

The objects are of the recipe's categories. One that the arm cannot operate counts as failed
episodes. On assets of real meshes: `mam-sim eval generalist-drawer --asset ASSET ... --expert`.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline import config_file
from mam_policies.wilson import wilson
from mam_sim.cli import main as mam_sim
from mam_training.policies.train_generalist import GeneralistTraining, objects


@dataclass(frozen=True)
class Count:
    """Successes of some episodes, and objects on which all or none succeeded."""

    objects: int
    refused: int
    episodes: int
    policy: int
    expert: int
    always: int
    never: int


def counted(rows: Sequence[dict], episodes: int) -> Count:
    """What the rows of `mam-sim eval --expert` say; a refused object has failed every time."""
    done = [row for row in rows if "refused" not in row]
    good = [int(row["successes"]) for row in done]
    return Count(
        len(rows), len(rows) - len(done), episodes * len(rows), sum(good),
        sum(int(row["expert"]["successes"]) for row in done),
        sum(n == episodes for n in good), sum(n == 0 for n in good),
    )  # fmt: skip


def main(
    recipe: Positional[Path], /, count: int = 3, seed: int = 90_000, episodes: int = 5,
    policy: str = "", keep: Path = Path("build/generalist-unseen"), out: Path | None = None,
) -> None:  # fmt: skip
    """Generate the objects, try them and print the totals.

    Args:
        recipe: that the policy was trained by. count: objects of each category. seed: of the first.
        episodes: of every object. policy: its name or run folder; default: the recipe's.
        keep: folder for the objects. out: JSON file.
    """
    config = config_file.fill(GeneralistTraining(), config_file.read(recipe), recipe)
    config = replace(config, count=count, seed=seed, cache=keep / config.kind)
    assets = objects(config)
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch, "result.json")
        words = ("--episodes", str(episodes), "--expert", "--out", str(file))
        mam_sim(["eval", policy or config.out.name, "--asset", *map(str, assets), *words])
        found = counted(json.loads(file.read_text(encoding="utf-8"))["results"], episodes)
    for who, good in (("policy", found.policy), ("expert", found.expert)):
        low, high = wilson(good, found.episodes)
        share = f"{100 * good / found.episodes:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"
        print(f"{who}: {good}/{found.episodes} = {share}")
    print(found)
    save(out, vars(found))


if __name__ == "__main__":
    tyro.cli(main)
