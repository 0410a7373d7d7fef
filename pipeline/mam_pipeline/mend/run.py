"""Mending one file: copy, check, repair by reason, check again; nothing is done without a line."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.foreign import foreign_card
from mam_pipeline.check.check import check_asset
from mam_pipeline.check.lint import Linter
from mam_pipeline.check.profiles import PROFILES, profile_findings
from mam_pipeline.check.report import REASONS, CheckReport
from mam_pipeline.claims import ASSET, MENDED
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import InputError, MamSimError, unknown_name
from mam_pipeline.formats.articulations import KINDS, SUFFIXES, converted
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.formats.mesh_files import files_kept
from mam_pipeline.formats.xml_file import parse_xml
from mam_pipeline.mend.files import bring_along
from mam_pipeline.mend.repairs import LATER, REPAIRS
from mam_pipeline.mend.work import Change, Work


@dataclass(frozen=True)
class Mended:
    """What became of one file.

    Attributes:
        source: the file. urdf: its mended copy; "" on a dry run.
        passed: whether the check passes now; before: whether it did.
        reasons_before: why it did not. left: findings that are left, in words.
        changes: in the order in which they were made.
        fault: why it cannot be mended at all, in a sentence.
        asset: whether the folder of the copy is an asset that other commands take.
    """

    source: str
    urdf: str
    before: bool
    passed: bool
    reasons_before: tuple[str, ...]
    left: tuple[str, ...]
    changes: tuple[Change, ...]
    fault: str = ""
    asset: bool = False

    @staticmethod
    def refused(source: Path, fault: str) -> Mended:
        """Of a file that cannot be read."""
        return Mended(folders.as_text(str(source)), "", False, False, (), (), (), fault)

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Order:
    """What is asked for.

    Attributes:
        only: reasons that are mended; empty for all that an object suffers from.
        profile: a simulator that is to take it, too. drive: also run the simulator.
        allow_outside: let the file name others outside its folder; they are copied.
        rounds: passes over the table before the parts are moved: one repair may bring out another
            reason.
    """

    only: Collection[str] = ()
    profile: str | None = None
    drive: bool = True
    allow_outside: bool = False
    rounds: int = 4

    def check(self) -> None:
        """Refuse what cannot be.

        Raises:
            ConfigError: a reason that nothing mends, or no such profile.
        """
        for reason in self.only:
            if reason not in REPAIRS:
                raise unknown_name("reason that is mended", reason, REPAIRS)
        if self.profile is not None and self.profile not in PROFILES:
            raise unknown_name("profile", self.profile, PROFILES)


def mend(source: Path, out: Path | None, order: Order | None = None) -> Mended:
    """Mend a URDF, an MJCF or a USD file into the folder `out`, which is replaced.

    None writes nothing.

    Raises:
        InputError: no such file, or none that can be read at all.
        ConfigError: the order cannot be.
    """
    order = order or Order()
    order.check()
    if not source.is_file():
        raise InputError(f"no file at {source}; name {KINDS}")
    if source.suffix.lower() not in SUFFIXES:
        raise InputError(f"{source} is not {KINDS} ({', '.join(SUFFIXES)})")
    place: AbstractContextManager[Any] = (
        folders.Scratch() if out is None else folders.new_folder(out)
    )
    with outside_allowed(order.allow_outside), files_kept(), place as folder:
        found, report = _mended(source, Path(folder), order)
        made = Path(folder) / found.urdf
        found = replace(found, urdf="" if out is None else str(out / made.name))
        if out is not None:
            found = replace(found, asset=_with_card(made, out.name, source, report))
            text = json.dumps(found.as_dict(), indent=1) + "\n"
            (Path(folder) / MENDED.file).write_text(text, encoding="utf-8")
    return found


def _with_card(urdf: Path, name: str, source: Path, report: CheckReport) -> bool:
    """Make the folder of a mended file an asset by its card, where a part of it moves."""
    said = {"path": folders.as_text(source.name), "sha256": file_digest(source), "kind": "urdf"}
    checks = {"executability": report.for_card()}
    try:
        foreign_card(urdf, name=name, source=said, checks=checks).save(urdf.parent)
        Asset.load(urdf.parent)
    except MamSimError:  # what is left says why
        (urdf.parent / ASSET.file).unlink(missing_ok=True)
        return False
    return True


def _mended(source: Path, folder: Path, order: Order) -> tuple[Mended, CheckReport]:
    work = _begun(source, folder)
    _look(work, order)
    assert work.report is not None
    first = work.report
    for _ in range(order.rounds):
        count = len(work.changes)
        for reason in _standing(work, order):
            repair = REPAIRS[reason]
            if not repair.moving:
                repair.work(work, reason)
        if len(work.changes) == count:
            break
        _look(work, order, moving=False)
    if work.changes:
        _look(work, order)
    tried: set[Callable[[Work, str], None]] = set()
    for reason, repair in REPAIRS.items():
        if repair.moving and repair.work not in tried and reason in _standing(work, order):
            tried.add(repair.work)
            _kept_if_better(work, repair.work, reason, order)
    for reasons, step in LATER:
        left = [r for r in reasons if r in _standing(work, order)]
        if left:
            _kept_if_better(work, step, left[0], order)
    work.finish()
    words = [f"{f.code}: {f.where}: {f.message}" for f in work.report.findings if not f.warning]
    words += [
        f"{code}: {j.name}: {REASONS[code]}" for j in work.report.joints for code in j.reasons
    ]
    found = Mended(str(source), work.urdf.name, _passes(first), _passes(work.report),
                   first.reasons, tuple(words), tuple(work.changes))  # fmt: skip
    return found, work.report


def _begun(source: Path, folder: Path) -> Work:
    """The copy, with what it names."""
    found = converted(source, folder)
    if found is not None:
        work = Work(found.urdf, found.urdf)
        why = f"{found.how}: the same bodies, joints, shapes and masses"
        why += f"; not taken over: {', '.join(found.left)}" if found.left else ""
        change = Change("file_format", source.name, found.kind, found.urdf.name, why)
        work.changes.append(change)
        return work
    if parse_xml(source).tag != "robot":
        raise InputError(f"{source} is neither a URDF nor an MJCF: see its root element")
    work = Work(source, folder / f"{source.stem}.urdf")
    bring_along(work)
    return work


def _look(work: Work, order: Order, moving: bool = True) -> None:
    """Check the copy as it is now; `moving`: also what needs its parts to be moved."""
    work.save()
    linter = Linter(work.urdf)
    linter.run()
    if moving:
        report = check_asset(work.urdf, drive=order.drive)
    else:
        report = CheckReport(work.urdf.name, False, {}, (), tuple(linter.findings))
    names = [order.profile] if order.profile is not None else list(PROFILES)
    known = {(f.code, f.where) for f in report.findings}
    odd = {"bad_joint", "not_finite"} & {f.code for f in linter.findings if not f.warning}
    more = [] if odd else [f for n in names for f in profile_findings(linter, n)]
    extra = []
    for finding in more:
        if (finding.code, finding.where) not in known:
            known.add((finding.code, finding.where))
            strict = order.profile is not None and not finding.warning
            extra.append(replace(finding, warning=not strict))
    work.report = replace(report, findings=(*report.findings, *extra))


def _passes(report: CheckReport) -> bool:
    return not report.reasons


def _standing(work: Work, order: Order) -> list[str]:
    """Reasons that hold and are to be mended, in the order of the table."""
    assert work.report is not None
    found = {f.code for f in work.report.findings} | set(work.report.reasons)
    return [
        reason
        for reason, repair in REPAIRS.items()
        if reason in found
        and (reason in order.only if order.only else not repair.asked or order.profile is not None)
    ]


def _kept_if_better(
    work: Work, step: Callable[[Work, str], None], reason: str, order: Order
) -> None:
    """Do a step, and take it back where the check then finds no less than before."""
    state, count, before = work.state(), len(work.changes), _faults(work)
    step(work, reason)
    if len(work.changes) == count:
        return
    _look(work, order)
    if _faults(work) >= before:
        work.restore(state)


def _faults(work: Work) -> int:
    assert work.report is not None
    errors = [f for f in work.report.findings if not f.warning]
    return len(errors) + sum(len(j.reasons) for j in work.report.joints)
