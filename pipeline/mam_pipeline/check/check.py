"""The public test of physical executability: lint, offline sweep, and driving in SAPIEN."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from mam_pipeline.asset.card import Asset
from mam_pipeline.check.lint import lint
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.report import CLAUSES, CheckReport, Finding, JointReport
from mam_pipeline.check.sweep import sweep_joint
from mam_pipeline.check.thresholds import THRESHOLDS, Thresholds
from mam_pipeline.errors import InputError, MamSimError

_CLAUSE_OF = {
    "penetration": "penetration",
    "cavity_filled": "penetration",
    "detached": "contact",
    "off_axis": "contact",
    "frozen": "reach",
    "drift": "base",
    "exploded": "stable",
    "sags": "hold",
    "no_return": "return",
    "load_failed": "loads",
    "timeout": "reach",
}


def check_asset(
    path: str | Path,
    *,
    drive: bool = True,
    picture: Path | None = None,
    thresholds: Thresholds = THRESHOLDS,
) -> CheckReport:
    """Check an asset folder or any URDF.

    Args:
        path: asset folder, asset.json or URDF; nothing outside its folder is read.
        drive: also run the simulator.
        picture: where to save the worst frame as PNG, None for no picture.
        thresholds: what counts as a failure.

    Raises:
        InputError: there is nothing to check at `path`.
    """
    urdf, card_friction = _locate(Path(path))
    seconds: dict[str, float] = {}
    began = time.perf_counter()
    findings = lint(urdf)
    seconds["lint"] = _since(began)
    clauses: dict[str, bool | None] = dict.fromkeys(CLAUSES)
    clauses["lint"] = not any(not f.warning for f in findings)
    if not clauses["lint"]:
        return CheckReport(str(path), False, clauses, (), tuple(findings), seconds)
    try:
        model = CheckModel.read(urdf)
    except MamSimError as error:
        findings.append(Finding("no_surface", urdf.name, str(error)))
        clauses["lint"] = False
        return CheckReport(str(path), False, clauses, (), tuple(findings), seconds)
    began = time.perf_counter()
    joints = _sweep(model, thresholds)
    seconds["sweep"] = _since(began)
    if drive:
        began = time.perf_counter()
        joints, more = _drive(urdf, model, card_friction, joints, thresholds)
        findings += more
        seconds["drive"] = _since(began)
    report = _verdict(str(path), clauses, joints, findings, seconds, drive)
    if picture is not None:
        from mam_pipeline.check.picture import save_worst_frame

        save_worst_frame(model.articulation, report, picture)
        report = replace(report, picture=str(picture))
    return report


def _locate(path: Path) -> tuple[Path, dict[str, tuple[float, float]]]:
    """The URDF behind a path, and the card's friction where there is a card."""
    if not path.exists():
        raise InputError(f"no asset or URDF at {path}")
    if path.is_file() and path.suffix.lower() in (".urdf", ".xml"):
        card = path.parent / "asset.json"
        if not card.is_file():
            return path, {}
        asset = Asset.load(path.parent)
        if asset.urdf_path.resolve() != path.resolve():
            return path, {}
    elif path.is_dir() and not (path / "asset.json").is_file():
        found = sorted(path.glob("*.urdf"))
        if len(found) != 1:
            raise InputError(f"{path} holds no asset.json and {len(found)} URDF files; name one")
        return found[0], {}
    else:
        asset = Asset.load(path)
    urdf = asset.urdf_path
    if not urdf.resolve().is_relative_to(asset.folder.resolve()):
        raise InputError(f"{path} names a URDF outside its folder: {asset.card.urdf}")
    if not urdf.is_file():
        raise InputError(f"{path} names {asset.card.urdf}, which does not exist")
    return urdf, {j.name: (j.friction, j.damping) for j in asset.card.joints}


def _sweep(model: CheckModel, limit: Thresholds) -> list[JointReport]:
    out = []
    for joint in model.articulation.joints:
        if joint.type == "fixed":
            continue
        s = sweep_joint(model, joint, limit)
        reasons = []
        if s.penetration > limit.penetration_share:
            reasons.append("penetration")
        if s.filled > limit.filled_area:
            reasons.append("cavity_filled")
        if s.gap is not None and s.gap > limit.gap_share:
            reasons.append("detached")
        if s.line_gap is not None and s.line_gap > limit.gap_share:
            reasons.append("off_axis")
        out.append(
            JointReport(
                joint.name,
                joint.type,
                _finite(joint.lower),
                _finite(joint.upper),
                penetration=s.penetration,
                penetration_at=s.penetration_at,
                gap=s.gap,
                line_gap=s.line_gap,
                filled=s.filled,
                reasons=tuple(reasons),
            )
        )
    return out


def _drive(
    urdf: Path,
    model: CheckModel,
    card_friction: dict[str, tuple[float, float]],
    joints: list[JointReport],
    limit: Thresholds,
) -> tuple[list[JointReport], list[Finding]]:
    from mam_pipeline.check.drive import drive_urdf

    result = drive_urdf(urdf, card_friction or model.friction, limit)
    if result.failure:
        return joints, [Finding("load_failed", urdf.name, result.failure)]
    findings = []
    if result.exploded:
        findings.append(Finding("exploded", "robot", "a velocity grew without bound"))
    if result.timed_out:
        findings.append(Finding("timeout", "robot", "driving all joints took too long"))
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
