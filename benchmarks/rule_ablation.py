"""What is each hand rule of the engine worth?

    python benchmarks/rule_ablation.py --log build/rules.jsonl
    python benchmarks/rule_ablation.py --log build/rules.jsonl --only-report

Runs the embedded engine on generated objects that nothing was trained on (kinds that are held back
entirely, and held-back seeds of the others), once with all rules and once with each rule off, and
writes docs/results/rule_ablation.json and .md. Objects that are done are kept in the log, so a run
can be cut short and continued. Where a rule changes nothing up to its own step, what follows is
not computed again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from common import save
from compare_bench import interval
from mam_sim_bench.metrics import score

from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.joints.estimate import OF_JOINTS, JointEstimator
from mam_pipeline.joints.solver import EmbeddedSolver
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.parts.embedded import (
    REASONER,
    Scored,
    chosen_parts,
    drafted,
    sampled_views,
    scored,
)
from mam_pipeline.parts.scores import load_scores
from mam_pipeline.parts.settle import settled
from mam_pipeline.parts.tree import clear_from
from mam_pipeline.prior.embedded import EmbeddedPrior
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.types import KinematicTree, Mesh, Primitives
from mam_world.ground_truth import GroundTruth
from mam_world.splits import VALIDATION_ONLY, iterate
from mam_world.truth import generated_truth

METRICS = ("miou", "count", "type_error", "axis", "limits")
MORE_IS_BETTER = ("miou", "count", "limits")
DECIDING = ("miou", "count", "type_error", "axis")  # by these a rule stays or goes
LEAST_GAIN = 0.005
ENOUGH = {"authored": 60, "fused": 30}  # objects from which a verdict is given
FUSED_ONLY = (
    "closed_fronts", "handle_on_panel", "two_sided_sheet", "through_sheet", "same_handle",
    "sunken_slide",
)  # fmt: skip
AUTHORED_ONLY = ("minor",)
OF_RANKING = ("near_lines", "sunken_slide")  # rules that the joint hypotheses depend on
SEED = EngineConfig().seed
STAGE_OF = {
    rule: "segment" if rule == "closed_fronts" else "joints" if rule in OF_JOINTS else "parts"
    for rule in Rules.names()
}


@dataclass
class Settings:
    """What is run.

    Attributes:
        authored, fused: objects of either sort. log: results by object, as JSON lines.
        out: the two files that are written, without suffix. only_report: run nothing.
        part: run only every N-th object from the K-th on (K N), to share the work out.
        stages: whose rules are tried; those of the joints cost most.
        samplings: how often an object is sampled; the engine's own number is 4.
    """

    log: Path
    authored: int = 60
    fused: int = 30
    out: Path = Path("docs/results/rule_ablation")
    only_report: bool = False
    part: tuple[int, int] = (0, 1)
    stages: tuple[Literal["segment", "parts", "joints"], ...] = ("segment", "parts", "joints")
    samplings: int = REASONER.samplings


def objects(count: int) -> list[tuple[str, int]]:
    """Held-back kinds and held-back seeds of other kinds by turns: (category, seed)."""
    plain = [pair for pair in iterate("validation", 193) if pair[0] not in VALIDATION_ONLY]
    order = np.random.default_rng(0).permutation(len(plain))
    kinds = ((kind, seed) for seed in range(8, 10_000, 10) for kind in sorted(VALIDATION_ONLY))
    out: list[tuple[str, int]] = []
    for k in order:
        out += [*islice(kinds, 1), plain[int(k)]]
    return out[:count]


class Case:
    """One object under different rules.

    Attributes:
        mesh, primitives: as the stages meet them. base: its scores with all rules.
    """

    def __init__(self, truth: GroundTruth, mesh: Mesh, samplings: int) -> None:
        self.truth, self.whole, self.samplings = truth, mesh, samplings
        self.primitives = GeometricSegmenter().segment(mesh)
        self.found = self._scored(self.primitives, ALL_RULES)
        self._drafts: dict[str, KinematicTree] = {}
        self._ends: dict[str, dict[str, float]] = {}
        self.tree = self._tree(self.found, self.primitives, ALL_RULES)
        self.base = self._score(self.tree, self.primitives, ALL_RULES)

    def off(self, rule: str) -> dict[str, float]:
        """Scores with one rule off."""
        rules, fused = ALL_RULES.without(rule), self.primitives.is_fused
        if rule in (AUTHORED_ONLY if fused else FUSED_ONLY):
            return self.base
        primitives, found = self.primitives, self.found
        if rule == "closed_fronts":
            primitives = GeometricSegmenter(rules=rules).segment(self.whole)
            if np.array_equal(primitives.labels, self.primitives.labels) and np.array_equal(
                primitives.fronts, self.primitives.fronts
            ):
                return self.base
        if rule in ("closed_fronts", "handle_on_panel", "two_sided_sheet", "through_sheet"):
            found = self._scored(primitives, rules)
        if rule in ("when_stuck", "siblings") and not self._fired(rule):
            return self.base
        return self._score(self._tree(found, primitives, rules), primitives, rules)

    def _fired(self, rule: str) -> bool:
        """Whether a rule of the joint estimator did anything for this object."""
        estimator = JointEstimator(*without_repeats(self.whole, self.primitives), SEED)
        turned = estimator.turned(self.tree)
        for index in range(1, len(turned.nodes)):
            found = estimator.estimate(turned, index)
            if found is None:
                continue
            first = found.candidates[0]
            turned_round = not np.array_equal(first.axis, found.chosen.axis)
            stuck = found.rank != 0 or turned_round
            if found.limits.sibling_at is not None if rule == "siblings" else stuck:
                return True
        # the parts stage may have met it on the way to this tree
        return bool(ALL_RULES.blockers and len(turned.nodes) > 1 and rule == "when_stuck" and any(
            (e := estimator.estimate(turned, i)) is not None and e.share < 0.75
            for i in range(1, len(turned.nodes))
        ))  # fmt: skip

    def _scored(self, primitives: Primitives, rules: Rules) -> Scored:
        prior = EmbeddedPrior().observe(self.whole, primitives, seed=SEED)
        mesh, bare = without_repeats(self.whole, primitives)
        views = sampled_views(mesh, bare, prior, SEED, rules, self.samplings)
        if rules != ALL_RULES and primitives is self.primitives:
            rigid, before = views[0].graph.rigid, self.found.graph.rigid
            if rigid is not None and before is not None and np.array_equal(rigid, before):
                return self.found
        return scored(views, load_scores("fused" if bare.is_fused else "authored"))

    def _tree(self, found: Scored, primitives: Primitives, rules: Rules) -> KinematicTree:
        mesh, bare = without_repeats(self.whole, primitives)
        masks, choice = chosen_parts(found, rules)
        ranking = [getattr(rules, name) for name in OF_RANKING]
        key = _digest(
            bare.labels, masks[list(choice.chosen)], choice.subtype[list(choice.chosen)],
            np.array(choice.chosen), masks[list(choice.left)], np.array(ranking),
        )  # fmt: skip
        if key not in self._drafts:
            self._drafts[key] = drafted(found.graph, masks, choice, mesh, bare, SEED, rules)
        draft = self._drafts[key]
        least = clear_from(found.graph, draft, rules)
        return settled(draft, mesh, bare, least, SEED, rules)

    def _score(self, tree: KinematicTree, primitives: Primitives, rules: Rules) -> dict[str, float]:
        if all(node.subtype == "fixed" for node in tree.nodes):
            found = None
        else:
            found = EmbeddedSolver(rules).solve(self.whole, primitives, tree, seed=SEED)
        key = "none" if found is None else _digest(
            found.face_link, *(a for j in found.joints for a in (j.axis, j.origin)),
            np.array([(j.lower, j.upper, j.parent) for j in found.joints]),
        )  # fmt: skip
        if key not in self._ends:
            scores = score(found, self.truth)
            self._ends[key] = {name: float(getattr(scores, name)) for name in METRICS}
        return self._ends[key]


def _digest(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def measured(
    kind: str, seed: int, fused: bool, rules: Sequence[str], samplings: int
) -> dict[str, Any]:
    """One row of the log."""
    began = time.perf_counter()
    truth = generated_truth(kind, seed)
    mesh = fuse_mesh(truth.mesh, 192, 0.0, faces=60_000) if fused else truth.mesh
    case = Case(truth, mesh, samplings)
    off = {rule: case.off(rule) for rule in rules}
    return {
        "kind": kind, "seed": seed, "fused": fused, "held_back_kind": kind in VALIDATION_ONLY,
        "one_surface": case.primitives.is_fused, "base": case.base, "rules": list(rules),
        "samplings": samplings,
        "off": {rule: scores for rule, scores in off.items() if scores != case.base},
        "seconds": round(time.perf_counter() - began, 1),
    }  # fmt: skip


def rows_of(log: Path) -> list[dict[str, Any]]:
    """What was measured so far."""
    if not log.is_file():
        return []
    return [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines() if line]


def run(settings: Settings) -> None:
    """Measure what the log lacks, authored and fused by turns."""
    jobs = zip_longest(objects(settings.authored), objects(settings.fused))
    wanted: list[tuple[str, int, bool]] = [
        (job[0], job[1], fused) for pair in jobs for job, fused in zip(pair, (False, True))
        if job is not None
    ]  # fmt: skip
    done = {(r["kind"], r["seed"], r["fused"]) for r in rows_of(settings.log)}
    first, step = settings.part
    rules = [rule for rule, stage in STAGE_OF.items() if stage in settings.stages]
    settings.log.parent.mkdir(parents=True, exist_ok=True)
    for job in wanted[first::step]:
        if job in done:
            continue
        try:
            kind, seed, fused = job
            row = measured(kind, seed, fused, rules, settings.samplings)
        except Exception as error:  # one object must not end an hour of work; it is named
            print(f"{job}: {error!r}", flush=True)
            continue
        with settings.log.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        print(f"{job}: {len(row['off'])} rules matter, {row['seconds']} s", flush=True)


@dataclass(frozen=True)
class Gain:
    """What a rule gains on some objects: better by `mean` with it than without it, per metric."""

    objects: int
    changed: int
    mean: dict[str, float]
    low: dict[str, float]
    high: dict[str, float]

    @property
    def most(self) -> float:
        """The largest gain among the metrics that decide."""
        return max(self.mean[m] for m in DECIDING)


def gain_of(rule: str, rows: list[dict[str, Any]]) -> Gain:
    """Paired differences of one rule; positive is better with the rule."""
    rows = [r for r in rows if rule in r["rules"]]
    mean, low, high = {}, {}, {}
    for metric in METRICS:
        sign = 1.0 if metric in MORE_IS_BETTER else -1.0
        difference = np.array([
            sign * (r["base"][metric] - r["off"].get(rule, r["base"])[metric]) for r in rows
        ])  # fmt: skip
        mean[metric] = float(difference.mean()) if len(rows) else 0.0
        low[metric], high[metric] = interval(difference)
    return Gain(len(rows), sum(rule in r["off"] for r in rows), mean, low, high)


def told(rule: str, gains: dict[str, Gain]) -> str:
    """What follows for a rule, in words."""
    if any(gains[k].objects < least for k, least in ENOUGH.items() if _acts_on(rule, k)):
        return "not decided: too few objects were measured"
    best = max(gains[k].most for k in ("authored", "fused"))
    if best >= LEAST_GAIN:
        where = [k for k in ("authored", "fused") if gains[k].most >= LEAST_GAIN]
        return "stays: gains on " + " and ".join(where)
    if max(gains[k].mean["limits"] for k in ("authored", "fused")) >= LEAST_GAIN:
        return "stays: it sets ranges, not axes"
    if not any(gains[k].changed for k in ("authored", "fused")):
        return "changed nothing here"
    return f"gains less than {LEAST_GAIN} here"


def _acts_on(rule: str, sort: str) -> bool:
    return rule not in (FUSED_ONLY if sort == "authored" else AUTHORED_ONLY)


def report(settings: Settings) -> None:
    """Write the JSON and the page."""
    rows = rows_of(settings.log)
    sorts = {s: [r for r in rows if r["fused"] == (s == "fused")] for s in ("authored", "fused")}
    table = {
        rule: {sort: gain_of(rule, own) for sort, own in sorts.items()} for rule in Rules.names()
    }
    about: dict[str, Any] = {
        "samplings": ", ".join(sorted({str(r["samplings"]) for r in rows})),
        "objects": {sort: len(own) for sort, own in sorts.items()},
        "held_back_kinds": {s: sum(r["held_back_kind"] for r in own) for s, own in sorts.items()},
        "all_rules": {
            sort: {m: float(np.mean([r["base"][m] for r in own])) for m in METRICS} if own else {}
            for sort, own in sorts.items()
        },
    }  # fmt: skip
    data = {**about, "rules": {
        rule: {"verdict": told(rule, gains), **{s: asdict(g) for s, g in gains.items()}}
        for rule, gains in table.items()
    }}  # fmt: skip
    settings.out.parent.mkdir(parents=True, exist_ok=True)
    file = settings.out.with_suffix(".json")
    save(file, data)
    about |= {k: v for k, v in json.loads(file.read_text()).items() if k in ("commit", "machine")}
    settings.out.with_suffix(".md").write_text(page(about, table))
    print(f"wrote {settings.out}.json and {settings.out}.md")


def page(about: dict[str, Any], table: dict[str, dict[str, Gain]]) -> str:
    """The table in Markdown."""
    number = about["objects"]
    lines = [
        "# What each hand rule is worth", "",
        "Generated by `benchmarks/rule_ablation.py`; do not edit. "
        f"{number['authored']} authored and {number['fused']} fused objects that nothing was "
        f"trained on; {about['held_back_kinds']['authored']} and "
        f"{about['held_back_kinds']['fused']} of them are of kinds that training never saw. "
        f"Commit {about['commit']}, {about['machine']}; "
        f"{about['samplings']} sampling(s) of each object.", "",
        "Each cell is what the rule gains in the mean over objects, with its 95 % bootstrap "
        "interval; positive is better with the rule. `n` is the number of objects that it changed. "
        f"With so few objects changed, a gain near {LEAST_GAIN} is within noise.", "",
    ]  # fmt: skip
    for sort in ("authored", "fused"):
        base = about["all_rules"][sort]
        if not base:
            continue
        said = ", ".join(f"{m} {v:.3f}" for m, v in base.items())
        lines += [f"## {sort.capitalize()} meshes", "", f"With all rules: {said}.", "",
                  "| rule | n | mIoU | count | type | axis (rad) | limits |",
                  "|---|---|---|---|---|---|---|"]  # fmt: skip
        lines += [_line(rule, gains[sort]) for rule, gains in table.items()]
        lines.append("")
    lines += ["## What follows", "", "| rule | |", "|---|---|"]
    lines += [f"| `{rule}` | {told(rule, gains)} |" for rule, gains in table.items()]
    return "\n".join(lines) + "\n"


def _line(rule: str, gain: Gain) -> str:
    if not gain.changed:
        return f"| `{rule}` | {'0' if gain.objects else 'not measured'} | | | | | |"
    cells = [
        f"{gain.mean[m]:+.3f} [{gain.low[m]:+.3f}, {gain.high[m]:+.3f}]" if gain.mean[m] else "0"
        for m in METRICS
    ]
    return f"| `{rule}` | {gain.changed} | {' | '.join(cells)} |"


def main(settings: Settings) -> None:
    """Run what is missing, then write the table."""
    if not settings.only_report:
        run(settings)
    report(replace(settings))


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
