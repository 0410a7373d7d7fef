"""Expert success over assets x joints x seeds: one row per joint, one line per kind of joint.

    python benchmarks/expert_table.py ASSET [ASSET ...] --seeds 20 --out FILE --page PAGE
    python benchmarks/expert_table.py --world drawer_unit:0-4 cabinet:0-4 --seeds 5

A joint that no placement can serve is "refused" with its reason and counts in no rate. Rows go into
--out as they come; the same command goes on from there and runs only what is missing. With
--checked, assets that fail `mam-sim check` are listed as such and not run.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
import tyro
from common import load, save
from world_objects import world_asset

import mam_envs
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import MamSimError
from mam_policies.expert import Expert, run_episode
from mam_policies.wilson import wilson

FIRST_SEED = 10_000
REFUSED = "refused"


@dataclass
class Row:
    """One joint's result, or that of several in sequence ("a + b"), from FIRST_SEED on."""

    asset: str
    joint: str
    kind: str
    subtype: str
    verdict: str = "passes"
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
            out.append(world_asset(name, seed, folder / f"{name}_{seed}"))
    return out


def measure(path: Path, row: Row, robot: str, seeds: int, task: str | None) -> Row:
    """Run the expert on one joint for the seeds that `row` still lacks."""
    start = time.process_time()
    try:
        env = mam_envs.make(
            path, joint=row.joint.split(" + "), task=task, robot_uids=robot,
            control_mode="pd_joint_pos", obs_mode="none", reward_mode="none",
        )  # fmt: skip
    except MamSimError as error:
        row.refused = str(error).removeprefix(f"{row.asset}: ")
        row.seconds += time.process_time() - start
        return row
    expert = Expert(env)
    reasons: dict[str, int] = defaultdict(int, row.reasons)
    taken = row.steps * row.episodes
    for seed in range(row.episodes, seeds):
        episode = run_episode(env, expert, seed=FIRST_SEED + seed)
        row.episodes += 1
        row.successes += episode.success
        taken += episode.steps
        if not episode.success:
            reasons[episode.reason.replace(f"{row.asset}: ", "")] += 1
    env.close()
    row.reasons, row.steps = dict(reasons), taken / max(row.episodes, 1)
    row.seconds += time.process_time() - start
    return row


def summary(rows: list[Row]) -> str:
    """A table by kind of part: joints, refused, success rate."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row.verdict == "passes":
            groups[f"{row.subtype} {row.kind}"].append(row)
            groups["all"].append(row)
    lines = ["| joint | joints | refused | episodes | success |", "|---|---|---|---|---|"]
    for name in sorted(groups, key=lambda g: (g == "all", g)):
        group = groups[name]
        done = sum(r.episodes for r in group)
        good = sum(r.successes for r in group)
        refused = sum(bool(r.refused) for r in group)
        rate = "-"
        if done:
            low, high = wilson(good, done)
            rate = f"{100 * good / done:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"
        lines.append(f"| {name} | {len(group)} | {refused} | {done} | {rate} |")
    return "\n".join(lines)


def table(rows: list[Row]) -> str:
    """One line per joint, for a page."""
    lines = ["| asset | joint | kind | check | expert |", "|---|---|---|---|---|"]
    for row in rows:
        if row.refused:
            result = f"refused: {row.refused}"
        elif row.episodes:
            low, high = wilson(row.successes, row.episodes)
            result = f"{row.successes}/{row.episodes} [{100 * low:.0f}, {100 * high:.0f}]"
            if row.reasons:
                often = max(row.reasons, key=lambda r: row.reasons[r])
                result += f"; {often}"
        else:
            result = "not run"
        lines.append(
            f"| {row.asset} | {row.joint} | {row.subtype} {row.kind} | {row.verdict} | {result} |"
        )
    return "\n".join(lines)


def verdict_of(path: Path, checked: bool) -> str:
    """What `mam-sim check` says, remembered in the asset's card; "passes" where not asked."""
    if not checked:
        return "passes"
    known = Asset.load(path).card.checks.get("executability")
    if known is None:
        from mam_pipeline.check import check_asset

        report = check_asset(path)
        known = {"passed": report.passed, "reasons": list(report.reasons)}
    return "passes" if known["passed"] else "fails: " + ", ".join(known["reasons"])


def wanted_joints(path: Path, kinds: list[str], joints: int) -> list[Row]:
    """A row for each joint that is to be measured."""
    card = Asset.load(path).card
    parts = {p.link: p.kind for p in card.parts}
    seen: dict[str, int] = defaultdict(int)
    out = []
    for joint in card.joints:
        kind = parts.get(joint.child, "?")
        wanted = not kinds or any(k in f"{joint.subtype} {kind}" for k in kinds)
        if joint.type == "fixed" or not wanted or seen[kind] >= joints:
            continue
        seen[kind] += 1
        out.append(Row(card.name, joint.name, kind, joint.subtype))
    return out


def main(
    assets: tyro.conf.Positional[list[Path]],
    /,
    world: list[str] = [],  # noqa: B006 (tyro copies it)
    robot: str = "panda",
    seeds: int = 5,
    task: str | None = None,
    joints: int = 3,
    kinds: list[str] = [],  # noqa: B006
    checked: bool = False,
    out: Path | None = None,
    page: Path | None = None,
) -> None:
    """Measure and print the table.

    Args:
        assets: asset folders.
        world: procedural objects to write and measure, "category:first-last".
        joints: at most so many joints of each asset and kind of part.
        kinds: only joints whose "subtype kind" contains one of these words ("hinge door").
        checked: leave out assets that fail `mam-sim check`.
        out: file for the rows, and memory of an interrupted run.
        page: write a line per joint and the totals as markdown.
    """
    torch.set_num_threads(1)
    known = {(r["asset"], r["joint"]): Row(**r) for r in load(out) or []}
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        for path in [*assets, *world_assets(world, Path(scratch))]:
            found = [known.get((r.asset, r.joint), r) for r in wanted_joints(path, kinds, joints)]
            fresh = [r for r in found if not r.refused and r.episodes < seeds]
            verdict = verdict_of(path, checked) if fresh else ""
            for row in found:
                rows.append(row)
                if row in fresh:
                    row.verdict = verdict
                    if verdict == "passes":
                        measure(path, row, robot, seeds, task)
                    text = row.refused or f"{row.successes}/{row.episodes} {row.reasons or ''}"
                    line = f"{row.asset:24s} {row.joint:22s} {row.seconds:5.1f}s {verdict} {text}"
                    print(line, file=sys.stderr, flush=True)
                    kept = known | {(r.asset, r.joint): r for r in rows}
                    save(out, [asdict(r) for r in kept.values()])
    print(summary(rows))
    if page:
        head = page.read_text(encoding="utf-8").split("<!-- table -->")[0] if page.is_file() else ""
        text = f"{head}<!-- table -->\n\n{summary(rows)}\n\n{table(rows)}\n"
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
