"""Train, validation and test: fixed by seed, and by categories that are held back entirely."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from mam_pipeline.errors import unknown_name
from mam_pipeline.world.object import WorldObject, make_object
from mam_pipeline.world.registry import CATEGORIES

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = ("train", "validation", "test")
# held back: what is trained is chosen by them; only when nothing is left to choose does the
# packaged reasoner learn them too, from seeds of the training split (`reason.recipe.held_back`)
VALIDATION_ONLY = frozenset({"freezer_chest", "window_casement", "kettle", "suitcase", "switch"})
TEST_ONLY = frozenset({"safe", "toaster", "window_sash", "laptop", "stapler", "globe", "cart"})
# of ten seeds in a row, the last two are kept for validation and test
_OF_TEN: dict[int, Split] = {8: "validation", 9: "test"}


def split_of(category: str, seed: int) -> Split:
    """The split that an object belongs to."""
    if category in TEST_ONLY:
        return "test"
    if category in VALIDATION_ONLY:
        return "validation"
    return split_of_seed(seed)


def split_of_seed(seed: int) -> Split:
    """The split that draws objects of a seed, whatever their category.

    Validation and test therefore never draw an object from which `reason.recipe.held_back` learns.
    """
    return _OF_TEN.get(seed % 10, "train")


def iterate(split: str, count: int | None = None, start: int = 0) -> Iterator[tuple[str, int]]:
    """(category, seed) pairs of a split: round after round over the categories, then higher seeds.

    Args:
        count: how many pairs; None goes on for ever.
        start: first seed to look at.

    Raises:
        ConfigError: no such split.
    """
    if split not in SPLITS:
        raise unknown_name("split", split, SPLITS)
    names = [
        n for n in CATEGORIES
        if (split == "test" or n not in TEST_ONLY)
        and (split == "validation" or n not in VALIDATION_ONLY)
    ]  # fmt: skip
    yielded, block = 0, start
    while True:
        # one seed of every category in turn: ten seeds hold at least one of each split
        for name in names:
            for seed in range(block, block + 10):
                if split_of_seed(seed) != split:
                    continue
                if count is not None and yielded >= count:
                    return
                yielded += 1
                yield name, seed
        block += 10


def benchmark(split: str, count: int) -> Iterator[WorldObject]:
    """The first `count` objects of a split, made one by one: `mam-sim bench generated:SPLIT`."""
    for name, seed in iterate(split, count):
        yield make_object(name, seed)
