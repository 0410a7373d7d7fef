"""Task success as the measure of executability: assets x (check verdict, expert, cloned policy).

    python benchmarks/policy_table.py WISH ... --bench DATASET --keep FOLDER --out FILE

A wish is ID:joint (an object of the dataset, its links merged into one static mesh and given to
`mam-sim make-env`) or category@seed:joint (a generated object with exact joints). The joint may be
left out. Rows that the JSON file already has are not measured again; the Markdown table goes to
standard output.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from common import load, save
from world_objects import world_asset

from mam_pipeline.asset.card import Asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.mesh_files import save_glb
from mam_policies.algorithms.bc import BcConfig, BehaviourCloning
from mam_policies.evaluate import evaluate_run, plain
from mam_policies.run import EnvChoice
from mam_policies.wilson import wilson
from mam_sim.cli import main as mam_sim
from mam_world.ground_truth import list_objects, read_object


@dataclass
class Settings:
    """What is measured.

    Attributes:
        bench: ground-truth URDFs. keep: folder for assets and runs. out: JSON file for the rows.
        demonstrations, rounds: of cloning. episodes: of the policy's test.
    """

    bench: Path = Path("../shared/bench/dev")
    keep: Path = Path("policy_table")
    out: Path | None = None
    demonstrations: int = 40
    rounds: int = 0
    episodes: int = 50


def prepare(wish: str, settings: Settings) -> tuple[Path, str | None]:
    """(asset folder, joint) of a wish; the asset is made once."""
    name, _, joint = wish.partition(":")
    folder = settings.keep / "assets" / name.replace("@", "_")
    if not (folder / "asset.json").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        if "@" in name:
            category, _, seed = name.partition("@")
            world_asset(category, int(seed), folder)
        else:
            found = next(row for row in list_objects(settings.bench) if row[0] == name)
            mesh = folder.with_suffix(".glb")
            save_glb(read_object(found[2], found[0], found[1]).mesh, mesh)
            mam_sim(["make-env", str(mesh), "--out", str(folder), "--quiet"])
    return folder, joint or None


def measure(wish: str, settings: Settings) -> dict[str, Any]:
    """One row: verdict of the check, expert, policy, seconds."""
    folder, joint = prepare(wish, settings)
    verdict = Asset.load(folder).card.checks.get("executability", {}).get("passed")
    if verdict is None:
        verdict = check_asset(folder).passed
    row: dict[str, Any] = {"wish": wish, "source": "world" if "@" in wish else "bench"}
    row |= {"asset": folder.name, "check": verdict, "joint": joint, "policy": None, "why": ""}
    choice = EnvChoice((str(folder),), joint)
    try:
        wall, cpu = time.monotonic(), time.process_time()
        run = settings.keep / "runs" / f"{folder.name}-{joint or 'any'}"
        config = BcConfig(episodes=settings.demonstrations, rounds=settings.rounds)
        info = BehaviourCloning().train(choice, config, run)
        row["training"] = {
            "wall": round(time.monotonic() - wall),
            "cpu": round(time.process_time() - cpu),
        }
        row["rounds"] = info.results["rounds"]
        row["policy"] = plain(evaluate_run(run, settings.episodes))
        row["joint"] = row["policy"]["joint"]
    except MamSimError as error:
        row["why"] = str(error)
    row["expert"] = expert_of(settings.keep / "runs" / f"{folder.name}-{joint or 'any'}")
    return row


def expert_of(run: Path) -> dict[str, Any] | None:
    """The expert's single plans without noise among a run's demonstrations (every third try)."""
    good = count = 0
    for file in sorted((run / "demos").glob("[0-9]*[0-9].npz"))[::3]:
        with np.load(file) as data:
            good, count = good + bool(data["obs"].size), count + 1
    if not count:
        return None
    low, high = wilson(good, count)
    return {"successes": good, "episodes": count, "low": low, "high": high}


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as Markdown."""
    lines = [
        "| asset, joint | made by | check | expert | cloned policy, unseen poses | CPU time |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        made = {"world": "generator", "bench": "make-env"}[row["source"]]
        check = "passes" if row["check"] else "fails"
        spent = "-"
        if row.get("training"):
            spent = f"{row['training']['cpu']} s"
        policy = _share(row["policy"]) if row["policy"] else row["why"].split(";")[0]
        expert = _share(row.get("expert"))
        name = f"`{row['asset']}`, {row['joint']}"
        lines.append(f"| {name} | {made} | {check} | {expert} | {policy} | {spent} |")
    return "\n".join(lines)


def _share(found: dict[str, Any] | None) -> str:
    if not found:
        return "-"
    low, high = 100 * found["low"], 100 * found["high"]
    return f"{found['successes']}/{found['episodes']} [{low:.0f}, {high:.0f}]"


def main(wishes: tyro.conf.Positional[list[str]], /, settings: Settings) -> None:
    """Measure what is missing and print the table."""
    torch.set_num_threads(1)
    rows: list[dict[str, Any]] = load(settings.out) or []
    for wish in wishes:
        if all(row["wish"] != wish for row in rows):
            rows.append(measure(wish, settings))
            save(settings.out, rows)
            print(table(rows[-1:]).splitlines()[-1], file=sys.stderr, flush=True)
    print(table(rows))


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
