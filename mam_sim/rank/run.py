"""Running the measure: a task for every asset, then one for every joint and robot.

Each task is a process of its own (mam_sim.forkserver): an asset that crashes the simulator ends
its own row. Results are files; what is there and unchanged is not measured again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import InputError, MamSimError, NotPhysicalError
from mam_pipeline.formats.mjcf_files import is_mjcf
from mam_pipeline.guarded import Ending, Limits
from mam_sim.batch.inputs import content_digest
from mam_sim.forkserver import run_all
from mam_sim.rank.measure import VERSION, Measure, Row, Verdict

USUAL = ("object", "mobility", "model", "robot", "scene")
"""Names of files that say nothing: their folder's name says what they are."""


@dataclass(frozen=True)
class Subject:
    """An asset folder or a URDF, with the digest of its content."""

    path: Path
    name: str
    sha256: str

    @staticmethod
    def of(path: Path) -> Subject:
        """Find out what a path is.

        Raises:
            InputError: nothing is there.
        """
        if not path.exists():
            raise InputError(f"no such file or folder: {path}")
        if path.is_dir():
            urdf, card = Asset.card_of(path).urdf_path, path / "asset.json"
            digest = content_digest(urdf) + hashlib.sha256(card.read_bytes()).hexdigest()
            digest = hashlib.sha256(digest.encode()).hexdigest()
        else:
            digest = content_digest(path)
        own = path.resolve()
        said = own.parent.name if own.suffix and own.stem in USUAL else own.stem
        return Subject(own, f"{said}-{digest[:6]}", digest)


@dataclass(frozen=True)
class Examine:
    """Lint and check of one subject; makes the asset that robots are given."""

    subject: Subject
    out: Path
    limits: Limits = field(default_factory=Limits)

    @property
    def file(self) -> Path:
        key = f"{VERSION} {self.subject.sha256} {self.subject.path}"
        return self.out / "verdicts" / f"{_digest(key)}.json"

    def warm(self) -> None:
        """Import what a check needs."""
        from mam_pipeline.check import check  # noqa: F401
        from mam_sim.rank import foreign  # noqa: F401

    def run(self) -> None:
        """Write the verdict."""
        _write(self.file, asdict(self.verdict()))

    def verdict(self) -> Verdict:
        """What lint and check say, and the joints."""
        from mam_pipeline.check.check import check_asset

        path = self.subject.path
        foreign = not (path.is_dir() or path.name == "asset.json")
        start = Verdict(self.subject.name, str(path), foreign=foreign)
        try:
            if foreign and is_mjcf(path):
                from mam_pipeline.formats.mjcf import urdf_of_mjcf

                path = urdf_of_mjcf(path, self.out / "mjcf" / self.subject.name)
            report = check_asset(path)
            start = replace(
                start, lint=report.clauses["lint"], check=report.passed, reasons=report.reasons
            )
            if foreign:
                from mam_sim.rank.foreign import foreign_asset

                asset = foreign_asset(path, self.out / "foreign" / self.subject.name)
            else:
                asset = Asset.load(path)
        except (MamSimError, OSError) as error:
            return replace(start, why=str(error))
        movable = [(j.name, j.type) for j in asset.card.movable]
        return replace(start, folder=str(asset.folder), joints=tuple(movable))

    def ended(self, ending: Ending) -> Verdict:
        """The verdict after its process has ended."""
        if ending.how != "done":
            _write(self.file, asdict(Verdict(self.subject.name, str(self.subject.path),
                                             why=f"{ending.how}: {ending.why}")))  # fmt: skip
        return _verdict(self.file)


