"""`mam-sim bench`: score the engine on ground-truth URDFs, beside the paper's numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional

from mam_pipeline import config_file, folders
from mam_pipeline.claims import BENCH_LOG, BENCH_SETTINGS, SCORES, claim_file
from mam_pipeline.edited import Count
from mam_pipeline.errors import ConfigError, HintNeeded
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.settings import given
from mam_pipeline.weights import standing_in
from mam_sim.console import Screen, counting_bar
from mam_sim.options import Verb, settings
from mam_sim_bench.config import BenchConfig

if TYPE_CHECKING:
    from mam_sim_bench.runner import Record


@dataclass(frozen=True, kw_only=True)
class Bench(Verb):
    """Run the engine on every object of a dataset and print the table of metrics."""

    dataset: Positional[str]
    """Folder of URDF objects, or generated:validation, generated:test, generated:motionless,
    generated:unseen."""
    out: Path | None = None
    """JSON file for everything; beside it a .jsonl makes the run resumable, and a .yaml says the
    settings."""
    only: tuple[str, ...] = ()
    """Ids of objects to run."""
    limit: Count | None = None
    """At most this many objects (generated: 50 unless told)."""
    jobs: Count = 1
    """Processes."""
    weights: Path | None = None
    """Folder of weights that stand in for the packaged ones: `parts/abstention` and so on."""
    bench: Annotated[BenchConfig, OmitArgPrefixes] = field(default_factory=BenchConfig)
    json: bool = False
    """Print the result as JSON instead of tables."""

    def run(self) -> int:
        """Run and score every object; print the tables."""
        from mam_sim_bench.table import as_json

        if self.bench.engine.reasoner == "vlm" and self.jobs > 1:
            raise ConfigError("--reasoner vlm needs --jobs 1: the cost cap is kept in one process")
        self.bench.engine.check()
        claim_file(self.out, SCORES)
        if self.out is not None:
            claim_file(self.out.with_suffix(".yaml"), BENCH_SETTINGS)
            claim_file(self.out.with_suffix(".jsonl"), BENCH_LOG)
        screen = Screen(self.quiet)
        with (
            given(self.bench.models.settings()), standing_in(self.weights), one_ledger() as ledger
        ):  # fmt: skip
            records = self._records(screen)
            data = as_json(records, self.dataset, self.bench)
        waiting = [r for r in records if r.status == "asked"]
        if waiting:
            more = f"{len(waiting)} of {len(records)} objects wait for an answer"
            raise HintNeeded(f"{more}; first: {waiting[0].why}")
        if self.out is not None:
            folders.write_text(self.out, json.dumps(data, indent=1) + "\n")
            config_file.save(settings(self), self.out.with_suffix(".yaml"))
        if self.json:
            screen.json(data)
            return 0
        if ledger.summary():
            screen.say(f"asked: {ledger.summary()}")
        self._tables(screen, records, data["models"])
        return 0

    def _records(self, screen: Screen) -> list[Record]:
        """Run what is not in the log yet, with a bar."""
        from mam_sim_bench.runner import find_tasks, run_bench

        tasks = find_tasks(self.dataset, self.only, self.limit)
        if self.out is not None:
            self.out.parent.mkdir(parents=True, exist_ok=True)
        log = None if self.out is None else self.out.with_suffix(".jsonl")
        with counting_bar(screen, len(tasks) * self.bench.seeds, 0) as tell:

            def done(record: Record, reused: bool) -> None:
                mark = "kept" if reused else f"{record.seconds:.1f} s"
                tell(f"{record.id} {record.scores.miou:.2f}", mark)

            return [
                record
                for config in self.bench.seeded()
                for record in run_bench(tasks, config, log, self.jobs, done)
            ]

    def _tables(
        self, screen: Screen, records: list[Record], models: Mapping[str, Any]
    ) -> None:  # fmt: skip
        from mam_sim_bench import table

        screen.out.width = max(screen.out.width, 136)  # the table must not lose digits in a pipe
        screen.out.print(table.objects_table(records))
        screen.out.print(table.rows_table(table.by_category(records), "categories"))
        total = table.summarise("mam-sim" + self.bench.told(), records)
        rows = [total, *table.intervals(records), *table.PAPER]
        screen.out.print(table.rows_table(rows, f"total of {self.dataset}"))
        lines = (table.review_line, table.calibration_line, table.motionless_line)
        for said in filter(None, (line(records) for line in lines)):
            screen.out.print(said)
        screen.out.print(table.seen_line(models, self.dataset))
        if self.out is not None:
            screen.say(f"result: {self.out}")
