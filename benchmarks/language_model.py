"""Recorded answers of a language model, scored offline beside the embedded reasoner.

    python benchmarks/language_model.py DATASET [--answers ARCHIVE ...] [--out FILE.json]

An archive holds one folder per object: what was answered from the pictures alone, the pieces that
were shown (pieces.npz), and by `subject.txt` what each answer is about. Both reasoners get those
pieces, the same prior and the same solver. Where the object moves otherwise than it did when it was
looked at, that look no longer counts, and the table says for how many objects that is so.
`python -m mam_training.labels pack` makes an archive of a folder of questions.
"""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import tyro
from common import ROOT, save
from tyro.conf import Positional

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.errors import BackendError, HintNeeded, MamSimError
from mam_pipeline.ground_truth import GroundTruth, list_objects, read_object
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.metrics import Scores, score
from mam_pipeline.models import settings
from mam_pipeline.stages import Stages
from mam_pipeline.types import KinematicTree, Primitives

ANSWERS = ROOT / "tests" / "pipeline" / "answers.zip"
LABELS = {"file": "recorded answers", "embedded": "embedded"}
COLUMNS = ("miou", "count", "type_error", "axis", "pivot")


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


def compare(
    folder: Path, truth: GroundTruth, prior: str, embedded: bool
) -> tuple[dict[str, Scores], bool]:
    """Scores of one object by each reasoner, and whether the answers are about today's pictures.

    Args:
        folder: its answers and pieces. embedded: whether the embedded reasoner is scored, too.
    """
    with np.load(folder / "pieces.npz") as data:
        merges = data["merges"] if "merges" in data else np.zeros((0, 2), dtype=np.int64)
        primitives = Primitives(data["labels"].astype(np.int64), merges)
    out, current = {}, True
    for reasoner in ("file", "embedded") if embedded else ("file",):
        engine = Stages(EngineConfig("geometric", prior, reasoner, "embedded"))
        try:
            found = engine.observe(truth.mesh, primitives)
            if reasoner == "file":
                tree, current = replayed(engine, folder, truth, primitives, found)
            else:
                tree = engine.reason(truth.mesh, primitives, found)
            still = all(node.subtype == "fixed" for node in tree.nodes)
            answer = None if still else engine.solve(truth.mesh, primitives, tree)
            out[reasoner] = score(answer, truth)
        except MamSimError as error:
            print(f"{truth.id}, {reasoner}: {error}")
            out[reasoner] = score(None, truth)
    return out, current


def line(name: str, scores: Sequence[Scores]) -> str:
    """One Markdown row of means; pivot over the objects that have one."""
    cells = []
    for column in COLUMNS:
        known = [v for s in scores if (v := getattr(s, column)) is not None]
        cells.append(f"{np.mean(known):.2f}" if known else "")
    return f"| {name} | {len(scores)} | {' | '.join(cells)} |"


def main(
    dataset: Positional[str],
    /,
    answers: tuple[Path, ...] = (ANSWERS,),
    prior: str = "embedded",
    embedded: bool = True,
    out: Path | None = None,
) -> None:
    """Score every object that has answers and print the table.

    Args:
        dataset: folder of ground-truth URDFs. answers: archives. prior: of both reasoners.
        embedded: score the embedded reasoner, too. out: JSON file for the scores.
    """
    rows: dict[str, dict[str, Scores]] = {}
    past = []
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        for archive in answers:
            with zipfile.ZipFile(archive) as packed:
                packed.extractall(place)
        print(f"| object, reasoner | n | {' | '.join(COLUMNS)} |\n|---|---|{'---|' * len(COLUMNS)}")
        for name, category, urdf in list_objects(dataset):
            if not (place / name / "pieces.npz").is_file():
                continue
            truth = read_object(urdf, name, category)
            rows[name], current = compare(place / name, truth, prior, embedded)
            past += [] if current else [name]
            for reasoner, scores in rows[name].items():
                print(line(f"{name}, {LABELS[reasoner]}", [scores]), flush=True)
    for reasoner in rows and next(iter(rows.values())):
        print(line(f"**all, {LABELS[reasoner]}**", [r[reasoner] for r in rows.values()]))
    if past:
        print(f"\nmove otherwise than they did when they were looked at: {', '.join(past)}")
    plain = {
        name: {k: asdict(replace(s, joints=())) for k, s in row.items()}
        for name, row in rows.items()
    }
    save(out, plain)


if __name__ == "__main__":
    tyro.cli(main)
