"""Where learned weights lie, and what each was trained on.

The weights of a room lie in the package: `mam_pipeline/parts/weights/abstention`. The environment
variable MAM_SIM_WEIGHTS names a folder whose weights stand in for them: `parts/abstention` in it is
read instead, where it is there. So one engine is measured with other weights, for example with
those that never saw an object of the source it is measured on.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar, cast

from mam_pipeline.digests import bytes_digest
from mam_pipeline.errors import ConfigError

VARIABLE = "MAM_SIM_WEIGHTS"
MANIFEST = "manifest.json"
T = TypeVar("T")
_asked: ContextVar[set[str] | None] = ContextVar("asked", default=None)


@dataclass(frozen=True)
class Learned:
    """One folder of weights.

    Attributes:
        room: its name, as `parts/abstention` or `joints`.
        trained_on: the sources of its training objects: "generated", or the name of a dataset's
            folder.
        reproducible: whether a command makes it again.
        digest: of its manifest, which holds a digest of every file.
        objects: ids of the training objects, where the manifest names them.
    """

    room: str
    trained_on: tuple[str, ...]
    reproducible: bool
    digest: str
    objects: tuple[str, ...] = ()


def place_of(room: str) -> Traversable:
    """The folder of a room's weights.

    Raises:
        ConfigError: MAM_SIM_WEIGHTS names no folder.
    """
    given = os.environ.get(VARIABLE)
    if given:
        if not Path(given).is_dir():
            raise ConfigError(f"{VARIABLE}={given} names no folder of weights")
        other = Path(given) / room
        if other.is_dir():
            return other
    wing, _, rest = room.partition("/")
    folder = resources.files("mam_pipeline") / wing / "weights"
    return folder / rest if rest else folder


@contextmanager
def standing_in(folder: Path | None) -> Iterator[None]:
    """Inside, the weights of a folder stand in for the packaged ones; None: as it was."""
    old = os.environ.get(VARIABLE)
    try:
        if folder is not None:
            os.environ[VARIABLE] = str(folder.resolve())
        yield
    finally:
        if folder is not None:
            os.environ.pop(VARIABLE)
            if old is not None:
                os.environ[VARIABLE] = old


@contextmanager
def noting() -> Iterator[set[str]]:
    """The rooms whose weights are asked inside, also those that were read before."""
    rooms: set[str] = set()
    token = _asked.set(rooms)
    try:
        yield rooms
    finally:
        _asked.reset(token)


def loaded(room: str, read: Callable[..., T], *options: Any) -> T:
    """What a function makes of a room's weights; it is kept for the next time.

    Args:
        read: a function of a module, of the folder and the options.
    """
    rooms = _asked.get()
    if rooms is not None:
        rooms.add(room)
    return cast(T, _kept(read, cast(Hashable, place_of(room)), *options))


@cache
def _kept(read: Callable[..., Any], place: Traversable, *options: Any) -> Any:
    return read(place, *options)


def learned(rooms: Sequence[str]) -> list[Learned]:
    """What the manifests of rooms say.

    Raises:
        ConfigError: a manifest is missing, or does not say what the weights were trained on.
    """
    out = []
    for room in rooms:
        file = place_of(room) / MANIFEST
        if not file.is_file():
            raise ConfigError(f"the weights of {room} have no {MANIFEST}; {file} is where it goes")
        content = file.read_bytes()
        kept = json.loads(content)
        if not kept.get("trained_on"):
            raise ConfigError(f"{file} does not say `trained_on`, the sources of its objects")
        out.append(Learned(
            room, tuple(kept["trained_on"]), bool(kept.get("reproducible")),
            bytes_digest(content), tuple(kept.get("data", {}).get("ids", ())),
        ))  # fmt: skip
    return out


def rooms() -> list[str]:
    """All rooms of the package that have a manifest, sorted."""
    package = Path(str(resources.files("mam_pipeline")))
    found = [p.parent.relative_to(package).parts for p in package.glob(f"*/weights/**/{MANIFEST}")]
    return sorted("/".join((wing, *rest)) for wing, _, *rest in found)
