"""Trains the network of mobility, which the bar of abstention asks: docs/lab-notebook/network.md.

    python -m mam_training.articulation.train configs/train/network.yaml

Recipe: (1) generated objects in every style, abstract mechanisms, objects in which nothing moves,
some fused surfaces, and objects of other sources (folders of URDFs), each through the real
segmenter and probing, become one file, `corpus.safetensors`; (2) a network on all of them, and for
each other source one without it, by which the bar of abstention is fitted and which says what the
network knows of a source that it never saw; (3) what the engine needs of it is written.

Step 2 takes hours on a CPU and ten minutes on a GPU: there, `python -m
mam_training.articulation.fit` trains one network on the file alone.
"""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.torch import load_file, save_file

from mam_pipeline.ground_truth import list_objects, read_object
from mam_pipeline.parts.mobility_network import MobilityNetwork, read_mobility
from mam_pipeline.types import FloatArray
from mam_training import manifest
from mam_training.articulation.corpus import STEP, Corpus, corpus_of, spread
from mam_training.articulation.fit import Lesson, fit
from mam_training.articulation.items import (
    MOST,
    Item,
    columns,
    gather,
    object_words,
    pack,
    part_words,
    truth_item,
    unpack,
    with_word,
    word_index,
)
from mam_training.articulation.model import Shape
from mam_training.articulation.publish import publish
from mam_training.command import configured
from mam_training.parts.recipe import jobs
from mam_training.sources import GENERATED, OTHERS
from mam_world.splits import iterate_motionless

PRIOR = ("mobility", "affinity")  # columns whose names hold these come from the kinematic prior
WORLD = "world"


@dataclass(frozen=True)
class NetworkTraining:
    """Settings of the training of the network of mobility."""

    objects: int = 22_000
    """Objects of the procedural world and abstract mechanisms: the first of a mixed order."""
    motionless: int = 1000
    """Objects in which nothing moves."""
    fused: int = 600
    """Fused objects, each of which is seen twice in a pass."""
    loose: float = 0.5
    """Share of those that are not fused that is modelled loosely."""
    blocks: float = 0.4
    """Share of those that are not fused that is built of blocks."""
    others: tuple[Path, ...] = OTHERS
    """Folders of URDF objects of other sources."""
    times: tuple[int, ...] = (12, 6, 1)
    """How often their objects are seen in a pass."""
    fused_times: tuple[int, ...] = (4, 2, 0)
    """The same of their fused forms; 0: without."""
    width: int = 192
    """Of a token."""
    edge: int = 32
    """Of a pair of tokens."""
    layers: int = 6
    """Of attention."""
    lesson: Lesson = field(default_factory=lambda: Lesson(30.0, average=0.999))
    """How each network is trained."""
    device: str = "cpu"
    """Where it is trained: cpu or cuda."""
    seed: int = 0
    """Of the weights and the order."""
    cache: Path = Path("build/network")
    """Folder that keeps the measured objects, the corpus and the trained networks."""
    out: Path = Path("build/weights/parts/mobility")
    """Folder that gets the network and a manifest."""


def main(argv: Sequence[str] | None = None) -> None:
    """Make the corpus, train, report and write the network."""
    config = configured(NetworkTraining(), argv)
    file = config.cache / "corpus.safetensors"
    if not file.exists():
        prepare(config, file)
    corpus, about = Corpus.load(file)
    shape = Shape(
        corpus.unary.shape[1], corpus.pair.shape[1], len(about["object_words"]),
        len(about["part_words"]), config.width, config.edge, layers=config.layers,
    )  # fmt: skip
    scores = {}
    for source in (None, *about["sources"][1:]):
        name = "network" if source is None else f"without_{source}"
        path = config.cache / f"{name}.safetensors"
        if not path.exists():
            part = corpus if source is None else corpus.without(about["sources"].index(source))
            net = fit(part.to(config.device), shape, about["prior"], config.lesson, config.seed)
            save_file({k: v.cpu().half() for k, v in net.state_dict().items()}, str(path))
        publish(load_file(str(path)), about, config.cache / f"{name}.npz")
        if source is not None:
            trained = read_mobility(config.cache / f"{name}.npz")
            rows = np.flatnonzero((corpus.source == about["sources"].index(source)).numpy())
            scores[source] = right(trained, corpus, rows)
    print(json.dumps(scores, indent=1), file=sys.stderr)
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "network.npz").write_bytes((config.cache / "network.npz").read_bytes())
    manifest.write(
        config.out, "python -m mam_training.articulation.train configs/train/network.yaml",
        config, {"network": config.seed},
        {"objects": len(corpus), "of other sources": int((corpus.source > 0).sum()),
         "share of the surface that a network without the source judges rightly": scores,
         "sha256": manifest.data_digest([file.read_bytes()])},
        [GENERATED, *(folder.name for folder in config.others)],
    )  # fmt: skip


