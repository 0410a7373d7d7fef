"""Runs what the pages tell a reader to type, and compares it with the output that they show.

    python docs/run_pages.py             # exit 1 where a page shows something else
    python docs/run_pages.py --write     # put what was printed into the pages

A block of commands with a block ```text below it is run, and the text is what its last command
prints: every line must be there, in this order, with the numbers about as shown (`TOLERANCE`);
other lines may lie between. A block of YAML whose title names a file is what the reader changes
there: `upper: 0.15  # was 0.26`; what has no such remark must be as it is shown. Blocks of Python
are run. All pages share one folder, in which the examples lie, and come in the order of `PAGES`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
PAGES = (
    "docs/tutorials/first-environment.md",
    "README.md",
    "docs/concepts/check.md",
    "docs/concepts/asset-folder.md",
    "docs/concepts/environment.md",
    "docs/concepts/generated-objects.md",
    "docs/tutorials/put-right-by-hand.md",
)
FENCE = re.compile(
    r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<body>.*?)^```$', re.M | re.S
)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
WAS = re.compile(r"^ *(?P<key>\w+): .+? +# was (?P<old>[^ :]+)")
TOLERANCE = 0.02
"""Share by which a shown number may differ from the printed one, of 0.5 at least."""


@dataclass(frozen=True)
class Block:
    """A block of a page.

    Attributes:
        start, end: of its body in the page's text.
    """

    kind: str
    title: str | None
    body: str
    start: int
    end: int


def blocks(text: str) -> list[Block]:
    """All blocks of a page that say what they are."""
    return [
        Block(m["kind"], m["title"], m["body"], m.start("body"), m.end("body"))
        for m in FENCE.finditer(text)
    ]


def steps(text: str) -> Iterator[tuple[Block, Block | None]]:
    """What of a page is done, in order; beside commands the output that they should have."""
    found = blocks(text)
    for k, block in enumerate(found):
        shown = found[k + 1] if k + 1 < len(found) and found[k + 1].kind == "text" else None
        if block.kind == "python" or (block.kind == "yaml" and block.title):
            if block.title is None or block.kind == "yaml":
                yield block, None
        elif block.kind == "sh" and shown is not None:
            yield block, shown


def compared(shown: str, printed: str) -> tuple[str, list[str]]:
    """What should be shown, and what is wrong with what is.

    Returns:
        the shown lines with the numbers that were printed; a sentence for each line that differs.
    """
    lines = printed.splitlines()
    at, out, wrong = 0, [], []
    for line in shown.splitlines():
        place = next((k for k in range(at, len(lines)) if _words(lines[k]) == _words(line)), None)
        if place is None:
            wrong.append(f"shows {line.strip()!r}, which is not printed")
            out.append(line)
            continue
        at = place + 1
        out.append(lines[place].rstrip())
        if not _alike(line, lines[place]):
            wrong.append(f"shows {line.strip()!r}, printed is {lines[place].strip()!r}")
    return "\n".join(out) + "\n", wrong


def _words(line: str) -> str:
    """A line without its numbers and the width of its gaps."""
    return " ".join(NUMBER.sub("#", line).split())


def _alike(shown: str, printed: str) -> bool:
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed))
    return all(abs(float(a) - float(b)) <= TOLERANCE * max(abs(float(b)), 0.5) for a, b in pairs)


def edit(block: Block, folder: Path) -> list[str]:
    """Do what a block of YAML says in the file of its title; what is wrong with it."""
    file = folder / str(block.title)
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    lists = content.values() if isinstance(content, dict) else [content]
    rows = [row for some in lists if isinstance(some, list) for row in some]
    named = yaml.safe_load(re.sub(r"^ *\.\.\.\n", "", block.body, flags=re.M))
    old = {m["key"]: m["old"] for m in map(WAS.match, block.body.splitlines()) if m}
    wrong = []
    for item in named:
        row = next((r for r in rows if r["name"] == item["name"]), None)
        if row is None:
            wrong.append(f"changes {item['name']!r}, which {block.title} does not hold")
            continue
        for key, value in item.items():
            shown = str(old.get(key, value))
            if _words(shown) != _words(str(row[key])) or not _alike(shown, str(row[key])):
                wrong.append(f"shows {key}: {shown} in {block.title}, where {row[key]} is")
        row |= item
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return wrong


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in the reader's folder, with this tree's `mam-sim` first on the path."""
    places = [str(Path(sys.executable).parent), os.environ.get("PATH", "")]
    env = {**os.environ, "PATH": os.pathsep.join(places)}
    return subprocess.run(
        command, cwd=folder, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def check_page(page: Path, folder: Path) -> tuple[str, list[str]]:
    """Do what a page says: its text with what was printed, and what is wrong with it."""
    text = page.read_text(encoding="utf-8")
    wrong: list[str] = []
    new: list[tuple[Block, str]] = []
    before = ""  # a later block of Python goes on where an earlier one of its page ended
    for block, shown in steps(text):
        if block.kind == "yaml":
            wrong += edit(block, folder)
            continue
        if block.kind == "python":
            before += block.body
            done = run([sys.executable, "-c", before], folder)
        else:
            done = run(["bash", "-euc", block.body], folder)
        if done.returncode:
            wrong.append(f"{block.body.splitlines()[0]!r} failed: {done.stdout[-500:]}")
        elif shown is not None:
            lines, more = compared(shown.body, done.stdout)
            wrong += more
            new.append((shown, lines))
    for shown, lines in reversed(new):
        text = text[: shown.start] + lines + text[shown.end :]
    return text, wrong


def main() -> int:
    """Run all pages."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    found = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        shutil.copytree(ROOT / "examples", folder / "examples")
        for name in PAGES:
            text, wrong = check_page(ROOT / name, folder)
            for sentence in wrong:
                print(f"{name}: {sentence}", flush=True)
            found += len(wrong)
            if args.write:
                (ROOT / name).write_text(text, encoding="utf-8")
    return int(found > 0 and not args.write)


if __name__ == "__main__":
    raise SystemExit(main())
