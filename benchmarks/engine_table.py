"""Measures the engine's table: every source of real objects, by models that never saw it.

    python benchmarks/engine_table.py ../shared/bench build                  # all, and the README
    python benchmarks/engine_table.py ../shared/bench build --only kitchen dev

A source is a folder of ground-truth URDFs below one of the folders given. It is judged by the
shipped models where none of them was trained on it (their manifests say so), else by those of
`--left-out FOLDER/SOURCE` (`mam-sim bench --weights`), else with nothing withheld, if that asks no
model that saw it. Where the shipped models saw a source, a second row has their figures too.

Rows go to docs/results/engine.json as each is done, with the commit, what every model was trained
on, and the paths they depend on, which must have no changes. How far each run's confidence can be
believed goes to docs/results/confidence.json. Figures are means over the objects
in which something moves; `false joints` counts the others. `true parts` are those of which a part
that was found has half of the surface or more (IoU).

`labels_unseen` is made by `python -m mam_training.labels dataset build/labels_unseen --corpus
CORPUS --unseen`. What is "true" there is what somebody saw in pictures.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import code_state
import results_page
import tyro
from common import machine
from mam_sim_bench.runner import GENERATED, Record, record_from
from mam_sim_bench.table import SURE, Row, calibration, summarise

import mam_pipeline
from mam_pipeline.weights import MANIFEST

TABLE, CONFIDENCE = "engine", "confidence"
COLUMNS = {
    "mIoU": "miou", "count": "count", "type error": "type_error", "axis (rad)": "axis",
    "pivot": "pivot", "executable": "executable", "s": "median_seconds",
}  # fmt: skip
"""Column of the table: field of the bench's total."""
NOTHING_WITHHELD = ("--no-abstain",)
"""Flags under which no part is withheld: the models that decide that are not asked."""


@dataclass(frozen=True)
class Wanted:
    """A row of the table.

    Attributes:
        id: of the row. name: what the row says. source: folder of its objects.
        flags: of `mam-sim bench`. shipped: measured with the shipped models even where they saw
            the source; else a row of models that did not. readme: shown there.
    """

    id: str
    name: str
    source: str
    flags: tuple[str, ...] = ()
    shipped: bool = False
    readme: bool = False


NAMES = {
    "kitchen": "kitchen objects that nobody tuned on",
    "labels": "objects of many public repositories, labelled by eye",
    "labels_unseen": "objects labelled by eye that no model was trained on",
    "dev": "objects from robot simulators",
    "sweet_home": "pieces of furniture (Sweet Home 3D)",
    "scene_synthesizer": "objects of scene-synthesizer",
    "generated:unseen": "generated objects, of kinds that no model was trained on",
}  # fmt: skip
"""What a source is, by its folder, or by what `mam-sim bench` generates."""
FLAGS = {"labels_unseen": ("--no-exec",), "generated:unseen": ("--limit", "56")}
"""Flags of the rows of a source: of many objects none is executed; four of each generated kind."""
README = ("kitchen",)
"""Sources of the README's rows, which are measured again with every change, so they are few. The
other rows stand in docs/results alone, which says where they are of older code."""


def wanted_rows() -> tuple[Wanted, ...]:
    """All rows, in the order of the table."""
    rows = [Wanted(k, name, k, FLAGS.get(k, ()), readme=k in README) for k, name in NAMES.items()]
    rows += [
        Wanted(f"{k}-shipped", name, k, FLAGS.get(k, ()), shipped=True, readme=k in README)
        for k, name in NAMES.items() if shipped_saw(k)
    ]  # fmt: skip
    for source in ("kitchen", "dev"):
        name = NAMES[source]
        rows.append(Wanted(f"{source}-named", f"{name}, names shown", source, ("--named",)))
        rows.append(Wanted(f"{source}-fused", f"{name}, fused", source, ("--fuse",)))
    paper = {"the paper's initialisation alone": "init",
             "the paper's optimisation (Levenberg–Marquardt)": "lm"}  # fmt: skip
    for words, solver in paper.items():
        flags = ("--solver", solver)
        rows.append(Wanted(f"dev-{solver}", f"{NAMES['dev']}, {words}", "dev", flags))
    rows.append(Wanted(
        "dev-no-prior", f"{NAMES['dev']}, without the kinematic prior", "dev", ("--prior", "none")
    ))  # fmt: skip
    return tuple(rows)