def right(
    trained: MobilityNetwork, corpus: Corpus, rows: Sequence[int] | NDArray[np.integer]
) -> float:
    """Mean share of the objects' surface of which it says rightly whether it moves."""
    out = []
    for k in rows:
        found = said_of(trained, corpus, k)
        own = slice(int(corpus.first[k]), int(corpus.first[k + 1]))
        truth = corpus.subtype[own].numpy() >= 0
        out.append(float(np.average((found > 0.5) == truth, weights=corpus.area[own].numpy())))
    return round(float(np.mean(out)), 4)


def said_of(trained: MobilityNetwork, corpus: Corpus, k: int) -> FloatArray:
    """(P,) chance of every primitive of object `k` that it moves."""
    own = slice(int(corpus.first[k]), int(corpus.first[k + 1]))
    pairs = slice(int(corpus.edge[k]), int(corpus.edge[k + 1]))
    return trained.answer(
        corpus.unary[own].float().numpy() * STEP, corpus.pair[pairs].float().numpy() * STEP,
        corpus.ends[pairs].long().numpy(), corpus.geometry[own].float().numpy(),
        bool(corpus.fused[k]),
    )  # fmt: skip


def prepare(config: NetworkTraining, file: Path) -> None:
    """Measure all objects and write them as one corpus."""
    pool = jobs("train", 9000, 8000, 0, 5000), jobs("train", 0, 0, 1600)
    still = [(kind, seed, False) for kind, seed in iterate_motionless("train", config.motionless)]
    items: list[Item] = []
    times: list[int] = []
    sources: list[int] = []
    for name, some, most, often in (
        ("authored", pool[0], config.objects, 1), ("still", still, config.motionless, 1),
        ("fused", [job for job in pool[1] if job[2]], config.fused, 2),
    ):  # fmt: skip
        random.Random(0).shuffle(some)
        for path in gather(some[:most], config.cache / name, config.loose, config.blocks):
            found = [with_word(item) for item in unpack(path)]
            items, times = items + found, times + [often] * len(found)
    sources = [0] * len(items)
    for k, folder in enumerate(config.others):
        for fused, often in ((False, config.times[k]), (True, config.fused_times[k])):
            found = source_items(folder, config.cache, fused) if often else []
            found = [item for item in found if len(item.area) <= MOST]
            items, times = items + found, times + [often] * len(found)
            sources += [k + 1] * len(found)
    rng = np.random.default_rng(0)
    some_items = [items[k] for k in rng.permutation(len(items))[:3000]]
    scales = [
        spread(np.concatenate([i.unary for i in some_items])),
        spread(np.concatenate([i.pair for i in some_items]).astype(np.float32)),
    ]
    prior = [
        np.flatnonzero([any(p in name for p in PRIOR) for name in names]).tolist()
        for names in columns()
    ]
    corpus_of(items, scales, times, sources).save(file, {
        "sources": [WORLD, *(folder.name for folder in config.others)],
        "object_words": list(object_words()), "part_words": list(part_words()), "prior": prior,
        "scales": [scale.tolist() for scale in scales], "columns": [list(c) for c in columns()],
    })  # fmt: skip


def source_items(folder: Path, cache: Path, fused: bool) -> list[Item]:
    """The objects of a folder of URDFs, with the words of their categories."""
    path = cache / f"source_{folder.name}{'_fused' if fused else ''}.pack"
    known = {name: (category, urdf) for name, category, urdf in list_objects(folder)}
    if not path.exists():
        truths = (read_object(urdf, name, kind) for name, (kind, urdf) in known.items())
        made = [truth_item(truth, folder.name, fused) for truth in truths]
        pack([item for item in made if item is not None], path)

    def word(item: Item) -> int:
        name = item.name.removesuffix("_f")
        return word_index(known[name][0]) or word_index(name.split("__")[-1])

    return [replace(item, word=word(item)) for item in unpack(path)]


if __name__ == "__main__":
    main()
