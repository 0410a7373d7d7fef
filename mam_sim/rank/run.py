"""Running the measure: a task for every asset, then one for every joint and robot.

Each task is a process of its own (`mam_pipeline.forkserver`): an asset that crashes the simulator
ends its own row. Results are files; what is there and unchanged is not measured again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.listing import assets_in
from mam_pipeline.claims import ASSET, MENDED, is_ours, not_a_link
from mam_pipeline.edited import read_json, validated
from mam_pipeline.errors import (
    InputError,
    MamSimError,
    NotPhysicalError,
    disk_error,
    disk_is_full,
)
from mam_pipeline.forkserver import run_all
from mam_pipeline.formats.articulations import KINDS, SUFFIXES, converted
from mam_pipeline.formats.door import entries, is_file
from mam_pipeline.formats.suffixes import PHOTOS, mesh_suffixes
from mam_pipeline.guarded import Ending, Limits
from mam_sim.batch.inputs import content_digest, telling_name
from mam_sim.rank.measure import VERSION, Measure, Row, Verdict

T = TypeVar("T")


@dataclass(frozen=True)
class Subject:
    """An asset folder or a URDF, with the digest of its content.

    Attributes:
        fault: why it is neither, in a sentence; "" where that is not known yet.
    """

    path: Path
    name: str
    sha256: str
    fault: str = ""

    @staticmethod
    def of(path: Path) -> Subject:
        """Find out what a path is; what is neither asset nor robot file has a fault."""
        fault = ""
        try:
            digest = Subject._digest(path)
        except OSError as error:
            fault = str(disk_error(error))
        except (InputError, ValueError, RecursionError, MemoryError) as error:
            fault = str(error) or f"{path} cannot be read"
        if fault:
            digest = hashlib.sha256(folders.as_text(f"{path} {fault}").encode()).hexdigest()
        own = path.absolute() if fault else path.resolve()
        return Subject(own, f"{folders.as_text(telling_name(own))}-{digest[:6]}", digest, fault)

    @staticmethod
    def _digest(path: Path) -> str:
        """Digest of the content.

        Raises:
            InputError: nothing is there, or something else.
        """
        if path.is_dir():
            urdf, card = Asset.card_of(path).urdf_path, path / "asset.json"
            digest = content_digest(urdf) + hashlib.sha256(card.read_bytes()).hexdigest()
            return hashlib.sha256(digest.encode()).hexdigest()
        robot_file(path)
        return content_digest(path)


def subjects(paths: Sequence[Path]) -> list[Path]:
    """Assets and files that are meant: of a folder that is none, all that lie directly in it.

    A mended file of which no part moves made no asset: it is meant itself.
    """
    found = [p for path in paths for p in assets_in(path, MENDED.file) or [path]]
    return [_urdf_alone(p) if is_ours(p / MENDED.file, MENDED) else p for p in found]


def _urdf_alone(folder: Path) -> Path:
    """The folder, or the one URDF in it where it has no card."""
    files = [] if is_file(folder / ASSET.file) else entries(folder, "*.urdf")
    return files[0] if len(files) == 1 else folder


def robot_file(path: Path) -> Path:
    """The path itself, where it is an ordinary file that may be a robot's.

    Raises:
        InputError: it is none.
    """
    if not path.exists():
        raise InputError(f"no such file or folder: {path}")
    if not path.is_file():
        raise InputError(f"{path} is no ordinary file; name an asset folder, {KINDS}")
    if path.name != "asset.json" and path.suffix.lower() not in SUFFIXES:
        if path.suffix.lower() in (*mesh_suffixes(), *PHOTOS):
            Asset.card_of(path)  # refuses it, and says what makes an asset of it
        raise InputError(f"{path} is no asset folder, and not {KINDS}")
    return path


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

    @property
    def known(self) -> Verdict | None:
        """The verdict, where nothing is left to find out."""
        if self.subject.fault:
            return self._refused(self.subject.fault)
        found: Verdict | None = _read(Verdict, self.file)
        return found if found is not None and self._fits(found) else None

    def _fits(self, found: Verdict) -> bool:
        """Whether a verdict that was read is of this subject."""
        own = (str(self.subject.path), *(str(p) for p in (self.out / "foreign").glob("*")))
        return found.name == self.subject.name and found.folder in ("", *own)

    def _refused(self, why: str) -> Verdict:
        source = folders.as_text(str(self.subject.path))
        return Verdict(self.subject.name, source, why=folders.as_text(why))

    def warm(self) -> None:
        """Import what a check needs."""
        from mam_pipeline.asset import foreign  # noqa: F401
        from mam_pipeline.check import check  # noqa: F401

    def run(self) -> None:
        """Write the verdict."""
        _write(self.file, asdict(self.verdict()))

    def verdict(self) -> Verdict:
        """What lint and check say, and the joints."""
        from mam_pipeline.check.check import check_asset

        path = self.subject.path
        foreign = not (path.is_dir() or path.name == "asset.json")
        start = Verdict(self.subject.name, folders.as_text(str(path)), foreign=foreign)
        try:
            if foreign and (found := converted(path, self.out / "made" / self.subject.name)):
                path = found.urdf
            report = check_asset(path)
            start = replace(
                start, lint=report.clauses["lint"], check=report.passed, reasons=report.reasons
            )
            if foreign:
                from mam_pipeline.asset.foreign import foreign_asset

                asset = foreign_asset(path, self.out / "foreign" / self.subject.name)
            else:
                asset = Asset.load(path)
        except (MamSimError, OSError) as error:
            return replace(start, why=folders.as_text(str(error)))
        movable = [(j.name, j.type) for j in asset.card.movable]
        return replace(
            start, folder=str(asset.folder), joints=tuple(movable), draft=asset.card.draft
        )

    def ended(self, ending: Ending) -> Verdict:
        """The verdict after its process has ended."""
        if ending.how == "done" and (found := self.known) is not None:
            return found
        why = "its process ended without a verdict" if ending.how == "done" else ending.why
        found = self._refused(f"{ending.how}: {why}")
        _kept(self.file, asdict(found))
        return found


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
        found = self.known
        if found is None:
            return False
        return bool(found.cause) or not self.video or self.film.is_file()

    @property
    def known(self) -> Row | None:
        """The row, where it was measured; a file that is none is measured again."""
        found: Row | None = _read(Row, self.file)
        mine = self.row()
        own = [f.name for f in fields(Row)][:5]  # what was tried, and how often
        if found is None or any(getattr(found, k) != getattr(mine, k) for k in own):
            return None
        return found

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
        from mam_envs.tasks import OtherTaskError

        began = time.perf_counter()
        try:
            row = self._measured()
        except PlacementError as error:
            row = self.row(cause=error.cause, why=str(error))
        except OtherTaskError as error:
            row = self.row(cause="task", why=str(error))
        except NotPhysicalError as error:
            row = self.row(cause="truth" if self.truth else "asset", why=str(error))
        except MamSimError as error:
            row = self.row(cause="asset", why=str(error))
        _write(self.file, asdict(replace(row, seconds=round(time.perf_counter() - began, 1))))

    def _measured(self) -> Row:
        from mam_envs.tasks import episode_steps
        from mam_policies.evaluate import evaluate_expert, evaluate_run
        from mam_policies.run import EnvChoice, task_settings

        m = self.measure
        choice = EnvChoice(
            (self.verdict.folder,), self.joint, m.task, self.robot, m.control_mode,
            m.max_steps or episode_steps(m.task, robot=self.robot), task_settings(m.task),
        )  # fmt: skip
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
        from mam_pipeline.asset.foreign import true_asset

        asset = Asset.load(self.verdict.folder)
        return true_asset(self.truth.path, asset, self.out / "truth" / self.file.stem).folder

    def ended(self, ending: Ending) -> Row:
        """The row after its process has ended."""
        if ending.how == "done" and (found := self.known) is not None:
            return found
        why = "its process ended without a row" if ending.how == "done" else ending.why
        cause = "crash" if ending.how == "done" else ending.how
        found = self.row(cause=cause, why=why)
        _kept(self.file, asdict(found))
        return found


Tell = Callable[[str], None]


def joints_of_truth(urdf: Path) -> tuple[str, ...]:
    """Names of the joints of a true object that a robot could move; followers of others are none.

    Raises:
        InputError: it is no URDF that can be read, or nothing moves in it.
    """
    from mam_pipeline.formats.urdf.read import read_urdf

    return tuple(j.name for j in read_urdf(robot_file(urdf)).joints if j.coupling is None)


def examine(
    paths: Sequence[Path], out: Path, jobs: int, limits: Limits, tell: Tell = lambda _words: None
) -> list[Verdict]:
    """Verdicts on assets, in the order of the paths; those known already are read."""
    tasks = [Examine(Subject.of(path), out, limits) for path in paths]
    known = {i: found for i, t in enumerate(tasks) if (found := t.known) is not None}
    left = {id(t): i for i, t in enumerate(tasks) if i not in known}
    for task, ending in run_all([tasks[i] for i in left.values()], jobs):
        known[left[id(task)]] = task.ended(ending)
        tell(task.subject.name)
    return [known[i] for i in range(len(tasks))]


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
    known = {i: row for i, t in enumerate(tasks) if t.done and (row := t.known) is not None}
    left = {id(t): i for i, t in enumerate(tasks) if i not in known}
    for task, ending in run_all([tasks[i] for i in left.values()], jobs):
        row = known[left[id(task)]] = task.ended(ending)
        said = row.cause or f"{row.successes}/{row.episodes}"
        tell(f"{row.asset} {row.joint} {row.robot}: {said}")
    return [known[i] for i in range(len(tasks))]


def _read(kind: type[T], file: Path) -> T | None:
    """What an ordinary file holds; None for what is none of its kind, as one that was cut."""
    if file.is_symlink() or not file.is_file():
        return None
    try:
        found: T = validated(kind, read_json(file))
    except InputError:
        return None
    return found


def _kept(file: Path, data: Any) -> None:
    """Write a result down where that can be; it is a row in any case."""
    try:
        _write(file, data)
    except OSError as error:
        if disk_is_full(error):
            raise


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _write(file: Path, data: Any) -> None:
    not_a_link(file.parent).mkdir(parents=True, exist_ok=True)
    folders.write_text(file, json.dumps(data, indent=1, default=str))
