"""Whose a place is: a command writes only into a folder that is new, empty or its own.

Every kind of result has a file that is always in it, and what that file holds tells it from a
file of the same name that somebody else wrote. A result that is one file takes the place of an
earlier one of its kind, and of nothing else.
"""

from __future__ import annotations

import csv
import json
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL.PngImagePlugin import PngInfo

from mam_pipeline import folders
from mam_pipeline.edited import LIMITS, parse_yaml
from mam_pipeline.errors import ConfigError

PNG_MARK = "mam-sim"
"""`Software` of the pictures that we write over; pages have it as generator, films as comment."""


@dataclass(frozen=True)
class Kind:
    """A kind of result.

    Attributes:
        said: what it is called in a sentence.
        file: that every folder of this kind holds; for a result that is one file, its suffix.
        keys: that the file's names and values have; of a CSV file, its first columns.
        also: names that may lie in a folder before its file does.
    """

    said: str
    file: str
    keys: tuple[str, ...] = ()
    also: tuple[str, ...] = ()


ASSET = Kind("asset", "asset.json", ("schema", "urdf"))
BATCH = Kind("batch", "batch.yaml", ("pipeline",), (".lock",))
RANK = Kind("result of rank", "rank.json", ("measure",))
RUN = Kind("run", "run.json", ("schema", "algo", "env"))
RUN_BEGUN = Kind("run", "settings.txt", ("assets",))
COLLECTION = Kind("collection", "collect.json", ("asset", "collect"))
EXPORT = Kind("export", "mam_sim_export.json", ("kind", "schema"), ("joint_mapping.yaml",))
OBJECTS = Kind("generated objects", "MANIFEST.csv", ("name", "category", "seed", "split"))
SETUP = Kind("set-up of an arm", "markers.yaml", ("markers",))
MENDED = Kind("result of mend", "mend.json", ("source", "changes"))
CHECKED = Kind("report of check", ".json", ("passed", "clauses", "joints"))
SCORES = Kind("result of bench", ".json", ("objects",))
BENCH_SETTINGS = Kind("settings of bench", ".yaml", ("bench",))
BENCH_LOG = Kind("log of bench", ".jsonl", ("id", "scores"))
PHOTO_SCORES = tuple(
    Kind("result of bench-photo", ".json", (key,))
    for key in ("photos", "clean", "medium", "clutter", "silently_wrong")
)
EVALUATION = Kind("result of eval", ".json", ("results", "total"))
HINTS = Kind("hints file", ".yaml", ("schema",))
PAGE = Kind("page of mam-sim", ".html")
PICTURE = Kind("picture of mam-sim", ".png")
FILM = Kind("film of mam-sim", ".mp4")
REVIEW = Kind("review of the studio", ".csv", ("path", "doubt", "why", "decision"))
EPISODES = Kind("log of mam-sim's episodes", ".jsonl", ("seed", "success"))
FILM_MARK = ("-metadata", f"comment={PNG_MARK}")
"""Arguments of ffmpeg by which `is_ours` knows a film."""


def claim_folder(out: Path, *kinds: Kind, flag: str = "--out") -> None:
    """Refuse a folder that is neither new nor empty nor of one of the kinds.

    Raises:
        ConfigError: it holds something else, or is a file or a link that leads nowhere.
    """
    if out.is_symlink() and not out.exists():
        raise ConfigError(f"{out} is a link that leads nowhere; remove it or name another {flag}")
    if not out.exists():
        return
    if not out.is_dir():
        raise ConfigError(f"{out} is a file; {flag} names a folder")
    held = {name for name in os.listdir(out) if not _half_made(name)}
    if any(held <= set(kind.also) or is_ours(out / kind.file, kind) for kind in kinds):
        return
    raise ConfigError(
        f"{out} is not empty and holds no {kinds[0].said}; name a new or an empty folder "
        f"with {flag}"
    )


def claim_entries(out: Path, what: str, ours: Callable[[str], bool], flag: str = "--out") -> None:
    """Refuse a folder that holds other names than those that are written into it.

    Args:
        what: the results are called. ours: whether a name is of one.

    Raises:
        ConfigError: see `claim_folder`.
    """
    nothing = Kind(what, "")
    if out.is_dir() and all(ours(name) for name in os.listdir(out) if not _half_made(name)):
        return
    claim_folder(out, nothing, flag=flag)


