"""What kind of thing a photo shows, told by a network that was trained on ImageNet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.evidence.kinds import ObjectKind
from mam_pipeline.evidence.kinds import kinds as kinds_of_things
from mam_pipeline.package_data import table
from mam_pipeline.photo import efficientnet
from mam_pipeline.photo.measure import by_proportions
from mam_pipeline.photo.opened import stands_open
from mam_pipeline.photo.options import PhotoOptions

THING = {
    "drawer_unit": "dresser", "file_cabinet": "filingcabinet", "bookcase": "bookshelf",
    "fridge": "refrigerator", "washing_machine": "washer",
}  # fmt: skip
"""Category of size to what the table of kinds calls it, where that is another word."""
LIKELY = 0.35  # from this probability on a kind is named
SHARPER = 1.5  # exponent on the probabilities: the training's label smoothing, undone


@dataclass(frozen=True)
class Looks:
    """What a photo looks like.

    Attributes:
        kinds: kind of thing to its probability, likeliest first; they sum to 1.
        opened: 0..1 that a drawer or door stands open.
    """

    kinds: Mapping[str, float]
    opened: float = 0.0

    @property
    def best(self) -> str:
        """The likeliest kind."""
        return next(iter(self.kinds))

    @property
    def in_scope(self) -> float:
        """0..1 that it is a thing whose front can be read."""
        known = categories()
        return float(sum(p for kind, p in self.kinds.items() if kind in known))

    @property
    def stranger(self) -> tuple[str, float]:
        """The likeliest kind that is out of scope, and its probability.

        Where no kind is likely by itself, the likeliest of what several are together: a room.
        """
        known = categories()
        out = {kind: p for kind, p in self.kinds.items() if kind not in known}
        best = max(out, key=lambda kind: out[kind], default="thing")
        if out.get(best, 0.0) < LIKELY:
            for kind, p in list(out.items()):
                name = wider().get(kind)
                if name is not None:
                    out[name] = out.get(name, 0.0) + p * (name != kind)
            best = max(out, key=lambda kind: out[kind], default="thing")
        return best, out.get(best, 0.0)

    def categories(self) -> dict[str, float]:
        """Category of size to its probability among the things in scope; they sum to 1."""
        out: dict[str, float] = {}
        for kind, p in self.kinds.items():
            for name, share in categories().get(kind, {}).items():
                out[name] = out.get(name, 0.0) + p * share
        total = max(sum(out.values()), 1e-9)
        return {k: v / total for k, v in out.items()}


@dataclass(frozen=True)
class FrontPrior:
    """How often panels of a kind are on fronts that are read without knowing the object.

    Attributes:
        drawer, door, flap: share of such objects that have any; flaps hinge below or above.
        least: no kind of object is taken to have a part less often, or more often than 1 - least.
        weight: exponent on the odds: the table counts what is inside an object too.
    """

    drawer: float = 0.6
    door: float = 0.7
    flap: float = 0.1
    least: float = 0.02
    weight: float = 0.5


PRIOR = FrontPrior()


def front_kinds(things: Mapping[str, float]) -> dict[str, float]:
    """Odds of every kind of panel for an object, over those for a thing that is not known.

    Args:
        things: kind of object, by the table of kinds, to its probability; what is left of 1 is
            not known.

    Returns:
        drawer, door left, door right, door bottom, door top to their odds.
    """
    known = kinds_of_things().objects
    unknown = max(1.0 - sum(things.values()), 0.0)
    out = {}
    for kind in ("drawer", "door left", "door right", "door bottom", "door top"):
        name, _, side = kind.partition(" ")
        usual = PRIOR.flap if side in ("bottom", "top") else getattr(PRIOR, name)
        often = unknown * usual + sum(
            p * _has(known[thing], name, side) for thing, p in things.items()
        )
        often = min(max(often, PRIOR.least), 1.0 - PRIOR.least)
        out[kind] = float((often / (1 - often) * (1 - usual) / usual) ** PRIOR.weight)
    return out


def _has(thing: ObjectKind, name: str, side: str) -> float:
    """How often such a thing has a drawer, or a door or flap with its hinge on a side."""
    names = (name, "flap") if side else (name,)
    mine = [p for p in thing.parts if p.kind in names and (not side or side in p.side)]
    return max((p.often for p in mine), default=0.0)


def things_of(looks: Looks | None, options: PhotoOptions, ratio: float) -> dict[str, float]:
    """Kind of object to its probability, by what somebody says or else by what a photo looks like.

    What it looks like counts by how well the front's proportions suit it: nothing that is three
    times as high as wide is a dishwasher.

    Args:
        options: what a person, a language model or the file's name says that it is.
        ratio: width of the front over its height.
    """
    category, named = options.category, options.things
    if category is not None:
        thing = THING.get(category, category)
        return {thing: max(options.sure("category"), named.get(thing, 0.0))}
    out = dict(named)
    rest = 0.0 if looks is None else looks.in_scope * (1.0 - sum(named.values()))
    seen = {} if looks is None else by_proportions(ratio, looks.categories())
    for name, p in seen.items():
        thing = THING.get(name, name)
        out[thing] = out.get(thing, 0.0) + p * rest
    return out


def look(rgb: NDArray[np.uint8]) -> Looks:
    """Name what a picture (h, w, 3) shows."""
    views = described(rgb)
    p = efficientnet.probabilities(views) ** SHARPER
    p = (p / p.sum(axis=1, keepdims=True)).mean(axis=0)
    names = class_names()
    of_class = {k: name for name, members in kinds().items() for k in members}
    out: dict[str, float] = {}
    for k, value in enumerate(p):
        kind = of_class.get(k, names[k])
        out[kind] = out.get(kind, 0.0) + float(value)
    return Looks(dict(sorted(out.items(), key=lambda item: -item[1])), stands_open(views))


def described(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(2, 1280) descriptions of a picture (h, w, 3): in its proportions, and squeezed."""
    return efficientnet.described(np.stack([_letterbox(rgb), _square(rgb)]))


