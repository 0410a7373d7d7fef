"""A policy that was trained on many generated objects, on assets made of real meshes.

    python benchmarks/generalist_on_real.py RUN DATASET drawer --keep FOLDER --out FILE.json

Of every object of a ground-truth dataset the surface at rest is one static mesh without names; its
size and up axis are told, as in `rank_baseline.py`. The policy tries every joint whose part
is a KIND, by `mam-sim eval --expert`. A joint that the arm cannot do counts as failed episodes.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import tyro
from common import save
from mam_sim_bench.runner import find_tasks
from rank_baseline import Object, made
from tyro.conf import Positional

from mam_pipeline.asset.card import Asset
from mam_policies.wilson import wilson


def tried(run: Path, asset: Path, joint: str, episodes: int, out: Path) -> tuple[int, int] | None:
    """Successes of expert and policy; None where the joint cannot be tried."""
    command = [
        sys.executable, "-m", "mam_sim.cli", "eval", str(run), "--asset", str(asset), "--joint",
        joint, "--episodes", str(episodes), "--expert", "--out", str(out),
    ]  # fmt: skip
    if not out.is_file():
        subprocess.run(command, stdout=subprocess.DEVNULL)
    if not out.is_file():
        return None
    row = json.loads(out.read_text(encoding="utf-8"))["results"][0]
    if "successes" not in row:
        return None
    return row["expert"]["successes"], row["successes"]


def main(
    run: Positional[Path], dataset: Positional[str], kind: Positional[str], /,
    keep: Path = Path("generalist-on-real"), episodes: int = 3, out: Path | None = None,
) -> None:  # fmt: skip
    """Make the assets, try their joints and print a line for each.

    Args:
        run: folder of mam-sim train. dataset: folder of ground-truth URDFs. kind: of the parts.
        keep: folder for assets and results. episodes: of every joint. out: JSON file.
    """
    objects = [Object.of(task, keep) for task in find_tasks(dataset)]
    (keep / run.name).mkdir(parents=True, exist_ok=True)
    joints, each = 0, []
    for _, folder in made("ours", objects, keep):
        card = Asset.load(folder).card
        kinds = {part.link: part.kind for part in card.parts}
        for joint in card.joints:
            if joint.type == "fixed" or kinds.get(joint.child) != kind:
                continue
            joints += 1
            file = keep / run.name / f"{folder.name}-{joint.name}.json"
            found = tried(run, folder, joint.name, episodes, file)
            print(folder.name, joint.name, found or "cannot be tried", flush=True)
            each += [found] if found else []
    expert, policy = (sum(row[k] for row in each) for k in range(2))
    result: dict[str, Any] = {
        "joints": joints, "tried": len(each), "expert": wilson(expert, episodes * joints),
        "policy": wilson(policy, episodes * joints), "successes": policy,
        "policy on tried": wilson(policy, episodes * len(each)),
    }  # fmt: skip
    print(result)
    save(out, result)


if __name__ == "__main__":
    tyro.cli(main)
