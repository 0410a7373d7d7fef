"""Objects that the engine gets wrong, put right in the studio's page by a scripted person.

    python benchmarks/studio_trial.py DATASET ... [--limit 20] [--each 8] [--out FILE.json]

A dataset is a folder of URDF objects or `generated:test`. `studio_person.py` knows the truth and
uses the page alone: real clicks in a headless Chromium, then "Make and check the asset". Objects
are taken in the datasets' order, those that are right already left out. For each:

    edits, clicks, drags         that it took
    keys, shortcuts              typed into fields; of the page, for a command
    machine_s                    seconds that the page and the check took for it, by the clock;
                                 without those in which the script looks for where to click
    person_s                     seconds of a person for these clicks, by the keystroke-level model
    total_s                      both
    right                        whether parts and joints are the true ones at the end
    passes                       whether the check passes
    same                         whether `articulate --hints` makes the same of what was saved

The person's seconds are a model, not a measurement: 1.35 s to think before each click, 1.1 s to
point, 0.2 s to press, 0.28 s a key (Card, Moran and Newell, 1980); a shortcut is thought of, too.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import tyro
from common import save
from mam_sim_bench.metrics import nearest_face, score
from mam_sim_bench.runner import Task, find_tasks
from playwright.sync_api import Error as PageError
from playwright.sync_api import sync_playwright
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from studio_hands import until
from studio_person import Person
from studio_speed import DRAWN_BY_CPU, SIZE
from tyro.conf import Positional

from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.geometry.front import moved
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import make_asset
from mam_sim.studio.page import Page
from mam_sim.studio.place import place_of
from mam_sim.studio.session import Session
from mam_world.ground_truth import GroundTruth

PATIENCE = 60.0  # seconds for one step of the machine
GENERATED = 60  # objects of a generated split that are looked at
SAME = ("object.urdf", "stages/3_parts/parts.yaml", "stages/4_joints/joints.yaml")


def one(truth: GroundTruth, browser: Any, folder: Path) -> dict[str, Any] | None:
    """The trial of one object; None where the engine is right already."""
    file = folder / f"{truth.id}.glb"
    save_glb(truth.mesh, file)
    session = Session(place_of(file, MakeConfig(), folder / "page" / truth.id))
    truth = as_shown(truth, session)
    before = measured(session, truth)
    if before["right"]:
        return None
    session.prepare()
    page, context = Page(), browser.new_context(viewport=SIZE)
    try:
        page.put(session)
        context.set_default_timeout(PATIENCE * 1000)
        window = context.new_page()
        window.goto(page.url)
        until(lambda: len(page.server.get_clients()) > 0, PATIENCE)
        window.get_by_text("What was found").wait_for()
        window.wait_for_timeout(1500)  # until the object is drawn: not counted
        person = Person(page, window, truth, session)
        begun = time.monotonic()
        person.put_right()
        edited = time.monotonic() - begun - person.looked
        passes = person.make(PATIENCE)
        took = time.monotonic() - begun - person.looked
    finally:
        context.close()
        page.stop()
    acts, after = person.acts, measured(session, truth)
    return {
        "id": truth.id, "faces": len(session.mesh.faces), "pieces": session.primitives.count,
        "edits": acts.edits, "clicks": acts.clicks, "drags": acts.drags, "keys": acts.keys,
        "shortcuts": acts.shortcuts,
        "editing_s": round(edited, 1), "machine_s": round(took, 1),
        "person_s": round(acts.seconds, 1), "total_s": round(took + acts.seconds, 1),
        "before": before, "after": after, "bound": round(bound(person), 3),
        "unseen": len(person.unseen), "right": after["right"], "passes": passes,
        "verdict": page.trying.verdict.content if not passes else "",
        "same": same(session, file, folder / "again" / truth.id), "steps": acts.steps,
    }  # fmt: skip


def as_shown(truth: GroundTruth, session: Session) -> GroundTruth:
    """The truth in the page's frame: the object may have been turned until its front shows, and
    brought to the size that its kind has."""
    theirs = session.mesh.vertices[session.mesh.faces].mean(axis=1)
    size = session.mesh.diagonal / truth.mesh.diagonal
    found = []
    for quarter in range(4):
        turn = np.eye(4)
        turn[:3, :3] = size * Rotation.from_euler("z", 90.0 * quarter, degrees=True).as_matrix()
        turned = moved(truth.truth_articulation(), turn)
        shift = np.eye(4)
        shift[:3, 3] = session.mesh.bounds[0] - turned.mesh.bounds[0]
        turned = moved(turned, shift)
        ours = turned.mesh.vertices[turned.mesh.faces].mean(axis=1)
        found.append((float(cKDTree(ours).query(theirs)[0].mean()), quarter, turned))
    best = min(found)[2]
    return replace(truth, mesh=best.mesh, links=best.links, joints=best.joints)


def measured(session: Session, truth: GroundTruth) -> dict[str, Any]:
    """How right the page's parts and joints are: all parts found, and each moves as it truly does.

    A part is found at half an overlap; an axis is right within 10 degrees, a hinge line within 3 %
    of the object's diagonal.

    Args:
        truth: in the page's frame (`as_shown`).
    """
    found = score(session.state.articulation, truth)
    right = found.count == 1.0 and all(
        j.iou >= 0.5 and not j.type_error and (j.axis or 0.0) < np.radians(10)
        and (j.pivot or 0.0) < 0.03
        for j in found.joints
    )  # fmt: skip
    return {"miou": round(found.miou, 3), "count": found.count, "right": bool(right)}


def bound(person: Person) -> float:
    """Share of the surface that lies in pieces of its own part: what whole pieces can reach."""
    mesh, truth, session = person.session.mesh, person.truth, person.session
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    own = truth.face_link[nearest_face(truth.mesh, middles)]
    area = face_geometry(mesh.vertices, mesh.faces)[1]
    moving = own != 0
    fits = person.owner[session.primitives.labels] == own
    return float(area[moving & fits].sum() / max(area[moving].sum(), 1e-12))


def same(session: Session, file: Path, out: Path) -> bool:
    """Whether the command line makes the same asset from the saved hints."""
    ours, hints = session.place.asset, session.place.hints
    theirs = make_asset(file, out, MakeConfig(hints=hints if hints.is_file() else None)).folder
    return all((ours / name).read_bytes() == (theirs / name).read_bytes() for name in SAME)


def tasks(datasets: Sequence[str], only: Sequence[str]) -> Iterator[Iterator[Task]]:
    """The objects of every dataset."""
    for dataset in datasets:
        many = GENERATED if dataset.startswith("generated:") else None
        yield (t for t in find_tasks(dataset, (), many) if not only or t.id in only)


def main(
    datasets: Positional[tuple[str, ...]], only: tuple[str, ...] = (), limit: int = 20,
    each: int = 20, out: Path | None = None,
) -> None:  # fmt: skip
    """Try objects until `limit` wrong ones have been put right, `each` of a dataset at most."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=[*DRAWN_BY_CPU, "--no-sandbox"]
        )
        for dataset in tasks(datasets, only):
            taken = 0
            for task in dataset:
                if taken == each or len(rows) == limit:
                    break
                try:
                    row = one(task.load(), browser, Path(folder))
                except (MamSimError, TimeoutError, PageError) as error:
                    row = {"id": task.id, "failed": str(error).partition("\n")[0]}
                if row is not None:
                    rows.append(row)
                    taken += 1
                    print(row, flush=True)
                    save(out, summed(rows))
        browser.close()
    print(summed(rows)["total"])


def summed(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Rows, their counts and their medians."""
    done = [r for r in rows if "failed" not in r]
    total: dict[str, Any] = {"objects": len(rows)}
    if done:
        total |= {k: sum(r[k] for r in done) for k in ("right", "passes", "same")}
        total["right_and_passes"] = sum(r["right"] and r["passes"] for r in done)
        total["under_60_s"] = sum(r["total_s"] < 60 for r in done)
        names = ("edits", "clicks", "drags", "editing_s", "machine_s", "person_s", "total_s")
        total |= {f"median_{k}": round(median(r[k] for r in done), 1) for k in names}
        for when in ("before", "after"):
            total[f"{when}_miou"] = round(sum(r[when]["miou"] for r in done) / len(done), 3)
            total[f"{when}_count"] = round(sum(r[when]["count"] for r in done) / len(done), 3)
    return {"total": total, "rows": list(rows)}


if __name__ == "__main__":
    tyro.cli(main)
