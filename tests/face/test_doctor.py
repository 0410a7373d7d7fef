"""mam-sim doctor: how much disk each part takes."""

from __future__ import annotations

from mam_sim.installed_size import closure, parts

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
