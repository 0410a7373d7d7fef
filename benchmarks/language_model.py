"""Recorded answers of a language model, scored offline beside the embedded reasoner.

    python benchmarks/language_model.py DATASET [--answers ARCHIVE ...] [--out FILE.json]
    python benchmarks/language_model.py ../shared/bench/dev --rows      # and the README's rows
    python benchmarks/language_model.py ../shared/corpus/photos         # photos, read by both

An archive holds one folder per object: what was answered from the pictures alone, the pieces that
were shown (pieces.npz), and by `subject.txt` what each answer is about. Its about.json says who
answered, what was known, and how many pictures a question had. Both reasoners get those pieces, the
same prior and the same solver. Where the object moves otherwise than it did when it was looked at,
that look no longer counts, and the table says for how many objects that is so.
`python -m mam_training.labels pack` makes an archive of a folder of questions.

Of photos (DATASET has a boxes.csv: id, class, x_center, y_center, width, height) both readers'
panels are compared with the boxes that somebody else drew round the doors and drawers of a photo,
whatever they belong to: found is what lies on one by IoU 0.5. A box of another piece of furniture
counts as missed, for both readers alike.

An answer tells nothing of what fewer pictures would have shown. A table by their number needs the
questions put again, each number into an archive (`--vlm-images`); each archive is a row here.
"""

from __future__ import annotations

import csv
import json
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import code_state
import engine_table
import numpy as np
import results_page
import tyro
from common import ROOT, save
from tyro.conf import Positional

from mam_pipeline.asset.interiors import add_interiors
from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import BackendError, HintNeeded, MamSimError, NotThisKind
from mam_pipeline.ground_truth import GroundTruth, list_objects, read_object
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.metrics import score
from mam_pipeline.models import settings
from mam_pipeline.models.photo_reader import read_by_model
from mam_pipeline.photo import reconstruct
from mam_pipeline.photo.evaluate import score_boxes
from mam_pipeline.photo.find import Found
from mam_pipeline.photo.image import read_photo
from mam_pipeline.photo.options import parse_options
from mam_pipeline.stages import Stages
from mam_pipeline.types import Articulation, KinematicTree, Primitives
from mam_pipeline.weights import noting
from mam_sim.bench.runner import Record, execute
from mam_sim.bench.table import Row, models_of, summarise

ANSWERS = tuple(
    ROOT / "tests" / "pipeline" / name
    for name in ("answers.zip", "answers_kitchen.zip", "answers_photos.zip")
)
EMBEDDED = "the embedded reasoner"
OWN = "our own reading"
COLUMNS = ("miou", "count", "type_error", "axis", "pivot", "executable")
PATHS = (
    "pipeline/mam_pipeline", ":!pipeline/mam_pipeline/photo", "mam_sim/bench",
    "benchmarks/language_model.py", "tests/pipeline/answers*.zip",
)  # fmt: skip
"""What the rows depend on: the questions and the pictures, too."""


@dataclass(frozen=True)
class Archive:
    """Recorded answers, unpacked.

    Attributes:
        folder: one folder per object. by: who answered, and what was known.
    """

    folder: Path
    by: str

    @staticmethod
    def of(file: Path, folder: Path) -> Archive:
        """Unpack an archive.

        Raises:
            SystemExit: it does not say who answered.
        """
        with zipfile.ZipFile(file) as packed:
            if "about.json" not in packed.namelist():
                sys.exit(f"{file} has no about.json, so nobody knows who answered; pack it again")
            about = json.loads(packed.read("about.json"))
            packed.extractall(folder)
        shown = about.get("pictures")
        return Archive(folder, about["by"] + (f", {shown} pictures" if shown else ""))


def replayed(
    engine: Stages, folder: Path, truth: GroundTruth, primitives: Primitives,
    prior: KinematicPrior | None,
) -> tuple[KinematicTree, bool]:  # fmt: skip
    """The tree of an object's answers, and whether all its looks at the motion still count."""
    one = (folder / "1_parts").is_dir()
    looks = len(list(folder.glob("?_motion/answer.json")))
    for rounds in range(looks, -1, -1):
        given = {
            "MAM_SIM_QUESTIONS": str(folder.parent), settings.SUBJECT: truth.id,
            "MAM_SIM_VLM_SIMPLE": "999" if one else "0", "MAM_SIM_VLM_ROUNDS": str(rounds),
        }  # fmt: skip
        try:
            with settings.given(given):
                return engine.reason(truth.mesh, primitives, prior), rounds == looks
        except (HintNeeded, BackendError):
            if rounds == 0:
                raise
    raise AssertionError("unreachable")


