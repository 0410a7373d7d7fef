"""The errors of mam-sim: one root, one subclass per person who must act."""

from __future__ import annotations

import difflib
import errno
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mam_pipeline.secrets import masked


class MamSimError(Exception):
    """Root of every error that mam-sim raises on purpose; `exit_code` is the process status.

    Secrets are masked in what it says, whoever repeated them.
    """

    exit_code = 1

    def __str__(self) -> str:
        return masked(super().__str__())


class InputError(MamSimError):
    """The user's file cannot be used: missing, empty, unreadable, malformed."""

    exit_code = 2


class ConfigError(MamSimError):
    """A flag, a configuration key or a hints file is wrong."""

    exit_code = 2


class BackendError(MamSimError):
    """A backend named by the user is missing, failed or answered nonsense."""

    exit_code = 2


class NotPhysicalError(MamSimError):
    """The geometry allows no physical articulation, or nothing movable was found."""

    exit_code = 1


class _PictureError(MamSimError):
    """An error that can show what was seen: `pictures` maps names to (H, W, 3) uint8 RGB."""

    def __init__(self, message: str, pictures: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.pictures = dict(pictures or {})


class HintNeeded(_PictureError):
    """Confidence is too low to go on; the message names the hint that would help most.

    `draft` is the asset folder that was made all the same, for looking at; None where none was.
    """

    exit_code = 3

    def __init__(
        self, message: str, pictures: Mapping[str, Any] | None = None, draft: Path | None = None
    ) -> None:
        super().__init__(message, pictures)
        self.draft = draft


class NotThisKind(_PictureError):
    """The input shows a thing that this tool cannot handle (a face, a plain wall ...)."""

    exit_code = 4


_DISK = {
    errno.ENOSPC: "the disk is full at {}; make room there, or name a place on another disk",
    errno.EDQUOT: "your share of the disk is used up at {}; make room, or name another place",
    errno.EROFS: "{} lies on a disk that cannot be written; name another place",
    errno.EACCES: "you have no right to use {}; change its rights, or name another place",
    errno.EPERM: "you have no right to use {}; change its rights, or name another place",
    errno.ENAMETOOLONG: "the name {} is too long; a name has at most 255 bytes",
    errno.ENOTDIR: "{} leads through a file; a folder is needed there",
    errno.EEXIST: "{} is a file; a folder is needed there",
    errno.EISDIR: "{} is a folder; a file is needed there",
    errno.ENOENT: "there is no {}",
    errno.ELOOP: "the links at {} lead round in a circle",
    errno.EMFILE: "too many files are open ({}); raise the limit with: ulimit -n 4096",
}


def disk_is_full(error: OSError) -> bool:
    """Whether nothing more can be written to the disk, whatever it is."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


def disk_error(error: OSError) -> InputError:
    """What the operating system refused, in a sentence with the way out."""
    said = str(error)
    code = error.errno
    if code is None:  # HDF5 tells its number in words
        found = re.search(r"errno\D{0,4}(\d+)", said, re.I)
        code = int(found[1]) if found else None
    place = error.filename2 or error.filename or "the place that was named"
    place = place.decode(errors="replace") if isinstance(place, bytes) else str(place)
    place = place if len(place) <= 200 else f"{place[:80]}...{place[-40:]}"
    if code in _DISK:
        return InputError(_DISK[code].format(place))
    return InputError(f"{error.strerror or ' '.join(said.split())[:200]} ({place})")


FEW = 40  # names that a message can list


def unknown_name(what: str, given: str, available: Iterable[str]) -> ConfigError:
    """Build the error for a name that is not in a table, naming the nearest and all others.

    Where there are very many, the nearest is enough.
    """
    names = sorted(available)
    near = difflib.get_close_matches(given, names, n=1)
    if near and len(names) > FEW:
        return ConfigError(f"no {what} named {given!r}; did you mean {near[0]!r}?")
    hint = f"; did you mean {near[0]!r}?" if near else ";"
    return ConfigError(f"no {what} named {given!r}{hint} available: {', '.join(names)}")
