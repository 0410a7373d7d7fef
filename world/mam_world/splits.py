"""Train, validation and test: fixed by seed, and by categories that are held back entirely."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from mam_pipeline.errors import unknown_name
from mam_world.object import WorldObject, make_object
from mam_world.registry import CATEGORIES, motionless

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = ("train", "validation", "test")
# held back from all training: what is trained is chosen by them. Of the eight families that were
# written last (`cooking` to `park`) the second kind and the sixth, as first drafted
VALIDATION_ONLY = frozenset({
    "rice_cooker", "miter_saw", "excavator", "ottoman_bench", "window_shutters", "flatbed_scanner",
    "egg_beater", "water_pump",
})  # fmt: skip
TEST_ONLY = frozenset({
    "wood_stove", "hole_punch", "wheelchair", "lazy_susan", "vault_door", "radio_set",
    "hinged_case", "pinball",
})  # fmt: skip
# kinds in which nothing moves, held back in the same way
MOTIONLESS_TEST_ONLY = frozenset({"hydrant", "animal", "bench", "spanner", "fixed_lamp", "stool"})
# of ten seeds in a row, the last two are kept for validation and test
_OF_TEN: dict[int, Split] = {8: "validation", 9: "test"}


def split_of(category: str, seed: int) -> Split:
    """The split that an object belongs to."""
    if category in TEST_ONLY or category in MOTIONLESS_TEST_ONLY:
        return "test"
    if category in VALIDATION_ONLY:
        return "validation"
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
    yield from _rounds(names, split, count, start)


def iterate_motionless(
    split: str, count: int | None = None, start: int = 0
) -> Iterator[tuple[str, int]]:
    """The same of objects in which nothing moves; see `iterate`."""
    if split not in SPLITS:
        raise unknown_name("split", split, SPLITS)
    names = [n for n in motionless() if split == "test" or n not in MOTIONLESS_TEST_ONLY]
    yield from _rounds(names, split, count, start)


def iterate_unseen(count: int | None = None, start: int = 0) -> Iterator[tuple[str, int]]:
    """The same of the kinds that are held back for the test alone, those that never move too."""
    yield from _rounds(sorted(TEST_ONLY | MOTIONLESS_TEST_ONLY), "test", count, start)


def _rounds(
    names: list[str], split: str, count: int | None, start: int
) -> Iterator[tuple[str, int]]:
    """Round after round over some categories, the seeds of a split in turn."""
    yielded, block = 0, start
    while True:
        # one seed of every category in turn: ten seeds hold at least one of each split
        for name in names:
            for seed in range(block, block + 10):
                if _OF_TEN.get(seed % 10, "train") != split:
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