def judged(
    folder: Path, truth: GroundTruth, prior: str, reasoner: str, run: bool
) -> tuple[Record, bool]:
    """One object by one reasoner, and whether the answers are about today's pictures.

    Args:
        folder: its answers and pieces. reasoner: file or embedded.
        run: write the asset and test it in the simulator.
    """
    with np.load(folder / "pieces.npz") as data:
        merges = data["merges"] if "merges" in data else np.zeros((0, 2), dtype=np.int64)
        primitives = Primitives(data["labels"].astype(np.int64), merges)
    engine = Stages(EngineConfig("geometric", prior, reasoner, "embedded"))
    answer: Articulation | None = None
    current, why, began = True, "", time.perf_counter()
    with noting() as rooms:
        try:
            found = engine.observe(truth.mesh, primitives)
            if reasoner == "file":
                tree, current = replayed(engine, folder, truth, primitives, found)
            else:
                tree = engine.reason(truth.mesh, primitives, found)
            if any(node.subtype != "fixed" for node in tree.nodes):
                answer, _ = add_interiors(engine.solve(truth.mesh, primitives, tree))
        except MamSimError as error:
            why = str(error)
            print(f"{truth.id}, {reasoner}: {why}")
    seconds = time.perf_counter() - began
    passed: bool | None = False if run else None
    reasons: tuple[str, ...] = ("no_joint",) if run else ()
    if run and answer is not None:
        passed, reasons = execute(answer, truth.id)
    record = Record(
        id=truth.id, category=truth.category, key="", status="error" if why else "ok", why=why,
        scores=score(answer, truth), seconds=seconds, stages={}, faces=len(truth.mesh.faces),
        primitives=primitives.count, bound=None, executable=passed, reasons=reasons,
        weights=tuple(sorted(rooms)),
    )  # fmt: skip
    return record, current


def boxes_of(file: Path) -> dict[str, list[tuple[str, Any]]]:
    """The boxes of each photo: class and (4, 2) corners, 0..1 of the picture."""
    out: dict[str, list[tuple[str, Any]]] = {}
    with file.open(encoding="utf-8") as rows:
        for row in csv.DictReader(rows):
            x, y, w, h = (float(row[k]) for k in ("x_center", "y_center", "width", "height"))
            corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (w / 2, h / 2) + (x, y)
            out.setdefault(row["id"], []).append((row["class"], corners))
    return out


def seen_on(photo: Path, answers: Path | None) -> tuple[str, Found | None]:
    """What a reader makes of a photo: right away, or why not, and what it found.

    Args:
        answers: folder of them, for the reader that looks at them; None for the embedded one.
    """
    given = {"MAM_SIM_QUESTIONS": str(answers), settings.SUBJECT: photo.stem}
    try:
        options = {}
        if answers is not None:
            with settings.given(given):
                options = read_by_model(photo, "file", {}).options
        seen = read_photo(photo)
        found, judged, _ = reconstruct.read_object(seen, parse_options(options), photo.name)
    except HintNeeded:
        return "asked", None
    except NotThisKind:
        return "refused", None
    return "asked" if judged.doubt else "made", found


def read_photos(folder: Path, known: Sequence[Archive], only: tuple[str, ...]) -> dict[str, Any]:
    """Panels of both readers against the boxes of photos; prints a row a photo and the sums.

    Drafts count, too: what is asked about is built as it was read.
    """
    boxes = boxes_of(folder / "boxes.csv")
    total: dict[str, Counter[str]] = {}
    print("| photo, reader | outcome | boxes | panels | found |\n|---|---|---|---|---|")
    for archive in known:
        for name in sorted(p.name for p in archive.folder.iterdir() if p.name in boxes):
            photo = folder / f"{name}.jpg"
            if (only and name not in only) or not photo.is_file():
                continue
            seen = {archive.by: seen_on(photo, archive.folder), OWN: seen_on(photo, None)}
            both = all(found is not None for _, found in seen.values())
            for by, (outcome, found) in seen.items():
                counts = {} if found is None else score_boxes(found, boxes[name])
                n, ours, hit = (counts.get(k, 0) for k in ("panels", "found", "matched50"))
                total.setdefault(by, Counter()).update({outcome: 1, "photos": 1, "both": both})
                total[by].update({"boxes": n, "panels": ours, "found": hit} if both else {})
                print(f"| {name}, {by} | {outcome} | {n} | {ours} | {hit} |", flush=True)
    for by, sums in total.items():
        shares = (sums["found"] / max(sums[k], 1) for k in ("panels", "boxes"))
        print(f"**{by}**: {dict(sums)}; where both read the photo, precision and recall of panels",
              *(f"{share:.2f}" for share in shares))  # fmt: skip
    return {by: dict(sums) for by, sums in total.items()}


