"""How many URDFs of others `mam-sim mend` brings to a passing check, and what is left by reason.

    python benchmarks/mend_foreign.py FOLDER ... [--broken] [--out FILE.json]
    python benchmarks/mend_foreign.py FOLDER --row SOURCE  # a row of docs/results/mended.json

With --broken, files that pass as they are are also broken on purpose, in one way at a time, and
mended again. Files in which no joint moves are counted apart: no repair makes one.
"""

from __future__ import annotations

import json
import re
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import results_page
import tyro
from broken_variants import KINDS
from common import commit, machine, save
from tyro.conf import Positional

from mam_pipeline.check.model import CheckModel
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.guarded import Limits
from mam_pipeline.mend import Mended, Order, mend
from mam_sim.mending import Task, found_files, mended


@dataclass
class Count:
    """Files of one kind.

    Attributes:
        files: that were tried. still: of these, files in which nothing moves, or that are no URDF.
        before, after: those that pass. worse: that pass no longer.
        had, left: files by reason, before and after.
    """

    files: int = 0
    still: int = 0
    before: int = 0
    after: int = 0
    worse: int = 0
    had: Counter[str] = field(default_factory=Counter)
    left: Counter[str] = field(default_factory=Counter)

    def add(self, found: Mended) -> None:
        """Count a file."""
        self.files += 1
        if found.fault or _still(found):
            self.still += 1
            return
        self.before += found.before
        self.after += found.passed
        self.worse += found.before and not found.passed
        self.had.update(found.reasons_before)
        self.left.update({line.partition(":")[0] for line in found.left})

    def row(self) -> dict[str, object]:
        """As JSON takes it."""
        return {**vars(self), "had": dict(self.had), "left": dict(self.left)}


def _still(found: Mended) -> bool:
    """Whether nothing moves, also after it was mended."""
    return any(line.startswith("no_joint") for line in found.left)


def _text(pattern: str, new: str) -> Callable[[str], str]:
    return lambda text: re.sub(pattern, new, text, count=1)


BREAKS: dict[str, Callable[[str], str]] = {
    "limits exchanged": _text(r'lower="([^"]+)"(\s+)upper="([^"]+)"', r'lower="\3"\2upper="\1"'),
    "an axis ten times as long": _text(r'<axis xyz="([-\d.e]+) ([-\d.e]+) ([-\d.e]+)"',
                                 r'<axis xyz="\g<1>e1 \g<2>e1 \g<3>e1"'),
    "a mesh in another case": _text(r'filename="([^"]*?)(\w+)\.obj"', r'filename="\1\2.OBJ"'),
    "a package": _text(r'filename="(?!package)', 'filename="package://object/'),
    "no dynamics": lambda text: re.sub(r"<dynamics[^>]*/>", "", text),
    "no effort": lambda text: re.sub(r'effort="[^"]*"', "", text),
    "a range that is no number": _text(r'upper="[^"]*"', 'upper="nan"'),
    "a loose link": _text("</robot>", '<link name="loose"/></robot>'),
    "a type with a blank": _text(r'type="(revolute|prismatic)"', r'type="\1 "'),
}  # fmt: skip
"""What is done to the text of a sound file; those of `broken_variants.py` are done beside it."""
SHARED = ("zero inertia", "block over the cavity", "upper limit doubled")


def main(
    files: Positional[tuple[str, ...]], /, broken: bool = False, jobs: int = 1,
    limit: int | None = None, drive: bool = True, out: Path | None = None, row: str = "",
) -> None:  # fmt: skip
    """Print a line a file, then the counts.

    Args:
        files: as of `mam-sim mend`. broken: break those that pass, too. limit: files at most.
        drive: also drive the joints. out: JSON file. row: name of the source, for a row of
            docs/results/mended.json.
    """
    order, whole = Order(drive=drive), Count()
    kinds: dict[str, Count] = {}
    with tempfile.TemporaryDirectory() as scratch:
        tasks = [
            Task(item, None, order, Path(scratch) / f"{i}.json", Limits(600.0, 8.0))
            for i, item in enumerate(found_files(files)[:limit])
        ]
        for found in mended(tasks, jobs):
            whole.add(found)
            if _still(found):
                continue
            said = found.fault or ", ".join(found.reasons_before) or "passes"
            left = ", ".join(found.left) or "passes"
            print(f"{found.source}: {said} -> {left}; {len(found.changes)} changes", flush=True)
            if broken and found.before:
                _broken(Path(found.source), Path(scratch) / "broken", order, kinds)
    _print("files", whole)
    for name, count in kinds.items():
        _print(name, count)
    if row:
        _write_row(row, whole, Path(files[0]).name)
    save(out, {"files": whole.row(), "broken": {k: v.row() for k, v in kinds.items()}})


def _write_row(name: str, count: Count, folder: str) -> None:
    """One source's row of the results page; a row of the same source is replaced."""
    able, had = count.files - count.still, count.had.most_common(4)
    values = {
        "files": able,
        "pass before": f"{count.before} ({count.before / max(able, 1):.0%})",
        "pass after": f"{count.after} ({count.after / max(able, 1):.0%})",
        "worse": count.worse,
        "most frequent reasons, before and after": ", ".join(
            f"{reason} {number} and {count.left[reason]}" for reason, number in had
        ),
    }
    new = {
        "id": re.sub(r"\W+", "-", name.lower()),
        "name": name,
        "values": values,
        "command": f'python benchmarks/mend_foreign.py {folder.upper()} --row "{name}"',
        "commit": commit(),
        "machine": machine(),
    }
    file = results_page.RESULTS / "mended.json"
    table = json.loads(file.read_text(encoding="utf-8"))
    table["rows"] = [r for r in table["rows"] if r["id"] != new["id"]] + [new]
    text = json.dumps(table, indent=1, ensure_ascii=False)
    file.write_text(text + "\n", encoding="utf-8")


def _broken(source: Path, folder: Path, order: Order, kinds: dict[str, Count]) -> None:
    """Break one file in every way and mend it; a copy beside it is what is broken."""
    sound = mend(source, folder, Order(only=("mesh_path",), drive=False))
    urdf = Path(sound.urdf)
    text = urdf.read_text(encoding="utf-8")
    model, tree = CheckModel.read(urdf), UrdfTree.read(urdf)
    for name in (*BREAKS, *SHARED):
        changed = BREAKS[name](text) if name in BREAKS else _shared(name, text, model, tree)
        if changed == text:
            continue
        urdf.write_text(changed, encoding="utf-8")
        try:
            kinds.setdefault(name, Count()).add(mend(urdf, None, order))
        except MamSimError as error:
            print(f"  {name}: {error}")
    urdf.write_text(text, encoding="utf-8")


def _shared(name: str, text: str, model: CheckModel, tree: UrdfTree) -> str:
    root = ET.fromstring(text)
    joint = model.articulation.joints[0].name
    element = next(e for e in root.findall("joint") if e.get("name") == joint)
    done = KINDS[name](root, element, model, tree)
    return ET.tostring(root, encoding="unicode") if done else text


def _print(name: str, count: Count) -> None:
    able = max(count.files - count.still, 1)
    print(f"{name}: {count.files - count.still} files with joints, {count.before} pass before, "
          f"{count.after} after ({count.after / able:.0%}), {count.worse} worse")  # fmt: skip
    for reason, number in count.had.most_common():
        print(f"  {reason}: {number} -> {count.left[reason]}")


if __name__ == "__main__":
    tyro.cli(main)
