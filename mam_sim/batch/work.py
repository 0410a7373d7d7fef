"""One object of a batch: what its process does, and what is written of it."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import platform
import resource
import time
import traceback
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mam_pipeline import backends, config_file
from mam_pipeline.asset.card import Asset
from mam_pipeline.claims import not_a_link
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import (
    HintNeeded,
    InputError,
    MamSimError,
    NotPhysicalError,
    NotThisKind,
    disk_error,
    disk_is_full,
)
from mam_pipeline.folders import Scratch
from mam_pipeline.guarded import Ending, Limits
from mam_pipeline.make_config import EngineConfig, MakeConfig
from mam_pipeline.run import make_asset
from mam_sim import __version__
from mam_sim.batch.inputs import Input
from mam_sim.batch.record import GUARDED, Record, Status, Target

PICTURE = (360, 300)
"""(width, height) of an object in the gallery, pixels."""
OUTCOMES: tuple[tuple[type[MamSimError], Status], ...] = (
    (HintNeeded, "needs a hint"),
    (NotThisKind, "another kind"),
    (NotPhysicalError, "bad input"),
    (InputError, "bad input"),
)


@dataclass(frozen=True)
class Work:
    """What is made of every input.

    Attributes:
        environment: try a robot environment too, with `robot`.
        report: draw each asset's report.html.
    """

    pipeline: MakeConfig = field(default_factory=MakeConfig)
    environment: bool = False
    robot: str = "panda"
    report: bool = False

    def digest(self) -> str:
        """Of everything that decides a result beside the input: settings, backends, code."""
        roles = {"reconstructor": self.pipeline.reconstructor} | {
            role: getattr(self.pipeline.engine, role)
            for role in ("segmenter", "prior", "reasoner", "solver")
        }
        makers = [backends.maker(r, backends.resolved(r, n)) for r, n in roles.items()]
        told: dict[str, Any] = {"pipeline": config_file.plain(self.pipeline), "makers": makers}
        if self.pipeline.hints is not None:
            told["hints"] = file_digest(self.pipeline.hints)
        told["report"] = self.report
        if self.environment:
            told["robot"] = self.robot
        return hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()

    def warm(self) -> None:
        """Load what objects need, by making a small one, so that no process loads it again."""
        from mam_pipeline.joints.ranker import learned
        from mam_pipeline.parts.scores import load_scores

        for role in ("segmenter", "prior", "reasoner", "solver"):
            name = backends.resolved(role, getattr(self.pipeline.engine, role))
            backends.maker(role, name)
        load_scores("fused"), learned(True)
        # a failure here is met again by the first object, which has a record to tell it in
        with contextlib.suppress(Exception):
            self._rehearse()
        if self.environment:
            import mam_envs.env
            import mam_envs.trial  # noqa: F401

    def _rehearse(self) -> None:
        """Make a generated object by the embedded backends, which ask no network and no GPU."""
        from mam_pipeline.formats.mesh_files import save_glb
        from mam_world.truth import generated_truth

        engine = EngineConfig("geometric", "embedded", "embedded", "embedded")
        with Scratch() as folder:
            source = Path(folder) / "object.glb"
            save_glb(generated_truth("cabinet_one_door", 0).mesh, source)
            config = MakeConfig(engine=engine, visuals=self.pipeline.visuals)
            asset = make_asset(source, Path(folder) / "asset", config)
            _picture(asset)
            if self.report:
                from mam_sim.report import write_report

                write_report(asset)

    def make(self, job: Job, target: Target, out: Path) -> Record:
        """Make the asset at `out`, its picture, and what else is asked for."""
        from mam_pipeline.formats.mesh_files import files_kept

        with files_kept():
            asset = make_asset(job.item.path, out, self.pipeline)
        tried: dict[str, Any] = {}
        if self.environment:
            from mam_envs.trial import try_environment

            tried = try_environment(asset, self.robot)
            asset = asset.noted(environment=tried)
        if self.report:
            from mam_sim.report import write_report

            write_report(asset)
        target.write(f"pictures/{job.item.name}.jpg", _picture(asset))
        verdict = asset.card.checks["executability"]
        status: Status = "passes"
        reason = ""
        if not asset.card.movable:
            asleep = [f"{j.child} ({j.confidence:.2f})" for j in asset.card.likeliest]
            status, reason = "nothing moves", f"dormant: {', '.join(asleep)}" if asleep else ""
        elif not verdict["passed"]:
            status, reason = "fails check", ", ".join(verdict["reasons"])
        elif tried and not tried["ok"]:
            status, reason = "no environment", str(tried["why"])
        joints = asset.card.movable
        return job.record(
            status,
            reason=reason,
            check=tuple(verdict["reasons"]),
            joints=tuple(j.name for j in joints),
            types=tuple(j.type for j in joints),
            confidences=tuple(round(j.confidence, 3) for j in joints),
            environment=str(tried.get("joint") or ""),
            backends={role: str(maker["name"]) for role, maker in asset.card.backends.items()},
        )


_WARMED: list[Work] = []
"""What this process, a server, is ready for."""


@dataclass(frozen=True)
class Job:
    """One input and all that its process must know."""

    item: Input
    work: Work
    key: str
    address: str
    limits: Limits = field(default_factory=Limits)

    def record(self, status: Status, **more: Any) -> Record:
        """What is known of it whatever becomes of it, with a status."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        return Record(
            self.item.name, str(self.item.path), self.item.sha256, self.key, status,
            version=__version__, host=platform.node(), ended=now, **more,
        ).readable  # fmt: skip

    def warm(self) -> None:
        """Load what objects need, at the first one."""
        if not _WARMED:
            _WARMED.append(self.work)
            self.work.warm()

    def run(self) -> None:
        """Make the object and write its record; every error that Python can catch becomes one.

        Raises:
            OSError: the disk is full, which is no object's fault.
        """
        began, target = time.perf_counter(), Target(self.address)
        try:
            if target.local:
                place = not_a_link(Path(target.path("assets", self.item.name)))
                record = self.work.make(self, target, place)
            else:
                with Scratch() as folder:
                    out = Path(folder) / self.item.name
                    record = self.work.make(self, target, out)
                    target.put(out, self.item.name)
        except MamSimError as error:
            status: Status = next((s for kind, s in OUTCOMES if isinstance(error, kind)), "error")
            record = self.record(status, reason=str(error))
        except OSError as error:
            if disk_is_full(error):
                raise
            record = self.record("error", reason=str(disk_error(error)))
        except Exception as error:  # one broken object must not end the batch
            log = traceback.format_exc()[-4000:]
            record = self.record("error", reason=f"{type(error).__name__}: {error}", log=log)
        used = resource.getrusage(resource.RUSAGE_SELF)
        record = replace(
            record,
            seconds=round(time.perf_counter() - began, 2),
            cpu_seconds=round(used.ru_utime + used.ru_stime, 2),
            peak_mb=round(used.ru_maxrss / 1024, 1),
        )
        target.save(record)

    def finished(self, ending: Ending) -> Record:
        """Its record after its process has ended, written here where the process could not.

        Raises:
            InputError: the disk is full: the others would fare no better.
        """
        if ending.how == "disk":
            raise InputError(ending.why)
        target = Target(self.address)
        if ending.how == "done":
            record = target.record(self.item.name)
            if record is not None and record.key == self.key:
                return record if ending.tries == 1 else self._kept(record, target, ending)
            ending = replace(ending, how="crash", why="its process ended without a record")
        record = self.record(
            next((s for s in GUARDED if s == ending.how), "crash"),
            reason=ending.why,
            seconds=ending.seconds,
            cpu_seconds=ending.cpu_seconds,
            peak_mb=ending.peak_mb,
            limit=ending.limit,
            log=ending.log,
        )
        return self._kept(record, target, ending)

    def refused(self) -> Record:
        """The record of an input of which nothing can be made."""
        record = self.record("bad input", reason=self.item.fault)
        return self._kept(record, Target(self.address), Ending("done"))

    def _kept(self, record: Record, target: Target, ending: Ending) -> Record:
        """The record, written down where that can be; it is a row of the manifest in any case."""
        record = replace(record, tries=ending.tries)
        try:
            target.save(record)
        except Exception as error:  # each file system has errors of its own
            if isinstance(error, OSError):
                if disk_is_full(error):
                    raise disk_error(error) from error
                error = disk_error(error)
            why = f"its record cannot be written: {error}"
            return replace(record, status="error", reason=f"{record.reason}; {why}".lstrip("; "))
        return record


def _picture(asset: Asset) -> bytes:
    """The asset with all its joints open, as JPEG."""
    from PIL import Image

    from mam_pipeline.asset.read import read_asset
    from mam_pipeline.render.motion import motion_pictures

    shown = motion_pictures(read_asset(asset), [1.0], PICTURE)[0]
    buffer = io.BytesIO()
    Image.fromarray(shown).save(buffer, format="JPEG", quality=85)
    return buffer.getvalue()


def job_key(item: Input, work: str) -> str:
    """What an object's result depends on: its content, and the digest of the work."""
    return hashlib.sha256(f"{item.sha256} {work}".encode()).hexdigest()[:24]
