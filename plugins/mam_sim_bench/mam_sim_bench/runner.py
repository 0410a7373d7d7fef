"""Running the engine over a dataset: one record per object, resumable, parallel over processes."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline import backends
from mam_pipeline.errors import ConfigError, HintNeeded, MamSimError
from mam_pipeline.evidence.spec import NOTHING, KindCount, KinematicSpec, Said
from mam_pipeline.folders import Scratch
from mam_pipeline.geometry.front import moved
from mam_pipeline.models import settings
from mam_pipeline.stages import articulate_mesh
from mam_pipeline.types import Articulation
from mam_pipeline.weights import VARIABLE, noting
from mam_sim_bench.config import BenchConfig
from mam_sim_bench.metrics import RIGHT_IOU, FoundJoint, JointScore, Scores, score
from mam_world.ground_truth import GroundTruth, list_objects, read_object

GENERATED = "generated:"
MOTIONLESS = "motionless"
UNSEEN = "unseen"
_CODE = (".py", ".txt", ".npz", ".json", ".gz")
_NOT_ENGINE = ("photo", "check", "formats")


@dataclass(frozen=True)
class Task:
    """One object to run: a URDF path, or a generated category and seed."""

    id: str
    category: str
    source: str
    seed: int = -1

    def load(self, named: bool = False) -> GroundTruth:
        """Read or generate the truth, its nodes with names or without."""
        if self.seed >= 0:
            from mam_world.named import with_names
            from mam_world.truth import generated_truth

            truth = generated_truth(self.category, self.seed)
            return with_names(truth) if named else truth
        return read_object(self.source, self.id, self.category, named)


@dataclass(frozen=True)
class Record:
    """What came out for one object.

    Attributes:
        status: ok | nothing (no joint is awake) | asked (a question waits for its
            answer; such a record is not kept) | error.
        bound: mIoU that a perfect grouping of the primitives would reach; None without them.
        awake: true parts of which a part that moves has half (IoU); dormant: further ones of which
            a dormant part has; None if not counted.
        executable: all clauses of the check hold; None if not tested.
        reasons: reason codes of the check.
        weights: the rooms whose weights were read (`mam_pipeline.weights`).
    """

    id: str
    category: str
    key: str
    status: str
    why: str
    scores: Scores
    seconds: float
    stages: dict[str, float]
    faces: int
    primitives: int
    bound: float | None
    awake: int | None = None
    dormant: int | None = None
    executable: bool | None = None
    reasons: tuple[str, ...] = ()
    used: dict[str, str] = field(default_factory=dict)
    weights: tuple[str, ...] = ()


def find_tasks(dataset: str, only: Sequence[str] = (), limit: int | None = None) -> list[Task]:
    """Objects of a dataset folder, or of `generated:SPLIT`; `generated:motionless` are objects of
    the test split in which nothing moves, `generated:unseen` those of kinds of that split alone.

    Raises:
        InputError: no such folder, or nothing in it.
        ConfigError: an id of `only` that is not there.
    """
    if dataset.startswith(GENERATED):
        from mam_world.splits import iterate, iterate_motionless, iterate_unseen

        split = dataset.removeprefix(GENERATED)
        many = limit or 50
        if split == UNSEEN:
            pairs = iterate_unseen(many)
        else:
            still = split == MOTIONLESS
            pairs = (iterate_motionless if still else iterate)("test" if still else split, many)
        tasks = [Task(f"{name}_{seed}", name, dataset, seed) for name, seed in pairs]
    else:
        tasks = [Task(name, kind, str(urdf)) for name, kind, urdf in list_objects(dataset)]
    for name in only:
        if name not in {t.id for t in tasks}:
            known = ", ".join(t.id for t in tasks[:5])
            raise ConfigError(f"no object {name!r} in {dataset}; it has {known} ...")
    tasks = [t for t in tasks if not only or t.id in only]
    return tasks if limit is None else tasks[:limit]


def run_task(task: Task, config: BenchConfig) -> Record:
    """Run the engine on one object and score it; a failure becomes a record too."""
    from mam_pipeline.asset.interiors import add_interiors

    truth = task.load(config.named)
    spec = _spec(truth, config)
    mesh = truth.mesh
    if config.fuse:
        from mam_pipeline.geometry.fuse import fuse_mesh

        mesh = fuse_mesh(mesh, config.resolution, config.noise, faces=config.faces)
    status, why, found, run = "ok", "", None, None
    rooms: set[str] = set()
    began = time.perf_counter()
    try:
        subject = {**config.models.settings(), settings.SUBJECT: task.id}
        with settings.given(subject), noting() as rooms:
            run = articulate_mesh(mesh, config=config.engine, spec=spec)
        if run.articulation.joints:
            found, _ = add_interiors(run.articulation)  # as the asset is delivered
        else:
            asleep = ", ".join(f"{d.link.name} ({d.joint.confidence:.2f})"
                               for d in run.articulation.dormant)  # fmt: skip
            status, why = "nothing", f"dormant: {asleep}" if asleep else "no part was found"
    except HintNeeded as error:
        status, why = "asked", str(error)
    except MamSimError as error:
        status, why = "error", str(error)
    except Exception as error:  # one broken object must not end the run
        status, why = "error", f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - began
    executable: bool | None = None
    reasons: tuple[str, ...] = ()
    if found is not None and config.execute:
        executable, reasons, found = execute(found, task.id)
    elif found is None and config.execute:
        executable, reasons = False, ("no_joint",)
    scores = score(found, truth)
    awake = sum(j.iou >= RIGHT_IOU for j in scores.joints)
    every = awake
    known = found or (None if run is None else run.articulation)
    if known is not None and known.dormant:
        every = sum(j.iou >= RIGHT_IOU for j in score(_woken(known), truth).joints)
    return Record(
        id=task.id,
        category=task.category,
        key=task_key(task, config),
        status=status,
        why=why,
        scores=scores,
        awake=awake,
        dormant=max(every - awake, 0),
        seconds=round(seconds, 3),
        stages={} if run is None else {k: round(v, 3) for k, v in run.seconds.items()},
        faces=len(mesh.faces),
        primitives=0 if run is None else run.primitives.count,
        bound=None if run is None else grouping_bound(mesh, run.primitives.labels, truth),
        executable=executable,
        reasons=reasons,
        used={} if run is None else dict(run.used),
        weights=tuple(sorted(rooms)),
    )


def _woken(found: Articulation) -> Articulation:
    """The articulation in which every dormant part is a link that moves."""
    links, joints = list(found.links), list(found.joints)
    for part in found.dormant:
        host = links[part.joint.parent]
        left = np.setdiff1d(host.faces, part.link.faces)
        links[part.joint.parent] = replace(host, faces=left)
        joints.append(replace(part.joint, child=len(links)))
        links.append(part.link)
    return replace(found, links=tuple(links), joints=tuple(joints), dormant=())


def _spec(truth: GroundTruth, config: BenchConfig) -> KinematicSpec:
    """What the engine is told beside geometry."""
    from mam_pipeline.evidence.names import object_of
    from mam_pipeline.evidence.read import spec_of

    what = truth.category.replace("_", " ")
    if not config.word or object_of(what, Said("user", what)) is None:
        what = ""
    spec = spec_of(truth.mesh, what=what) if config.named or what else NOTHING
    return replace(spec, counts=_counts(truth)) if config.counts else spec


def _counts(truth: GroundTruth) -> tuple[KindCount, ...]:
    """How many movable parts of each kind there are, as a person would say it."""
    from mam_pipeline.evidence.names import part_kind_of

    found: dict[str, int] = {}
    for joint in truth.joints:
        if joint.type == "fixed":
            continue
        link = truth.links[joint.child]
        said = [part_kind_of(link.name), part_kind_of(link.kind)]
        fitting = [k.kind for k in said if k is not None and k.moves in ("hinge", "spin", "slide")]
        word = [*fitting, "drawer" if joint.type == "prismatic" else "door"][0]
        found[word] = found.get(word, 0) + 1
    return tuple(KindCount(k, n, Said("user", f"{n} {k}")) for k, n in found.items())


def grouping_bound(mesh: Any, labels: Any, truth: GroundTruth) -> float:
    """mIoU of the primitives of `mesh` when each is given to the link that most of it belongs to.

    Args:
        mesh: what was segmented; it may be fused.
        labels: (F,) primitive of every face of `mesh`.
    """
    from mam_pipeline.geometry.sampling import face_geometry
    from mam_pipeline.types import Link
    from mam_sim_bench.metrics import nearest_face

    nearest = nearest_face(truth.mesh, mesh.vertices[mesh.faces].mean(axis=1))
    owner = truth.face_link[nearest]
    votes = np.zeros((int(labels.max()) + 1, len(truth.links)))
    np.add.at(votes, (labels, owner), face_geometry(mesh.vertices, mesh.faces)[1] + 1e-15)
    link = votes.argmax(axis=1)[labels]
    links = tuple(
        Link(n.name, n.kind, np.flatnonzero(link == i)) for i, n in enumerate(truth.links)
    )
    return score(Articulation(mesh, links, truth.joints), truth).miou


def execute(found: Articulation, name: str) -> tuple[bool, tuple[str, ...], Articulation]:
    """Write the asset to a temporary folder and run the check.

    Returns:
        Whether it holds, reason codes, and the articulation as it was corrected.
    """
    from mam_pipeline.asset.writer import write_asset
    from mam_pipeline.check.correct import written_and_checked

    with Scratch() as folder:
        try:
            low, high = found.mesh.bounds
            shift = np.eye(4)
            shift[:3, 3] = [*(-(low + high)[:2] / 2), -low[2]]
            write = partial(write_asset, out=Path(folder) / "asset", name=name)
            asset, corrected = written_and_checked(moved(found, shift), write)
        except Exception as error:  # an asset that cannot be written or loaded does not execute
            return False, (f"{type(error).__name__}: {error}"[:120],), found
    verdict = asset.card.checks["executability"]
    shift[:3, 3] *= -1.0
    back = replace(moved(corrected, shift), mesh=found.mesh)  # to the last bit, for the score
    return verdict["passed"], tuple(verdict["reasons"]), back


def run_bench(
    tasks: Sequence[Task],
    config: BenchConfig,
    log: Path | None = None,
    jobs: int = 1,
    on_done: Callable[[Record, bool], None] | None = None,
) -> list[Record]:
    """Run all tasks; records come back in the order of `tasks`.

    Args:
        log: JSON lines, one per object; those with the same key are reused, others appended.
        jobs: processes.
        on_done: called with each record and whether it was reused.
    """
    tell = on_done or (lambda _record, _reused: None)
    known = read_log(log) if log is not None else {}
    done: dict[str, Record] = {}
    todo: list[Task] = []
    for task in tasks:
        record = known.get(task_key(task, config))
        if record is None:
            todo.append(task)
        else:
            done[task.id] = record
            tell(record, True)
    for record in _results(todo, config, jobs):
        done[record.id] = record
        if log is not None and record.status != "asked":
            with log.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(asdict(record)) + "\n")
        tell(record, False)
    return [done[t.id] for t in tasks if t.id in done]


def read_log(log: Path) -> dict[str, Record]:
    """Records of a log by key; a line cut short by a kill is passed over."""
    out: dict[str, Record] = {}
    if not log.is_file():
        return out
    for line in log.read_text(encoding="utf-8").splitlines():
        try:
            record = record_from(json.loads(line))
        except (ValueError, TypeError, KeyError):
            continue
        out[record.key] = record
    return out


def record_from(data: dict[str, Any]) -> Record:
    """A Record from plain data, as written by `json.dumps(asdict(record))`."""
    scores = dict(data["scores"])
    scores["joints"] = tuple(JointScore(**j) for j in scores["joints"])
    scores["found"] = tuple(FoundJoint(**j) for j in scores["found"])
    lists: dict[str, Any] = {k: tuple(data.get(k, ())) for k in ("reasons", "weights")}
    rest = {k: v for k, v in data.items() if k != "scores" and k not in lists}
    return Record(**rest, **lists, scores=Scores(**scores))


def task_key(task: Task, config: BenchConfig) -> str:
    """Digest of the object's files, the config, engine and weights, and a folder's answers."""
    digest = hashlib.sha256(repr((task, config)).encode())
    digest.update(engine_digest().encode())
    if os.environ.get(VARIABLE):
        digest.update(_tree_digest(Path(os.environ[VARIABLE])))
    with settings.given({**config.models.settings(), settings.SUBJECT: task.id}):
        for role in ("prior", "reasoner"):
            name = backends.resolved(role, getattr(config.engine, role))
            digest.update(repr(backends.maker(role, name)).encode())
    path = Path(task.source)
    if task.seed < 0 and path.is_file():
        digest.update(path.read_bytes())
    return digest.hexdigest()[:24]


def engine_digest() -> str:
    """Digest of all code and weights of the pipeline package that the engine may use."""
    import mam_pipeline

    return _tree_digest(Path(mam_pipeline.__file__).parent).hex()


@cache
def _tree_digest(root: Path) -> bytes:
    digest = hashlib.sha256()
    for file in sorted(root.rglob("*")):
        inside = file.relative_to(root)
        if file.suffix in _CODE and inside.parts[0] not in _NOT_ENGINE:
            digest.update(str(inside).encode() + file.read_bytes())
    return digest.digest()


def _results(tasks: list[Task], config: BenchConfig, jobs: int) -> Iterator[Record]:
    if jobs <= 1 or len(tasks) <= 1:
        for task in tasks:
            yield run_task(task, config)
        return
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    # fresh processes: threads of the ray caster do not survive a fork
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=context) as pool:
        futures = [pool.submit(run_task, task, config) for task in tasks]
        for future in as_completed(futures):
            yield future.result()
