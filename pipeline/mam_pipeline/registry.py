"""Names of things that people add (backends, robots, tasks, algorithms), and where their code is.

A table holds "module:attribute" strings, so listing names imports nothing. A package of somebody
else's adds a name through an entry point of the group; built-in names cannot be replaced.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from typing import Any

from mam_pipeline.errors import BackendError, MamSimError, unknown_name


@dataclass(frozen=True)
class Registry:
    """One kind of thing and its names.

    Attributes:
        kind: what it is, in the singular, as error messages say it ("robot").
        builtin: name to "module:attribute".
        group: entry-point group in which other packages add names; "mam_sim.<kind>" if empty.
    """

    kind: str
    builtin: Mapping[str, str]
    group: str = ""

    def targets(self) -> dict[str, str]:
        """All names with their "module:attribute", those of other packages last."""
        table = dict(self.builtin)
        for entry in installed(self.group or f"mam_sim.{self.kind}"):
            table.setdefault(entry.name, entry.value)
        return table

    def check(self, name: str) -> None:
        """Refuse a name that is not in the table; nothing is imported.

        Raises:
            ConfigError: no such name; the nearest and all others are named.
        """
        table = self.targets()
        if name not in table:
            raise unknown_name(self.kind, name, table)

    def load(self, name: str) -> Any:
        """Import what `name` stands for.

        Raises:
            ConfigError: no such name; the nearest and all others are named.
            BackendError: it cannot be imported.
        """
        self.check(name)
        return resolve(self.targets()[name], f"the {self.kind} {name!r}")


def installed(group: str) -> metadata.EntryPoints:
    """What the installed packages add to an entry-point group."""
    return _all(tuple(sys.path)).select(group=group)


@lru_cache(maxsize=1)
def _all(_path: tuple[str, ...]) -> metadata.EntryPoints:
    """All entry points; finding them reads a file of every package in `_path`."""
    found: metadata.EntryPoints = metadata.entry_points()  # type: ignore[assignment]
    return found


def resolve(target: str, what: str) -> Any:
    """The object that a "module:attribute" string names.

    Args:
        what: it is, as the subject of a sentence.

    Raises:
        BackendError: it cannot be imported, whatever its own code raised.
    """
    module, _, attribute = target.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except MamSimError:
        raise
    except Exception as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise BackendError(
            f"{what} is registered as {target}, which cannot be imported: {said}"
        ) from error
