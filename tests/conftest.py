"""Shared by all tests: no network, two tiers by folder, and where the real objects may lie."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ.setdefault("OMP_NUM_THREADS", "2")

ROOT = Path(__file__).resolve().parent.parent
FOLDER_MARKS = {"envs": "sim", "policies": "sim", "conformance": "sim", "training": "slow"}
"""What every test of a folder needs; `make test-fast` leaves `sim` and `slow` out."""


def _folder(path: Path) -> str:
    """The first folder below tests/ on the way to a file."""
    return path.relative_to(ROOT / "tests").parts[0]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what is left out: it imports the simulator or torch."""
    if not collection_path.is_relative_to(ROOT / "tests") or collection_path == ROOT / "tests":
        return None
    mark = FOLDER_MARKS.get(_folder(collection_path))
    return True if mark and f"not {mark}" in config.option.markexpr else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test by its folder, and by the real objects that it asks for."""
    for item in items:
        mark = FOLDER_MARKS.get(_folder(item.path))
        if mark:
            item.add_marker(getattr(pytest.mark, mark))
        if {"bench_dev", "bench_photos"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.bench_data)


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


@pytest.fixture(scope="session", autouse=True)
def _placements(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Places for robots are remembered among the tests of a run, not in the user's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAM_SIM_PLACEMENTS", str(tmp_path_factory.getbasetemp() / "placements"))
        yield
