"""The result tables of the site and of the README, made from docs/results/*.json.

    python benchmarks/results_page.py            # write the README's tables again
    python benchmarks/results_page.py --check    # exit 1 where the README is old

A row holds its figures, the command, the commit and the machine that gave them, and, where a model
took part, the weights and what these were trained on. It depends on `paths` of the repository, its
own or those of its table. Where they changed since its commit, the site marks it "older code"; the
README may have no such row, nor one whose commit is unknown. Rows measured before a `rule` of their
table (what counts as a success) stand apart under its name. A row names the commit before the one
that records it: no figure depends on docs/. The site's pages are made from the same files when it
is built (docs/hooks.py); `engine_table.py` measures the rows of the README.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from code_state import ROOT, State, is_ancestor, state_of

RESULTS = ROOT / "docs" / "results"
README = ROOT / "README.md"
BLOCK = re.compile(r"(<!-- results: (\w+) -->\n).*?(<!-- end of results -->)", re.DOTALL)
SEEN = {True: "never saw these", False: "seen in training", None: ""}
"""What the row's models are to its objects, by `models.unseen`."""


def load(name: str) -> dict[str, Any]:
    """One table: title, columns (name: format), paths, and rows with values and their origin."""
    table: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    return table


def put(name: str, rows: Sequence[Mapping[str, Any]], new: Mapping[str, Any] | None = None) -> None:
    """Put rows into a table, in the place of those with the same ids, or below the others.

    Args:
        new: the table without its rows, where there is none yet.
    """
    there = new is None or (RESULTS / f"{name}.json").is_file()
    table = load(name) if there else {**(new or {}), "rows": []}
    kept = {row["id"]: row for row in table["rows"]} | {row["id"]: dict(row) for row in rows}
    text = json.dumps({**table, "rows": list(kept.values())}, indent=1, ensure_ascii=False)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def state(table: Mapping[str, Any], row: Mapping[str, Any]) -> State:
    """Whether a row was measured on the present code; what others printed always was."""
    if row["commit"] is None:
        return State.PRESENT
    return state_of(row["commit"], tuple(row.get("paths", table["paths"])), ROOT)


def before_rule(table: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Whether a row was measured before the rule by which its table judges today."""
    rule = row.get("rule", table.get("rule"))
    if rule is None or row["commit"] is None or state(table, row) is not State.OLDER:
        return False
    return not is_ancestor(rule["since"], row["commit"], ROOT)


def figures(
    table: Mapping[str, Any], rows: Sequence[Mapping[str, Any]] | None = None, marked: bool = True
) -> str:
    """The figures of a table as Markdown.

    Args:
        rows: some of its rows; all, if None. marked: whether rows of other code say so.
    """
    rows = table["rows"] if rows is None else rows
    columns: dict[str, str] = table["columns"]
    seen = any("models" in row for row in rows)
    heads = [*(["models"] if seen else []), *columns]
    lines = ["| | " + " | ".join(heads) + " |", "|---" + "|---" * len(heads) + "|"]
    for row in rows:
        cells = [_cell(row["values"].get(name), form) for name, form in columns.items()]
        if seen:
            cells.insert(0, SEEN[row.get("models", {}).get("unseen")])
        mark = state(table, row).value if marked else ""
        name = f"{row['name']} · *{mark}*" if mark else row["name"]
        lines.append("| " + " | ".join([name, *cells]) + " |")
    return "\n".join(lines)


def origins(table: Mapping[str, Any]) -> str:
    """Where each row comes from, as a Markdown table."""
    lines = ["| row | command | commit | machine | models trained on |", "|---|---|---|---|---|"]
    for row in table["rows"]:
        commit = f"`{row['commit']}`" if row["commit"] else "–"
        mark = state(table, row).value
        cells = [row["name"], f"`{row['command']}`", f"{commit} {mark}".strip(), row["machine"]]
        lines.append("| " + " | ".join([*cells, trained_on(row)]) + " |")
    return "\n".join(lines)


def trained_on(row: Mapping[str, Any]) -> str:
    """The sources of all models of a row; a dash where it records none."""
    sources = row.get("models", {}).get("trained_on", {}).values()
    return ", ".join(sorted({name for some in sources for name in some.split(", ")})) or "–"


def readme(text: str) -> str:
    """The README with its tables written again: the rows that are marked `readme`."""

    def block(match: re.Match[str]) -> str:
        table = load(match[2])
        return f"{match[1]}{figures(table, readme_rows(table), marked=False)}\n{match[3]}"

    return BLOCK.sub(block, text)


def write_readme() -> None:
    """Write the README's tables again."""
    text = README.read_text(encoding="utf-8")
    README.write_text(readme(text), encoding="utf-8")


def readme_rows(table: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The rows of a table that the README shows."""
    return [row for row in table["rows"] if row.get("readme")]


def faults(text: str) -> Iterator[tuple[bool, str]]:
    """What is wrong with the README's tables: whether it is an error, and a sentence."""
    again = "python benchmarks/engine_table.py"
    if readme(text) != text:
        yield True, "README.md has an old table: python benchmarks/results_page.py"
    for match in BLOCK.finditer(text):
        table = load(match[2])
        for row in readme_rows(table):
            found, name = state(table, row), f"README.md, row {row['name']!r}"
            commit = row["commit"]
            if row["command"].startswith("python"):
                again = row["command"]
            if found is State.OLDER:
                yield True, f"{name}: its code changed since {commit}; measure it: {again}"
            elif found is State.UNKNOWN:
                yield (
                    True,
                    f"{name}: this history has no commit {commit}; measure it: {again}",
                )
            elif found is State.UNTOLD:
                yield False, f"{name}: not compared, this clone lacks commit {commit}"


def main() -> int:
    """Write or check the README."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true")
    args = parser.parse_args()
    if not args.check:
        write_readme()
        return 0
    found = list(faults(README.read_text(encoding="utf-8")))
    for _, sentence in found:
        print(sentence)
    return int(any(wrong for wrong, _ in found))


def _cell(value: Any, form: str) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    return f"{value:{form}}".replace("%", " %")


if __name__ == "__main__":
    raise SystemExit(main())
