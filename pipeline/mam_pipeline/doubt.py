"""A doubt about what was read on a photo, and the lines that a person can type to settle it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FLAGS = ("bbox", "mask", "front", "layout", "category", "height", "width", "depth")


@dataclass(frozen=True)
class Doubt:
    """Why a reading needs somebody's word, and what gives it.

    Attributes:
        why: a sentence on the photo, without its full stop.
        read: the panels as `--layout` takes them; "" where they lie neither in rows nor columns.
        options: photo options, as typed, that confirm what was read.
        others: what else it may be, in words, to the options that say so.
        notes: sentences on what can be typed.
    """

    why: str
    read: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    others: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def told(self, photo: Path | str, given: Mapping[str, Any], out: Path | None = None) -> str:
        """The doubt, what was read, the line that confirms it, and the page to click on.

        Args:
            photo: as the user wrote it. given: the user's own photo options, which stay.
            out: the folder that the asset is written to, where the user named one.
        """
        unread = "What was read cannot be said in rows or columns."
        lines = [f"{photo}: {self.why}.", f"Read: {self.read}." if self.read else unread]
        if self.read:
            lines.append("If that is right, type this as it is; if not, put it right in the line:")
            lines.append(_line(photo, {**given, **self.options}, out))
        for words, options in self.others.items():
            lines += [f"{words}:", _line(photo, {**given, **options}, out)]
        lines += [*self.notes, "Or put it right by clicks:", marking_line(photo)]
        return "\n".join(lines)


def marking_line(photo: Path | str) -> str:
    """The command that opens a photo's page."""
    return f"  {shlex.join(['mam-sim', 'studio', str(photo)])}"


def _line(photo: Path | str, options: Mapping[str, Any], out: Path | None) -> str:
    words = ["mam-sim", "make-env", str(photo)]
    for flag in FLAGS:
        value = options.get(flag)
        if value is not None:
            many = isinstance(value, list | tuple)
            words += [f"--{flag}", ",".join(map(str, value)) if many else str(value)]
    words += [] if out is None else ["--out", str(out)]
    return f"  {shlex.join(words)}"
