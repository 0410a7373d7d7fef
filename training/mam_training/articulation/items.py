"""Objects as the network of parts meets them in training: tokens, pairs and the truth, compact.

An item is one object's primitives with their features, the features of neighbouring pairs, its
word, the words of its parts, and what moves how. It is made once and cached.
"""

from __future__ import annotations

import pickle
import re
import sys
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.evidence.kinds import kinds
from mam_pipeline.evidence.names import object_of, part_kind_of
from mam_pipeline.evidence.spec import Said
from mam_pipeline.geometry.fuse import fuse_mesh, nearest_faces
from mam_pipeline.ground_truth import GroundTruth
from mam_pipeline.parts.features import pair_features, primitive_features
from mam_pipeline.parts.mobility_network import filled
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_pipeline.types import Articulation, Primitives
from mam_training.parts.corpus import Example, as_met, make_example, object_name, relabelled
from mam_training.parts.recipe import blocky, loose

MOST = 120  # primitives of an object that is learned from


@dataclass
class Item:
    """One object.

    Attributes:
        name: of the object. source: "world", "abstract" or of which set it is.
        fused: one closed surface. word: index into `object_words`, 0 unknown.
        unary: (P, U). pair: (E, G). ends: (E, 2). low, high, size, spin: (P, 3). axes: (P, 3, 3).
        area, purity: (P,). link: (P,) the link that owns most of every primitive.
        overlap: (P, L) area shares. subtype: (L,) 0 hinge, 1 spin, 2 slide, -1 still.
        kind: (L,) index into `part_words`, 0 unknown. axis, origin: (L, 3) of the joints in the
            object's frame, NaN for what is still. parent: (L,).
    """

    name: str
    source: str
    fused: bool
    word: int
    unary: NDArray
    pair: NDArray
    ends: NDArray
    low: NDArray
    high: NDArray
    size: NDArray
    spin: NDArray
    axes: NDArray
    area: NDArray
    purity: NDArray
    link: NDArray
    overlap: NDArray
    subtype: NDArray
    kind: NDArray
    axis: NDArray
    origin: NDArray
    parent: NDArray


def object_words() -> tuple[str, ...]:
    """Words of objects that the network knows; the first stands for all others."""
    return ("", *sorted(kinds().objects))


def part_words() -> tuple[str, ...]:
    """Words of parts that the network knows; the first stands for all others."""
    return ("", *sorted(kinds().parts))


def word_index(name: str) -> int:
    """Index of what an object's name says, 0 for nothing."""
    found = object_of(name.replace("_", " "), Said("name", name))
    return 0 if found is None else object_words().index(found.word)


def part_index(name: str) -> int:
    """Index of what a part's name says, 0 for nothing."""
    found = part_kind_of(name)
    return 0 if found is None else part_words().index(found.kind)


def item_of(example: Example, truth: Articulation, source: str, word: int) -> Item:
    """The compact form of an example whose joints are those of `truth`."""
    graph = example.graph
    prior = example.prior()
    unary = primitive_features(graph, prior)
    pairs = pair_features(graph, unary, prior)
    turn = graph.probe.object_T_asset
    count = len(truth.links)
    axis, origin = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    for joint in truth.joints:
        if joint.type != "fixed":
            along = turn[:3, :3] @ joint.axis
            axis[joint.child] = along / np.linalg.norm(along)
            origin[joint.child] = turn[:3, :3] @ joint.origin + turn[:3, 3]
    kind = np.array([part_index(link.kind) for link in truth.links])
    names = columns()
    return Item(
        example.name, source, example.fused, word, filled(unary, names[0]).astype(np.float32),
        filled(pairs, names[1]).astype(np.float16), graph.pairs.astype(np.int16),
        graph.low, graph.high, graph.size, graph.spin_axis, graph.axes, graph.area, example.purity,
        example.link, example.overlap, example.subtype, kind, axis, origin, example.parent,
    )  # fmt: skip


