"""Reviewing a folder of objects: in order of doubt, each accepted, mended or rejected, in a CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Literal, get_args

from mam_pipeline.asset.card import Asset, AssetCard
from mam_pipeline.check.report import REASONS
from mam_pipeline.claims import REVIEW, claim_file
from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.folders import write_text
from mam_pipeline.formats.door import entries, is_file
from mam_pipeline.formats.suffixes import PHOTOS, mesh_suffixes

Decision = Literal["", "accept", "mend", "reject"]
DECISIONS: tuple[Decision, ...] = get_args(Decision)[1:]
FILE = "review.csv"
UNMADE = 0.5  # doubt about what nobody has looked at yet


@dataclass(frozen=True)
class Entry:
    """One object of a folder.

    Attributes:
        path: below the folder. doubt: 0 (nothing speaks against it) .. 1 (the check fails).
        why: the doubt in words. decision, note: the person's. seconds: it took.
    """

    path: str
    doubt: float = 0.0
    why: str = ""
    decision: Decision = ""
    note: str = ""
    seconds: float = 0.0


class Review:
    """The objects of a folder, most doubtful first, with what was decided so far.

    Attributes:
        folder: of the objects and of the CSV. entries: of all of them.
    """

    def __init__(self, folder: Path) -> None:
        """Find the objects, and go on where the CSV in the folder stops.

        Raises:
            InputError: nothing in the folder can be opened. ConfigError: its CSV is another's.
        """
        self.folder = folder
        claim_file(folder / FILE, REVIEW, flag="")
        known = {entry.path: entry for entry in self._read()}
        found = [_doubted(folder, path) for path in _objects(folder)]
        if not found:
            raise InputError(f"{folder} holds no asset, mesh, photo or URDF")
        self.entries = sorted((_decided(e, known) for e in found), key=_order)

    def index(self, path: str) -> int:
        """Of the entry of an object, by its file or by the asset that was made of it."""
        made = str(asset_of(Path(path)))
        return next(i for i, e in enumerate(self.entries) if e.path in (path, made))

    def look_again(self, path: str) -> None:
        """An object was made meanwhile: its entry is the asset's, and moves by its doubt."""
        old = self.entries.pop(self.index(path))
        asset = self.folder / asset_of(Path(path))
        self.entries.append(_decided(_doubted(self.folder, asset), {asset.name: old}))
        self.entries.sort(key=_order)

    @property
    def done(self) -> int:
        """How many are decided."""
        return sum(bool(entry.decision) for entry in self.entries)

    def next_from(self, index: int) -> int | None:
        """The first undecided entry after one, round and round; None when all are decided."""
        count = len(self.entries)
        order = ((index + 1 + k) % count for k in range(count))
        return next((i for i in order if not self.entries[i].decision), None)

    def decide(self, index: int, decision: Decision, note: str, seconds: float) -> None:
        """Write a decision down at once; the time adds to that of earlier visits."""
        entry = self.entries[index]
        spent = round(entry.seconds + seconds, 1)
        self.entries[index] = replace(entry, decision=decision, note=note, seconds=spent)
        text = io.StringIO()
        writer = csv.DictWriter(text, [f.name for f in fields(Entry)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(e) for e in self.entries)
        write_text(self.folder / FILE, text.getvalue())

    def _read(self) -> list[Entry]:
        path = self.folder / FILE
        if not path.is_file():
            return []
        try:
            with path.open(newline="", encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
            return [
                Entry(
                    row["path"], float(row["doubt"]), row["why"],
                    _decision(row["decision"]), row["note"], float(row["seconds"]),
                )
                for row in rows
            ]  # fmt: skip
        except (KeyError, TypeError, ValueError, csv.Error) as error:
            raise InputError(f"{path} is not a review of the studio: {error!r}") from error


def doubt(card: AssetCard) -> tuple[float, str]:
    """How doubtful an asset is, and why: a failed check, a stuck joint, then low confidence."""
    if not card.joints:
        asleep = ", ".join(joint.child for joint in card.likeliest)
        return 0.9, f"nothing moves; dormant: {asleep}" if asleep else "nothing moves"
    if card.executable is False:
        return 1.0, "; ".join(REASONS.get(r, r) for r in card.check_reasons) or "the check fails"
    looked_at = [joint for joint in card.joints if joint.review]
    unsure = 1.0 - min(j.confidence if j.provenance != "user" else 1.0 for j in card.joints)
    if looked_at:
        return max(0.6, unsure), "; ".join(f"{j.name} {j.review}" for j in looked_at)
    return round(min(unsure, 0.5), 4), ""


def asset_of(file: Path) -> Path:
    """The asset that is made of a file of the folder; of an asset, itself."""
    return file.with_name(f"{file.stem}-asset") if file.suffix else file


def _order(entry: Entry) -> tuple[float, str]:
    return -entry.doubt, entry.path


def _decided(entry: Entry, known: Mapping[str, Entry]) -> Entry:
    """An entry with what was decided on it, or on the file that its asset was made of."""
    file = next((p for p in known if str(asset_of(Path(p))) == entry.path), entry.path)
    old = known.get(entry.path, known.get(file))
    if old is None:
        return entry
    return replace(entry, decision=old.decision, note=old.note, seconds=old.seconds)


def _decision(text: str) -> Decision:
    if text not in get_args(Decision):
        raise ValueError(f"no decision is called {text!r}")
    return next(d for d in get_args(Decision) if d == text)


def _objects(folder: Path) -> list[Path]:
    """Assets of a folder, and files from which no asset beside them was made."""
    inside = entries(folder)
    assets = [p for p in inside if is_file(p / "asset.json")]
    made = set()
    for path in assets:
        try:
            made.add(str(Asset.load(path).card.source.get("path")))
        except MamSimError:
            continue  # it is listed, and says itself what is wrong with it
    suffixes = {*mesh_suffixes(), *PHOTOS, ".urdf"}
    files = (p for p in inside if p.suffix.lower() in suffixes)
    return [*assets, *(p for p in files if p.is_file() and p.name not in made)]


def _doubted(folder: Path, path: Path) -> Entry:
    name = str(path.relative_to(folder))
    if not path.is_dir():
        return Entry(name, UNMADE, "not made yet")
    try:
        return Entry(name, *doubt(Asset.load(path).card))
    except MamSimError as error:
        return Entry(name, 1.0, str(error))
