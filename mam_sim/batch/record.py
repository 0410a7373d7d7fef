"""What is known of one object of a batch, and the place where everything is kept.

    TARGET/assets/NAME/         the asset folder
    TARGET/records/NAME.json    written last: an object without it is not done
    TARGET/pictures/NAME.jpg    for the gallery
    TARGET/manifest.csv, manifest.parquet, index.html, batch.yaml

The target is a folder, or whatever else fsspec can write to (s3://, gs://, memory:// ...).
"""

from __future__ import annotations

import json
import posixpath
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from mam_pipeline import folders
from mam_pipeline.errors import ConfigError

MADE = ("passes", "fails check", "no environment")
"""Outcomes with an asset folder."""
GUARDED = ("timeout", "memory")
"""Outcomes that a limit caused: tried again when the limit is wider."""


@dataclass(frozen=True)
class Record:
    """How one object went.

    Attributes:
        name: of its folder: the input's name and the first digits of its digest.
        source: the input's path. sha256: of it and the files that it names.
        key: digest of source, settings and code; an object with the same key is not done again.
        status: passes | fails check | no environment (an asset is there) | nothing moves | needs a
            hint | another kind | bad input | timeout | memory | crash | error.
        reason: why, in a sentence; empty for "passes".
        check: reason codes of the check.
        joints, types, confidences: of the asset's joints, in one order.
        environment: joint on which a robot's environment started; empty where none was asked for.
        seconds: on the clock. cpu_seconds: of the processor. peak_mb: greatest resident memory.
        limit: seconds or megabytes that ended it; 0 where none did.
        backends: role to name. version: of mam-sim. host: where it ran. ended: UTC, ISO 8601.
        log: last lines of what its process printed, where it crashed.
    """

    name: str
    source: str
    sha256: str
    key: str
    status: str
    reason: str = ""
    check: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    confidences: tuple[float, ...] = ()
    environment: str = ""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_mb: float = 0.0
    limit: float = 0.0
    backends: dict[str, str] = field(default_factory=dict)
    version: str = ""
    host: str = ""
    ended: str = ""
    log: str = ""

    @staticmethod
    def parse(text: str | bytes) -> Record | None:
        """Read a record; None for what is none, as a file that was cut short."""
        try:
            data = json.loads(text)
            known = {f.name for f in fields(Record)}
            row: dict[str, Any] = {}
            for name, value in data.items():
                if name in known:
                    row[name] = tuple(value) if isinstance(value, list) else value
            return Record(**row)
        except (ValueError, TypeError, AttributeError):
            return None


class Target:
    """Where a batch is kept; made anew from its address in every process."""

    def __init__(self, address: str) -> None:
        import fsspec

        self.address = address
        self.files, self.root = fsspec.core.url_to_fs(address)
        self.local = "file" in self.files.protocol

    def path(self, *parts: str) -> str:
        """A place in the target, as its file system names it."""
        return posixpath.join(self.root, *parts)

    def refuse_foreign(self) -> None:
        """Raise ConfigError where the target holds something else than a batch."""
        held = self.names("")
        if held and not held & {".lock", "batch.yaml", "records"}:
            raise ConfigError(f"{self.root} is not empty and holds no batch; name another --out")

    def prepare(self) -> None:
        """Make the folders; what a killed run left half done goes."""
        for part in ("assets", "records", "pictures"):
            self.files.makedirs(self.path(part), exist_ok=True)
        if self.local:
            import shutil

            for left in Path(self.path("assets")).glob(".*.partial-*"):
                shutil.rmtree(left, ignore_errors=True)

    def names(self, part: str) -> set[str]:
        """Names in one of the folders."""
        if not self.files.isdir(self.path(part)):
            return set()
        return {posixpath.basename(p.rstrip("/")) for p in self.files.ls(self.path(part), False)}

    def records(self) -> dict[str, Record]:
        """All records by name; those cut short are passed over."""
        paths = [self.path("records", n) for n in self.names("records") if n.endswith(".json")]
        found = [Record.parse(t) for t in self.files.cat(paths).values()] if paths else []
        return {r.name: r for r in found if r is not None}

    def record(self, name: str) -> Record | None:
        """The record of one object."""
        path = self.path("records", f"{name}.json")
        return Record.parse(self.files.cat_file(path)) if self.files.exists(path) else None

    def save(self, record: Record) -> None:
        """Write a record: from now on the object is done."""
        text = json.dumps(asdict(record), indent=1)
        self.write(f"records/{record.name}.json", text.encode())

    def write(self, path: str, content: bytes) -> None:
        """Write a file, whole."""
        place = self.path(*path.split("/"))
        if self.local:
            with folders.new_file(Path(place)) as part:
                part.write_bytes(content)
        else:
            self.files.pipe_file(place, content)

    def put(self, folder: Path, name: str) -> None:
        """Send an asset folder to a target that is no local folder, in place of a former one."""
        place = self.path("assets", name)
        if self.files.exists(place):
            self.files.rm(place, recursive=True)
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                inside = posixpath.join(place, *file.relative_to(folder).parts)
                self.files.makedirs(posixpath.dirname(inside), exist_ok=True)
                self.files.put_file(str(file), inside)


def as_row(record: Record) -> dict[str, Any]:
    """A record as a row of the manifest."""
    row = asdict(record)
    row.pop("log")
    return {**row, "backends": " ".join(f"{k}={v}" for k, v in record.backends.items())}
