"""Puts the product's questions about objects of a corpus, and writes labels of the answers."""

from __future__ import annotations

import csv
import datetime
import json
import re
import shutil
import signal
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mam_pipeline import folders
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import HintNeeded, InputError, MamSimError, unknown_name
from mam_pipeline.geometry.stand_in import restored, stand_in
from mam_pipeline.joints.solver import EmbeddedSolver
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models import settings
from mam_pipeline.models.transports import FileTransport, Question
from mam_pipeline.models.vlm import ask_for_tree
from mam_pipeline.run import Source, read_source
from mam_pipeline.stages import Stages
from mam_pipeline.types import Articulation, KinematicTree, Mesh, Primitives
from mam_training.labels.finer import split_pieces
from mam_training.labels.label import Label, label_parts, notes_of

ONE_QUESTION = 90
"""Pieces up to which parts and motions are asked at once: labels are looked at in motion anyway."""
KEPT = re.compile(
    r"\w[\w.-]*/(pieces\.npz|notes\.json|[0-9]_\w+(-\d+)?/(answer\.json|subject\.txt))"
)
"""What is kept of a folder of questions in an archive, by path; nothing else is taken from one."""
SHEETS = 3
"""Pictures into which those of a first question are put; motions are shown as large as they are."""


class LabelTransport(FileTransport):
    """Questions in a folder, with few sheets to open."""

    def most_pictures(self, question: Question) -> int:
        """See FileTransport."""
        return SHEETS if question.name.startswith("1_") else super().most_pictures(question)


@dataclass(frozen=True)
class Item:
    """One object of a corpus: a row of its manifest, and its file."""

    id: str
    category: str
    repository: str
    file: Path


def items_of(corpus: Path, ids: Sequence[str]) -> list[Item]:
    """The objects of some ids, in that order.

    Raises:
        InputError: no manifest, or a file that is missing.
        ConfigError: an id that the manifest does not have.
    """
    manifest = corpus / "MANIFEST.csv"
    if not manifest.is_file():
        raise InputError(f"no MANIFEST.csv in {corpus}: name the folder that holds it and files/")
    with manifest.open(newline="", encoding="utf-8") as stream:
        rows = {row["id"]: row for row in csv.DictReader(stream)}
    out = []
    for name in ids:
        if name not in rows:
            raise unknown_name(f"object of {manifest}", name, rows)
        row, file = rows[name], corpus / "files" / f"{name}.glb"
        if not file.is_file():
            raise InputError(f"{file} is missing")
        out.append(Item(name, row["category"], row["repo"], file))
    return out


def label_file(labels: Path, item: Item) -> Path:
    """Where the label of an object lies: labels/<repository>/<id>.json."""
    slug = re.sub(r"[^a-z0-9]+", "_", item.repository.lower()).strip("_")
    return labels / (slug or "other") / f"{item.id}.json"


def read_item(file: Path) -> Source:
    """The object as `articulate` reads it."""
    config = MakeConfig()
    return read_source(file, "mesh", config, Stages(config.engine))


def ask(item: Item, work: Path, by: str, labels: Path) -> str:
    """Put the next question about one object, or write its label; says what was done.

    Raises:
        HintNeeded: an answer is awaited.
        MamSimError: the file cannot be read, or an answer cannot be used.
    """
    notes = notes_of(work / item.id)
    read = read_item(item.file)
    made = stand_in(read.mesh)
    mesh = read.mesh if made is None else made.mesh
    articulation: Articulation | None = None
    if not notes.get("out_of_scope"):
        primitives, aside = _pieces(work / item.id, mesh, notes.get("split", []))
        given = {
            settings.SUBJECT: item.id,
            "MAM_SIM_VLM_SIMPLE": str(ONE_QUESTION),
        }
        try:
            with settings.given(given):
                tree = ask_for_tree(LabelTransport(work), mesh, primitives, None, spec=read.spec)
        except HintNeeded as waiting:
            raise HintNeeded(f"{aside}{waiting}") from waiting
        articulation = _solved(mesh, primitives, tree)
        if articulation is not None and made is not None:
            articulation = restored(articulation, read.mesh, made)
            if articulation is None:
                raise InputError(f"{item.id}: a part is too small to be found on the full mesh")
    out = label_file(labels, item)
    base = "body" if articulation is None else articulation.links[0].name
    parts = () if articulation is None else label_parts(articulation)
    label = Label(
        id=item.id, repository=item.repository, category=item.category,
        file_digest=file_digest(item.file), faces=len(read.mesh.faces), by=by,
        date=datetime.datetime.now(datetime.UTC).date().isoformat(),
        source_to_asset=tuple(round(float(v), 9) for v in read.source_to_asset.reshape(-1)),
        base=base, parts=parts, nothing_moves=not parts and not notes.get("out_of_scope"),
        out_of_scope=notes.get("out_of_scope"), notes=notes.get("notes", ""),
    )  # fmt: skip
    label.save(out)
    if label.out_of_scope:
        return f"out of scope: {label.out_of_scope}: {out}"
    return f"labelled, {len(parts)} parts that move: {out}"


