"""What pages show is what their commands print."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import run_pages  # noqa: E402 - docs/ is no package

PAGE = """
```sh
echo "door  0 to 0.261 m   confidence 0.98"; echo more; echo passes
```

It prints:

```text
door  0 to 0.26 m   confidence 0.98
passes
```
"""


def test_shown_lines_may_leave_some_out_and_round(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    text, wrong = run_pages.check_page(page, tmp_path)
    assert wrong == [] and text == PAGE.replace("0.26 m", "0.261 m")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("0.98\npasses", "0.73\npasses", "printed is 'door  0 to 0.261 m   confidence 0.98'"),
        ("\npasses\n", "\nfails\n", "shows 'fails', which is not printed"),
        ("echo more", "exit 3", "failed"),
    ],
)
def test_what_differs_is_a_sentence(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE.replace(old, new))
    _, wrong = run_pages.check_page(page, tmp_path)
    assert len(wrong) == 1 and sentence in wrong[0]


def test_an_edit_is_done_and_what_stood_there_is_compared(tmp_path: Path) -> None:
    (tmp_path / "joints.yaml").write_text("- {name: door, lower: 0.0, upper: 0.2612}\n")
    page = tmp_path / "page.md"
    row = "- name: door\n  ...\n  lower: 0.0\n  upper: 0.15   # was {}\n"
    for old, count in (("0.2612", 0), ("0.4", 1)):
        (tmp_path / "joints.yaml").write_text("- {name: door, lower: 0.0, upper: 0.2612}\n")
        page.write_text(f'```yaml title="joints.yaml"\n{row.format(old)}```\n')
        _, wrong = run_pages.check_page(page, tmp_path)
        assert len(wrong) == count
        assert "upper: 0.15\n" in (tmp_path / "joints.yaml").read_text()


@pytest.mark.slow
@pytest.mark.sim
def test_the_pages_show_what_is_printed() -> None:
    command = [sys.executable, str(ROOT / "docs" / "run_pages.py")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
