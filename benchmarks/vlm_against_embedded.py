"""The vision-language path with recorded answers beside the embedded reasoner, object by object.

    python benchmarks/vlm_against_embedded.py DATASET [--out FILE.json]

The answers lie in tests/pipeline/answers.zip, one folder per object: what was asked, what was
answered from the pictures alone, and the pieces that were shown. Both reasoners get those
pieces, the same prior and the same solver; `--prior` chooses the prior of both.
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

from mam_pipeline.errors import MamSimError
from mam_pipeline.ground_truth import GroundTruth, list_objects, read_object
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.metrics import Scores, score
from mam_pipeline.models import settings
from mam_pipeline.stages import Stages
from mam_pipeline.types import Primitives

ANSWERS = ROOT / "tests" / "pipeline" / "answers.zip"
COLUMNS = ("miou", "count", "type_error", "axis", "pivot")


def compare(folder: Path, truth: GroundTruth, prior: str) -> dict[str, Scores]:
    """Scores of one object by both reasoners; `folder` holds its answers and pieces."""
    with np.load(folder / "pieces.npz") as data:
        primitives = Primitives(data["labels"].astype(np.int64))
    out = {}
    for reasoner in ("file", "embedded"):
        engine = Stages(EngineConfig("geometric", prior, reasoner, "embedded"))
        given = {"MAM_SIM_QUESTIONS": str(folder.parent), settings.SUBJECT: truth.id}
        with settings.given({**given, "MAM_SIM_VLM_SIMPLE": "0", "MAM_SIM_VLM_ROUNDS": "0"}):
            try:
                found = engine.observe(truth.mesh, primitives)
                tree = engine.reason(truth.mesh, primitives, found)
                out[reasoner] = score(engine.solve(truth.mesh, primitives, tree), truth)
            except MamSimError as error:
                print(f"{truth.id}, {reasoner}: {error}")
                out[reasoner] = score(None, truth)
    return out


def line(name: str, scores: Sequence[Scores]) -> str:
    """One Markdown row of means; pivot over the objects that have one."""
    cells = []
    for column in COLUMNS:
        known = [v for s in scores if (v := getattr(s, column)) is not None]
        cells.append(f"{np.mean(known):.2f}" if known else "")
    return f"| {name} | {len(scores)} | {' | '.join(cells)} |"


def main(dataset: Positional[str], /, prior: str = "embedded", out: Path | None = None) -> None:
    """Score every object that has answers and print the table.

    Args:
        dataset: folder of ground-truth URDFs. prior: of both reasoners.
        out: JSON file for the scores.
    """
    rows: dict[str, dict[str, Scores]] = {}
    scratch = tempfile.TemporaryDirectory()
    answers = Path(scratch.name)
    with zipfile.ZipFile(ANSWERS) as archive:
        archive.extractall(answers)
    print(f"| object, reasoner | n | {' | '.join(COLUMNS)} |\n|---|---|{'---|' * len(COLUMNS)}")
    for name, category, urdf in list_objects(dataset):
        if not (answers / name / "pieces.npz").is_file():
            continue
        rows[name] = compare(answers / name, read_object(urdf, name, category), prior)
        for reasoner, label in (("file", "recorded answers"), ("embedded", "embedded")):
            print(line(f"{name}, {label}", [rows[name][reasoner]]), flush=True)
    for reasoner, label in (("file", "recorded answers"), ("embedded", "embedded")):
        print(line(f"**all, {label}**", [r[reasoner] for r in rows.values()]))
    scratch.cleanup()
    plain = {
        name: {k: asdict(replace(s, joints=())) for k, s in row.items()}
        for name, row in rows.items()
    }
    save(out, plain)


if __name__ == "__main__":
    tyro.cli(main)
