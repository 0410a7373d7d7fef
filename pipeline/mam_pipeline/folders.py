"""Files and folders that appear whole or not at all, and what is done with the rest.

Everything is written under a name of its own beside its place, `.NAME.partial-PID`, and renamed
when it is whole. What a killed process left is swept by the next one that writes to the same
place; what a stopped process has under construction goes with `clean_up`.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_LONGEST = 180
"""Bytes of a name that is kept in the name of its partial file; file systems allow 255."""
_FULL = 1 << 20
"""Bytes: a disk with less is full."""
_building: set[Path] = set()


@contextmanager
def work_folder(out: Path) -> Iterator[Path]:
    """A fresh folder beside `out`; it is gone afterwards, whatever happens.

    Folders above `out` are made, and taken away again where nothing came into them.
    """
    out = out.absolute()
    made = _missing(out.parent)
    work = _beside(out, "partial")
    _building.add(work)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        sweep(out)
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        with _full_disk_said(work):
            yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)
        _building.discard(work)
        for folder in made:
            with suppress(OSError):  # something is in it
                folder.rmdir()


@contextmanager
def used_folder(out: Path) -> Iterator[None]:
    """Make a folder; it, and those above it that were made, go again where nothing came in."""
    made = _missing(out.absolute())
    try:
        out.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for folder in made:
            with suppress(OSError):  # something is in it
                folder.rmdir()


def check_place(out: Path) -> None:
    """Try to write beside `out`, so that what the disk refuses is said before any work is done.

    Raises:
        OSError: it cannot be done.
    """
    with work_folder(out):
        pass


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A fresh folder that takes the place of `out`, and of what is there, once it is whole."""
    with work_folder(out) as work:
        yield work
        put_in_place(work, out)


@contextmanager
def new_entries(out: Path, name: str) -> Iterator[Path]:
    """A fresh folder whose entries go into the folder `out` once all are whole.

    Entries of the same names are replaced; what else is in `out` stays.

    Args:
        out: the folder. name: of one of the entries; the fresh folder is named after it.
    """
    with work_folder(out / name) as work:
        yield work
        for entry in sorted(work.iterdir(), key=lambda p: (p.is_file(), p.name)):
            if entry.is_dir():
                put_in_place(entry, out / entry.name)
            else:
                os.replace(entry, out / entry.name)


def put_in_place(new: Path, out: Path) -> None:
    """Rename the folder `new` to `out`; what was there goes aside first and is deleted last."""
    out = out.absolute()
    out.parent.mkdir(parents=True, exist_ok=True)
    old = _beside(out, "old")
    try:
        if out.exists():
            out.rename(old)
        new.rename(out)
    except BaseException:
        if old.exists() and not out.exists():
            old.rename(out)
        raise
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def new_file(file: Path) -> Iterator[Path]:
    """A path to write to, of the same suffix; it takes the place of `file` once it is whole."""
    file = file.absolute()
    part = _beside(file, "partial")
    part = part.with_name(part.name + file.suffix)  # writers look at it
    _building.add(part)
    try:
        sweep(file)
        with _full_disk_said(part):
            yield part
            os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)
        _building.discard(part)


def write_text(file: Path, text: str) -> None:
    """Write UTF-8 text, all or nothing."""
    with new_file(file) as part:
        part.write_text(text, encoding="utf-8")


def as_text(name: str) -> str:
    """A file's name as text that can be printed and kept: what is not UTF-8 in it as \\udc.."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def sweep(out: Path) -> None:
    """Remove what dead processes left beside `out`; what one had moved aside comes back."""
    name, suffix = re.escape(_stem(out)), re.escape(out.suffix)
    pattern = re.compile(rf"\.{name}\.(partial|old)-(\d+)(?:{suffix})?")
    try:
        names = os.listdir(out.parent)
    except OSError:
        return
    for name in names:
        found = pattern.fullmatch(name)
        path = out.parent / name
        if found is None or path in _building or _alive(int(found[2])):
            continue
        if found[1] == "old" and not out.exists():
            path.rename(out)
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()


def clean_up() -> None:
    """Remove what this process has under construction; for one that is told to stop."""
    for path in list(_building):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()


def remove_if_empty(folder: Path) -> None:
    """Remove a folder in which there are no files."""
    if folder.is_dir() and not any(p.is_file() or p.is_symlink() for p in folder.rglob("*")):
        shutil.rmtree(folder, ignore_errors=True)


def _beside(out: Path, kind: str) -> Path:
    return out.parent / f".{_stem(out)}.{kind}-{os.getpid()}"


def _stem(out: Path) -> str:
    """The name of `out`, or one of its own that is short enough to be lengthened."""
    data = os.fsencode(out.name)
    if not _LONGEST < len(data) <= 255:  # a name that cannot be is refused by the disk
        return out.name
    return f"{out.name[:40]}-{hashlib.sha256(data).hexdigest()[:12]}"


def _missing(folder: Path) -> list[Path]:
    """The folders that are made for a path, the deepest first."""
    out = []
    while not folder.exists():
        out.append(folder)
        folder = folder.parent
    return out


def _alive(pid: int) -> bool:
    """Whether another process of this number runs."""
    if pid == os.getpid():
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


@contextmanager
def _full_disk_said(path: Path) -> Iterator[None]:
    """Whatever a library makes of a full disk, an OSError comes out that names the place."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path.parent)) from error
    except Exception as error:
        if shutil.disk_usage(path.parent).free < _FULL:
            code = errno.ENOSPC
            raise OSError(code, os.strerror(code), str(path.parent)) from error
        raise
