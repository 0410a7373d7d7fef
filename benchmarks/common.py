"""What every script here does with its result: save it as JSON, with what it was measured by."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent


CODE = ("mam_sim", "policies", "envs", "pipeline")
"""Paths of the product: what a figure depends on, unless its script knows better."""


def save(out: Path | None, result: Any, paths: Sequence[str] = CODE) -> None:
    """Write `result` to `out`, with its command, commit, machine and paths; nothing for None."""
    if out is None:
        return
    script = Path(sys.argv[0]).name
    head = {
        "command": " ".join(["python", f"benchmarks/{script}", *sys.argv[1:]]),
        "commit": commit(),
        "machine": machine(),
        "paths": list(paths),
    }
    text = json.dumps({**head, "result": result}, indent=1, default=_plain)
    out.write_text(text + "\n", encoding="utf-8")


def load(out: Path | None) -> Any:
    """The result that an earlier run saved in `out`; None where there is none."""
    if out is None or not out.is_file():
        return None
    return json.loads(out.read_text(encoding="utf-8"))["result"]


def commit() -> str:
    """The working tree's commit, as git describes it."""
    done = subprocess.run(
        ["git", "-C", str(ROOT), "describe", "--always", "--dirty"], capture_output=True, text=True
    )
    return done.stdout.strip() or "unknown"


def machine() -> str:
    """The machine, as a row says it."""
    return f"{platform.machine()}, {os.cpu_count()} cores, Python {sys.version.split()[0]}"


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)
