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
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

from mam_pipeline import folders
from mam_pipeline.claims import BATCH, claim_folder, holds, not_a_link
from mam_pipeline.edited import LIMITS, STRICT, Count, Document, NotNegative, Share, validated
from mam_pipeline.errors import ConfigError, InputError, MamSimError

MADE = ("passes", "fails check", "no environment")
"""Outcomes with an asset folder."""
Status = Literal[
    "passes", "fails check", "no environment", "nothing moves", "needs a hint", "another kind",
    "bad input", "timeout", "memory", "crash", "error",
]  # fmt: skip
ORDER: tuple[Status, ...] = get_args(Status)
"""All outcomes, assets first."""
GUARDED: tuple[Status, ...] = ("timeout", "memory")
"""Outcomes that a limit caused: tried again when the limit is wider."""
_READ: dict[str, Any] = {**STRICT, "extra": "ignore"}
PAGES = ("batch.yaml", "manifest.csv", "manifest.parquet", "index.html")
PARTS = ("assets", "records", "pictures")


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
        tries: 2 where its process was killed by somebody else, and it was made again alone.
        backends: role to name. version: of mam-sim. host: where it ran. ended: UTC, ISO 8601.
        log: last lines of what its process printed, where it crashed.
    """

    __pydantic_config__ = _READ
    name: str
    source: str
    sha256: str
    key: str
    status: Status
    reason: str = ""
    check: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    confidences: tuple[Share, ...] = ()
    environment: str = ""
    seconds: NotNegative = 0.0
    cpu_seconds: NotNegative = 0.0
    peak_mb: NotNegative = 0.0
    limit: NotNegative = 0.0
    tries: Count = 1
    backends: dict[str, str] = field(default_factory=dict)
    version: str = ""
    host: str = ""
    ended: str = ""
    log: str = ""

    @staticmethod
    def parse(text: str | bytes) -> Record | None:
        """Read a record; None for what is none, as a file that was cut short."""
        try:
            record: Record = validated(Record, Document(json.loads(text), error=InputError))
        except (ValueError, RecursionError, InputError):
            return None
        return record

    @property
    def readable(self) -> Record:
        """With text that every file can hold: a file's name need not be text."""
        texts: dict[str, Any] = {
            f.name: folders.as_text(getattr(self, f.name)) for f in fields(self) if f.type == "str"
        }
        return replace(self, **texts)


class Target:
    """Where a batch is kept; made anew from its address in every process."""

    def __init__(self, address: str) -> None:
        """Find out which file system an address is of.

        Raises:
            ConfigError: none, or one whose package is not installed.
        """
        import fsspec

        self.address = address
        try:
            scheme, mark, place = address.strip().partition("://")
            if not (place if mark else scheme):
                raise ValueError("it names no place")
            self.files, self.root = fsspec.core.url_to_fs(address)
        except ImportError as error:
            raise ConfigError(f"--out {address}: {_one_line(error)} (with pip)") from error
        except Exception as error:  # every file system of fsspec has errors of its own
            raise ConfigError(
                f"--out {address} is neither a folder nor an address of fsspec such as "
                f"s3://bucket/run: {_one_line(error)}"
            ) from error
        self.local = "file" in self.files.protocol
        if self.local and "://" in self.root:
            raise ConfigError(f"--out {address} is neither a folder nor an address of fsspec")

    def path(self, *parts: str) -> str:
        """A place in the target, as its file system names it."""
        return posixpath.join(self.root, *parts)

    def refuse_foreign(self) -> None:
        """Raise ConfigError where the target holds something else than a batch."""
        if self.local:
            claim_folder(Path(self.root), BATCH)
            return
        with self._told():
            held = self.names("")
            if not held:
                return
            settings = self.files.cat_file(self.path(BATCH.file)) if BATCH.file in held else b""
        if not holds(settings, ".yaml", BATCH.keys):
            raise ConfigError(f"{self.address} is not empty and holds no batch; name another --out")

    def prepare(self, settings: bytes = b"pipeline: {}\n") -> None:
        """Write the settings, which mark the target as a batch, and make the folders.

        What a killed run left half done goes.

        Raises:
            ConfigError: one of the places is a link or a file, or nothing can be written there.
        """
        if self.local:
            for part in PARTS:
                place = not_a_link(Path(self.path(part)))
                if place.exists() and not place.is_dir():
                    raise ConfigError(f"{place} is a file; a batch keeps its {part} there")
            for page in PAGES:
                if Path(self.path(page)).is_dir():
                    raise ConfigError(f"{self.path(page)} is a folder; a batch writes a file there")
        with self._told():
            if self.local:
                Path(self.root).mkdir(parents=True, exist_ok=True)
            self.write(BATCH.file, settings)
            for part in PARTS:
                self.files.makedirs(self.path(part), exist_ok=True)
        if self.local:
            folders.sweep_inside(Path(self.path("assets")))

    @contextmanager
    def _told(self) -> Iterator[None]:
        """What a far file system refuses comes out as a ConfigError."""
        try:
            yield
        except MamSimError:
            raise
        except Exception as error:
            if self.local:
                raise
            raise ConfigError(
                f"{self.address} cannot be written: {_one_line(error)}; name another --out"
            ) from error

    def names(self, part: str) -> set[str]:
        """Names in one of the folders."""
        if not self.files.isdir(self.path(part)):
            return set()
        return {posixpath.basename(p.rstrip("/")) for p in self.files.ls(self.path(part), False)}

    def records(self) -> dict[str, Record]:
        """All records by name; what is none, or of another name, is passed over."""
        names = [n.removesuffix(".json") for n in self.names("records") if n.endswith(".json")]
        found = {name: self.record(name) for name in names}
        return {name: r for name, r in found.items() if r is not None}

    def record(self, name: str) -> Record | None:
        """The record of one object; None where there is none that can be read."""
        path = self.path("records", f"{name}.json")
        if self.local:
            try:
                status = Path(path).lstat()
                if not stat.S_ISREG(status.st_mode) or status.st_size > LIMITS.bytes:
                    return None
                text = Path(path).read_bytes()
            except OSError:
                return None
        else:
            if not self.files.exists(path):
                return None
            text = self.files.cat_file(path)
        found = Record.parse(text)
        return found if found is not None and found.name == name else None

    def save(self, record: Record) -> None:
        """Write a record: from now on the object is done."""
        text = json.dumps(asdict(record.readable), indent=1)
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


def _one_line(error: Exception) -> str:
    """What a library says, as the end of a sentence."""
    return (" ".join(str(error).split()) or type(error).__name__)[:200].rstrip(".")


def as_row(record: Record) -> dict[str, Any]:
    """A record as a row of the manifest."""
    row = asdict(record.readable)
    row.pop("log")
    return {**row, "backends": " ".join(f"{k}={v}" for k, v in record.backends.items())}
