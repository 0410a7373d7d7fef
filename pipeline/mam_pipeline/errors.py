"""The errors of mam-sim: one root, one subclass per person who must act."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any


class MamSimError(Exception):
    """Root of every error that mam-sim raises on purpose; `exit_code` is the process status."""

    exit_code = 1


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
    """Confidence is too low to go on; the message names the hint that would help most."""

    exit_code = 3


class NotThisKind(_PictureError):
    """The input shows a thing that this tool cannot handle (a face, a plain wall ...)."""

    exit_code = 4


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
