"""The pictures that go with a question: the object whole, its pieces, what is inside, the masks.

For n pieces, in this order: the object as it is from four corners; ten views of the numbered
pieces; the kinematic masks of the prior in the same order of views; the pieces that cannot be seen
from outside, in place; all pieces pulled apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import cKDTree

from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.prior.masks import mask_colors
from mam_pipeline.render import orbit_views as views
from mam_pipeline.render import pictures
from mam_pipeline.render.pictures import Picture
from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives


@dataclass(frozen=True)
class AlbumLimits:
    """What is numbered, and how large it is shown.

    Attributes:
        size: pixels a side of a picture.
        first_look: pixels a side of the views that decide what is numbered.
        most_ids: pieces that get a number.
        close_ups: enlarged pictures that one answer can ask for.
        thin: diagonals: second longest side of a hidden piece that may join others.
        wide: diagonals: second longest side of a rack; what is narrower are rails.
        near: diagonals within which thin hidden pieces are one thing, as the bars of a rack.
        plain_sight: share of its best view with which a piece counts as seen from outside.
        small: share of its best view below which a piece may need a closer look.
        barely: share of one view, over all pictures, below which a piece gets no number.
    """

    size: int = 512
    first_look: int = 256
    most_ids: int = 90
    close_ups: int = 3
    thin: float = 0.03
    wide: float = 0.2
    near: float = 0.01
    plain_sight: float = 150 / 512**2
    small: float = 0.004
    barely: float = 25 / 512**2


ALBUM = AlbumLimits()
TWO = (views.CORNERS[0], views.CORNERS[2])
Labelled = tuple[tuple[str, Picture], ...]


@dataclass(frozen=True)
class Album:
    """What is numbered in the pictures of one object; the pictures are cast when they are needed.

    Attributes:
        stands_for: (P,) the numbered primitive that stands for each one in the pictures: hidden
            specks are asked about through their nearest neighbour, and so is what is too many.
        hidden: numbered primitives that no outside view shows well.
        crowds: groups of small pieces close together, each with the view that shows it best.
    """

    mesh: Mesh
    primitives: Primitives
    stands_for: IntArray
    hidden: tuple[int, ...]
    crowds: tuple[tuple[int, tuple[int, ...]], ...] = ()

    @property
    def labels(self) -> IntArray:
        """(F,) numbered primitive of every face."""
        return self.stands_for[self.primitives.labels]

    @property
    def ids(self) -> list[int]:
        """The numbers that are shown."""
        return [int(i) for i in np.unique(self.stands_for)]

    @cached_property
    def outside(self) -> list[views.View]:
        """Ten views from the corners, the sides, above and below."""
        return views.look(self.mesh, size=ALBUM.size, tight=True)

    @cached_property
    def apart(self) -> list[views.View]:
        """Two views of the pieces pulled apart."""
        loose = pictures.exploded(self.mesh, self.primitives.labels)
        return views.look(loose, TWO, ALBUM.size, tight=True)

    @cached_property
    def inside(self) -> list[views.View]:
        """Two views of the hidden pieces alone, with the cameras of the whole."""
        if not self.hidden:
            return []
        shown = np.isin(self.labels, self.hidden)
        return views.look(self.mesh, TWO, ALBUM.size, tight=True, only=shown)


def cast(mesh: Mesh, primitives: Primitives) -> Album:
    """Look at the object from all sides and pulled apart, in small, to see what can be seen."""
    outside = views.look(mesh, size=ALBUM.first_look, tight=True)
    loose = pictures.exploded(mesh, primitives.labels)
    apart = views.look(loose, TWO, ALBUM.first_look, tight=True)
    seen = _seen((*outside, *apart), primitives)
    lost = np.flatnonzero(seen < ALBUM.barely * ALBUM.first_look**2)
    if len(lost):  # what is in the middle of a closed body is not freed by pulling apart
        only = np.isin(primitives.labels, lost)
        seen += _seen(views.look(mesh, TWO, ALBUM.first_look, tight=True, only=only), primitives)
    stands_for = _representatives(mesh, primitives, seen)
    labels = stands_for[primitives.labels]
    counts = np.stack([_pixels(v, labels, primitives.count) for v in outside]) / ALBUM.first_look**2
    stands_for = _racks(mesh, stands_for, primitives, counts.max(axis=0))
    labels = stands_for[primitives.labels]
    counts = np.stack([_pixels(v, labels, primitives.count) for v in outside]) / ALBUM.first_look**2
    ids = np.unique(stands_for)
    best = counts.max(axis=0)
    hidden = tuple(int(i) for i in ids[best[ids] < ALBUM.plain_sight])
    small = ids[(best[ids] >= ALBUM.plain_sight) & (best[ids] < ALBUM.small)]
    crowds = tuple(
        (int(counts[:, group].sum(axis=1).argmax()), tuple(int(i) for i in group))
        for group in _close_together(mesh, labels, small)[:2]
    )
    return Album(mesh, primitives, stands_for, hidden, crowds)


def _racks(mesh: Mesh, stands_for: IntArray, primitives: Primitives, best: FloatArray) -> IntArray:
    """Thin hidden pieces that touch each other stand as one where they cross: a rack in an oven.

    What only lies along each other, as the rails of a drawer and of its case, may move apart.
    """
    labels = stands_for[primitives.labels]
    thin = []
    for i in np.unique(stands_for):
        if best[i] >= ALBUM.plain_sight:
            continue
        sides = np.sort(np.ptp(mesh.vertices[mesh.faces[labels == i].reshape(-1)], axis=0))
        if sides[1] < ALBUM.thin * mesh.diagonal:
            thin.append(int(i))
    if len(thin) < 3:
        return stands_for
    faces = np.flatnonzero(np.isin(labels, thin))
    near = _touching(mesh.submesh(faces), labels[faces], ALBUM.near)
    out, left = stands_for.copy(), set(thin)
    while left:
        group, open_ = {min(left)}, [min(left)]
        while open_:
            more = {k for k in near.get(open_.pop(), []) if k in left} - group
            group |= more
            open_ += sorted(more)
        left -= group
        sides = np.sort(
            np.ptp(mesh.vertices[mesh.faces[np.isin(labels, list(group))].reshape(-1)], 0)
        )
        if len(group) >= 3 and sides[1] > ALBUM.wide * mesh.diagonal:
            out[np.isin(stands_for, sorted(group))] = min(group)
    return out


def _close_together(mesh: Mesh, labels: IntArray, ids: IntArray) -> list[IntArray]:
    """Groups of three and more of `ids` whose middles lie near each other, largest first."""
    if len(ids) < 3:
        return []
    boxes = [mesh.vertices[mesh.faces[labels == i].reshape(-1)] for i in ids]
    middles = np.stack([(b.min(axis=0) + b.max(axis=0)) / 2 for b in boxes])
    group = fcluster(linkage(middles, "single"), 0.1 * mesh.diagonal, "distance")
    found = [ids[group == g] for g in np.unique(group)]
    return sorted([g for g in found if len(g) >= 3], key=lambda g: (-len(g), int(g[0])))


def of_pieces(album: Album, kinematic: IntArray | None) -> Labelled:
    """Pictures for the grouping question.

    Args:
        kinematic: (P,) kinematic label of every primitive (0 held fast), or None without a prior.
    """
    colors = pictures.distinct_colors(int(album.labels.max()) + 1)
    return (
        ("object", whole(album)),
        *_outside(album, album.labels, colors, album.ids),
        *(() if kinematic is None else (("measured", masks(album, kinematic)),)),
        *_close(album, album.labels, colors),
        *_hidden(album, album.labels, colors),
        ("apart", _pair(album.apart, album.labels, colors, album.ids)),
    )


def of_parts(album: Album, part: IntArray) -> Labelled:
    """Pictures for the mounting question; `part` (P,) of every primitive, 0 the base."""
    colors = pictures.distinct_colors(int(part.max()) + 1)
    colors[0] = 205
    labels = part[album.primitives.labels]
    tags = [int(i) for i in np.unique(part)]
    loose = pictures.exploded(album.mesh, labels)
    apart = views.look(loose, TWO, ALBUM.size, tight=True)
    return (
        ("object", whole(album)),
        *_outside(album, labels, colors, tags),
        ("apart", _pair(apart, labels, colors, tags)),
    )


def whole(album: Album) -> Picture:
    """The object as it is, from four corners."""
    own = pictures.own_colors(album.mesh)
    return pictures.sheet([pictures.plain(v, own) for v in album.outside[:4]], 2)


def numbered(album: Album) -> Picture:
    """The numbered pieces from two corners."""
    colors = pictures.distinct_colors(int(album.labels.max()) + 1)
    pair = [album.outside[0], album.outside[2]]
    return _pair(pair, album.labels, colors, album.ids)


def masks(album: Album, kinematic: IntArray) -> Picture:
    """The kinematic masks in the order of the outside views, half as large."""
    colors = mask_colors(kinematic)
    labels = kinematic[album.primitives.labels]
    rows = [pictures.paint(v, labels, colors)[::2, ::2] for v in album.outside]
    return pictures.sheet(rows, 5)


def facts(album: Album, labels: IntArray) -> str:
    """One line per label: where it lies, in percent of the longest side, and what it touches."""
    mesh = album.mesh
    low, high = mesh.bounds
    scale = 100.0 / float((high - low).max())
    rows = []
    near = _touching(mesh, labels)
    for i in np.unique(labels):
        own = mesh.vertices[mesh.faces[labels == i].reshape(-1)]
        a, b = own.min(axis=0), own.max(axis=0)
        span = ", ".join(
            f"{axis} {(a[k] - low[k]) * scale:.0f}..{(b[k] - low[k]) * scale:.0f}"
            for k, axis in enumerate("xyz")
        )
        others = ", ".join(map(str, near.get(int(i), []))) or "nothing"
        rows.append(f"{i}: {span}; touches {others}")
    return "\n".join(rows)


def direction_name(azimuth: float, elevation: float) -> str:
    """Where a camera stands, in words: "from -x and +y, from above"."""
    a = np.radians(azimuth)
    place = (-np.cos(a), -np.sin(a))
    sides = [f"{'+' if v > 0 else '-'}{n}" for v, n in zip(place, "xy") if abs(v) > 0.2]
    height = ", from above" if elevation > 50 else ", from below" if elevation < 0 else ""
    return f"from {' and '.join(sides)}{height}"


def _outside(album: Album, labels: IntArray, colors: Picture, tags: Sequence[int]) -> Labelled:
    return tuple(
        (f"view_{i}", pictures.paint(view, labels, colors, tags))
        for i, view in enumerate(album.outside)
    )


def close_groups(album: Album, wanted: Sequence[int]) -> list[tuple[int, ...]]:
    """Pieces that somebody asks to see closer, in a few groups that lie together."""
    labels = album.labels
    boxes = [album.mesh.vertices[album.mesh.faces[labels == i].reshape(-1)] for i in wanted]
    middles = np.stack([(b.min(axis=0) + b.max(axis=0)) / 2 for b in boxes])
    if len(wanted) == 1:
        return [tuple(wanted)]
    group = fcluster(linkage(middles, "complete"), ALBUM.close_ups, "maxclust")
    return [tuple(int(wanted[k]) for k in np.flatnonzero(group == g)) for g in np.unique(group)]


def closer(album: Album, groups: Sequence[tuple[int, ...]]) -> Labelled:
    """Enlarged pictures of some groups of pieces, each from where it is seen best."""
    labels = album.labels
    colors = pictures.distinct_colors(int(labels.max()) + 1)
    seen = np.stack([_pixels(v, labels, album.primitives.count) for v in album.outside])
    found = [(int(seen[:, list(group)].sum(axis=1).argmax()), group) for group in groups]
    return _enlarged(album, labels, colors, found, "closer")


def _close(album: Album, labels: IntArray, colors: Picture) -> Labelled:
    return _enlarged(album, labels, colors, album.crowds, "close")


def _enlarged(
    album: Album, labels: IntArray, colors: Picture,
    found: Sequence[tuple[int, tuple[int, ...]]], name: str,
) -> Labelled:  # fmt: skip
    out = []
    for k, (index, group) in enumerate(found):
        where = [views.AROUND[index]]
        view = views.look(album.mesh, where, ALBUM.size, focus=np.isin(labels, group))[0]
        out.append((f"{name}_{k}", pictures.paint(view, labels, colors, group)))
    return tuple(out)


def _hidden(album: Album, labels: IntArray, colors: Picture) -> Labelled:
    if not album.hidden:
        return ()
    shells = (album.outside[0], album.outside[2])
    rows = [
        pictures.paint(v, labels, colors, album.hidden, ghost=shell.edges)
        for v, shell in zip(album.inside, shells)
    ]
    return (("inside", np.concatenate(rows, axis=1)),)


def _pair(
    cast: Sequence[views.View], labels: IntArray, colors: Picture, tags: Sequence[int]
) -> Picture:
    return np.concatenate([pictures.paint(v, labels, colors, tags) for v in cast], axis=1)


def _pixels(view: views.View, labels: IntArray, count: int) -> IntArray:
    shown = view.ids(labels)
    return np.bincount(shown[shown >= 0], minlength=count)


def _seen(cast: Sequence[views.View], primitives: Primitives) -> IntArray:
    """(P,) pixels of every primitive over all views."""
    counts = [_pixels(v, primitives.labels, primitives.count) for v in cast]
    return np.asarray(np.sum(counts, axis=0))


def _representatives(mesh: Mesh, primitives: Primitives, pixels: IntArray) -> IntArray:
    visible = np.flatnonzero(pixels >= ALBUM.barely * ALBUM.first_look**2)
    visible = visible[np.argsort(-pixels[visible], kind="stable")][: ALBUM.most_ids]
    if not len(visible):
        visible = np.array([int(pixels.argmax())])
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    known = np.isin(primitives.labels, visible)
    tree, owner = cKDTree(centres[known]), primitives.labels[known]
    out = np.arange(primitives.count)
    for p in np.setdiff1d(np.arange(primitives.count), visible):
        _, near = tree.query(centres[primitives.labels == p])
        out[p] = np.bincount(owner[np.atleast_1d(near)]).argmax()
    return out


def _touching(mesh: Mesh, labels: IntArray, within: float = 0.015) -> dict[int, list[int]]:
    """Pieces whose surfaces come within a share of the diagonal of each other, nearest first."""
    samples = sample_surface(mesh.vertices, mesh.faces, 12000, seed=0)
    owner = labels[samples.faces]
    pairs = cKDTree(samples.points).query_pairs(within * mesh.diagonal, output_type="ndarray")
    a, b = owner[pairs[:, 0]], owner[pairs[:, 1]]
    out: dict[int, list[int]] = {}
    for i in np.unique(labels):
        other = np.concatenate([b[(a == i) & (b != i)], a[(b == i) & (a != i)]])
        count = np.bincount(other) if len(other) else np.zeros(0, dtype=int)
        out[int(i)] = [int(k) for k in np.argsort(-count, kind="stable") if count[k] > 0][:8]
    return out
