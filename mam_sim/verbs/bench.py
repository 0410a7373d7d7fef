"""`mam-sim bench`: score the engine on ground-truth URDFs, beside the paper's numbers."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated

import tyro
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from mam_pipeline.engine import EngineConfig
from mam_pipeline.errors import ConfigError, HintNeeded
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.settings import given
from mam_sim.bench.runner import BenchConfig, Record, find_tasks, run_bench
from mam_sim.bench.table import (
    PAPER,
    as_json,
    by_category,
    objects_table,
    review_line,
    rows_table,
    summarise,
)
from mam_sim.console import Screen
from mam_sim.verbs.flags import ModelFlags


def bench(
    dataset: Annotated[str, tyro.conf.Positional],
    /,
    out: Path | None = None,
    fuse: bool = False,
    only: tuple[str, ...] = (),
    jobs: int = 1,
    limit: int | None = None,
    exec: bool = True,
    noise: float = 0.0,
    segmenter: str = "auto",
    prior: str = "auto",
    reasoner: str = "auto",
    solver: str = "auto",
    models: Annotated[ModelFlags, tyro.conf.OmitArgPrefixes] = ModelFlags(),  # noqa: B008
    seed: int = 0,
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Run the engine on every object of a dataset and print the table of metrics.

    Args:
        dataset: folder of URDF objects, or generated:validation, generated:test.
        out: JSON file for everything; beside it FILE.jsonl makes the run resumable.
        fuse: first turn each input into one watertight surface, as a generator would.
        only: ids of objects to run.
        jobs: processes.
        limit: at most this many objects (generated: 50 unless told).
        exec: also write each asset and test it in the simulator (--no-exec leaves it out).
        noise: with --fuse, displacement of the surface as a share of the diagonal.
        segmenter: backend that cuts primitives.
        prior: backend that probes motion; none leaves it out.
        reasoner: backend that finds parts; file and vlm keep their answers, so that a run can be
            repeated without asking again.
        solver: backend that estimates joints: embedded, init, lm, nelder-mead.
        models: models outside mam-sim; each object's questions lie in a folder of its name.
        seed: of everything random.
        quiet: no progress bar.
        json: print the result as JSON instead of tables.
    """
    if jobs < 1:
        raise ConfigError(f"--jobs must be at least 1, got {jobs}")
    if limit is not None and limit < 1:
        raise ConfigError(f"--limit must be at least 1, got {limit}")
    engine = EngineConfig(segmenter, prior, reasoner, solver, seed)
    if reasoner == "vlm" and jobs > 1:
        raise ConfigError("--reasoner vlm needs --jobs 1: the cost cap is kept in one process")
    settings = tuple(sorted(models.settings().items()))
    config = BenchConfig(engine, fuse=fuse, noise=noise, execute=exec, settings=settings)
    tasks = find_tasks(dataset, only, limit)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
    log = None if out is None else out.with_suffix(".jsonl")
    screen = Screen(quiet)
    columns = (BarColumn(24), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, TimeElapsedColumn(), console=screen.err, disable=quiet) as bar:
        line = bar.add_task("", total=len(tasks))

        def done(record: Record, reused: bool) -> None:
            mark = "kept" if reused else f"{record.seconds:.1f} s"
            bar.update(line, advance=1, description=f"{record.id} {record.scores.miou:.2f} {mark}")

        with given(models.settings()), one_ledger() as ledger:
            records = run_bench(tasks, config, log, jobs, done)
    waiting = [r for r in records if r.status == "asked"]
    if waiting:
        more = f"{len(waiting)} of {len(records)} objects wait for an answer"
        raise HintNeeded(f"{more}; first: {waiting[0].why}")
    data = as_json(records, dataset, config)
    if out is not None:
        out.write_text(json_module.dumps(data, indent=1) + "\n", encoding="utf-8")
    if json:
        screen.json(data)
        return 0
    if ledger.summary():
        screen.say(f"asked: {ledger.summary()}")
    screen.out.width = max(screen.out.width, 136)  # the table must not lose digits in a pipe
    screen.out.print(objects_table(records))
    screen.out.print(rows_table(by_category(records), "categories"))
    total = summarise("mam-sim" + (", fused input" if fuse else ""), records)
    screen.out.print(rows_table([total, *PAPER], f"total of {dataset}"))
    screen.out.print(review_line(records))
    if out is not None:
        print(f"wrote {out}")
    return 0
