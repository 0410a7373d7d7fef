"""The core of the world kit: shapes on links, joints between them, grasps.

Families call it in the asset frame (metres, Z up, front towards -X, floor z = 0), or in a local
frame opened with `with b.at(...)` or `with b.facing(...)`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.types import CollisionShape, FloatArray, Grasp, JointSubtype, joint_motion
from mam_world import collide, shapes
from mam_world.materials import Paint, draw_palette
from mam_world.shapes import Shape
from mam_world.style import Style

HAIR = 4e-4  # smallest clearance of sliding neighbours, share of the diagonal


@dataclass
class Piece:
    """One component: a shape on a link. `role` tells the styles what they may do to it.

    Roles: panel (may become a sheet), solid, drawer_box (may be missing), handle, decor, content,
    fastener. `is_box`: the faces are those of a box, two for each side.
    """

    shape: Shape
    link: int
    material: str
    role: str
    is_box: bool
    collision: tuple[CollisionShape, ...]


@dataclass
class JointSpec:
    """A joint as the family states it, asset frame, closed at q = 0."""

    child: int
    parent: int
    subtype: JointSubtype
    axis: FloatArray
    origin: FloatArray
    lower: float
    upper: float
    ajar: bool
    rest: float
    closed: float | None
    open: float | None
    evidence: dict[str, Any]


class Core:
    """Collects the pieces, joints and grasps of one object. The base link is "base".

    Attributes:
        rng: the object's random numbers; use no others.
        style: gap, tessellation and the like.
        gap: clearance between neighbouring parts, metres (call `size` first).
        palette: role -> Paint; call `theme` to draw another, or assign entries.
    """

    def __init__(self, rng: np.random.Generator, style: Style) -> None:
        self.rng, self.style = rng, style
        self.gap, self.diagonal = 0.0, 1.0
        self.palette: dict[str, Paint] = draw_palette(rng)
        self.links: list[tuple[str, str]] = [("base", "body")]
        self.pieces: list[Piece] = []
        self.joints: list[JointSpec] = []
        self.grasps: list[tuple[int, Grasp]] = []
        self._frame = np.eye(4)

    # -- random numbers -------------------------------------------------------------------
    def uniform(self, low: float, high: float) -> float:
        """A number between low and high."""
        return float(self.rng.uniform(low, high))

    def integer(self, low: int, high: int) -> int:
        """A whole number from low to high, both included."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < probability)

    def choice(self, options: Sequence[Any], p: Sequence[float] | None = None) -> Any:
        """One of the options, as it is."""
        return options[int(self.rng.choice(len(options), p=p))]

    # -- set-up ---------------------------------------------------------------------------
    def size(self, *extents: float) -> None:
        """Tell the object's rough extents (metres): sets `diagonal` and `gap`.

        Gap 0 keeps a hair between what slides along each other (fronts still lie on the body):
        surfaces that share a plane while they move have no defined side to be on.
        """
        self.diagonal = float(np.linalg.norm(extents))
        self.gap = max(self.style.gap, HAIR) * self.diagonal

    def theme(self, name: str = "any") -> None:
        """Draw another palette: wood, paint, white, steel, dark, plastic or any."""
        self.palette = draw_palette(self.rng, name)

    def link(self, name: str, kind: str) -> str:
        """Add a moving link and return its name, which is made unique if taken."""
        taken = {n for n, _ in self.links}
        unique, k = name, 0
        while unique in taken:
            k += 1
            unique = f"{name}_{k}"
        self.links.append((unique, kind))
        return unique

    def index(self, link: str) -> int:
        """Index of a link by name."""
        for i, (name, _) in enumerate(self.links):
            if name == link:
                return i
        raise KeyError(f"no link named {link!r}")

    # -- frames ---------------------------------------------------------------------------
    @contextmanager
    def at(self, matrix: ArrayLike) -> Iterator[None]:
        """Work in a local frame: `matrix` (4, 4) is parent_T_local."""
        before = self._frame
        self._frame = before @ np.asarray(matrix, dtype=float)
        try:
            yield
        finally:
            self._frame = before

    def facing(self, origin: ArrayLike, normal: ArrayLike, along: ArrayLike = (0, 0, 1)) -> Any:
        """Work in a frame at `origin` with local z = normal and local x = along."""
        return self.at(shapes.frame(origin, normal, along))

    def moved(self, offset: ArrayLike, axis: ArrayLike = (0, 0, 1), angle: float = 0.0) -> Any:
        """Work in a frame turned by `angle` about `axis`, then moved by `offset`."""
        matrix = joint_motion("revolute", axis, np.zeros(3), angle)
        matrix[:3, 3] = offset
        return self.at(matrix)

    def point(self, local: ArrayLike) -> FloatArray:
        """(3,) or (n, 3) local points in the asset frame."""
        return np.asarray(local, dtype=float) @ self._frame[:3, :3].T + self._frame[:3, 3]

    def direction(self, local: ArrayLike) -> FloatArray:
        """(3,) unit direction in the asset frame."""
        v = self._frame[:3, :3] @ np.asarray(local, dtype=float)
        return v / np.linalg.norm(v)

    def segments(self, radius: float, low: int = 8, high: int = 48) -> int:
        """How many sides a circle of this radius gets in this style; always even."""
        share = np.clip(radius / (0.12 * self.diagonal), 0.25, 1.0)
        n = {"coarse": 12, "normal": 28, "dense": 56}[self.style.tessellation] * share
        return int(np.clip(2 * round(n / 2), low, high))

    # -- shapes ---------------------------------------------------------------------------
    def add(
        self,
        link: str,
        shape: Shape,
        collision: Sequence[CollisionShape] = (),
        material: str = "body",
        role: str = "solid",
        is_box: bool = False,
    ) -> Piece:
        """Add any shape given in the current frame; collision shapes too."""
        placed = shape
        if self._frame is not _IDENTITY:
            placed = Shape(self.point(shape.vertices), shape.faces, shape.uv)
            collision = [collide.moved(c, self._frame) for c in collision]
        piece = Piece(placed, self.index(link), material, role, is_box, tuple(collision))
        self.pieces.append(piece)
        return piece

    def box(
        self,
        link: str,
        low: ArrayLike,
        high: ArrayLike,
        material: str = "body",
        role: str = "solid",
        collision: bool = True,
    ) -> Piece:
        """Axis-aligned box between two corners."""
        pieces = [collide.box(low, high)] if collision else []
        return self.add(link, shapes.box(low, high), pieces, material, role, is_box=True)

    def panel(self, link: str, low: ArrayLike, high: ArrayLike, material: str = "body") -> Piece:
        """A thin box that the styles may turn into a sheet."""
        return self.box(link, low, high, material, "panel")

    def block(
        self, link: str, center: ArrayLike, size: ArrayLike, material: str = "body",
        role: str = "solid", collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Axis-aligned box by centre and full extents."""
        c, s = np.asarray(center, dtype=float), np.asarray(size, dtype=float) / 2
        return self.box(link, c - s, c + s, material, role, collision)

    def cylinder(
        self, link: str, start: ArrayLike, end: ArrayLike, radius: float,
        radius_end: float | None = None, material: str = "body", role: str = "solid",
        collision: bool = True, sides: int | None = None,
    ) -> Piece:  # fmt: skip
        """Capped cylinder or cone between two points; `sides` 6 makes a hexagonal rod."""
        start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(end - start))
        top = radius if radius_end is None else radius_end
        n = sides or self.segments(max(radius, top))
        profile = np.array([[0, 0], [radius, 0], [top, length], [0, length]], dtype=float)
        with self.facing(start, end - start, _across(end - start)):
            solids = collide.solid(profile[1:3]) if collision else []
            return self.add(link, shapes.revolve(profile, n), solids, material, role)

    rod = cylinder

    def disc(
        self, link: str, center: ArrayLike, normal: ArrayLike, radius: float, thickness: float,
        material: str = "body", role: str = "solid", collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Flat cylinder standing on `center`, growing along `normal`."""
        n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
        end = np.asarray(center, dtype=float) + n * thickness
        return self.cylinder(link, center, end, radius, None, material, role, collision)

    def lathe(
        self, link: str, profile: ArrayLike, material: str = "body", role: str = "solid",
        collision: bool = True, sides: int | None = None,
    ) -> Piece:  # fmt: skip
        """Solid of revolution about local z; profile (n, 2) of (radius, z), bottom to top.

        Ends that are not on the axis are capped.
        """
        p = np.asarray(profile, dtype=float)
        ends = [[[0.0, p[k, 1]]] if p[k, 0] > 0 else [] for k in (0, -1)]
        full = [*ends[0], *p.tolist(), *ends[1]]
        n = sides or self.segments(float(p[:, 0].max()))
        solids = collide.solid(p) if collision else []
        return self.add(link, shapes.revolve(full, n), solids, material, role)

    def vessel(
        self, link: str, profile: ArrayLike, wall: float, material: str = "body",
        role: str = "solid", bottom: bool = True, collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Hollow solid of revolution about local z, open at the top: pots, bottles, bins.

        Args:
            profile: (n, 2) outer (radius, z), bottom to top; `wall` is the thickness, metres.
            bottom: closed below; False makes a tube open at both ends.
        """
        p = np.asarray(profile, dtype=float)
        inner = p.copy()
        inner[:, 0] = np.maximum(inner[:, 0] - wall, 1e-4)
        if bottom:
            inner[0, 1] += wall
            loop = np.concatenate([[[0, p[0, 1]]], p, inner[::-1], [[0, inner[0, 1]]]])
        else:
            loop = np.concatenate([p, inner[::-1]])
        n = self.segments(float(p[:, 0].max()), low=12)
        solids = collide.shell(p, wall, bottom) if collision else []
        return self.add(link, shapes.revolve(loop, n, loop=not bottom), solids, material, role)

    def tube(
        self, link: str, start: ArrayLike, end: ArrayLike, outer: float, inner: float,
        material: str = "body", role: str = "solid", collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Hollow cylinder open at both ends."""
        start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(end - start))
        with self.facing(start, end - start, _across(end - start)):
            return self.vessel(link, [[outer, 0], [outer, length]], outer - inner, material,
                               role, bottom=False, collision=collision)  # fmt: skip

    def sphere(
        self, link: str, center: ArrayLike, radius: float, material: str = "body",
        role: str = "solid", collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Sphere with poles along local z."""
        n = self.segments(radius)
        angle = np.linspace(-np.pi / 2, np.pi / 2, max(n // 2, 4) + 1)
        profile = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        profile[[0, -1], 0] = 0
        with self.moved(center):
            solids = [collide.sphere(np.zeros(3), radius)] if collision else []
            return self.add(link, shapes.revolve(profile, n), solids, material, role)

    def torus(
        self, link: str, center: ArrayLike, axis: ArrayLike, radius: float, thickness: float,
        material: str = "body", role: str = "solid", collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Ring of centre-line `radius` and tube radius `thickness` about `axis`."""
        profile = shapes.circle(thickness, self.segments(thickness)) + np.array([radius, 0])
        with self.facing(center, axis, _across(np.asarray(axis, dtype=float))):
            ring = shapes.circle(radius, 12)
            solids = collide.path(np.c_[ring, np.zeros(12)], thickness, True) if collision else []
            n = self.segments(radius, low=12)
            return self.add(link, shapes.revolve(profile, n, loop=True), solids, material, role)

    def sweep(
        self, link: str, path: ArrayLike, radius: float, material: str = "body",
        role: str = "solid", loop: bool = False, section: ArrayLike | None = None,
        collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Bent rod of `radius` along a path (n, 3); `section` (m, 2) replaces the round section."""
        outline = shapes.circle(radius, self.segments(radius)) if section is None else section
        solids = collide.path(path, radius, loop) if collision else []
        return self.add(link, shapes.sweep(path, outline, loop), solids, material, role)

    def extrude(
        self, link: str, polygon: ArrayLike, height: float, material: str = "body",
        role: str = "solid", collision: bool = True,
    ) -> Piece:  # fmt: skip
        """Prism over a simple polygon (n, 2) in local x, y, from local z = 0 to `height`."""
        solids = collide.prism(polygon, height) if collision else []
        return self.add(link, shapes.extrude(polygon, height), solids, material, role)

    def shell(
        self, link: str, low: ArrayLike, high: ArrayLike, thickness: float, open: str = "-x",
        material: str = "body", role: str = "panel",
    ) -> None:  # fmt: skip
        """Hollow box of panels; `open` lists the missing sides, for example "-x" or "-x,+z"."""
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        missing = open.split(",")
        t = thickness
        # top and bottom span everything, the sides stand between them, the back between all
        inner_low, inner_high = low.copy(), high.copy()
        for axis, letter in ((2, "z"), (1, "y"), (0, "x")):
            a, b = inner_low.copy(), inner_high.copy()
            for sign, edge in (("-", 0), ("+", 1)):
                if f"{sign}{letter}" in missing:
                    continue
                p, q = a.copy(), b.copy()
                if edge == 0:
                    q[axis] = p[axis] + t
                    inner_low[axis] = q[axis]
                else:
                    p[axis] = q[axis] - t
                    inner_high[axis] = p[axis]
                self.box(link, p, q, material, role)

    # -- joints ---------------------------------------------------------------------------
    def hinge(
        self, child: str, parent: str, origin: ArrayLike, axis: ArrayLike, lower: float = 0.0,
        upper: float = np.pi / 2, opens: ArrayLike | None = None, tip: ArrayLike | None = None,
        **more: Any,
    ) -> None:  # fmt: skip
        """Revolute joint; with `opens` the axis is signed so that the part first moves that way.

        Args:
            opens: direction (current frame) in which `tip` (default: the child's middle) travels
                at the start of positive motion.
            more: ajar=False (must rest closed), rest= (source pose), closed=, open=, evidence=.
        """
        a, o = self.direction(axis), self.point(origin)
        if opens is not None:
            at = self._middle(child) if tip is None else self.point(tip)
            if np.cross(a, at - o) @ self.direction(opens) < 0:
                a = -a
        self._joint(child, parent, "hinge", a, o, lower, upper, **more)

    def spin(
        self, child: str, parent: str, origin: ArrayLike, axis: ArrayLike,
        lower: float = -np.inf, upper: float = np.inf, **more: Any,
    ) -> None:  # fmt: skip
        """Turning about the part's own axis: continuous unless both limits are given."""
        self._joint(child, parent, "spin", self.direction(axis), self.point(origin), lower, upper,
                    **more)  # fmt: skip

    def slide(
        self, child: str, parent: str, axis: ArrayLike, lower: float = 0.0, upper: float = 0.1,
        **more: Any,
    ) -> None:  # fmt: skip
        """Prismatic joint along `axis`; its origin is the child's middle."""
        self._joint(child, parent, "slide", self.direction(axis), self._middle(child), lower, upper,
                    **more)  # fmt: skip

    def _joint(
        self, child: str, parent: str, subtype: JointSubtype, axis: FloatArray, origin: FloatArray,
        lower: float, upper: float, ajar: bool = True, rest: float = 0.0,
        closed: float | None = None, open: float | None = None,
        evidence: dict[str, Any] | None = None,
    ) -> None:  # fmt: skip
        self.joints.append(
            JointSpec(self.index(child), self.index(parent), subtype, axis, origin, float(lower),
                      float(upper), ajar, rest, closed, open, evidence or {})
        )  # fmt: skip

    def bounds_of(self, link: str) -> FloatArray:
        """(2, 3) box of what a link holds so far, asset frame."""
        i = self.index(link)
        parts = [p.shape.vertices for p in self.pieces if p.link == i]
        low = np.min([v.min(axis=0) for v in parts], axis=0)
        return np.stack([low, np.max([v.max(axis=0) for v in parts], axis=0)])

    def _middle(self, link: str) -> FloatArray:
        return self.bounds_of(link).mean(axis=0)

    def grasp(
        self, link: str, kind: Any, position: ArrayLike, approach: ArrayLike, closing: ArrayLike,
        width: float, depth: float = 0.02,
    ) -> None:  # fmt: skip
        """Where to take hold of a link (current frame); see mam_pipeline.types.Grasp."""
        i = self.index(link)
        self.grasps.append((i, Grasp(
            "", link, kind, self.point(position), self.direction(approach),
            self.direction(closing), width, depth, 1.0, "observed",
        )))  # fmt: skip


_IDENTITY = np.eye(4)


def _across(axis: FloatArray) -> FloatArray:
    """A direction clearly not along `axis`, preferring an upright seam for lying cylinders."""
    return np.array([0.0, 0, 1]) if abs(axis[2]) < 0.9 * np.linalg.norm(axis) else np.eye(3)[0]