def _square(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture squeezed to the network's square."""
    side = (efficientnet.SIDE, efficientnet.SIDE)
    return np.asarray(cv2.resize(rgb, side, interpolation=cv2.INTER_AREA), np.uint8)


def _letterbox(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture in its proportions on a grey square."""
    side = max(rgb.shape[:2])
    out = np.full((side, side, 3), 127, np.uint8)
    y, x = (side - rgb.shape[0]) // 2, (side - rgb.shape[1]) // 2
    out[y : y + rgb.shape[0], x : x + rgb.shape[1]] = rgb
    return _square(out)


@lru_cache(maxsize=1)
def _table() -> dict[str, dict[str, Any]]:
    return dict(table("mam_pipeline.photo", "imagenet", "kinds.yaml"))


@lru_cache(maxsize=1)
def class_names() -> tuple[str, ...]:
    """The 1000 names of ImageNet's classes."""
    folder = resources.files("mam_pipeline.photo").joinpath("imagenet", "classes.txt")
    return tuple(folder.read_text(encoding="utf-8").split("\n")[:1000])


@lru_cache(maxsize=1)
def kinds() -> dict[str, tuple[int, ...]]:
    """Kind of thing to the numbers of its ImageNet classes."""
    out: dict[str, tuple[int, ...]] = {}
    for name, row in _table().items():
        span = range(row["first"], row["last"] + 1) if "first" in row else row["classes"]
        out[name] = tuple(span)
    return out


@lru_cache(maxsize=1)
def categories() -> dict[str, dict[str, float]]:
    """Kind of thing in scope to what it may be: categories of size with their shares."""
    return {name: row["categories"] for name, row in _table().items() if "categories" in row}


@lru_cache(maxsize=1)
def wider() -> dict[str, str]:
    """Kind of thing to what it is together with others."""
    return {name: str(row["wider"]) for name, row in _table().items() if "wider" in row}
