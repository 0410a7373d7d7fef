"""Files and folders that appear whole or not at all, and what is done with the rest.

Everything is written under a name of its own beside its place, `.NAME.partial-PID-...`, and renamed
when it is whole. What a killed process left is swept by the next one that writes to the same
place; what a stopped process has under construction goes with `clean_up`. A `Scratch` folder lies
where temporary files do. Folders are locked as long as their process lives, so that the next one
removes those without a lock, whatever number its process has and had.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import mmap
import os
import re
import shutil
import stat
import tempfile
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_LONGEST = 180
"""Bytes of a name that is kept in the name of its partial file; file systems allow 255."""
_CLOCK = 2.0
"""Seconds by which the times of files and processes may differ."""
_FULL = 1 << 20
"""Bytes: a disk with less is full."""
_building: set[Path] = set()


class Scratch(tempfile.TemporaryDirectory[str]):
    """A temporary folder that goes with its process, however that ends.

    It is made and used as `tempfile.TemporaryDirectory` is. What a process that was killed has
    left is removed when the next scratch folder is made.
    """

    def __init__(self) -> None:
        """Make it, after those that nobody holds any more are gone."""
        prefix = f"mam-sim-{os.getuid()}-"
        _sweep_scratch(prefix)
        while True:
            super().__init__(prefix=prefix)
            lock = _locked(Path(self.name))
            if lock is not None and Path(self.name).is_dir():
                break
            if lock is not None:  # another process swept it before it was locked
                os.close(lock)
            self._finalizer.detach()  # type: ignore[attr-defined]
        _begin(Path(self.name))
        weakref.finalize(self, _let_go, Path(self.name), lock, os.getpid())


def _let_go(folder: Path, lock: int, owner: int) -> None:
    if owner == os.getpid():
        os.close(lock)
        _done(folder)


def _sweep_scratch(prefix: str) -> None:
    """Remove the scratch folders of this user that no living process holds."""
    place = Path(tempfile.gettempdir())
    try:
        names = [n for n in os.listdir(place) if n.startswith(prefix)]
    except OSError:
        return
    for name in names:
        with suppress(OSError):
            found = (place / name).lstat()
            if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
                continue
            lock = _locked(place / name)
            if lock is not None:
                shutil.rmtree(place / name, ignore_errors=True)
                os.close(lock)


def _locked(folder: Path) -> int | None:
    """A handle that holds a folder until it is closed; None where another process holds it."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


@dataclass(frozen=True)
class Board:
    """Memory in which a process shows another one what it has under construction.

    Attributes:
        memory: shared with a child that was forked. owner: the process that writes.
    """

    memory: mmap.mmap
    owner: int

    def write(self, paths: set[Path]) -> None:
        """Show these; what has no room is not shown."""
        if os.getpid() != self.owner:
            return
        text = b"".join(os.fsencode(p) + b"\0" for p in list(paths))
        text = text[: len(self.memory) - 1]
        self.memory[: len(text) + 1] = text + b"\0"

    def read(self) -> list[Path]:
        """What is shown."""
        text = self.memory[:].partition(b"\0\0")[0]
        return [Path(os.fsdecode(name)) for name in text.split(b"\0") if name.startswith(b"/")]


_boards: list[Board] = []


def show_on(board: Board) -> None:
    """From now on show on a board what is under construction."""
    _boards[:] = [board]


def _begin(path: Path) -> None:
    _building.add(path)
    for board in _boards:
        board.write(_building)


def _done(path: Path) -> None:
    _building.discard(path)
    for board in _boards:
        board.write(_building)


@contextmanager
def work_folder(out: Path) -> Iterator[Path]:
    """A fresh folder beside `out`; it is gone afterwards, whatever happens.

    Folders above `out` are made, and taken away again where nothing came into them.
    """
    out = out.absolute()
    made = _missing(out.parent)
    work = _beside(out, "partial")
    _begin(work)
    lock = None
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        sweep(out)
        work.mkdir()
        lock = _locked(work)
        with _full_disk_said(work):
            yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)
        _unlock(lock)
        _done(work)
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
    lock = _locked(out)
    try:
        if out.exists():
            out.rename(old)
        new.rename(out)
        shutil.rmtree(old, ignore_errors=True)
    except BaseException:
        if old.exists() and not out.exists():
            old.rename(out)
        raise
    finally:
        _unlock(lock)


@contextmanager
def new_file(file: Path) -> Iterator[Path]:
    """A path to write to, of the same suffix; it takes the place of `file` once it is whole."""
    file = file.absolute()
    part = _beside(file, "partial")
    part = part.with_name(part.name + file.suffix)  # writers look at it
    _begin(part)
    try:
        sweep(file)
        with _full_disk_said(part):
            yield part
            os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)
        _done(part)


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
    for path, found in _left(out.parent, name, suffix):
        if not path.is_dir() or path.is_symlink():
            if not _written_by(int(found["pid"]), path):
                with suppress(OSError):
                    path.unlink()
            continue
        lock = _locked(path)
        if lock is None:  # its process lives
            continue
        if found["kind"] == "old" and not out.exists():
            path.rename(out)
        else:
            shutil.rmtree(path, ignore_errors=True)
        _unlock(lock)


def sweep_inside(folder: Path) -> None:
    """Sweep beside every name in a folder of which something was left."""
    for name in {found["of"] for _, found in _left(folder, ".+", ".*")}:
        sweep(folder / name)


def _left(folder: Path, name: str, suffix: str) -> list[tuple[Path, re.Match[str]]]:
    """What other processes left, by patterns, and what its name tells."""
    pattern = re.compile(
        rf"\.(?P<of>{name})\.(?P<kind>partial|old)-(?P<pid>\d+)(?:-[0-9a-f]+)?(?:{suffix})?"
    )
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    found = [(folder / n, m) for n in names if (m := pattern.fullmatch(n))]
    return [row for row in found if row[0] not in _building]


def clean_up() -> None:
    """Remove what this process has under construction; for one that is told to stop."""
    remove(list(_building))


def remove(paths: list[Path]) -> None:
    """Remove files and folders, as far as they are there."""
    for path in paths:
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
    return out.parent / f".{_stem(out)}.{kind}-{os.getpid()}-{os.urandom(4).hex()}"


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


def _unlock(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def _written_by(pid: int, file: Path) -> bool:
    """Whether the process that has this number now may be writing a file: it is the older one."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - int(words[19]) / os.sysconf("SC_CLK_TCK")
        return time.time() - file.lstat().st_ctime < age + _CLOCK
    except (OSError, IndexError, ValueError):  # one of the two is gone
        return False


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
