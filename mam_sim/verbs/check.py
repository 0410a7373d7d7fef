"""`mam-sim check`: lint and physical executability of an asset or of anybody's URDF."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import tyro

from mam_pipeline.check.report import REASONS, CheckReport, JointReport


def check(
    asset: Annotated[Path, tyro.conf.Positional],
    /,
    json: Path | None = None,
    picture: Path | None = None,
    drive: bool = True,
    quiet: bool = False,
) -> int:
    """Test whether an asset is ready for simulation; exit status 0 passes, 1 fails.

    Args:
        asset: asset folder, or a URDF file (ours or anybody's; nothing outside its folder is read).
        json: also write the whole report to this file ("-" for the screen instead of the table).
        picture: save the worst frame as a PNG here.
        drive: drive the joints in the simulator too (needs no graphics driver).
        quiet: no table, only the exit status.
    """
    from mam_pipeline.check.check import check_asset

    report = check_asset(asset, drive=drive, picture=picture)
    if json is not None:
        text = json_module.dumps(report.as_dict(), indent=1)
        if str(json) == "-":
            print(text)
        else:
            json.parent.mkdir(parents=True, exist_ok=True)
            json.write_text(text + "\n", encoding="utf-8")
            print(f"report: {json}", file=sys.stderr)
    if not quiet and str(json) != "-":
        print_table(report)
    if picture is not None and report.picture is not None:
        print(f"picture: {picture}", file=sys.stderr)
    return 0 if report.passed else 1


def print_table(report: CheckReport) -> None:
    """The verdict, its clauses, a row per joint, and each reason in words; on stdout."""
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    verdict = "[green]passes[/]" if report.passed else "[red]fails[/]"
    console.print(f"{report.path}: {verdict}")
    marks = {True: "[green]ok[/]", False: "[red]no[/]", None: "-"}
    console.print("  ".join(f"{name} {marks[held]}" for name, held in report.clauses.items()))
    if report.joints:
        table = Table(box=None, pad_edge=False)
        for column in ("joint", "range", "reached", "depth", "gap", "hold", "return", "verdict"):
            table.add_column(column)
        for joint in report.joints:
            table.add_row(*_row(joint))
        console.print(table)
    for finding in report.findings:
        kind = "warning" if finding.warning else "error"
        console.print(f"{kind} {finding.code}: {finding.where}: {finding.message}", markup=False)
    for code in report.reasons:
        console.print(f"{code}: {REASONS.get(code, '')}", markup=False)


def _row(joint: JointReport) -> list[str]:
    unit = (lambda v: f"{v * 100:.1f} cm") if joint.type == "prismatic" else _degrees
    bounds = "turns freely" if joint.lower is None or joint.upper is None else (
        f"{unit(joint.lower)} .. {unit(joint.upper)}"
    )  # fmt: skip
    gap = joint.gap if joint.gap is not None else joint.line_gap
    return [
        joint.name,
        bounds,
        _percent(joint.reached),
        _percent(joint.penetration),
        _percent(gap),
        _percent(joint.hold_drift),
        _percent(joint.return_error),
        ", ".join(joint.reasons) or "ok",
    ]


def _degrees(value: float) -> str:
    return f"{value * 57.29578:.0f}°"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value * 100:.1f} %"
