"""The result tables of the site and of the README, made from docs/results/*.json.

    python benchmarks/results_page.py                    # write the README's table again
    python benchmarks/results_page.py --check            # exit 1 where the README's table is old
    python benchmarks/results_page.py --engine authored=A.json seeds=A.json,B.json,C.json

With --engine, rows of docs/results/engine.json take the figures of files that `mam-sim bench --out`
wrote; several files with commas between them give their mean. The row then names the commit of the
working tree and the machine. The site's pages are made from the same files when it is built
(docs/hooks.py).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
README = ROOT / "README.md"
BLOCK = re.compile(r"(<!-- results: (\w+) -->\n).*?(<!-- end of results -->)", re.DOTALL)
FIELDS = {  # column of engine.json: name in the file of `mam-sim bench`
    "mIoU": "miou",
    "count": "count",
    "type error": "type_error",
    "axis (rad)": "axis",
    "pivot": "pivot",
    "executable": "executable",
    "s": "median_seconds",
}


def load(name: str) -> dict[str, Any]:
    """One table: title, columns (name: format) and rows with values, command, commit, machine."""
    table: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    return table


def figures(table: dict[str, Any], rows: Sequence[dict[str, Any]] | None = None) -> str:
    """The figures of a table as Markdown."""
    columns: dict[str, str] = table["columns"]
    lines = ["| | " + " | ".join(columns) + " |", "|---" + "|---" * len(columns) + "|"]
    for row in table["rows"] if rows is None else rows:
        cells = [_cell(row["values"].get(name), form) for name, form in columns.items()]
        lines.append("| " + " | ".join([row["name"], *cells]) + " |")
    return "\n".join(lines)


def origins(table: dict[str, Any]) -> str:
    """Where each row comes from, as a Markdown table."""
    lines = ["| row | command | commit | machine |", "|---|---|---|---|"]
    for row in table["rows"]:
        commit = f"`{row['commit']}`" if row["commit"] else "–"
        lines.append(f"| {row['name']} | `{row['command']}` | {commit} | {row['machine']} |")
    return "\n".join(lines)


def readme(text: str) -> str:
    """The README with its tables written again: the rows that are marked `readme`."""

    def block(match: re.Match[str]) -> str:
        table = load(match[2])
        rows = [row for row in table["rows"] if row.get("readme")]
        return f"{match[1]}{figures(table, rows)}\n{match[3]}"

    return BLOCK.sub(block, text)


def take_engine(given: Sequence[str], commit: str, machine: str) -> None:
    """Put the means of bench files into rows of engine.json."""
    table = load("engine")
    rows = {row["id"]: row for row in table["rows"]}
    for item in given:
        name, _, files = item.partition("=")
        if name not in rows or not files:
            raise SystemExit(f"--engine {item}: want ROW=FILE.json; rows: {', '.join(rows)}")
        totals = [json.loads(Path(f).read_text())["total"] for f in files.split(",")]
        for column, field in FIELDS.items():
            known = [t[field] for t in totals if t.get(field) is not None]
            rows[name]["values"][column] = round(sum(known) / len(known), 4) if known else None
        rows[name] |= {"commit": commit, "machine": machine}
    text = json.dumps(table, indent=1, ensure_ascii=False) + "\n"
    (RESULTS / "engine.json").write_text(text, encoding="utf-8")


def main() -> int:
    """Refresh rows where asked, then write or check the README."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", nargs="+", default=(), metavar="ROW=FILE.json")
    parser.add_argument("--commit", help="default: that of the working tree")
    parser.add_argument("--machine", default=f"{os.cpu_count()} cores, no GPU")
    parser.add_argument("--check", action="store_true")
    args = parser.parse_args()
    if args.engine:
        take_engine(args.engine, args.commit or _head(), args.machine)
    old = README.read_text(encoding="utf-8")
    new = readme(old)
    if args.check:
        if new != old:
            print("README.md has an old table: python benchmarks/results_page.py")
        return int(new != old)
    README.write_text(new, encoding="utf-8")
    return 0


def _cell(value: Any, form: str) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    return f"{value:{form}}".replace("%", " %")


def _head() -> str:
    command = ["git", "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


if __name__ == "__main__":
    raise SystemExit(main())
