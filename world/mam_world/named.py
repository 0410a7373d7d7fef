"""Names of a file's nodes as people write them: true, of no use, or false.

Half of the objects have names that tell their parts (in several languages and styles, with some
nameless); of the others half have an exporter's numbers, and half have names that are given to the
wrong pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mam_pipeline.evidence.kinds import kinds
from mam_world.ground_truth import GroundTruth
from mam_world.object import generator

TRUE = 0.5  # share of objects whose names mean their parts
NAMELESS = 0.2  # share of parts without a word in such an object
_STREAM = 9  # of the object's random numbers
_BASES = ("body", "base", "frame", "cabinet", "Korpus", "corps", "cuerpo", "corpo", "机身", "main")
_NUMBERED: tuple[Callable[[int], str], ...] = (
    lambda k: f"Cube.{k:03d}", lambda k: f"Object_{k}", lambda k: f"mesh_{k:03d}",
    lambda k: f"polySurface{k}", lambda k: f"Component#{k}", lambda k: f"Gruppe {k}",
)  # fmt: skip


def with_names(truth: GroundTruth) -> GroundTruth:
    """The object with a node for every link, named truly or not; the same for one id every time."""
    seed = int(truth.id.rpartition("_")[2])
    rng = generator(truth.category, seed, _STREAM)
    number = _NUMBERED[int(rng.integers(len(_NUMBERED)))]
    linked = [link.kind for link in truth.links]
    names = [
        number(k) if k and rng.random() < NAMELESS else _named(kind, k, rng)
        for k, kind in enumerate(linked)
    ]
    sort = rng.random()
    if sort >= TRUE:
        names = (
            [number(k) for k in range(len(linked))]
            if sort < TRUE + 0.5 * (1.0 - TRUE)
            else [names[i] for i in np.roll(np.arange(len(names)), int(rng.integers(1, 3)))]
        )
    names = [f"{name}.{k:03d}" if name in names[:k] else name for k, name in enumerate(names)]
    mesh = replace(truth.mesh, face_group=truth.face_link, group_names=tuple(names))
    return replace(truth, mesh=mesh)


def _named(kind: str, index: int, rng: np.random.Generator) -> str:
    """A name that means a part of this kind."""
    if index == 0:
        word = str(rng.choice(_BASES))
    else:
        synonyms = [w for w, (k, _) in kinds().part_words.items() if k == kind]
        word = str(rng.choice(synonyms)) if synonyms and rng.random() < 0.6 else kind
    side = str(rng.choice(["", "", "left", "Right", "top", "1", "02"]))
    style = int(rng.integers(5))
    if style == 0:
        return f"{word}{side.capitalize()}"
    if style == 1:
        return f"{word}_{side}" if side else word
    if style == 2:
        return f"SM_{word.capitalize()}.{int(rng.integers(100)):03d}"
    return f"{word} {side}".strip() if style == 3 else word.upper()