def ask_all(items: Sequence[Item], work: Path, by: str, labels: Path, seconds: float = 0.0) -> int:
    """Every object as far as it goes; 3 where answers are awaited, 2 where one cannot be used.

    Args:
        seconds: that one object may take; 0: no limit.
    """
    code = 0
    for item in items:
        try:
            with _at_most(seconds):
                done = ask(item, work, by, labels)
        except HintNeeded as waiting:
            done, code = str(waiting), code or 3
        except MamSimError as error:
            done, code = str(error), 2
        print(f"{item.id}: {done}", flush=True)
    return code


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Inside, an InputError is raised when so many seconds have passed; 0: never."""

    def stop(_signal: int, _frame: object) -> None:
        raise InputError(
            f"took more than {seconds:g} s and was left out; give it more with --seconds"
        )

    old = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, old)


def pack(work: Path, archive: Path, by: str) -> int:
    """The answers of a folder of questions as one archive, without the pictures; how many objects.

    Kept of each object are its answers, what each is about, and the pieces that were shown. In
    `about.json` stands who answered, and how many pictures a first question had at most.
    """
    objects = sorted(
        p for p in work.iterdir() if any(p.glob("*/answer.json")) or (p / "notes.json").is_file()
    )
    shown = max((len(list(p.glob("1_*[!0-9]/*.png"))) for p in objects), default=0)
    about = {"by": by, "pictures": shown, "objects": [p.name for p in objects]}
    with folders.new_file(archive) as place, zipfile.ZipFile(place, "w", zipfile.ZIP_LZMA) as out:
        out.writestr("about.json", json.dumps(about))
        for folder in objects:
            for file in sorted(folder.rglob("*")):
                name = file.relative_to(work).as_posix()
                if KEPT.fullmatch(name):
                    out.write(file, name)
    return len(objects)


def unpack(archive: Path, work: Path, ids: Sequence[str]) -> int:
    """Put the answers of an archive back into a folder of questions; how many objects.

    Each comes with the pieces that it is about, so it fits as long as the mesh is read as it was.

    Args:
        ids: of the objects; none: all.

    Raises:
        InputError: no such archive, or an object that has a folder already.
        ConfigError: an object that the archive does not have.
    """
    if not zipfile.is_zipfile(archive):
        raise InputError(f"{archive} is no archive of answers; `pack` makes one")
    with zipfile.ZipFile(archive) as source:
        names = {n: n.split("/")[0] for n in source.namelist() if "/" in n}
        known = sorted(set(names.values()))
        for one in ids:
            if one not in known:
                raise unknown_name(f"object of {archive}", one, known)
        chosen = list(ids) or known
        for one in chosen:
            if (work / one).exists():
                raise InputError(f"{work / one} is there already; remove it or name another --work")
        for name, owner in names.items():
            if owner in chosen and KEPT.fullmatch(name):
                place = work / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(source.read(name))
    return len(chosen)


def _solved(mesh: Mesh, primitives: Primitives, tree: KinematicTree) -> Articulation | None:
    if all(node.subtype == "fixed" for node in tree.nodes):
        return None
    return EmbeddedSolver().solve(mesh, primitives, tree)


def _pieces(folder: Path, mesh: Mesh, split: Sequence[int]) -> tuple[Primitives, str]:
    """The pieces that are shown, kept beside the questions; `split` are those to be cut finer.

    Where they are others than before, the questions are put anew; answers to the old ones are kept
    aside, and the sentence that says so is given, "" where there are none.
    """
    file, why = folder / "pieces.npz", ""
    if file.is_file():
        with np.load(file) as data:
            done = data["split"].tolist() if "split" in data else []
            same = len(data["labels"]) == len(mesh.faces)
            if same and done == list(split):
                return Primitives(data["labels"].astype(np.int64), data["merges"]), ""
        why = "other pieces are cut" if same else "the mesh is read with other faces"
    found = Stages(MakeConfig().engine).segment(mesh)
    if split:
        found = Primitives(split_pieces(mesh, found.labels, split))
    aside = _set_aside(folder, why)
    folder.mkdir(parents=True, exist_ok=True)
    labels = found.labels.astype(np.int32)
    np.savez_compressed(file, labels=labels, merges=found.merges, split=np.array(split, np.int64))
    return found, aside


def _set_aside(folder: Path, why: str) -> str:
    """Move questions about other pieces out of the way; what is to be said of their answers."""
    old = sorted(folder.glob("[0-9]_*"))
    if not why or not old:
        return ""
    count = len(list(folder.glob("before_*")))
    answers = sum((question / "answer.json").is_file() for question in old)
    place = folder / f"before_{count + 1}"
    place.mkdir()
    for question in old:
        shutil.move(question, place / question.name)
    if not answers:
        return ""
    fit = "answer no longer fits" if answers == 1 else "answers no longer fit"
    return f"{answers} earlier {fit}, as {why}; to read in {place}; "
