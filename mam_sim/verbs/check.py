"""`mam-sim check`: lint and physical executability of an asset or of anybody's URDF."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from mam_pipeline import folders
from mam_pipeline.claims import CHECKED, PICTURE, claim_file
from mam_sim.options import Verb

if TYPE_CHECKING:
    from mam_pipeline.check.report import CheckReport, JointReport


@dataclass(frozen=True, kw_only=True)
class Check(Verb):
    """Test whether an asset is ready for simulation; exit status 0 passes, 1 fails."""

    asset: Positional[Path]
    """Asset folder, or a URDF file (ours or anybody's; nothing outside its folder is read). With
    --profile also an MJCF or a USD file."""
    allow_outside: bool = False
    """Let a URDF of your own name files outside its folder."""
    out: Path | None = None
    """JSON file for the whole report."""
    json: bool = False
    """Print the whole report as JSON instead of the table."""
    picture: Path | None = None
    """Save the worst frame as a PNG here."""
    drive: bool = True
    """Drive the joints in the simulator too (needs no graphics driver)."""
    profile: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Say instead what a simulator would refuse or ignore of the file: sapien, mujoco, pybullet,
    isaac, newton, gazebo, drake (in strict mode) or physx-gpu; nothing is driven."""

    def run(self) -> int:
        """Check, and print or write the report."""
        from mam_pipeline.check.check import check_asset, check_profile

        claim_file(self.out, CHECKED)
        claim_file(self.picture, PICTURE, flag="--picture")
        if self.profile is not None:
            report = check_profile(self.asset, self.profile, allow_outside=self.allow_outside)
        else:
            report = check_asset(
                self.asset, drive=self.drive, picture=self.picture,
                allow_outside=self.allow_outside,
            )  # fmt: skip
        text = json.dumps(report.as_dict(), indent=1)
        if self.out is not None:
            self.out.parent.mkdir(parents=True, exist_ok=True)
            folders.write_text(self.out, text + "\n")
            print(f"report: {self.out}", file=sys.stderr)
        if self.json:
            print(text)
        elif not self.quiet:
            print_table(report)
        if self.picture is not None and report.picture is not None:
            print(f"picture: {self.picture}", file=sys.stderr)
        if not self.quiet and (words := self._next(report.passed)):
            print(f"next: mam-sim {shlex.join(words)}", file=sys.stderr)
        return 0 if report.passed else 1

    def _next(self, passed: bool) -> list[str]:
        """What to type now: an asset of ours is put right by hand, another file is mended."""
        ours = (self.asset / "asset.json").is_file()
        if not passed:
            profile = [] if self.profile is None else ["--profile", self.profile]
            out = ["--out", f"{self.asset.stem}-mended"]
            if ours and self.profile is None:
                return ["studio", str(self.asset)]
            return [] if ours else ["mend", str(self.asset), *out, *profile]
        if self.profile is not None:
            return []
        return ["view" if ours else "make-env", str(self.asset)]


def print_table(report: CheckReport) -> None:
    """The verdict, its clauses, a row per joint, and each reason in words; on stdout."""
    from rich.console import Console
    from rich.table import Table

    from mam_pipeline.check.report import REASONS

    console = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    verdict = "[green]passes[/]" if report.passed else "[red]fails[/]"
    console.print(f"{report.path}: {verdict}")
    marks = {True: "[green]ok[/]", False: "[red]no[/]", None: "-"}
    console.print("  ".join(f"{name} {marks[held]}" for name, held in report.clauses.items()))
    if report.joints:
        table = Table(box=None, pad_edge=False)
        for column in (
            "joint", "range", "reached", "depth", "gap", "hold", "return", "force", "tilt",
            "verdict",
        ):  # fmt: skip
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
        _starts(joint),
        "-" if joint.tilt_half is None else f"{joint.tilt_half:.0f}°",
        ", ".join(joint.reasons) or "ok",
    ]


def _starts(joint: JointReport) -> str:
    """The force or torque that starts a joint."""
    unit = "N" if joint.type == "prismatic" else "N m"
    return "-" if joint.breakaway is None else f"{joint.breakaway:.2g} {unit}"


def _degrees(value: float) -> str:
    return f"{value * 57.29578:.0f}°"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value * 100:.1f} %"