@dataclass(frozen=True)
class Try:
    """One joint and one robot."""

    verdict: Verdict
    joint: str
    kind: str
    robot: str
    measure: Measure
    policy: str
    out: Path
    sha256: str
    video: bool = False
    limits: Limits = field(default_factory=Limits)
    truth: Subject | None = None

    @property
    def file(self) -> Path:
        words = [VERSION, self.sha256, self.joint, self.robot, self.measure, self.policy]
        words += [] if self.truth is None else [self.truth.sha256]
        return self.out / "rows" / f"{_digest(repr(words))}.json"

    @property
    def film(self) -> Path:
        """Where the video of the first episodes goes."""
        return self.out / "videos" / f"{self.file.stem}.mp4"

    @property
    def done(self) -> bool:
        """Whether nothing is left to measure, or to film where a video is asked for."""
        if not self.file.is_file():
            return False
        filmed = not self.video or self.film.is_file()
        return filmed or bool(json.loads(self.file.read_text())["cause"])

    def warm(self) -> None:
        """Import the simulator and the expert."""
        from mam_envs import env  # noqa: F401
        from mam_policies import evaluate  # noqa: F401

    def row(self, **more: Any) -> Row:
        """The row with what is known of it."""
        return Row(self.verdict.name, self.joint, self.kind, self.robot, self.measure.episodes,
                   **more)  # fmt: skip

    def run(self) -> None:
        """Write the row."""
        from mam_envs.grasping.candidates import PlacementError

        began = time.perf_counter()
        try:
            row = self._measured()
        except PlacementError as error:
            row = self.row(cause=error.cause, why=str(error))
        except NotPhysicalError as error:
            row = self.row(cause="truth" if self.truth else "asset", why=str(error))
        except MamSimError as error:
            row = self.row(cause="asset", why=str(error))
        _write(self.file, asdict(replace(row, seconds=round(time.perf_counter() - began, 1))))

    def _measured(self) -> Row:
        from mam_policies.evaluate import evaluate_expert, evaluate_run
        from mam_policies.run import EnvChoice

        m = self.measure
        choice = EnvChoice(
            (self.verdict.folder,), self.joint, None, self.robot, m.control_mode, m.max_steps
        )
        film, truth = self.film if self.video else None, self._truth()
        found = evaluate_expert(choice, m.episodes, m.seed, video=film, truth=truth)
        policy = None
        if self.policy != "none":
            from mam_policies.algorithms import algorithm, settings_of
            from mam_policies.run import TrainingError

            folder, learner = self.out / "runs" / self.file.stem, algorithm(self.policy)
            learnt = replace(choice, control_mode=learner.control_mode)
            try:
                learner.train(learnt, settings_of(self.policy)(), folder)
                policy = evaluate_run(folder, m.episodes, seed=m.seed, truth=truth).successes
            except TrainingError:  # an expert that fails teaches nothing
                policy = 0
        true_joint = "" if truth is None else found.joint
        return self.row(
            successes=found.successes, policy=policy, reasons=found.reasons, true_joint=true_joint
        )

    def _truth(self) -> Path | None:
        """The folder of the true object in the asset's frame, made once for each row."""
        if self.truth is None:
            return None
        from mam_sim.rank.foreign import true_asset

        asset = Asset.load(self.verdict.folder)
        return true_asset(self.truth.path, asset, self.out / "truth" / self.file.stem).folder

    def ended(self, ending: Ending) -> Row:
        """The row after its process has ended."""
        if ending.how != "done":
            _write(self.file, asdict(self.row(cause=ending.how, why=ending.why)))
        return Row(**json.loads(self.file.read_text()))


Tell = Callable[[str], None]


def joints_of_truth(urdf: Path) -> tuple[str, ...]:
    """Names of the joints of a true object that a robot could move; followers of others are none.

    Raises:
        InputError: it is no URDF that can be read, or nothing moves in it.
    """
    from mam_pipeline.formats.urdf.read import read_urdf

    return tuple(j.name for j in read_urdf(urdf).joints if j.coupling is None)


def examine(
    paths: Sequence[Path], out: Path, jobs: int, limits: Limits, tell: Tell = lambda _words: None
) -> list[Verdict]:
    """Verdicts on assets, in the order of the paths; those known already are read."""
    tasks = [Examine(Subject.of(path), out, limits) for path in paths]
    for task, ending in run_all([t for t in tasks if not t.file.is_file()], jobs):
        task.ended(ending)
        tell(task.subject.name)
    return [_verdict(task.file) for task in tasks]


def attempts(
    paths: Sequence[Path], verdicts: Sequence[Verdict], robots: Sequence[str], measure: Measure,
    policy: str, out: Path, limits: Limits, video: bool = False, truths: Sequence[Path] = (),
) -> list[Try]:  # fmt: skip
    """A task for every joint and robot of the assets that can be loaded; `truths`: one URDF per
    path, or none."""
    real: list[Subject | None] = [Subject.of(t) for t in truths]
    real = real or [None] * len(paths)
    return [
        Try(verdict, joint, kind, robot, measure, policy, out, Subject.of(path).sha256, video,
            limits, truth)
        for path, verdict, truth in zip(paths, verdicts, real)
        if verdict.folder
        for joint, kind in verdict.joints
        for robot in robots
    ]  # fmt: skip


def measured(tasks: Sequence[Try], jobs: int, tell: Tell = lambda _words: None) -> list[Row]:
    """Rows in the order of the tasks; those known already are read."""
    for task, ending in run_all([t for t in tasks if not t.done], jobs):
        row = task.ended(ending)
        said = row.cause or f"{row.successes}/{row.episodes}"
        tell(f"{row.asset} {row.joint} {row.robot}: {said}")
    return [Row(**json.loads(task.file.read_text())) for task in tasks]


def _verdict(file: Path) -> Verdict:
    data = json.loads(file.read_text())
    data["joints"] = tuple(tuple(pair) for pair in data["joints"])
    return Verdict(**{**data, "reasons": tuple(data["reasons"])})


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _write(file: Path, data: Any) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(data, indent=1, default=str))
    part.replace(file)
