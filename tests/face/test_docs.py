"""The pages keep to the code: commands parse, the README's table is that of docs/results."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mam_pipeline.errors import InputError
from mam_sim.cli import VERBS, verb_class
from mam_sim.options import parse

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import results_page  # noqa: E402 - benchmarks/ is no package

PAGES = sorted(
    page
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md"))
    if not {"lab-notebook", "extend"} & set(page.parts)  # closed; names of the example plug-in
)


def commands(page: Path) -> list[str]:
    """What a page tells the reader to type that begins with mam-sim, comments left out."""
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = re.sub(r"\\\n", " ", "\n".join(blocks)).splitlines()
    return [line.strip() for line in lines if line.strip().startswith("mam-sim ")]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_command_on_a_page_parses(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    for line in commands(page):
        _, verb, *args = shlex.split(line, comments=True)
        assert verb in VERBS, line
        try:
            parse(verb_class(verb), f"mam-sim {verb}", args)
        except InputError:  # the run or asset that the reader has made by then
            continue
        except SystemExit:
            pytest.fail(f"{line}\n{capsys.readouterr().err}")


def test_the_pages_have_commands() -> None:
    assert sum(len(commands(page)) for page in PAGES) > 40


def test_the_readme_is_short_and_has_the_present_table() -> None:
    text = results_page.README.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 110
    assert "make test" in text
    assert results_page.readme(text) == text
    assert results_page.readme(text.replace("| 37 real objects |", "| 38 |")) == text


@pytest.mark.slow
def test_the_notebook_runs(tmp_path: Path) -> None:
    cells = json.loads((ROOT / "examples" / "first_environment.ipynb").read_text())["cells"]
    code = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")
    shutil.copy(ROOT / "examples" / "nightstand.jpg", tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert "passes" in done.stdout and "opened" in done.stdout
