"""Trains the network of parts, which the engine does not ask yet: docs/lab-notebook/network.md.

    python -m mam_training.articulation.train configs/train/network.yaml

Recipe: (1) generated objects in every style, abstract mechanisms, objects in which nothing moves,
and some as fused surfaces, each through the real segmenter and probing; (2) a network on these;
(3) it goes on with objects of other sources among them (folders of URDFs, `others`), each seen
several times in a pass; (4) its weights are written. With `leave_out` one of the sources is kept
for the report, which says what the network scores on objects of a source that it never saw.
"""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mam_pipeline.ground_truth import list_objects, read_object
from mam_training import manifest
from mam_training.articulation.batches import DRAW, NAMED, NOTHING, WORD
from mam_training.articulation.fit import Lesson, fit, report
from mam_training.articulation.items import (
    MOST,
    Item,
    gather,
    pack,
    truth_item,
    unpack,
    with_word,
    word_index,
)
from mam_training.articulation.publish import publish
from mam_training.command import configured
from mam_training.parts.recipe import jobs
from mam_world.splits import iterate_motionless

DRAWS = {"nothing told": NOTHING, "its word": WORD, "its parts' words": NAMED}


@dataclass(frozen=True)
class NetworkTraining:
    """Settings of the training of the network of parts."""

    objects: int = 11_400
    """Objects of the procedural world and abstract mechanisms: the first of a mixed order."""
    motionless: int = 1000
    """Objects in which nothing moves."""
    fused: int = 600
    """Fused objects."""
    loose: float = 0.5
    """Share of those that are not fused that is modelled loosely."""
    blocks: float = 0.4
    """Share of those that are not fused that is built of blocks."""
    validation: int = 200
    """Objects of held-back kinds that are reported."""
    others: tuple[Path, ...] = ()
    """Folders of URDF objects of other sources that are learned from at the end."""
    times: int = 5
    """How often these are seen for each time that a generated object is."""
    leave_out: Path | None = None
    """One of `others` that is not learned from but reported."""
    first: Lesson = field(default_factory=lambda: Lesson(12.0))
    """The first part of the training."""
    second: Lesson = field(default_factory=lambda: Lesson(3.0, rate=5e-4))
    """The part in which other sources are among the objects."""
    seed: int = 0
    """Of the weights and the order."""
    cache: Path = Path("build/network_items")
    """Folder that keeps measured objects, and the weights of the first part."""
    out: Path = Path("build/network")
    """Folder that gets the network and a manifest."""


def main(argv: Sequence[str] | None = None) -> None:
    """Make the items, train, report and write the network."""
    config = configured(NetworkTraining(), argv)
    pool = jobs("train", 9000, 8000, 0, 5000), jobs("train", 0, 0, 1600)
    still = [(kind, seed, False) for kind, seed in iterate_motionless("train", config.motionless)]
    packs: list[Path] = []
    for name, some, most in (
        ("authored", pool[0], config.objects), ("fused", pool[1], config.fused),
        ("still", still, config.motionless),
    ):  # fmt: skip
        random.Random(0).shuffle(some)
        packs += gather(some[:most], config.cache / name, config.loose, config.blocks)
    items = [with_word(item) for path in packs for item in unpack(path)]
    held = jobs("validation", config.validation, 0, 0)
    tests = {"kinds held back": [
        with_word(item) for path in gather(held, config.cache / "validation", 0.0, 0.0)
        for item in unpack(path)
    ]}  # fmt: skip
    trained = fit(items, config.first, DRAW, config.seed)
    rows = report(trained, tests, DRAWS)
    real: list[Item] = []
    for folder in config.others:
        found = source_items(folder, config.cache)
        if folder == config.leave_out:
            tests[folder.name] = found
        else:
            real += [item for item in found if len(item.area) <= MOST]
    if real:
        rows = {f"before, {k}": v for k, v in report(trained, tests, DRAWS).items()}
        trained = fit(items + real * config.times, config.second, DRAW, config.seed, trained)
        rows |= report(trained, tests, DRAWS)
    print(json.dumps(rows, indent=1), file=sys.stderr)
    publish(trained, config.out)
    digest = manifest.data_digest(path.name.encode() + path.read_bytes() for path in packs)
    manifest.write(
        config.out, "python -m mam_training.articulation.train configs/train/network.yaml",
        config, {"network": config.seed},
        {"items": len(items), "of other sources": len(real), "sha256": digest, "scores": rows},
    )  # fmt: skip


def source_items(folder: Path, cache: Path) -> list[Item]:
    """The objects of a folder of URDFs, with the words of their categories."""
    path = cache / f"source_{folder.name}.pack"
    known = {name: (category, urdf) for name, category, urdf in list_objects(folder)}
    if not path.exists():
        truths = (read_object(urdf, name, kind) for name, (kind, urdf) in known.items())
        made = [truth_item(truth, folder.name, fused=False) for truth in truths]
        pack([item for item in made if item is not None], path)
    return [
        replace(item, word=word_index(known[item.name][0]) or word_index(item.name.split("__")[-1]))
        for item in unpack(path)
    ]


if __name__ == "__main__":
    main()
