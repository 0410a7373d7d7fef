"""Training examples: procedural objects, seen through the real segmenter and probing."""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.geometry.fuse import fuse_mesh, nearest_faces
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.prior.embedded import prior_of
from mam_pipeline.segment.geometric import SPLIT, GeometricSegmenter
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.types import Articulation, FloatArray, IntArray, Primitives
from mam_training.curricula.blocks import of_blocks
from mam_training.curricula.loosening import loosened
from mam_world import make_object
from mam_world.kit import Builder
from mam_world.object import WorldObject, finish, generator
from mam_world.static import Soup
from mam_world.style import draw_style

FUSED = "_f"  # ends the names of fused examples
LOOSE = "_l"  # ends the names of loosely modelled ones
BLOCKS = "_b"  # in the names of those built of blocks, before LOOSE
RESOLUTIONS = (112, 128, 160, 192, 192)  # cells along a fused example's longest side
ROUGHNESS = (0.0, 0.0, 0.0, 0.0003, 0.001)  # of its diagonal
COARSENESS = (0.4, 1.6)  # times the bound on the cost of a cut, for fused examples
# share of authored examples whose base, or every link, is made one solid: the largest piece of real
# files fills 0.75 of the object's box in the median, of generated cabinets and doors it was 0.16
UNITED = 0.8
SUBTYPE_OF = {"hinge": 0, "spin": 1, "slide": 2}


@dataclass(frozen=True)
class Example:
    """One object as the reasoner meets it, with the truth.

    Attributes:
        name, category: of the object. fused: whether the mesh is one surface.
        graph: its primitives. overlap: (P, L) area share of every primitive in every true link.
        parent: (L,) parent links. subtype: (L,) 0 hinge, 1 spin, 2 slide, -1 base or fixed.
    """

    name: str
    category: str
    fused: bool
    graph: Graph
    overlap: FloatArray
    parent: IntArray
    subtype: IntArray

    @property
    def link(self) -> IntArray:
        """(P,) the true link that owns most of every primitive."""
        return np.argmax(self.overlap, axis=1)

    @property
    def purity(self) -> FloatArray:
        """(P,) share of a primitive's area that its link owns."""
        return self.overlap.max(axis=1) / np.maximum(self.overlap.sum(axis=1), 1e-12)

    @property
    def movable(self) -> IntArray:
        """Links that move and own a primitive; smaller ones cannot be found."""
        return np.intersect1d(np.flatnonzero(self.subtype >= 0), self.link)

    @property
    def bound(self) -> float:
        """Mean IoU of the movable links when each is given the primitives that are mostly its own.

        1 when nothing that moves is visible.
        """
        links = np.flatnonzero((self.overlap.sum(axis=0) > 0) & (self.subtype >= 0))
        if not len(links):
            return 1.0
        own = self.part_overlap(self.link == links[:, None])
        return float(own[np.arange(len(links)), links].mean())

    def prior(self) -> KinematicPrior:
        """What the embedded prior says of it."""
        return prior_of(self.graph.probe)

    def part_overlap(self, masks: np.ndarray) -> FloatArray:
        """(C, L) IoU of groups with the true links; the base's and empty columns are 0."""
        inside = masks.astype(np.float64) @ self.overlap
        union = inside.sum(axis=1)[:, None] + self.overlap.sum(axis=0)[None] - inside
        out = inside / np.maximum(union, 1e-12)
        out[:, self.subtype < 0] = 0.0
        return out


def make_example(name: str, category: str, truth: Articulation, primitives: Primitives) -> Example:
    """Measure one object whose links are known; fixed joints melt into their parents."""
    mesh = truth.mesh
    parent = np.full(len(truth.links), -1)
    subtype = np.full(len(truth.links), -1)
    root = np.arange(len(truth.links))
    for joint in truth.joints:
        parent[joint.child] = joint.parent
        if joint.type == "fixed":
            root[joint.child] = root[joint.parent]
        else:
            subtype[joint.child] = SUBTYPE_OF[joint.subtype]
    area = face_geometry(mesh.vertices, mesh.faces)[1]
    overlap = np.zeros((primitives.count, len(truth.links)))
    rows = primitives.labels, root[truth.face_link]
    np.add.at(overlap, rows, area / max(float(area.sum()), 1e-30))
    graph = build_graph(*without_repeats(mesh, primitives))
    fused = len(primitives.merges) > 0
    return Example(name, category, fused, graph, overlap, parent, subtype)


def generated_example(
    kind: str, seed: int, fused: bool = False, loose: bool = False, blocks: bool = False
) -> Example:
    """One generated object, segmented as in the product, in a style of its own or fused."""
    truth, primitives = as_met(kind, seed, fused, loose, blocks)
    return make_example(object_name(kind, seed, fused, loose, blocks), kind, truth, primitives)


def object_name(
    kind: str, seed: int, fused: bool, loose: bool = False, blocks: bool = False
) -> str:
    """What the example of a generated object is called."""
    manner = (FUSED if fused else "") + (BLOCKS if blocks else "") + (LOOSE if loose else "")
    return f"{kind}_{seed:06d}{manner}"


def as_met(
    kind: str, seed: int, fused: bool, loose: bool = False, blocks: bool = False
) -> tuple[Articulation, Primitives]:
    """A generated object with its truth, and its primitives; one surface if `fused`.

    That surface's resolution and roughness are drawn. Of those built of `blocks` (`of_blocks`) and
    of `loose` ones (`loosened`) the links and types hold; the joints of the latter lie about where
    they should.
    """
    made = generated(kind, seed, solids=not fused)
    if blocks:
        made = of_blocks(made, generator(kind, seed, stream=7))
    truth = (loosened(made, generator(kind, seed, stream=6)) if loose else made).truth()
    if not fused:
        return truth, GeometricSegmenter().segment(truth.mesh)
    rng = _draws(kind, seed)
    resolution, noise = int(rng.choice(RESOLUTIONS)), float(rng.choice(ROUGHNESS))
    surface = fuse_mesh(truth.mesh, resolution, noise, seed, faces=60_000)
    label = np.asarray(truth.face_link)[nearest_faces(truth.mesh, surface)]
    segmenter = GeometricSegmenter(SPLIT.clear * np.exp(rng.uniform(*np.log(COARSENESS))))
    return relabelled(replace(truth, mesh=surface), label), segmenter.segment(surface)


