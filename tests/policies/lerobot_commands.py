"""Stock LeRobot's commands, as an exported README writes them, run in this process."""

from __future__ import annotations

import importlib
import shlex
import sys
from pathlib import Path

import pytest

from mam_policies.lerobot.dataset import same_scheduling


def run_readme(
    monkeypatch: pytest.MonkeyPatch, folder: Path, verb: str, work: Path, *more: str
) -> None:
    """Run the first lerobot-VERB line of folder/README.md in `work`; `more` overrides its words."""
    text = (folder / "README.md").read_text().replace("\\\n", " ")
    line = next(row for row in text.splitlines() if row.startswith(f"lerobot-{verb} "))
    monkeypatch.chdir(work)
    monkeypatch.setattr(sys, "argv", [*shlex.split(line), *more])
    with same_scheduling():  # it records films
        importlib.import_module(f"lerobot.scripts.lerobot_{verb}").main()
