"""Shared by all tests: no network, one thread, and where the real benchmark objects may lie."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ.setdefault("OMP_NUM_THREADS", "2")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def bench_dev() -> Path:
    """The folder of real articulated objects with ground truth; skips where it is absent."""
    folder = ROOT.parent / "shared" / "bench" / "dev"
    if not folder.is_dir():
        pytest.skip("the real benchmark objects are not on this machine (../shared/bench/dev)")
    return folder


@pytest.fixture(scope="session")
def bench_photos() -> Path:
    """The folder of real photos; skips where it is absent."""
    folder = ROOT.parent / "shared" / "bench" / "photos"
    if not folder.is_dir():
        pytest.skip("the real photos are not on this machine (../shared/bench/photos)")
    return folder
