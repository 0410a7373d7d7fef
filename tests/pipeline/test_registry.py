"""Names that packages of others add: found, loaded, never hiding a built-in one."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline import backends
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.registry import Registry, resolve

COLOURS = Registry("colour", {"red": "math:pi", "broken": "no_such_module:X"})


def test_names_of_other_packages_come_behind_the_built_in_ones(monkeypatch: Any) -> None:
    added = [
        metadata.EntryPoint("blue", "math:e", "mam_sim.colour"),
        metadata.EntryPoint("red", "math:tau", "mam_sim.colour"),
    ]
    asked = []

    def installed(group: str) -> list[metadata.EntryPoint]:
        asked.append(group)
        return added

    monkeypatch.setattr("mam_pipeline.registry.installed", installed)
    assert COLOURS.targets() == {"red": "math:pi", "broken": "no_such_module:X", "blue": "math:e"}
    assert COLOURS.load("red") == pytest.approx(3.14159, abs=1e-5)
    assert COLOURS.load("blue") == pytest.approx(2.71828, abs=1e-5)
    assert set(asked) == {"mam_sim.colour"}


def test_errors_name_the_nearest_and_what_cannot_be_imported() -> None:
    with pytest.raises(ConfigError, match="no colour named 'rad'; did you mean 'red'"):
        COLOURS.load("rad")
    with pytest.raises(BackendError, match="'broken' is registered as no_such_module:X"):
        COLOURS.load("broken")


def test_a_module_that_fails_at_anything_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_colours.py").write_text("raise RuntimeError('no paint\\nis left')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BackendError) as told:
        resolve("broken_colours:Blue", "the colour 'blue'")
    assert str(told.value) == (
        "the colour 'blue' is registered as broken_colours:Blue, which cannot be imported: "
        "no paint is left"
    )


OURS = [
    (package, role, name)
    for package, roles in backends.PACKAGES.items() for role, known in roles.items()
    for name in known
]  # fmt: skip


@pytest.mark.parametrize(("package", "role", "name"), OURS)
def test_our_other_packages_bring_what_the_core_says(
    package: str, role: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Registry(role, {}).load(name).__module__.startswith("mam_sim_")
    monkeypatch.setattr("mam_pipeline.registry.installed", lambda _group: ())
    said = rf"{role} '{name}' comes with .* pip install \./{package}"
    with pytest.raises(ConfigError, match=said):
        backends.check_name(role, name)


def test_auto_does_without_our_other_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mam_pipeline.registry.installed", lambda _group: ())
    assert backends.resolved("segmenter") == "geometric"
    with pytest.raises(BackendError, match=r"no retexturer is available here; run: pip install"):
        backends.resolved("retexturer")
