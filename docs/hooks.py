"""What mkdocs fills in while it builds the site: tables of results, and tables made from the code.

A page asks for one by `{{ name }}`; `{{ results: NAME }}` is the table of docs/results/NAME.json.
"""

from __future__ import annotations

import csv
import inspect
import re
import shutil
import sys
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
GALLERY = ROOT / "build" / "gallery"
"""What docs/make_gallery.py makes, where somebody ran it; building the site runs it never."""
sys.path[:0] = [str(ROOT / name) for name in ("benchmarks", "docs", "tests/pipeline")]

import fault_cases  # noqa: E402 - nor are the tests
import generate_reference  # noqa: E402 - docs/ is no package
import results_page  # noqa: E402 - nor is benchmarks/

MARK = re.compile(r"\{\{ (\w+)(?:: (\w+))? \}\}")


def on_config(config: Any) -> Any:
    """Lead to the repository that the package names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    config["repo_url"] = project["urls"]["Repository"]
    config["repo_name"] = project["name"]
    return config


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace every mark on a page.

    Raises:
        KeyError: a mark that nothing here makes.
    """
    return MARK.sub(lambda m: MAKERS[m[1]](*([m[2]] if m[2] else [])), markdown)


def _results(name: str) -> str:
    table = results_page.load(name)
    origins = results_page.origins(table).replace("\n", "\n    ")
    past = [row for row in table["rows"] if results_page.before_rule(table, row)]
    now = [row for row in table["rows"] if row not in past]
    parts = [_figures(table, now)] if now else []
    if past:
        rule = past[0].get("rule", table.get("rule"))["name"]
        rows = results_page.figures(table, past, marked=False).replace("\n", "\n    ")
        parts.append(f'??? warning "Measured {rule}: {len(past)} rows"\n\n    {rows}')
    return "\n\n".join([*parts, f'??? note "How it was measured"\n\n    {origins}']) + "\n"


def _figures(table: dict[str, Any], rows: list[dict[str, Any]]) -> str:
    """Some rows of a table; a mark that all of them have is said once."""
    marks = {results_page.state(table, row).value for row in rows if row["commit"]}
    mark = marks.pop() if len(marks) == 1 else ""
    figures = results_page.figures(table, rows, marked=not mark)
    return f"*All rows: {mark}.*\n\n{figures}" if mark else figures


def _checks() -> str:
    """Every reason, which files of tests/pipeline/fault_cases.py have it, and what mends it."""
    from mam_pipeline.check.report import REASONS
    from mam_pipeline.mend import REPAIRS

    rows = []
    for code, text in REASONS.items():
        files = "<br>".join(f"`{name}`" for name, row in fault_cases.FAIL.items() if row[0] == code)
        repair = REPAIRS.get(code)
        asked = " (with `--only` or `--profile`)" if repair is not None and repair.asked else ""
        done = "" if repair is None else repair.text + asked
        rows.append(f"| `{code}` | {text} | {files} | {done} |")
    return "\n".join(["| reason | rule | fixture | mend |", "|---|---|---|---|", *rows])


def _thresholds() -> str:
    from mam_pipeline.thresholds import Thresholds

    words = _attributes(Thresholds.__doc__ or "")
    rows = [
        f"| `{name}` | {value:g} | {words.get(name, '')} |"
        for name, value in vars(Thresholds()).items()
    ]
    return "\n".join(["| threshold | value | meaning |", "|---|---|---|", *rows])


def _attributes(doc: str) -> dict[str, str]:
    """The sentence of each attribute in a Google-style docstring."""
    body = inspect.cleandoc(doc).partition("Attributes:")[2]
    found = re.findall(r"^([a-z_, ]+): (.+)$", re.sub(r"\n {8,}", " ", body), re.MULTILINE)
    return {name.strip(): text for names, text in found for name in names.split(",")}


def _category_count() -> str:
    from mam_world import CATEGORIES

    return str(len(CATEGORIES))


def _bearings() -> str:
    """Bearings of asset/matter.yaml: who has which, what it asks for, and by what source."""
    from mam_pipeline.asset.matter import bearings

    rows = []
    for one, parts in bearings():
        asks = [f"{one.torque:g} N m"] if one.torque else [f"{one.force:g} N"]
        asks += [f"{100 * one.share:g} % of the weight"] if one.share else []
        low, high = one.spread
        rows.append(
            f"| {one.name} | {', '.join(parts)} | {' + '.join(asks)} | {low:g} | {high:g} "
            f"| {one.source} |"
        )
    head = "| bearing | parts | friction | from, times | to, times | source |"
    return "\n".join([head, "|---|---|---|---|---|---|", *rows])


def _materials() -> str:
    """Materials of asset/matter.yaml."""
    from mam_pipeline.asset.matter import materials

    rows = [
        f"| {m.name} | {m.density:g} | {1e3 * m.wall:g} | {m.friction:g} | {m.restitution:g} "
        f"| {m.source} |"
        for m in materials()
    ]
    head = "| material | kg/m3 | walls, mm | friction | restitution | density by |"
    return "\n".join([head, "|---|---|---|---|---|---|", *rows])


def _gallery() -> str:
    """Where the gallery is, and of how many inputs its objects were made; or how to make it."""
    table = GALLERY / "run" / "manifest.csv"
    if not (GALLERY / "gallery.html").is_file():
        return "This build of the site has none: nobody ran the command below before it."
    with table.open(newline="", encoding="utf-8") as stream:
        found = Counter(row["status"] for row in csv.DictReader(stream))
    told = ", ".join(f"{status}: {count}" for status, count in found.most_common())
    link = '<a class="md-button" href="objects/gallery.html">Open the gallery</a>'
    return f"{link}\n\nOf {found.total()} inputs: {told}."


def on_post_build(config: Any, **_: Any) -> None:
    """Put the gallery into the site, where it was made."""
    for page in (GALLERY / "gallery.html", *GALLERY.glob("run/assets/*/view.html")):
        if page.is_file():
            target = Path(config["site_dir"], "gallery", "objects", page.relative_to(GALLERY))
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(page, target)


MAKERS: dict[str, Callable[..., str]] = {
    "gallery": _gallery,
    "results": _results,
    "cli": generate_reference.cli,
    "config": generate_reference.config,
    "checks": _checks,
    "bearings": _bearings,
    "materials": _materials,
    "thresholds": _thresholds,
    "category_count": _category_count,
}
