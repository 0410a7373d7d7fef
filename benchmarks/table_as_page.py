"""Results of `mam-sim bench --out FILE.json` as a Markdown page (docs/benchmark.md).

    python benchmarks/table_as_page.py "TITLE=FILE.json" ... > docs/benchmark.md
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

NAMES = ("miou", "count", "type_error", "axis", "pivot", "executable", "median_seconds")
HEAD = (
    "| | n | mIoU | count | type | axis | pivot | exec | s |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, count: int, values: dict[str, Any]) -> str:
    """One line of the table; what does not apply is left empty."""
    cells = ["" if values.get(n) is None else f"{float(values[n]):.2f}" for n in NAMES]
    return f"| {name} | {count} | {' | '.join(cells)} |"


def section(title: str, data: dict[str, Any]) -> None:
    """Print one result: its rows, and the objects that went wrong."""
    print(f"\n## {title}\n")
    print(HEAD)
    print(row("**total**", data["total"]["objects"], data["total"]))
    for category in sorted(data["categories"], key=lambda c: c["name"]):
        print(row(category["name"], category["objects"], category))
    print("\nBelow 0.5 mIoU, or not executable:\n")
    print("| object | mIoU | parts found / true | why not executable |\n|---|---|---|---|")
    for item in sorted(data["objects"], key=lambda o: (o["scores"] or {}).get("miou", 0)):
        scores = item["scores"] or {}
        if scores.get("miou", 0) >= 0.5 and item["executable"] is not False:
            continue
        found, true = scores.get("predicted_parts"), scores.get("true_parts")
        reasons = ", ".join(item["reasons"]) or item["why"]
        print(f"| {item['id']} | {scores.get('miou', 0):.2f} | {found} / {true} | {reasons} |")


def main() -> None:
    """Print the page."""
    print("# The engine on real objects, as measured\n")
    print("One static mesh per object, names and grouping discarded; metrics as in `metrics.py`.")
    for argument in sys.argv[1:]:
        title, _, file = argument.rpartition("=")
        section(title, json.loads(Path(file).read_text()))


if __name__ == "__main__":
    main()
