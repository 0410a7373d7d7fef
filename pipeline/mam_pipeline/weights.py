"""Where learned weights lie, and what each was trained on.

The weights of a room lie in the package, as `mam_pipeline/parts/weights/mobility`. The environment
variable MAM_SIM_WEIGHTS names a folder whose weights stand in for them: `parts/mobility` in it is
read instead, where it is there. So one engine is measured with other weights, for example with
those that never saw an object of the source it is measured on.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from mam_pipeline.digests import bytes_digest
from mam_pipeline.errors import ConfigError

VARIABLE = "MAM_SIM_WEIGHTS"
MANIFEST = "manifest.json"
_read: set[str] = set()


@dataclass(frozen=True)
class Learned:
    """One folder of weights.

    Attributes:
        room: its name, as `parts/mobility` or `joints`.
        trained_on: the sources of its training objects: "generated", or the name of a dataset's
            folder.
        reproducible: whether a command makes it again.
        digest: of its manifest, which holds a digest of every file.
    """

    room: str
    trained_on: tuple[str, ...]
    reproducible: bool
    digest: str


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


def open_weights(room: str) -> Traversable:
    """The same folder, of which the caller is about to read: `weights_read` names it from now."""
    _read.add(room)
    return place_of(room)


def weights_read() -> tuple[str, ...]:
    """Rooms whose weights this process has read so far, sorted."""
    return tuple(sorted(_read))


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
            bytes_digest(content),
        ))  # fmt: skip
    return out
