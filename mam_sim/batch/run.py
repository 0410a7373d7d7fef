"""The batch: what is still to do, done by processes of this machine or of a Ray cluster."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import stat
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mam_pipeline import folders
from mam_pipeline.claims import not_a_link
from mam_pipeline.errors import ConfigError
from mam_pipeline.forkserver import on_this_process, run_all
from mam_pipeline.guarded import Limits
from mam_sim.batch.inputs import Input
from mam_sim.batch.record import GUARDED, MADE, Record, Target
from mam_sim.batch.work import Job, Work, job_key
from mam_sim.console import duration

REFRESH = 60.0
"""Seconds between two versions of the manifest and the gallery while a batch runs."""
RETRIES = 10
"""How often Ray tries an object again whose node was lost."""


@dataclass(frozen=True)
class Plan:
    """What a batch has done already, and what is left.

    Attributes:
        done: records of objects that need not be made again. left: jobs in order.
    """

    done: list[Record]
    left: list[Job]


def plan(
    items: Sequence[Input], work: Work, target: Target, limits: Limits, retry: bool = False
) -> Plan:
    """Compare inputs with the records of the target.

    Args:
        retry: make anew what has no asset (a crash, a refusal), whatever the reason.
    """
    of_work, kept, there = work.digest(), target.records(), target.names("assets")
    done, left = [], []
    for item in items:
        job = Job(item, work, job_key(item, of_work), target.address, limits)
        record = kept.get(item.name)
        if record is not None and record.key == job.key and _stands(record, there, limits, retry):
            done.append(record)
        else:
            left.append(job)
    return Plan(done, left)


def _stands(record: Record, there: set[str], limits: Limits, retry: bool) -> bool:
    """Whether a record of the same key still says how the object goes."""
    if record.status in MADE:
        return record.name in there
    if record.status in GUARDED:
        now = limits.seconds if record.status == "timeout" else 1024 * limits.memory
        return now <= record.limit and not retry
    return not retry


def run(
    jobs: Sequence[Job],
    processes: int = 1,
    ray_address: str | None = None,
) -> Iterator[Record]:
    """Do jobs, each in a process of its own; records come as they are done.

    Args:
        processes: at once, on this machine.
        ray_address: of a Ray cluster, which then does them with all its processors ("local": Ray
            on this machine).
    """
    yield from (job.refused() for job in jobs if job.item.fault)
    sound = [job for job in jobs if not job.item.fault]
    if ray_address is None:
        yield from (job.finished(ending) for job, ending in run_all(sound, processes))
    elif sound:
        yield from _on_ray(sound, ray_address)


def _on_ray(jobs: Sequence[Job], address: str) -> Iterator[Record]:
    from mam_pipeline.optional import require

    require("--ray", "ray")
    import ray

    started = not ray.is_initialized()
    if started:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    try:
        remote = ray.remote(num_cpus=1, max_retries=RETRIES)(_attempt)
        waiting = [remote.remote(job) for job in jobs]
        while waiting:
            ready, waiting = ray.wait(waiting, num_returns=1)
            yield from ray.get(ready)
    finally:
        if started:
            ray.shutdown()


def _attempt(job: Job) -> Record:
    """Make an object, unless a node that was lost had finished it."""
    record = Target(job.address).record(job.item.name)
    if record is not None and record.key == job.key and record.status in MADE:
        return record
    return job.finished(on_this_process(job))


@contextmanager
def held(target: Target) -> Iterator[None]:
    """Keep a second batch out of a local target while this one runs.

    A new folder goes again where the batch fails before anything is done.

    Raises:
        ConfigError: another batch is at work there.
    """
    if not target.local:
        yield
        return
    folder = Path(target.root)
    fresh = not folder.exists()
    with folders.used_folder(folder), _lock_file(folder / ".lock") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ConfigError(
                f"another batch writes to {target.address}; wait for it or name another --out"
            ) from None
        try:
            yield
        except BaseException:
            if fresh and not target.names("records"):
                shutil.rmtree(folder, ignore_errors=True)
            raise


@contextmanager
def _lock_file(path: Path) -> Iterator[int]:
    """A file to lock, open; never one that a link leads to, and what it holds stays."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    handle = os.open(not_a_link(path), flags, 0o644)
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ConfigError(f"{path} is no ordinary file; remove it or name another --out")
        yield handle
    finally:
        os.close(handle)


class Pace:
    """Objects a minute over the last ones, and the time that is left."""

    KEPT = 50

    def __init__(self, left: int) -> None:
        self.left = left
        self._times = [time.monotonic()]

    def tick(self) -> None:
        """One more is done."""
        self.left -= 1
        self._times = [*self._times[-self.KEPT :], time.monotonic()]

    @property
    def per_minute(self) -> float:
        """Objects a minute; 0 before the first."""
        span = self._times[-1] - self._times[0]
        return 60.0 * (len(self._times) - 1) / span if span > 0 else 0.0

    def line(self) -> str:
        """For people: "12.5 a minute, 1 h 20 min left"."""
        if not self.per_minute:
            return ""
        left = duration(60.0 * self.left / self.per_minute)
        return f"{self.per_minute:.1f} a minute, {left} left"
