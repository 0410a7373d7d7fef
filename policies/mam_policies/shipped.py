"""Policies that come with mam-sim: run folders in the package, made by `mam_training.policies`."""

from __future__ import annotations

from pathlib import Path

SHIPPED = Path(__file__).parent / "weights"
"""Run folders that come with mam-sim."""


def run_folder(policy: Path) -> Path:
    """A policy's folder: as it is named, or of the name of one that comes with mam-sim."""
    shipped = SHIPPED / policy
    known = len(policy.parts) == 1 and (shipped / "run.json").is_file()
    return shipped if known and not policy.exists() else policy
