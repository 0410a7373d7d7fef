"""mam-sim doctor: who is asked where a backend is auto, and how much disk each part takes."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from mam_sim.cli import main
from mam_sim.installed_size import closure, parts
from tests.conftest import Answer

REQUIRES = {
    "mam-sim": ["numpy>=2", "torch>=2; extra == 'sim'", "mam-sim[sim]; extra == 'rl'",
                "sb3[plots]; extra == 'rl'"],
    "torch": ["numpy", "nvidia-cublas-cu12; platform_system == 'Linux'", "tests; extra == 'dev'"],
    "sb3": ["torch", "matplotlib; extra == 'plots'"],
    "numpy": [],
}  # fmt: skip
SIZES = {"mam-sim": 1, "numpy": 10, "torch": 100, "nvidia-cublas-cu12": 1000, "sb3": 10_000,
         "matplotlib": 100_000, "something-else": 1_000_000}  # fmt: skip


def test_an_extra_brings_what_its_packages_need() -> None:
    assert closure("", REQUIRES) == {"mam-sim", "numpy"}
    assert closure("sim", REQUIRES) == {"mam-sim", "numpy", "torch", "nvidia-cublas-cu12"}
    assert closure("rl", REQUIRES) >= {"torch", "sb3", "matplotlib"}


def test_every_package_counts_once_and_all_are_counted() -> None:
    found = parts(SIZES, REQUIRES)
    assert found == {"core": 11, "sim": 100, "CUDA libraries": 1000, "rl": 110_000,
                     "others": 1_000_000}  # fmt: skip
    assert sum(found.values()) == sum(SIZES.values())


def test_the_reasoner_that_auto_takes_is_the_active_one(
    serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    pytest.importorskip("openai", reason="the vlm extra is not installed")
    monkeypatch.setenv("OPENAI_BASE_URL", serve(lambda *_: (404, "text/plain", b"")))
    for allowed, active in (("0", "embedded"), ("1", "vlm")):
        monkeypatch.setenv("MAM_SIM_ALLOW_MODEL", allowed)
        main(["doctor"])
        assert re.findall(r"reasoner (\w+) +active", capsys.readouterr().out) == [active]
