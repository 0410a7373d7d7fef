"""`mam-sim batch`: assets of many inputs, side by side, resumable, each with its guards."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated

import yaml
from tyro.conf import OmitArgPrefixes, Positional

from mam_pipeline.edited import Count, Positive
from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import load_hints
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models.consent import offer_of
from mam_pipeline.models.settings import given
from mam_sim.console import Screen
from mam_sim.options import Verb, settings

if TYPE_CHECKING:
    from mam_sim.batch.record import Record, Target
    from mam_sim.batch.run import Plan


@dataclass(frozen=True, kw_only=True)
class Batch(Verb):
    """Make an asset of every input; the same command goes on where a killed one was.

    Nothing that is done and unchanged is done again. An object that crashes, or takes more than
    its time or memory, ends with a reason, and the others go on. Exit status 0 when every input
    became an asset that passes, 1 when one did not.
    """

    inputs: Positional[tuple[str, ...]]
    """Photos, meshes and URDFs: files, folders, quoted patterns ("scans/**/*.glb"), or a list
    (.txt) with one of these a line."""
    out: str
    """Folder to write, or an address of fsspec (s3://bucket/run)."""
    jobs: Count = 1
    """Objects at once, each in a process of its own."""
    ray: str | None = None
    """Address of a Ray cluster that makes them instead ("auto": the one that runs here)."""
    time_limit: Positive = 1800.0
    """Seconds after which an object is given up."""
    memory_limit: Positive = 8.0
    """Gigabytes of memory at which an object is given up."""
    retry: bool = False
    """Try again what has no asset yet for whatever reason."""
    environment: bool = False
    """Try a robot environment on each asset too, as make-env does."""
    robot: str = "panda"
    """The arm of that environment."""
    report: bool = False
    """Draw each asset's report.html."""
    pipeline: Annotated[MakeConfig, OmitArgPrefixes] = field(default_factory=MakeConfig)
    json: bool = False
    """Print counts and records as JSON."""

    def run(self) -> int:
        """Make what is not made yet; write the manifest and the gallery."""
        from mam_pipeline.guarded import Limits
        from mam_sim.batch.inputs import find_inputs
        from mam_sim.batch.pages import counts, write_pages
        from mam_sim.batch.record import MADE, Target
        from mam_sim.batch.run import held, plan
        from mam_sim.batch.work import Work

        self._check()
        screen, target = Screen(self.quiet or self.json), Target(self.out)
        items = find_inputs(self.inputs)
        target.refuse_foreign()
        with held(target), given(self.pipeline.models.settings()):
            target.prepare(yaml.safe_dump(settings(self), sort_keys=False).encode())
            work = Work(self.pipeline, self.environment, self.robot, self.report)
            limits = Limits(self.time_limit, self.memory_limit)
            todo = plan(items, work, target, limits, self.retry)
            records = list(todo.done)
            try:
                self._make(todo, target, records, screen)
            finally:
                write_pages(records, target, self.report)
        found = counts(records)
        if self.json:
            screen.json({"counts": found, "objects": [asdict(r) for r in records]})
        screen.say(f"{len(records)} objects, {len(todo.done)} of them done before")
        for status, count in found.items():
            screen.say(f"  {status:<16} {count}")
        screen.say(f"manifest: {self.out}/manifest.csv")
        screen.say(f"gallery:  {self.out}/index.html")
        done = set(found) <= {"passes"}
        if any(record.status in MADE for record in records) and "://" not in str(self.out):
            made = f"{self.out}/assets"
            screen.next(*(("view", made, "--html") if done else ("studio", made)))
        return 0 if done else 1

    def _check(self) -> None:
        """Raise ConfigError for what cannot be, before anything is loaded."""
        if not self.inputs:
            raise ConfigError("name at least one input: a file, a folder, a pattern or a list")
        self.pipeline.check()
        if self.pipeline.hints is not None:
            load_hints(self.pipeline.hints)
        if self.pipeline.engine.reasoner == "vlm":
            raise ConfigError("batch has no --reasoner vlm: the cost cap is kept in one process")
        with given(self.pipeline.models.settings()):
            offer = offer_of(self.pipeline.reconstructor)
        if offer is not None and offer.price:
            name = self.pipeline.reconstructor
            raise ConfigError(
                f"batch has no --reconstructor {name}: the cost cap is kept in one process"
            )
        if self.environment:
            from mam_envs.robots import ROBOTS

            ROBOTS.check(self.robot)

    def _make(self, todo: Plan, target: Target, records: list[Record], screen: Screen) -> None:
        """Do what is left with a bar; records are added as they come."""
        from mam_sim.batch.pages import write_pages
        from mam_sim.batch.run import REFRESH, Pace, run
        from mam_sim.console import counting_bar

        if not todo.left:
            return
        total = len(todo.done) + len(todo.left)
        pace, written = Pace(len(todo.left)), time.monotonic()
        with counting_bar(screen, total, len(todo.done)) as tell:
            for record in run(todo.left, self.jobs, self.ray):
                records.append(record)
                pace.tick()
                tell(f"{record.name}: {record.status}, {record.seconds:.1f} s", pace.line())
                if time.monotonic() - written > REFRESH:
                    write_pages(records, target, self.report)
                    written = time.monotonic()
