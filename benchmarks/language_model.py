"""Recorded answers of a language model, scored offline beside the embedded reasoner.

    python benchmarks/language_model.py DATASET [--answers ARCHIVE ...] [--out FILE.json]
    python benchmarks/language_model.py ../shared/bench/dev --rows      # and the README's rows
    python benchmarks/language_model.py ../shared/corpus/photos         # photos, read by both
    python benchmarks/language_model.py ../shared/corpus/photos --rows  # and the README's table

An archive holds one folder per object: what was answered from the pictures alone, the pieces that
were shown (pieces.npz), and by `subject.txt` what each answer is about. Its about.json says who
answered, what was known, and how many pictures a question had. Both reasoners get those pieces, the
same prior and the same solver. Where the object moves otherwise than it did when it was looked at,
that look no longer counts, and the table says for how many objects that is so.
`python -m mam_training.labels pack` makes an archive of a folder of questions.

Of photos (DATASET has a boxes.csv: id, class, x_center, y_center, width, height) both readers'
panels are compared with the boxes that somebody else drew round doors and drawers, those of rooms
left out. A panel is right where it lies on one by IoU 0.5. A reading is right where every panel
is, and none is missing of those whose middle lies in the front that was read: boxes are loose, and
some are missing, so look at the rest (`--pictures`). Precision and recall of panels are of photos
that both read, with the boxes in either's front: who takes another piece of furniture misses them.

An answer tells nothing of what fewer pictures would have shown. A table by their number needs the
questions put again, each number into an archive (`--vlm-images`); each archive is a row here.
"""

from __future__ import annotations

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
import cv2
import engine_table
import numpy as np
import results_page
import tyro
from common import ROOT, load, machine, save
from mam_sim_bench.metrics import score
from mam_sim_bench.photo_scores import panels_of
from mam_sim_bench.runner import Record, execute
from mam_sim_bench.table import Row, models_of, summarise
from tyro.conf import Positional

from mam_pipeline.asset.interiors import add_interiors
from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import BackendError, HintNeeded, MamSimError, NotThisKind
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.models import settings
from mam_pipeline.models.photo_reader import read_by_model
from mam_pipeline.photo import reconstruct
from mam_pipeline.photo.find import Found
from mam_pipeline.photo.image import read_photo
from mam_pipeline.photo.options import parse_options
from mam_pipeline.photo.score import match, polygon_iou, rect_quad
from mam_pipeline.stages import Stages
from mam_pipeline.types import Articulation, KinematicTree, Primitives
from mam_pipeline.weights import noting
from mam_training.photo.real_photos import boxes_of
from mam_world.ground_truth import GroundTruth, list_objects, read_object

ANSWERS = tuple(sorted((ROOT / "tests" / "pipeline").glob("answers*.zip")))
EMBEDDED = "the embedded reasoner"
OWN = "our own reading"
OTHERS = ("handle", "room door")  # classes of boxes
COLUMNS = ("miou", "count", "type_error", "axis", "pivot", "executable")
PATHS = (
    "pipeline/mam_pipeline", ":!pipeline/mam_pipeline/photo", "plugins/mam_sim_bench",
    "benchmarks/language_model.py", "tests/pipeline/answers*.zip",
)  # fmt: skip
"""What the rows depend on: the questions and the pictures, too."""
PHOTO_PATHS = (
    "pipeline/mam_pipeline/photo", "pipeline/mam_pipeline/models", "benchmarks/language_model.py",
    "tests/pipeline/answers_photos.zip",
)  # fmt: skip
"""What the rows of photos depend on."""


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
        passed, reasons, answer = execute(answer, truth.id)
    record = Record(
        id=truth.id, category=truth.category, key="", status="error" if why else "ok", why=why,
        scores=score(answer, truth), seconds=seconds, stages={}, faces=len(truth.mesh.faces),
        primitives=primitives.count, bound=None, executable=passed, reasons=reasons,
        weights=tuple(sorted(rooms)),
    )  # fmt: skip
    return record, current