@lru_cache(maxsize=1)
def columns() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The columns of `Item.unary` and of `Item.pair`: those of fused objects, which have more."""
    truth, primitives = as_met("box_cabinet", 0, True)
    example = make_example("", "", truth, primitives)
    assert example.graph.is_fused
    unary = primitive_features(example.graph, example.prior())
    return unary.names, pair_features(example.graph, unary, example.prior()).names


def generated_item(kind: str, seed: int, fused: bool, is_loose: bool, is_blocky: bool) -> Item:
    """A generated object."""
    truth, primitives = as_met(kind, seed, fused, is_loose, is_blocky)
    name = object_name(kind, seed, fused, is_loose, is_blocky)
    example = make_example(name, kind, truth, primitives)
    abstract = kind.startswith("abstract")
    return item_of(example, truth, "abstract" if abstract else "world",
                   0 if abstract else word_index(kind))  # fmt: skip


def truth_item(truth: GroundTruth, source: str, fused: bool, resolution: int = 160) -> Item | None:
    """An object of a dataset of URDFs; None if it has fewer than two primitives."""
    articulation = truth.truth_articulation()
    if fused:
        surface = fuse_mesh(truth.mesh, resolution, 0.0, 0, faces=60_000)
        label = np.asarray(truth.face_link)[nearest_faces(truth.mesh, surface)]
        articulation = relabelled(Articulation(surface, truth.links, truth.joints), label)
    primitives: Primitives = GeometricSegmenter().segment(articulation.mesh)
    if primitives.count < 2:
        return None
    name = truth.id + ("_f" if fused else "")
    example = make_example(name, truth.category, articulation, primitives)
    word = word_index(truth.category) or word_index(truth.id.split("__")[-1])
    return item_of(example, articulation, source, word)


def pack(items: Sequence[Item], path: Path) -> None:
    """Write items."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [{f.name: _small(getattr(i, f.name)) for f in fields(i)} for i in items]
    temporary = path.with_suffix(".part")
    temporary.write_bytes(zlib.compress(pickle.dumps(rows), 1))
    temporary.rename(path)


def unpack(path: Path) -> list[Item]:
    """Read what `pack` wrote (a cache of this program's own; not for foreign files)."""
    return [Item(**row) for row in pickle.loads(zlib.decompress(path.read_bytes()))]


def _small(value: object) -> object:
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.astype(np.float32)
    if isinstance(value, np.ndarray) and value.dtype == np.int64:
        return value.astype(np.int16)
    return value


def with_word(item: Item) -> Item:
    """A generated object with the word of its category, as the table of kinds has it."""
    found = re.fullmatch(r"(.+?)_\d{6}(_[a-z])*", item.name)
    known = found is not None and item.source != "abstract"
    return replace(item, word=word_index(found[1]) if found and known else 0)


Job = tuple[str, int, bool]


def gather(
    wanted: Sequence[Job], cache: Path, loosely: float, blocks: float, chunk: int = 200
) -> list[Path]:
    """Make items of generated objects in files of `chunk`, or find them in the cache.

    Args:
        loosely, blocks: of the objects that are not fused that are modelled loosely, that are built
            of blocks.
    """
    out, started = [], time.time()
    for k in range(0, len(wanted), chunk):
        some = list(wanted[k : k + chunk])
        digest = zlib.crc32(repr((some, loosely, blocks)).encode())
        path = cache / f"items_{k:06d}_{digest:08x}.pack"
        if not path.exists():
            items = []
            for kind, seed, fused in some:
                manner = loose(kind, seed, fused, loosely), blocky(kind, seed, fused, blocks)
                try:
                    item = generated_item(kind, seed, fused, *manner)
                except Exception as error:  # one bad object must not end an hour of work
                    print(f"skipped {kind} {seed}: {error!r}"[:200], file=sys.stderr)
                    continue
                if 2 <= len(item.area) <= MOST:
                    items.append(item)
            pack(items, path)
        out.append(path)
        told = f"{k + len(some)} of {len(wanted)} objects, {time.time() - started:.0f} s"
        print(told, file=sys.stderr, flush=True)
    return out