@dataclass(frozen=True)
class Measured:
    """What one run of the bench gave: its records, its models, and the command."""

    records: tuple[Record, ...]
    models: dict[str, Any]
    command: str

    @property
    def unseen(self) -> bool:
        """Whether no model was trained on the source."""
        return bool(self.models["unseen"])


def measure(source: Path | str, flags: Sequence[str], jobs: int, log: Path) -> Measured:
    """Run `mam-sim bench` on a folder or `generated:...`; a run that was cut short goes on."""
    name = source.name if isinstance(source, Path) else source
    # no path of this machine: FOLDER/SOURCE of the weights is told as LEFT_OUT/SOURCE
    shown = [f"LEFT_OUT/{name}" if at == "--weights" else flag
             for at, flag in zip(("", *flags), flags)]  # fmt: skip
    said = ["mam-sim", "bench", name.upper() if isinstance(source, Path) else name, *shown]
    words = [str(source), *flags, "--jobs", str(jobs), "--out", str(log), "--quiet"]
    subprocess.run([sys.executable, "-m", "mam_sim.cli", "bench", *words], check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    data = json.loads(log.read_text(encoding="utf-8"))
    records = tuple(record_from(record) for record in data["objects"])
    return Measured(records, data["models"], " ".join(said))


def attempts(wanted: Wanted, left_out: Path | None) -> Iterator[tuple[str, ...]]:
    """Flags of the runs that may give a row, the first best."""
    if wanted.shipped or not shipped_saw(wanted.source):
        yield wanted.flags
    if wanted.shipped:
        return
    if left_out is not None and (left_out / wanted.source).is_dir():
        yield (*wanted.flags, "--weights", str(left_out / wanted.source))
    yield (*wanted.flags, *NOTHING_WITHHELD)


def shipped_saw(source: str) -> bool:
    """Whether some shipped model of the engine was trained on a source."""
    package = Path(mam_pipeline.__file__).parent
    manifests = [p for wing in ("parts", "joints") for p in package.glob(f"{wing}/**/{MANIFEST}")]
    return any(source in json.loads(p.read_text())["trained_on"] for p in manifests)


def row_of(wanted: Wanted, found: Measured, commit: str) -> dict[str, Any]:
    """The row of the table."""
    moving = [r for r in found.records if r.scores.true_parts > 0]
    still = [r for r in found.records if r.scores.true_parts == 0]
    total: Row = summarise(wanted.id, moving)
    values: dict[str, Any] = {
        column: None if (v := getattr(total, field)) is None else round(v, 4)
        for column, field in COLUMNS.items()
    }
    false = sum(r.scores.predicted_parts > 0 for r in still)
    values["false joints"] = f"{false} of {len(still)}" if still else None
    values["true parts"] = parts_of(moving)
    name = f"{len(moving)} {wanted.name}"
    if not wanted.shipped and NOTHING_WITHHELD[0] in found.command:
        name += ", nothing withheld"
    return {
        "id": wanted.id, "name": name, "values": values, "command": found.command,
        "commit": commit, "machine": machine(), "models": models_of(found),
        **({"readme": True} if wanted.readme else {}),
    }  # fmt: skip


def confidence_row_of(row: dict[str, Any], records: Sequence[Record]) -> dict[str, Any]:
    """The row of the table of confidence: what was said of the joints found, and what was right.

    Args:
        row: of the engine's table, of the same run. records: of all its objects.
    """
    said = calibration(records)
    right = said["joints"] - said["wrong"]
    values: dict[str, Any] = {"joints": str(said["joints"]), "calibration error": said["error"]}
    edges = [0.0, 0.2, 0.4, 0.6, SURE]
    for low, high in zip(edges, [*edges[1:], 1.01]):
        some = [j for r in records for j in r.scores.found if low <= j.confidence < high]
        name = f"{low:g} to {min(high, 1.0):g}"
        values[name] = f"{sum(j.right for j in some)} of {len(some)}" if some else None
    values["wrong, no review"] = f"{said['unmarked']} of {said['wrong']}"
    values["of them sure"] = str(said["unmarked_sure"])
    values["true joints"] = f"{right} of {said['true']}"
    still = sum(r.scores.true_parts == 0 for r in records)
    name = f"{row['name']}, and {still} in which nothing moves" if still else row["name"]
    return {**{k: v for k, v in row.items() if k != "readme"}, "name": name, "values": values}


def parts_of(records: Sequence[Record]) -> str | None:
    """How many true parts are found and awake, and how many dormant; None where nobody counted."""
    counts = [(r.awake, r.dormant) for r in records if r.awake is not None]
    if not counts:
        return None
    awake, dormant = (sum(c or 0 for c in column) for column in zip(*counts))
    return f"{awake} of {sum(r.scores.true_parts for r in records)}, {dormant} dormant"


def models_of(found: Measured) -> dict[str, Any]:
    """What a row says of its models: whether none saw the source, and the sources of each."""
    sources = {one["room"]: ", ".join(one["trained_on"]) for one in found.models["weights"]}
    return {"unseen": found.unseen, "trained_on": sources}


def put(table: dict[str, Any], row: dict[str, Any] | None, name: str) -> None:
    """Put a row of a table in its place, or take it away where there is none any more."""
    order = [wanted.id for wanted in wanted_rows()]
    rows = {old["id"]: old for old in table["rows"]}
    rows.pop(name, None)
    if row is not None:
        rows[name] = row
    place = {k: i for i, k in enumerate(order)}
    table["rows"] = sorted(rows.values(), key=lambda r: place.get(r["id"], len(order)))


def main(
    data: tyro.conf.Positional[tuple[Path, ...]], only: tuple[str, ...] = (),
    left_out: Path | None = None, jobs: int = 2, logs: Path | None = None,
    readme_only: bool = False,
) -> None:  # fmt: skip
    """Measure rows of the engine's table and write them.

    Args:
        data: folders below which the sources lie. only: sources, or ids of rows.
        left_out: folder with weights for each source, SOURCE/parts/..., that never saw it.
        jobs: processes. logs: folder that keeps the runs, so that one cut short goes on.
        readme_only: measure the rows of the README alone.
    """
    table = results_page.load(TABLE)
    changed = code_state.changes(table["paths"])
    if changed:
        sys.exit(f"a row names a commit, and {changed[0]} differs from it; commit first")
    rows = [w for w in wanted_rows() if not only or {w.id, w.source} & set(only)]
    rows = [w for w in rows if w.readme or not readme_only]
    with tempfile.TemporaryDirectory() as scratch:
        kept = logs or Path(scratch)
        kept.mkdir(parents=True, exist_ok=True)
        for wanted in rows:
            for file, row in rows_of(wanted, data, left_out, jobs, kept).items():
                table = results_page.load(file)
                put(table, row, wanted.id)
                text = json.dumps(table, indent=1, ensure_ascii=False) + "\n"
                (results_page.RESULTS / f"{file}.json").write_text(text, encoding="utf-8")
                print(wanted.id, file, "no row" if row is None else row["values"], flush=True)
    results_page.write_readme()


def rows_of(
    wanted: Wanted, data: Sequence[Path], left_out: Path | None, jobs: int, logs: Path
) -> dict[str, dict[str, Any] | None]:
    """Measure a row of each table, by its file; None where there is nothing to say.

    That is: no model that never saw the source can be had, or the shipped models are such ones
    already and have their row.
    """
    folder: Path | str | None = wanted.source
    if not wanted.source.startswith(GENERATED):
        folder = next((f / wanted.source for f in data if (f / wanted.source).is_dir()), None)
    if folder is None:
        sys.exit(
            f"no folder {wanted.source} in {', '.join(map(str, data))}; see benchmarks/README.md"
        )
    commit = code_state.head()
    for flags in attempts(wanted, left_out):
        name = (
            "_".join([wanted.source, commit, *flags])
            .replace("/", "-")
            .replace(":", "-")
            .replace("--", "")
        )
        found = measure(folder, flags, jobs, logs / f"{name}.json")
        if wanted.shipped != found.unseen:
            row = row_of(wanted, found, commit)
            return {TABLE: row, CONFIDENCE: confidence_row_of(row, found.records)}
    return {TABLE: None, CONFIDENCE: None}


if __name__ == "__main__":
    tyro.cli(main)