@dataclass(frozen=True)
class Seen:
    """What one reader made of one photo.

    Attributes:
        outcome: made, asked or refused.
        front, panels: corners, 0..1 of the picture; none where nothing was read. The panels are
            upright, as the boxes of others are.
    """

    outcome: str
    front: Sequence[Sequence[float]] = ()
    panels: Sequence[Sequence[Sequence[float]]] = ()

    @staticmethod
    def of(outcome: str, found: Found) -> Seen:
        """What was found."""
        size = np.array(found.picture, float)
        quads = [rect_quad(p.rect, found.quad) / size for p in panels_of(found)]
        low, high = (np.array([f(q, axis=0) for q in quads]) for f in (np.min, np.max))
        upright = [[(a, b), (c, b), (c, d), (a, d)] for (a, b), (c, d) in zip(low, high)]
        return Seen(outcome, (found.quad / size).tolist(), upright)

    def beside(self, boxes: Sequence[Any]) -> tuple[int, int, int]:
        """How many boxes there are, how many panels, and how many of these lie on one."""
        iou = [[polygon_iou(box, np.array(panel)) for panel in self.panels] for box in boxes]
        hits = match(np.array(iou).reshape(len(boxes), len(self.panels)), 0.5)
        return len(boxes), len(self.panels), len(hits)


def inside(boxes: Sequence[Any], *seen: Seen) -> list[Any]:
    """The boxes whose middle lies in one of the fronts that were read."""
    fronts = [np.array(one.front, np.float32) for one in seen]
    return [
        box for box in boxes
        if any(cv2.pointPolygonTest(f, tuple(box.mean(axis=0)), False) >= 0 for f in fronts)
    ]  # fmt: skip


def seen_on(photo: Path, answers: Path | None, picture: Path | None) -> Seen:
    """What a reader makes of a photo: right away, or why not, and what it found.

    Args:
        answers: folder of them, for the reader that looks at them; None for the embedded one.
        picture: file for what was found, drawn on the photo.
    """
    given = {"MAM_SIM_QUESTIONS": str(answers), settings.SUBJECT: photo.stem}
    try:
        options = {}
        if answers is not None:
            with settings.given(given):
                options = read_by_model(photo, "file", {}).options
        seen = read_photo(photo)
        found, judged, drawn = reconstruct.read_object(seen, parse_options(options), photo.name)
    except HintNeeded:
        return Seen("asked")
    except NotThisKind:
        return Seen("refused")
    if picture is not None:
        cv2.imwrite(str(picture), drawn["overlay"][:, :, ::-1])
    return Seen.of("asked" if judged.doubt else "made", found)