def claim_file(file: Path | None, *kinds: Kind, flag: str = "--out") -> None:
    """Refuse a file that exists and is no earlier result of one of the kinds; None is no file.

    Args:
        flag: that names the file; empty where none does.

    Raises:
        ConfigError: it is something else: another file, a folder, a device.
    """
    if file is None:
        return
    try:
        mode = file.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return
    away = "move it elsewhere"
    way = f"name another file with {flag}" if flag else away
    if file.is_dir():
        raise ConfigError(f"{file} is a folder; {f'{flag} names a file' if flag else away}")
    if stat.S_ISLNK(mode):
        return  # the result takes the link's place, and what it leads to stays
    if not stat.S_ISREG(mode):
        raise ConfigError(f"{file} is no ordinary file; {way}")
    if file.stat().st_size and not any(is_ours(file, kind) for kind in kinds):
        raise ConfigError(f"{file} exists and is no {kinds[0].said}; it is kept: {way}")


def mark_export(folder: Path, kind: str, source: Path) -> None:
    """Write down that a folder is an export, and of what."""
    text = json.dumps({"kind": kind, "source": folders.as_text(source.name), "schema": 1})
    (folder / EXPORT.file).write_text(text + "\n", encoding="utf-8")


def png_mark() -> PngInfo:
    """What Pillow writes into a PNG by which `is_ours` knows it."""
    info = PngInfo()
    info.add_text("Software", PNG_MARK)
    return info


def instead(folder: Path) -> str:
    """What a folder holds that was given in place of another: ", but a run (run.json)"."""
    kinds = (ASSET, RUN, COLLECTION, BATCH, RANK, EXPORT, SETUP, MENDED)
    found = next((k for k in kinds if (folder / k.file).is_file()), None)
    if found is None:
        return ""
    article = "an" if found.said[0] in "aeiou" else "a"
    return f", but {article} {found.said} ({found.file})"


def not_a_link(path: Path) -> Path:
    """The path itself.

    Raises:
        ConfigError: it is a link: a part of a result is never written through one.
    """
    if path.is_symlink():
        raise ConfigError(f"{path} is a link, and nothing is written through one; remove it")
    return path


def is_ours(file: Path, kind: Kind) -> bool:
    """Whether an ordinary file holds what a result of the kind does."""
    try:
        if not stat.S_ISREG(file.lstat().st_mode):
            return False
        with file.open("rb") as stream:
            data = stream.read(LIMITS.bytes + 1)
    except OSError:
        return False
    suffix = file.suffix.lower()
    if kind.file == ".html":
        return f'name="generator" content="{PNG_MARK}"'.encode() in data[: 1 << 12]
    if kind.file == ".png":
        return data.startswith(b"\x89PNG") and f"Software\0{PNG_MARK}".encode() in data[: 1 << 12]
    if kind.file == ".mp4":
        return data[4:8] == b"ftyp" and PNG_MARK.encode() in data
    if kind.file == "settings.txt":
        return data.startswith(b'{"assets"')
    return suffix == Path(f"x{kind.file}").suffix and holds(data, suffix, kind.keys)


def holds(data: bytes, suffix: str, keys: tuple[str, ...]) -> bool:
    """Whether JSON, YAML or CSV has these keys at its top."""
    try:
        text = data.decode("utf-8")
        if suffix == ".csv":
            return tuple(next(csv.reader([text.partition("\n")[0]]))[: len(keys)]) == keys
        if suffix == ".jsonl":
            text, suffix = text.partition("\n")[0], ".json"
        values: Any = json.loads(text) if suffix == ".json" else parse_yaml(text).values
    except (ValueError, RecursionError, ConfigError, StopIteration, csv.Error):
        return False
    return isinstance(values, dict) and all(key in values for key in keys)


def _half_made(name: str) -> bool:
    """Whether a name is of what a command of ours is writing, or was when it was killed."""
    return name.startswith(".") and (".partial-" in name or ".old-" in name)
