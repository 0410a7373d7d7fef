"""Which objects the reasoner is trained on, and their examples in a cache folder."""

from __future__ import annotations

import sys
import time
import zlib
from itertools import islice
from pathlib import Path

from mam_training.parts.corpus import (
    BLOCKS,
    FUSED,
    LOOSE,
    generated_example,
    object_name,
    save_example,
)
from mam_world.object import generator
from mam_world.splits import iterate

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
    "abstract_opening", "abstract_clutter", "abstract_arm", "abstract_machine", "abstract_rolling",
    "abstract_machine", "abstract_boom", "abstract_machine", "abstract_rolling", "abstract_machine",
    "abstract_boom", "abstract_machine", "abstract_fascia", "abstract_lid", "abstract_fascia",
    "abstract_beam", "abstract_fascia", "abstract_lid", "abstract_fascia", "abstract_beam",
    "abstract_fascia", "abstract_lid", "abstract_fascia", "abstract_beam",
)  # fmt: skip
# what stands in homes: large fronts, doors and lids, which most other kinds do not have
HOUSEHOLD = frozenset({
    "chest_of_drawers", "cabinet_one_door", "cabinet_two_door", "cabinet_three_door",
    "storage_mixed", "cabinet_nested_drawers", "cabinet_sliding", "sideboard", "tall_cabinet",
    "bookcase", "wardrobe", "nightstand", "corner_cabinet", "filing_cabinet", "table_with_drawers",
    "desk", "coffee_table", "dressing_table", "fridge", "freezer_upright", "dishwasher", "oven",
    "microwave", "washer_front", "washer_top", "dryer", "door_lever", "door_knob", "door_double",
    "door_sliding", "window_sash", "window_casement", "window_sliding", "safe", "box_with_lid",
    "chest", "kitchen_run", "cooktop_oven", "tool_cabinet", "wall_locker", "secretary_desk",
    "bed_storage", "drop_leaf_table", "medicine_cabinet", "shoe_cabinet", "garage_door",
    "lift_doors", "skylight", "stable_door", "venetian_window", "hatch", "fence_gate", "air_fryer",
    "bread_box", "fuse_box", "vending_machine", "server_rack", "laptop", "toilet", "box_cabinet",
    "box_drawer", "box_door", "box_appliance", "hob", "lamp", "fan",
})  # fmt: skip
HOUSEHOLD_FROM = 700  # seeds of more of these begin here
FOLDS = 3  # of the cross-fitting
Job = tuple[str, int, bool]  # kind, seed, fused


def jobs(split: str, world: int, abstract: int, fused: int, household: int = 0) -> list[Job]:
    """What a split consists of: the world's categories, abstract kinds, and both fused.

    Args:
        household: how many more of the world's objects are of HOUSEHOLD kinds.
    """
    plain: list[Job] = [(kind, seed, False) for kind, seed in iterate(split, world)]
    more = (job for job in iterate(split, start=HOUSEHOLD_FROM) if job[0] in HOUSEHOLD)
    plain += [(kind, seed, False) for kind, seed in islice(more, household)]
    plain += [(kind, seed, False) for kind, seed in _abstract(split, abstract)]
    melted: list[Job] = [
        (kind, seed, True) for kind, seed in iterate(split, 3 * fused // 4, start=FUSED_FROM)
    ]
    melted += [(k, seed + FUSED_FROM, True) for k, seed in _abstract(split, fused - len(melted))]
    return plain + melted


def _abstract(split: str, number: int) -> list[tuple[str, int]]:
    first = 0 if split == "train" else 1_000_000
    return [(MIX[n % len(MIX)], first + n) for n in range(number)]


def loose(kind: str, seed: int, fused: bool, share: float) -> bool:
    """Whether an object is of the `share` of those that are not fused that is modelled loosely."""
    return not fused and bool(generator(kind, seed, stream=5).random() < share)


def blocky(kind: str, seed: int, fused: bool, share: float) -> bool:
    """Whether an object is of the `share` of those that are not fused that is built of blocks."""
    return not fused and bool(generator(kind, seed, stream=8).random() < share)


def gather(wanted: list[Job], cache: Path, share: float = 0.0, blocks: float = 0.0) -> list[Path]:
    """Make the examples, or find them in the cache; an object that fails is skipped.

    Args:
        share, blocks: of the objects that are not fused that are modelled loosely, that are built
            of blocks.
    """
    out, started = [], time.time()
    for kind, seed, fused in wanted:
        manner = loose(kind, seed, fused, share), blocky(kind, seed, fused, blocks)
        path = cache / f"{object_name(kind, seed, fused, *manner)}.ex"
        if not path.exists():
            try:
                save_example(generated_example(kind, seed, fused, *manner), path)
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
    plain = name.removesuffix(LOOSE).removesuffix(BLOCKS)
    same = name if name.endswith(FUSED) else plain.rsplit("_", 1)[0]
    return zlib.crc32(same.encode()) % FOLDS