def relabelled(truth: Articulation, label: IntArray) -> Articulation:
    """The same links on other faces: (F,) link of every face."""
    links = (replace(link, faces=np.flatnonzero(label == i)) for i, link in enumerate(truth.links))
    return replace(truth, links=tuple(links))


def generated(kind: str, seed: int, solids: bool = True) -> WorldObject:
    """A world category's or an abstract kind's object, not fused.

    With `solids`, some have their base, or every link, made one solid.
    """
    style = draw_style(generator(kind, seed, stream=1), fused=0.0)
    if kind in abstract_kinds():
        builder = Builder(generator(kind, seed), style)
        abstract_kinds()[kind](builder)
        made = finish(builder, kind, seed)
    else:
        made = make_object(kind, seed, style)
    if solids and (draw := _draws(kind, seed).random()) < UNITED:
        made = united(made, (0,) if draw < UNITED / 2 else range(len(made.articulation.links)))
    return made


def _draws(kind: str, seed: int) -> np.random.Generator:
    return np.random.default_rng(zlib.crc32(f"{kind}{seed}".encode()))


def united(made: WorldObject, links: Sequence[int]) -> WorldObject:
    """With the pieces of some links made one solid each, as many a real body is one shell.

    Pieces that enclose no volume stay as they are.
    """
    soup = made.soup
    out = soup
    for link in links:
        pieces = np.flatnonzero(soup.piece_link == link)
        shut = {int(k): m for k in pieces if (m := _piece(soup, k)).is_volume}
        if len(shut) < 2:
            continue
        whole = trimesh.boolean.union(list(shut.values()), engine="manifold")
        out = out.keep(~np.isin(out.face_piece, list(shut)))
        first = min(shut)
        owner = np.append(out.face_piece, np.full(len(whole.faces), first))
        order = np.argsort(owner, kind="stable")
        out = replace(
            out, vertices=np.concatenate([out.vertices, whole.vertices]),
            uv=np.concatenate([out.uv, whole.vertices[:, :2]]),
            faces=np.concatenate([out.faces, whole.faces + len(out.vertices)])[order],
            face_piece=owner[order],
            piece_is_box=out.piece_is_box & (np.arange(len(out.piece_link)) != first),
        )  # fmt: skip
    return replace(made, soup=out)


def _piece(soup: Soup, k: int) -> trimesh.Trimesh:
    """One piece as a mesh whose equal vertices are one."""
    faces = soup.faces[soup.face_piece == k]
    mesh = trimesh.Trimesh(soup.vertices, faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.remove_unreferenced_vertices()
    return mesh


def save_example(example: Example, path: Path) -> None:
    """Write an example, floats halved, packed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    graph = _shrunk(replace(example.graph, probe=_shrunk(_bare(example.graph.probe))))
    data = zlib.compress(pickle.dumps(replace(example, graph=graph)), 1)
    temporary = path.with_suffix(".part")
    temporary.write_bytes(data)
    temporary.rename(path)


def load_example(path: Path) -> Example:
    """Read what `save_example` wrote (a cache of this program's own; not for foreign files)."""
    example: Example = pickle.loads(zlib.decompress(path.read_bytes()))
    return example


def _bare(probe: Any) -> Any:
    return replace(probe, vertices=np.zeros((0, 3)))


def _shrunk(item: Any) -> Any:
    """The dataclass with 32-bit arrays."""
    small = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if isinstance(value, np.ndarray) and value.dtype == np.float64:
            small[field.name] = value.astype(np.float32)
        elif isinstance(value, np.ndarray) and value.dtype == np.int64:
            small[field.name] = value.astype(np.int32)
    return replace(item, **small)


def abstract_kinds() -> dict[str, Any]:
    """Builders of the abstract training objects, by name."""
    from mam_training.curricula import (
        arms_and_clutter,
        cases,
        large_movers,
        machines,
        mechanisms,
        openings,
        several_movers,
        slides_and_turns,
        telling_shapes,
    )

    return {
        "abstract_mechanism": mechanisms.mechanism, "abstract_vehicle": mechanisms.vehicle,
        "abstract_case": cases.case, "abstract_console": cases.console,
        "abstract_doorway": cases.doorway, "abstract_lidded": cases.lidded,
        "abstract_plunger": slides_and_turns.plunger, "abstract_sash": slides_and_turns.sash,
        "abstract_slot": slides_and_turns.slot, "abstract_tracks": slides_and_turns.tracks,
        "abstract_keys": slides_and_turns.keys, "abstract_board": large_movers.board,
        "abstract_leaf": large_movers.leaf, "abstract_opened": large_movers.opened,
        "abstract_tap": large_movers.tap, "abstract_several": several_movers.several,
        "abstract_opening": openings.opening, "abstract_arm": arms_and_clutter.arm,
        "abstract_clutter": arms_and_clutter.clutter,
        "abstract_machine": machines.machine,
        "abstract_rolling": machines.rolling, "abstract_boom": machines.boom,
        "abstract_fascia": telling_shapes.fascia, "abstract_lid": telling_shapes.lidded,
        "abstract_beam": telling_shapes.beam,
    }  # fmt: skip
