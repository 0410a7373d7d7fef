"""Expert success over assets x joints x seeds: one row per joint, one line per kind of joint.

    python benchmarks/expert_table.py ASSET [ASSET ...] --seeds 20 --json FILE
    python benchmarks/expert_table.py --world drawer_unit:0-4 cabinet:0-4 --seeds 5

A joint that no placement can serve is "refused" with its reason and counts in no rate.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import asdict, dataclass, field
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
import tyro

import mam_envs
from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import MamSimError
from mam_pipeline.world import make_object
from mam_policies.expert import Expert, run_episode


@dataclass
class Row:
    """One joint's result."""

    asset: str
    joint: str
    kind: str
    subtype: str
    successes: int = 0
    episodes: int = 0
    refused: str = ""
    reasons: dict[str, int] = field(default_factory=dict)
    steps: float = 0.0
    seconds: float = 0.0


def world_assets(wishes: list[str], folder: Path) -> list[Path]:
    """Write procedural assets: "category:first-last" or "category:seed"."""
    out = []
    for wish in wishes:
        name, _, span = wish.partition(":")
        first, _, last = (span or "0").partition("-")
        for seed in range(int(first), int(last or first) + 1):
            made = make_object(name, seed)
            path = folder / f"{name}_{seed}"
            write_asset(made.articulation, path, name=path.name, collision=made.collision)
            out.append(path)
    return out


def measure(path: Path, joint: str, robot: str, seeds: int, task: str | None) -> Row:
    """Run the expert on one joint."""
    asset = Asset.load(path)
    card = next(j for j in asset.card.joints if j.name == joint)
    part = next((p for p in asset.card.parts if p.link == card.child), None)
    row = Row(asset.card.name, joint, part.kind if part else "?", card.subtype)
    start = time.time()
    try:
        env = gym.make(
            mam_envs.ENV_ID, asset=path, joint=joint, task=task, robot_uids=robot,
            control_mode="pd_joint_pos", obs_mode="none", reward_mode="none",
        )
    except MamSimError as error:
        row.refused = str(error).split(" was raised from")[0]
        row.seconds = time.time() - start
        return row
    expert = Expert(env)
    reasons: dict[str, int] = defaultdict(int)
    steps = []
    for seed in range(seeds):
        episode = run_episode(env, expert, seed=10_000 + seed)
        row.episodes += 1
        row.successes += episode.success
        steps.append(episode.steps)
        if not episode.success:
            reasons[episode.reason] += 1
    env.close()
    row.reasons, row.steps = dict(reasons), float(np.mean(steps))
    row.seconds = time.time() - start
    return row


def summary(rows: list[Row]) -> str:
    """A table by kind of part: joints, refused, success rate."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        groups[f"{row.subtype} {row.kind}"].append(row)
        groups["all"].append(row)
    lines = ["| joint | joints | refused | episodes | success |", "|---|---|---|---|---|"]
    for name in sorted(groups, key=lambda g: (g == "all", g)):
        group = groups[name]
        done = sum(r.episodes for r in group)
        rate = 100 * sum(r.successes for r in group) / done if done else float("nan")
        refused = sum(bool(r.refused) for r in group)
        lines.append(f"| {name} | {len(group)} | {refused} | {done} | {rate:.0f} % |")
    return "\n".join(lines)


def main(
    assets: tyro.conf.Positional[list[Path]],
    /,
    world: list[str] = [],  # noqa: B006 (tyro copies it)
    robot: str = "panda",
    seeds: int = 5,
    task: str | None = None,
    joints: int = 3,
    kinds: list[str] = [],  # noqa: B006
    json_out: Path | None = None,
) -> None:
    """Measure and print the table.

    Args:
        assets: asset folders.
        world: procedural objects to write and measure, "category:first-last".
        joints: at most so many joints of each asset and kind of part.
        kinds: only parts whose kind contains one of these words.
    """
    torch.set_num_threads(1)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        for path in [*assets, *world_assets(world, Path(scratch))]:
            card = Asset.load(path).card
            parts = {p.link: p.kind for p in card.parts}
            seen: dict[str, int] = defaultdict(int)
            for joint in card.joints:
                kind = parts.get(joint.child, "?")
                wanted = not kinds or any(k in kind for k in kinds)
                if joint.type == "fixed" or not wanted or seen[kind] >= joints:
                    continue
                seen[kind] += 1
                row = measure(path, joint.name, robot, seeds, task)
                rows.append(row)
                text = row.refused or f"{row.successes}/{row.episodes} {row.reasons or ''}"
                line = f"{row.asset:24s} {row.joint:22s} {row.seconds:5.1f}s {text}"
                print(line, file=sys.stderr)
                if json_out:
                    data = [asdict(r) for r in rows]
                    json_out.write_text(json.dumps(data, indent=1), encoding="utf-8")
    print(summary(rows))


if __name__ == "__main__":
    tyro.cli(main)
