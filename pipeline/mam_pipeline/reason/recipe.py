"""Which objects the reasoner is trained on, and their examples in a cache folder."""

from __future__ import annotations

import sys
import time
import zlib
from pathlib import Path

from mam_pipeline.reason.corpus import (
    FUSED,
    LOOSE,
    generated_example,
    object_name,
    save_example,
)
from mam_pipeline.world.object import generator
from mam_pipeline.world.splits import iterate

FUSED_FROM = 200_000  # seeds of fused objects begin here, so that none is seen twice
# cases and mechanisms vary most, so they come most often
MIX = (
    "abstract_case", "abstract_mechanism", "abstract_case", "abstract_lidded",
    "abstract_mechanism", "abstract_case", "abstract_console", "abstract_doorway",
    "abstract_mechanism", "abstract_case", "abstract_vehicle", "abstract_mechanism",
    "abstract_case", "abstract_console", "abstract_doorway", "abstract_lidded",
    "abstract_tracks", "abstract_sash", "abstract_slot", "abstract_plunger", "abstract_keys",
    "abstract_leaf", "abstract_opened", "abstract_tap", "abstract_board", "abstract_tracks",
    "abstract_sash", "abstract_slot", "abstract_plunger", "abstract_keys", "abstract_leaf",
    "abstract_opened", "abstract_tap", "abstract_board", "abstract_several", "abstract_leaf",
    "abstract_several", "abstract_console", "abstract_several", "abstract_doorway",
    "abstract_several", "abstract_leaf", "abstract_several", "abstract_console",
    "abstract_opening", "abstract_clutter", "abstract_opening", "abstract_arm", "abstract_opening",
    "abstract_opening", "abstract_clutter", "abstract_opening", "abstract_clutter", "abstract_arm",
    "abstract_opening", "abstract_clutter", "abstract_opening", "abstract_arm", "abstract_opening",
    "abstract_opening", "abstract_clutter", "abstract_arm",
)  # fmt: skip
FOLDS = 3  # of the cross-fitting
Job = tuple[str, int, bool]  # kind, seed, fused


def jobs(split: str, world: int, abstract: int, fused: int) -> list[Job]:
    """What a split consists of: the world's categories, abstract kinds, and both as one skin."""
    plain: list[Job] = [(kind, seed, False) for kind, seed in iterate(split, world)]
    plain += [(kind, seed, False) for kind, seed in _abstract(split, abstract)]
    skins: list[Job] = [
        (kind, seed, True) for kind, seed in iterate(split, 3 * fused // 4, start=FUSED_FROM)
    ]
    skins += [(k, seed + FUSED_FROM, True) for k, seed in _abstract(split, fused - len(skins))]
    return plain + skins


def _abstract(split: str, number: int) -> list[tuple[str, int]]:
    first = 0 if split == "train" else 1_000_000
    return [(MIX[n % len(MIX)], first + n) for n in range(number)]


def gather(wanted: list[Job], cache: Path, loose: float = 0.0) -> list[Path]:
    """Make the examples, or find them in the cache; an object that fails is skipped.

    Args:
        loose: share of the objects that are not fused that are modelled loosely.
    """
    out, started = [], time.time()
    for kind, seed, fused in wanted:
        slack = not fused and generator(kind, seed, stream=5).random() < loose
        path = cache / f"{object_name(kind, seed, fused, slack)}.ex"
        if not path.exists():
            try:
                save_example(generated_example(kind, seed, fused, slack), path)
            except Exception as error:  # one bad object must not end an hour of work
                print(f"skipped {path.stem}: {error!r}", file=sys.stderr)
                continue
        out.append(path)
    print(f"{len(out)} examples, {time.time() - started:.0f} s", file=sys.stderr)
    return out


def fold_of(name: str) -> int:
    """The cross-fitting fold of an object: one for all of its kind, among fused ones its own.

    What is learned from models that never saw the kind is learned about new kinds. Of fused objects
    there are too few of every kind to do without any of them.
    """
    same = name if name.endswith(FUSED) else name.removesuffix(LOOSE).rsplit("_", 1)[0]
    return zlib.crc32(same.encode()) % FOLDS