def read_photos(
    folder: Path, known: Sequence[Archive], only: tuple[str, ...], pictures: Path | None,
    out: Path | None,
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """Both readers on every photo with answers and boxes; prints a row a photo and the sums.

    Args:
        out: every photo is kept there, and a run that was cut short goes on.
    """
    boxes = {
        photo: [box for kind, some in kinds.items() if kind not in OTHERS for box in some]
        for photo, kinds in boxes_of(folder / "boxes.csv").items()
    }
    readers = {archive.by: archive.folder for archive in known}
    asked = sorted(
        name for name in boxes
        if (folder / f"{name}.jpg").is_file() and (not only or name in only)
        and any((at / name / "photo").is_dir() for at in readers.values())
    )  # fmt: skip
    kept: dict[str, dict[str, Any]] = load(out) or {}
    print("| photo, reader | outcome | boxes | panels | found |\n|---|---|---|---|---|")
    for k, (by, answers) in enumerate([*readers.items(), (OWN, None)]):
        done = kept.setdefault(by, {})
        for name in asked:
            if answers is not None and not (answers / name / "photo").is_dir():
                continue
            if name not in done:
                picture = None if pictures is None else pictures / f"{name}_{k}.png"
                done[name] = asdict(seen_on(folder / f"{name}.jpg", answers, picture))
                save(out, kept, PHOTO_PATHS)
            one = Seen(**done[name])
            figures = one.beside(inside(boxes[name], one)) if one.front else ("", "", "")
            print(f"| {name}, {by} | {one.outcome} |", *(f"{n} |" for n in figures), flush=True)
    seen = {by: {n: Seen(**one) for n, one in done.items()} for by, done in kept.items() if done}
    total = {by: sums_of(by, seen, boxes) for by in seen}
    for by, sums in total.items():
        print(f"**{by}**: {sums}")
    return total


def sums_of(
    by: str, readers: Mapping[str, Mapping[str, Seen]], boxes: Mapping[str, Sequence[Any]]
) -> dict[str, Any]:
    """What one reader made of all photos, as the columns of the site's table.

    Precision and recall are of photos of which every reader read something.
    """
    seen = readers[by]
    outcomes = Counter(one.outcome for one in seen.values())
    alone = {n: one.beside(inside(boxes[n], one)) for n, one in seen.items() if one.front}
    right = Counter(
        seen[n].outcome for n, figures in alone.items() if 0 < min(figures) == max(figures)
    )
    sides = {n: [done[n] for done in readers.values() if n in done] for n in seen}
    both = [
        seen[n].beside(inside(boxes[n], *here)) for n, here in sides.items()
        if all(one.front for one in here)
    ]  # fmt: skip
    n, panels, hits = np.array(both, int).reshape(-1, 3).sum(axis=0).tolist()
    return {
        "photos": len(seen),
        "made": outcomes["made"], "panels as the boxes": right["made"],
        "asked": outcomes["asked"], "as the boxes, too": right["asked"],
        "refused": outcomes["refused"],
        "panels precision": round(hits / max(panels, 1), 4),
        "panels recall": round(hits / max(n, 1), 4),
    }  # fmt: skip


def write_photos(found: Mapping[str, Mapping[str, Any]], command: str) -> None:
    """Write the table of photos, of the site and of the README."""
    table = {
        "title": "Photos, read by a vision-language model",
        "columns": dict.fromkeys(next(iter(found.values())), "d")
        | {"panels precision": ".2f", "panels recall": ".2f"},
        "paths": list(PHOTO_PATHS),
        "rows": [
            {"id": f"read-{k}", "name": by, "readme": True, "values": values, "command": command,
             "commit": code_state.head(), "machine": machine()}
            for k, (by, values) in enumerate(found.items())
        ],
    }  # fmt: skip
    text = json.dumps(table, indent=1, ensure_ascii=False) + "\n"
    (results_page.RESULTS / "photos_read.json").write_text(text, encoding="utf-8")
    results_page.write_readme()


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
    results_page.write_readme()


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
    pictures: Path | None = None,
) -> None:
    """Score every object that has answers and print the table.

    Args:
        dataset: folder of ground-truth URDFs. answers: archives. prior: of both reasoners.
        embedded: score the embedded reasoner, too. only: some objects.
        simulate: write each asset and test it in the simulator.
        rows: write the rows of the README, or its table of photos.
        out: JSON file for the scores. pictures: folder for photos with what was read drawn on.
    """
    if rows and (only or not simulate):
        sys.exit("rows are of all objects, with the check: leave out --only and --no-simulate")
    photos = (Path(dataset) / "boxes.csv").is_file()
    paths = PHOTO_PATHS if photos else PATHS
    if rows and (changed := code_state.changes(paths)):
        sys.exit(f"a row names a commit, and {changed[0]} differs from it; commit first")
    found: dict[str, list[Record]] = {}
    past: list[str] = []
    with tempfile.TemporaryDirectory() as scratch:
        known = [Archive.of(file, Path(scratch) / str(k)) for k, file in enumerate(answers)]
        if photos:
            read = read_photos(Path(dataset), known, only, pictures, out)
            if rows:
                write_photos(read, "python benchmarks/language_model.py PHOTOS --rows")
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
