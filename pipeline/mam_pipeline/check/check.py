"""The public test of physical executability: lint, offline sweep, and driving in SAPIEN."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from mam_pipeline.asset.card import Asset, AssetCard
from mam_pipeline.asset.dynamics import catch_pull, rubbing
from mam_pipeline.check.lint import Linter, lint
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.other_files import file_findings, format_of
from mam_pipeline.check.profiles import profile_findings
from mam_pipeline.check.report import CLAUSES, CheckReport, Finding, JointReport
from mam_pipeline.check.sweep import JointSweep, exchanged, sweep_joint
from mam_pipeline.claims import instead
from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.optional import has, install_command
from mam_pipeline.thresholds import MAX_SWEEP, THRESHOLDS, Thresholds
from mam_pipeline.types import Joint, coupled

NOT_DRIVEN = f"SAPIEN is not installed, so no joint was driven: {install_command('sapien')}"
_CLAUSE_OF = {
    "penetration": "penetration",
    "cavity_filled": "penetration",
    "detached": "contact",
    "off_axis": "contact",
    "askew": "contact",
    "exchanged": "contact",
    "frozen": "reach",
    "drift": "base",
    "exploded": "stable",
    "sags": "hold",
    "no_return": "return",
    "load_failed": "loads",
    "not_finished": "reach",
}


def check_asset(
    path: str | Path,
    *,
    drive: bool = True,
    picture: Path | None = None,
    thresholds: Thresholds = THRESHOLDS,
    allow_outside: bool = False,
    only: Collection[str] = (),
) -> CheckReport:
    """Check an asset folder or any URDF; its work is bounded by the sizes that the lint allows.

    Args:
        path: asset folder, asset.json or URDF.
        drive: also run the simulator; a warning says so where SAPIEN is not installed.
        picture: where to save the worst frame as PNG, None for no picture.
        thresholds: what counts as a failure.
        allow_outside: let the URDF name files outside its folder.
        only: names of the joints that are moved; all, where none is named.

    Raises:
        InputError: there is nothing to check at `path`.
    """
    target = _locate(Path(path))
    with outside_allowed(allow_outside):
        return _run(str(path), target, drive, picture, thresholds, only)


def check_profile(path: str | Path, profile: str, *, allow_outside: bool = False) -> CheckReport:
    """What one simulator would refuse or ignore of an asset, a URDF, an MJCF or a USD file.

    Nothing is driven.

    Args:
        path: as for `check_asset`.
        profile: a name of `mam_pipeline.check.profiles.PROFILES`.
        allow_outside: let the URDF name files outside its folder.

    Raises:
        InputError: there is nothing to check at `path`.
        ConfigError: no such profile.
    """
    with outside_allowed(allow_outside):
        if Path(path).is_file() and format_of(Path(path)) is not None:
            findings = file_findings(Path(path), profile)
            clauses: dict[str, bool | None] = dict.fromkeys(CLAUSES)
            clauses["lint"] = passed = not any(not f.warning for f in findings)
            return CheckReport(str(path), passed, clauses, (), tuple(findings))
        return _profile(str(path), _locate(Path(path)), profile)


def _profile(path: str, target: _Target, profile: str) -> CheckReport:
    linter = Linter(target.urdf)
    linter.run()
    findings = linter.findings + profile_findings(linter, profile)
    clauses: dict[str, bool | None] = dict.fromkeys(CLAUSES)
    clauses["lint"] = not any(not f.warning for f in findings)
    return CheckReport(path, bool(clauses["lint"]), clauses, (), tuple(findings))


@dataclass(frozen=True)
class _Target:
    """A URDF, its card where there is one, and what that knows of its joints: (friction, damping),
    closed and open values, by how much their catches pull at a value, and which springs carry."""

    urdf: Path
    card: AssetCard | None = None
    friction: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    closed: Mapping[str, float] = field(default_factory=dict)
    open: Mapping[str, float] = field(default_factory=dict)
    catches: Mapping[str, Callable[[float], float]] = field(default_factory=dict)
    balanced: Collection[str] = ()


def _run(
    path: str, target: _Target, drive: bool, picture: Path | None, thresholds: Thresholds,
    only: Collection[str],
) -> CheckReport:  # fmt: skip
    urdf, seconds = target.urdf, dict[str, float]()
    clauses: dict[str, bool | None] = dict.fromkeys(CLAUSES)
    began = time.perf_counter()
    findings = lint(urdf, target.card)
    seconds["lint"] = _since(began)
    clauses["lint"] = not any(not f.warning for f in findings)
    if not clauses["lint"]:
        return CheckReport(path, False, clauses, (), tuple(findings), seconds)
    try:
        model = CheckModel.read(urdf)
    except MamSimError as error:
        findings.append(Finding("no_surface", urdf.name, str(error)))
        clauses["lint"] = False
        return CheckReport(path, False, clauses, (), tuple(findings), seconds)
    articulation = model.articulation
    work = len(articulation.mesh.faces) * len(articulation.joints)
    if work > MAX_SWEEP:
        text = f"{work} faces times joints, and a check sweeps {MAX_SWEEP}; simplify its meshes"
        findings.append(Finding("too_large", urdf.name, text))
        clauses["lint"] = False
        return CheckReport(path, False, clauses, (), tuple(findings), seconds)
    findings += _collision_off(model, thresholds)
    clauses["lint"] = not any(not f.warning for f in findings)
    began = time.perf_counter()
    joints, poses = _sweep(model, target, thresholds, only)
    seconds["sweep"] = _since(began)
    for joint in joints:
        if joint.apart > thresholds.apart_share:
            text = f"rests {joint.apart:.0%} of the object's diagonal from all that could hold it"
            findings.append(Finding("mid_air", joint.name, text, warning=True))
    if drive and not has("sapien"):
        drive = False
        findings.append(Finding("not_driven", urdf.name, NOT_DRIVEN, warning=True))
    if drive:
        began = time.perf_counter()
        joints, more = _drive(model, target, joints, poses, thresholds)
        findings += more
        seconds["drive"] = _since(began)
    report = _verdict(path, clauses, joints, findings, seconds, drive)
    if picture is not None:
        from mam_pipeline.check.picture import save_worst_frame

        save_worst_frame(model.articulation, report, picture)
        report = replace(report, picture=str(picture))
    return report


def _collision_off(model: CheckModel, limit: Thresholds) -> list[Finding]:
    """A finding per body that collides far outside the box of its surface: an unseen obstacle."""
    mesh, findings = model.articulation.mesh, list[Finding]()
    for link, hulls in zip(model.articulation.links, model.hulls):
        if not hulls or not len(link.faces):
            continue
        low, high = mesh.submesh(link.faces).bounds
        points = np.concatenate([h.points for h in hulls])
        beyond = float(max((low - points).max(), (points - high).max()))
        if beyond > limit.collision_reach * mesh.diagonal:
            text = f"its collision pieces reach {beyond:.3g} m beyond what is seen of it"
            findings.append(Finding("collision_off", link.name, text))
    return findings


def _locate(path: Path) -> _Target:
    """The URDF behind a path, and what its card says where there is one."""
    if not path.exists():
        raise InputError(f"no asset or URDF at {path}")
    if path.is_file() and (kind := format_of(path)) is not None:
        raise InputError(
            f"{path} is {kind}: joints of URDF files alone are driven; add --profile NAME"
        )
    if path.is_file() and path.suffix.lower() in (".urdf", ".xml"):
        card = path.parent / "asset.json"
        if not card.is_file():
            return _Target(path)
        asset = Asset.card_of(path.parent)
        if asset.urdf_path.resolve() != path.resolve():
            return _Target(path)
    elif path.is_dir() and not (path / "asset.json").is_file():
        found = sorted(path.glob("*.urdf"))
        if len(found) != 1:
            what = f"no asset.json and {len(found)} URDF files"
            raise InputError(f"{path} holds {what}{instead(path)}; name one")
        return _Target(found[0])
    else:
        asset = Asset.card_of(path)
    joints = asset.card.joints
    return _Target(
        asset.urdf_path,
        asset.card,
        {j.name: (rubbing(j)[0], j.damping) for j in joints},
        {j.name: j.closed for j in joints},
        {j.name: j.open for j in joints},
        {j.name: partial(catch_pull, j) for j in joints if j.catch is not None},
        [j.name for j in joints if j.balance is not None],
    )


def _sweep(
    model: CheckModel, target: _Target, limit: Thresholds, only: Collection[str]
) -> tuple[list[JointReport], dict[str, dict[str, float]]]:
    """Reports of all joints, and the pose in which each was tested.

    Other joints are closed. Where one of them is in the way (a door before a drawer), the joint is
    tested with its neighbours open, as it would be used, and the report says so.
    """
    joints = [j for j in model.articulation.joints if j.type != "fixed"]
    follow = {j.name: j.coupling for j in joints}
    closed = {j.name: target.closed.get(j.name, _nearest_to_zero(j)) for j in joints}
    closed = coupled({n: v for n, v in closed.items() if follow[n] is None}, follow)
    out, poses = [], {}
    for joint in joints:
        if only and joint.name not in only:
            continue
        pose = {**closed, joint.name: 0.0}
        found, pose, after = _tested(model, target, joint, pose, limit)
        poses[joint.name] = coupled({**pose, joint.name: closed[joint.name]}, follow)
        report = _report(joint, found, after, limit)
        if exchanged(model, joint, limit):
            report = replace(report, reasons=("exchanged", *report.reasons))
        out.append(report)
    return out, poses


def _tested(
    model: CheckModel, target: _Target, joint: Joint, pose: dict[str, float], limit: Thresholds
) -> tuple[JointSweep, dict[str, float], tuple[str, ...]]:
    """The sweep of a joint, in which pose of the others, and which of them had to be opened.

    Only those in the way are opened: doors that are all open may run into each other.
    """
    first = found = _sweep_at(model, joint, pose, limit)
    neighbours, opened = _neighbours(model, joint), dict(pose)
    moved: list[str] = []
    while found.penetration > limit.penetration_share:
        blocking = [
            j for j in neighbours
            if j.name not in moved
            and found.blocking.intersection(model.articulation.carried_links(j))
        ]  # fmt: skip
        if not blocking:
            return first, pose, ()
        moved += [j.name for j in blocking]
        opened |= {j.name: target.open.get(j.name, _far(j)) for j in blocking}
        found = _sweep_at(model, joint, opened, limit)
    return found, opened, tuple(moved)


def _sweep_at(
    model: CheckModel, joint: Joint, pose: Mapping[str, float], limit: Thresholds
) -> JointSweep:
    there = model.at(pose)
    same = next(j for j in there.articulation.joints if j.name == joint.name)
    return sweep_joint(there, same, limit)


def _neighbours(model: CheckModel, joint: Joint) -> list[Joint]:
    """Joints that move neither the part nor anything on it."""
    articulation = model.articulation
    carried = articulation.carried_links(joint)
    return [
        j
        for j in articulation.joints
        if j.type != "fixed"
        and j.child not in carried
        and joint.child not in articulation.carried_links(j)
    ]


def _nearest_to_zero(joint: Joint) -> float:
    return float(np.clip(0.0, joint.lower, joint.upper))


def _far(joint: Joint) -> float:
    """The end of the range that is farther from rest; rest where there is no end."""
    end = joint.upper if abs(joint.upper) >= abs(joint.lower) else joint.lower
    return float(end) if np.isfinite(end) else 0.0


def _report(joint: Joint, s: JointSweep, after: tuple[str, ...], limit: Thresholds) -> JointReport:
    reasons = []
    if s.penetration > limit.penetration_share:
        reasons.append("penetration")
    if s.filled > limit.filled_area:
        reasons.append("cavity_filled")
    if s.gap is not None and s.gap > limit.gap_share:
        reasons.append("detached")
    if s.askew > limit.askew_angle:
        reasons.append("askew")
    if s.line_gap is not None and s.line_gap > limit.gap_share:
        reasons.append("off_axis")
    return JointReport(
        joint.name,
        joint.type,
        _finite(joint.lower),
        _finite(joint.upper),
        penetration=s.penetration,
        penetration_at=s.penetration_at,
        gap=s.gap,
        line_gap=s.line_gap,
        askew=s.askew,
        filled=s.filled,
        apart=_finite(s.apart) or 0.0,
        after=after,
        reasons=tuple(reasons),
    )


def _drive(
    model: CheckModel,
    target: _Target,
    joints: list[JointReport],
    poses: Mapping[str, Mapping[str, float]],
    limit: Thresholds,
) -> tuple[list[JointReport], list[Finding]]:
    from mam_pipeline.check.drive import drive_urdf

    urdf = target.urdf
    follow = {j.name: j.coupling for j in model.articulation.joints if j.coupling is not None}
    friction = target.friction or model.friction
    result = drive_urdf(
        urdf, friction, limit, poses=poses, couplings=follow, catches=target.catches,
        balanced=target.balanced,
    )  # fmt: skip
    if result.failure:
        return joints, [Finding("load_failed", urdf.name, result.failure)]
    findings = []
    if result.exploded:
        findings.append(Finding("exploded", "robot", "a velocity grew without bound"))
    if result.unfinished:
        text = f"only {len(result.joints)} of {len(joints)} joints were driven: it has too many"
        findings.append(Finding("not_finished", "robot", text))
    if result.base_drift > limit.base_drift:
        text = f"the base moved {result.base_drift * 1e3:.1f} mm"
        findings.append(Finding("drift", "robot", text))
    out = []
    for report in joints:
        d = result.joints.get(report.name)
        if d is None:
            out.append(report)
            continue
        reasons = list(report.reasons)
        if d.reached < limit.reach_share:
            reasons.append("frozen")
        if d.hold_drift > limit.hold_share:
            reasons.append("sags")
        if d.return_error > limit.return_share:
            reasons.append("no_return")
        out.append(
            replace(
                report,
                reached=d.reached,
                return_error=d.return_error,
                hold_drift=d.hold_drift,
                top_speed=d.top_speed,
                **({} if d.handling is None else vars(d.handling)),
                reasons=tuple(reasons),
            )
        )
    return out, findings


def _verdict(
    path: str,
    clauses: dict[str, bool | None],
    joints: list[JointReport],
    findings: list[Finding],
    seconds: dict[str, float],
    drive: bool,
) -> CheckReport:
    report = CheckReport(path, False, clauses, tuple(joints), tuple(findings), seconds)
    for name in ("penetration", "contact"):
        clauses[name] = True
    if drive:
        for name in ("loads", "base", "reach", "stable", "hold", "return"):
            clauses[name] = True
    for code in report.reasons:
        clauses[_CLAUSE_OF.get(code, "lint")] = False
    return replace(report, clauses=clauses, passed=not report.reasons)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _since(start: float) -> float:
    return round(time.perf_counter() - start, 3)