def line(name: str, records: Sequence[Record]) -> str:
    """One Markdown row of means; pivot over the objects that have one."""
    total: Row = summarise(name, records)
    values = [getattr(total, column) for column in COLUMNS]
    cells = ["" if value is None else f"{value:.2f}" for value in values]
    return f"| {name} | {len(records)} | {' | '.join(cells)} |"


def write_rows(found: Mapping[str, Sequence[Record]], dataset: str, command: str) -> None:
    """Put a row for each reasoner into the engine's table, and the table into the README."""
    table = results_page.load(engine_table.TABLE)
    source = Path(dataset).name
    for k, (by, records) in enumerate(found.items()):
        name = f"of the {engine_table.NAMES.get(source, source)}, read by {by}"
        wanted = engine_table.Wanted(f"{source}-read-{k}", name, source, shipped=True, readme=True)
        measured = engine_table.Measured(tuple(records), models_of(records, dataset), command)
        row: dict[str, Any] = engine_table.row_of(wanted, measured, code_state.head())
        row["paths"] = list(PATHS)
        row["values"]["s"] = None  # the pieces were there, and nobody waited for an answer
        if by != EMBEDDED:
            row["models"]["unseen"] = None  # nobody knows what the one who answered had seen
        engine_table.put(table, row, wanted.id)
    text = json.dumps(table, indent=1, ensure_ascii=False) + "\n"
    (results_page.RESULTS / f"{engine_table.TABLE}.json").write_text(text, encoding="utf-8")
    text = results_page.README.read_text(encoding="utf-8")
    results_page.README.write_text(results_page.readme(text), encoding="utf-8")


def main(
    dataset: Positional[str],
    /,
    answers: tuple[Path, ...] = ANSWERS,
    prior: str = "embedded",
    embedded: bool = True,
    simulate: bool = True,
    only: tuple[str, ...] = (),
    rows: bool = False,
    out: Path | None = None,
) -> None:
    """Score every object that has answers and print the table.

    Args:
        dataset: folder of ground-truth URDFs. answers: archives. prior: of both reasoners.
        embedded: score the embedded reasoner, too. only: some objects.
        simulate: write each asset and test it in the simulator.
        rows: write the rows of the README. out: JSON file for the scores.
    """
    if rows and (only or not simulate):
        sys.exit("rows are of all objects, with the check: leave out --only and --no-simulate")
    if rows and (changed := code_state.changes(PATHS)):
        sys.exit(f"a row names a commit, and {changed[0]} differs from it; commit first")
    found: dict[str, list[Record]] = {}
    past: list[str] = []
    with tempfile.TemporaryDirectory() as scratch:
        known = [Archive.of(file, Path(scratch) / str(k)) for k, file in enumerate(answers)]
        if (Path(dataset) / "boxes.csv").is_file():
            save(out, read_photos(Path(dataset), known, only))
            return
        print(f"| object, reasoner | n | {' | '.join(COLUMNS)} |\n|---|---|{'---|' * len(COLUMNS)}")
        for name, category, urdf in list_objects(dataset):
            asked = [a for a in known if (a.folder / name / "pieces.npz").is_file()]
            if not asked or (only and name not in only):
                continue
            truth = read_object(urdf, name, category)
            runs = [(a.by, a.folder, "file") for a in asked]
            runs += [(EMBEDDED, asked[0].folder, "embedded")] if embedded else []
            for by, folder, reasoner in runs:
                record, current = judged(folder / name, truth, prior, reasoner, simulate)
                past += [] if current else [name]
                found.setdefault(by, []).append(record)
                print(line(f"{name}, {by}", [record]), flush=True)
    for by, records in found.items():
        print(line(f"**all, {by}**", records))
    if past:
        print(f"\nmove otherwise than they did when they were looked at: {', '.join(past)}")
    if rows:
        flags = "" if answers == ANSWERS else " --answers ARCHIVE"
        shown = f"python benchmarks/language_model.py {Path(dataset).name.upper()}{flags} --rows"
        write_rows(found, dataset, shown)
    plain = {
        by: {r.id: asdict(replace(r.scores, joints=())) for r in records}
        for by, records in found.items()
    }
    save(out, plain)


if __name__ == "__main__":
    tyro.cli(main)
