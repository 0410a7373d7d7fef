"""From a measured box and its front to a textured mesh of separate, hollow, named parts.

Construction (metres, asset frame; x = -d/2 is the front plane): a front layer of panels and
frame strips of one thickness, behind it the carcass boards; drawers have boxes, doors are slabs,
open cells are left open with boards around them. Gaps of 3 mm keep everything free to move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.hints import TRAVEL, HintBox, HintJoint, HintPart, Hints
from mam_pipeline.types import Material, Mesh

Array = NDArray[np.float64]
GAP = 0.003
BOARD = 0.018
THIN = 0.010
QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
FACE_ORDER = ("front", "back", "right", "left", "bottom", "top")


@dataclass(frozen=True)
class HandleSpec:
    """A handle on the front: rectangle (s0, t0, s1, t1) in metres, s to the right from the left
    edge, t up from the body's bottom; `seen` False for a virtual grasp line without geometry;
    `color`: of what the photo shows there, 0..1; None takes the body's."""

    rect: tuple[float, float, float, float]
    seen: bool = True
    provenance: str = "observed"
    color: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class CellSpec:
    """One cell of the front to build; `rect` as in HandleSpec."""

    name: str
    kind: str  # drawer | door | open | fixed
    rect: tuple[float, float, float, float]
    hinge_side: str | None = None
    handles: tuple[HandleSpec, ...] = ()
    confidence: float = 1.0
    provenance: str = "observed"


@dataclass(frozen=True)
class BodySpec:
    """The object: width, depth, height of the body in metres, legs below it, cells, colours."""

    width: float
    depth: float
    height: float
    cells: tuple[CellSpec, ...]
    legs: float = 0.0
    leg_inset: float = 0.04
    color: tuple[float, float, float] = (0.6, 0.5, 0.4)
    textures: tuple[tuple[str, bytes], ...] = ()  # face name -> JPEG bytes


class _Builder:
    """Collects boxes into one Mesh with groups and materials."""

    def __init__(self, spec: BodySpec) -> None:
        self.s = spec
        # a hinge line runs along the front's face, and must not lie far from the body behind it
        self.size = float(np.linalg.norm([spec.width, spec.depth, spec.height]))
        self.board = min(BOARD, 0.018 * self.size - GAP)
        self.vertices: list[Array] = []
        self.uv: list[Array] = []
        self.faces: list[NDArray[np.int64]] = []
        self.material: list[int] = []
        self.group: list[int] = []
        self.names: list[str] = []
        inner = tuple(0.75 * c for c in spec.color)
        self.materials = [
            Material("body", (*spec.color, 1.0)),
            Material("inside", (inner[0], inner[1], inner[2], 1.0)),
        ]
        self.texture: dict[str, int] = {}
        for face, data in spec.textures:
            self.texture[face] = len(self.materials)
            self.materials.append(Material(f"photo_{face}", (1, 1, 1, 1), data, "jpeg"))

    def box(
        self, name: str, low: Array, high: Array, skins: tuple[str, ...] = (), inside: bool = False,
        color: tuple[float, float, float] | None = None,
    ) -> None:  # fmt: skip
        """Add a box; faces named in `skins` show the photo of that side of the object.

        Args:
            color: of the other faces; None takes the body's, or the inside's.
        """
        plain = int(inside) if color is None else self._painted(color)
        lo, hi = np.minimum(low, high), np.maximum(low, high)
        grid = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        corners = lo + grid * (hi - lo)
        if name not in self.names:
            self.names.append(name)
        for quad, face in zip(QUADS, FACE_ORDER):
            points = corners[quad]
            base = 4 * len(self.vertices)
            self.vertices.append(points)
            skin = face in skins and face in self.texture
            self.uv.append(self._project(points, face) if skin else np.zeros((4, 2)))
            self.faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + base)
            self.material += [self.texture[face] if skin else plain] * 2
            self.group += [self.names.index(name)] * 2

    def _painted(self, color: tuple[float, float, float]) -> int:
        """The number of the material of a handle's colour."""
        made = Material("handle", (*color, 1.0))
        if made not in self.materials:
            self.materials.append(made)
        return self.materials.index(made)

    def _project(self, p: Array, face: str) -> Array:
        w, d, h = self.s.width, self.s.depth, self.s.height
        right, back = (w / 2 - p[:, 1]) / w, (p[:, 0] + d / 2) / d
        down = 1 - (p[:, 2] - self.s.legs) / h
        if face == "front":
            uv = np.stack([right, down], 1)
        elif face == "right":
            uv = np.stack([back, down], 1)
        elif face == "left":
            uv = np.stack([1 - back, down], 1)
        else:  # top: left to right, back to front
            uv = np.stack([right, 1 - back], 1)
        return np.clip(uv, 0.0, 1.0)

    def mesh(self) -> Mesh:
        """The collected mesh."""
        return Mesh(
            np.concatenate(self.vertices),
            np.concatenate(self.faces),
            tuple(self.materials),
            np.array(self.material),
            np.concatenate(self.uv).astype(np.float32),
            None,
            np.array(self.group),
            tuple(self.names),
        )

    def at(self, x: float, s: float, t: float) -> Array:
        """Asset point from depth behind the front plane, s from the left edge, t above the base."""
        return np.array([x - self.s.depth / 2, self.s.width / 2 - s, t + self.s.legs])


def build_object(spec: BodySpec) -> tuple[Mesh, Hints]:
    """Build the textured mesh and the hints that describe its parts."""
    b = _Builder(spec)
    _carcass(b)
    _frame(b)
    parts: list[HintPart] = []
    for cell in spec.cells:
        if cell.kind == "fixed":
            rect = _shrink(cell.rect, 0.0)
            b.box(
                f"{cell.name}_front",
                b.at(0, rect[0], rect[1]),
                b.at(b.board + GAP, rect[2], rect[3]),
                ("front",),
            )
        elif cell.kind in ("drawer", "door"):
            parts.append(_movable(b, cell))
    parts.insert(0, _base_part(b))
    return b.mesh(), Hints(up="z", parts=tuple(parts))


def _base_part(b: _Builder) -> HintPart:
    s = b.s
    nodes = tuple(n for n in b.names if n.startswith(("carcass", "leg", "fixed")))
    box = HintBox((0.0, 0.0, s.legs + s.height / 2), (s.depth, s.width, s.height))  # no legs
    return HintPart(
        "body", "body", nodes=nodes, box=_plain(box), joint=HintJoint("fixed"),
        provenance="observed",
    )  # fmt: skip


def _plain(box: HintBox) -> HintBox:
    c, z = box.center, box.size
    return HintBox((float(c[0]), float(c[1]), float(c[2])), (float(z[0]), float(z[1]), float(z[2])))


def _carcass(b: _Builder) -> None:
    w, d, h = b.s.width, b.s.depth, b.s.height
    t = min(b.board, 0.06 * w, 0.06 * h)
    x = b.board + GAP
    b.box("carcass_left", b.at(x, 0, 0), b.at(d, t, h), ("left",))
    b.box("carcass_right", b.at(x, w - t, 0), b.at(d, w, h), ("right",))
    b.box("carcass_top", b.at(x, t, h - t), b.at(d, w - t, h), ("top",))
    b.box("carcass_bottom", b.at(x, t, 0), b.at(d, w - t, t))
    b.box("carcass_back", b.at(d - 0.008, t, t), b.at(d, w - t, h - t), inside=True)
    if b.s.legs > 0:
        inset, r = b.s.leg_inset, 0.018
        k = 0
        for x0 in (inset, d - inset - 2 * r):
            for s0 in (inset, w - inset - 2 * r):
                low, high = b.at(x0, s0, -b.s.legs), b.at(x0 + 2 * r, s0 + 2 * r, 0.0)
                b.box(f"leg_{k}", low, high)
                k += 1


def _frame(b: _Builder) -> None:
    """Fill the front layer wherever no cell is, with strips; shelves around open cells."""
    cells = b.s.cells
    w, d, h = b.s.width, b.s.depth, b.s.height
    ss = np.unique(np.round([0, w, *(v for c in cells for v in (c.rect[0], c.rect[2]))], 5))
    ts = np.unique(np.round([0, h, *(v for c in cells for v in (c.rect[1], c.rect[3]))], 5))
    free = np.ones((len(ts) - 1, len(ss) - 1), bool)
    ms, mt = (ss[1:] + ss[:-1]) / 2, (ts[1:] + ts[:-1]) / 2
    for c in cells:
        inside_s = (ms > c.rect[0]) & (ms < c.rect[2])
        inside_t = (mt > c.rect[1]) & (mt < c.rect[3])
        free[np.ix_(inside_t, inside_s)] = False
    number = 0
    for i0, i1, j0, j1 in _rectangles(free):
        low, high = b.at(0, ss[j0], ts[i0]), b.at(b.board + GAP, ss[j1], ts[i1])
        b.box(f"carcass_frame_{number}", low, high, ("front",))
        number += 1
    t = THIN
    for c in cells:
        if c.kind != "open":
            continue
        s0, t0, s1, t1 = c.rect
        for a, e, f, g in (
            (s0, t0 - t, s1, t0), (s0, t1, s1, t1 + t),
            (s0 - t, t0, s0, t1), (s1, t0, s1 + t, t1),
        ):  # fmt: skip
            if a < b.board or e < b.board or f > w - b.board or g > h - b.board:
                continue
            lo, hi = b.at(b.board + GAP, a, e), b.at(d - 0.008, f, g)
            b.box(f"carcass_shelf_{number}", lo, hi, inside=True)
            number += 1


def _rectangles(free: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Cover the true cells of a grid with few disjoint rectangles (row runs, merged downwards)."""
    left = free.copy()
    out = []
    for i in range(free.shape[0]):
        j = 0
        while j < free.shape[1]:
            if not left[i, j]:
                j += 1
                continue
            j1 = j
            while j1 < free.shape[1] and left[i, j1]:
                j1 += 1
            i1 = i + 1
            while i1 < free.shape[0] and left[i1, j:j1].all():
                i1 += 1
            left[i:i1, j:j1] = False
            out.append((i, i1, j, j1))
            j = j1
    return out


def _shrink(r: tuple[float, float, float, float], by: float) -> tuple[float, float, float, float]:
    return r[0] + by, r[1] + by, r[2] - by, r[3] - by


def _movable(b: _Builder, cell: CellSpec) -> HintPart:
    s0, t0, s1, t1 = _shrink(cell.rect, GAP / 2)
    front = f"{cell.name}_front"
    nodes = [front]
    b.box(front, b.at(0, s0, t0), b.at(b.board, s1, t1), ("front",))
    low, high = b.at(0, s0, t0), b.at(b.board, s1, t1)
    if cell.kind == "drawer":
        nodes.append(f"{cell.name}_box")
        high = _drawer_box(b, cell, (s0, t0, s1, t1))
    for k, handle in enumerate(cell.handles):
        if handle.seen:
            nodes.append(f"{cell.name}_handle_{k}")
            _handle(b, nodes[-1], handle)
    lo, hi = np.minimum(low, high), np.maximum(low, high)
    box = HintBox(tuple(map(float, (lo + hi) / 2)), tuple(map(float, hi - lo)))  # type: ignore[arg-type]
    return HintPart(
        cell.name, cell.kind, nodes=tuple(nodes), box=box, parent="body",
        joint=_joint(b, cell, (s0, t0, s1, t1)), handle=_handle_box(b, cell),
        confidence=round(float(cell.confidence), 3),
        provenance=cell.provenance,  # type: ignore[arg-type]
    )  # fmt: skip


def _drawer_box(b: _Builder, cell: CellSpec, r: tuple[float, float, float, float]) -> Array:
    """Five boards behind the front (floor, two sides, back); returns the far upper corner."""
    w, d, h = b.s.width, b.s.depth, b.s.height
    t = min(b.board, 0.06 * w, 0.06 * h)
    # room for runners; in a small body less, or nothing would guide the box beside its walls
    play, room = min(0.006, 0.009 * b.size), min(0.012, 0.018 * b.size)
    s0, s1 = max(r[0] + room, t + play), min(r[2] - room, w - t - play)
    t0, t1 = max(r[1] + room, t + play), min(r[3] - 0.02, h - t - play)
    t1 = max(t0 + 0.03, t0 + 0.75 * (t1 - t0))
    x0, x1 = b.board, max(b.board + 0.05, d - 0.008 - 0.02)
    k = min(THIN, 0.2 * (s1 - s0), 0.3 * (t1 - t0))
    name = f"{cell.name}_box"
    b.box(name, b.at(x0, s0, t0), b.at(x1, s1, t0 + k), inside=True)
    b.box(name, b.at(x0, s0, t0 + k), b.at(x1, s0 + k, t1), inside=True)
    b.box(name, b.at(x0, s1 - k, t0 + k), b.at(x1, s1, t1), inside=True)
    b.box(name, b.at(x1 - k, s0 + k, t0 + k), b.at(x1, s1 - k, t1), inside=True)
    return b.at(x1, r[2], r[3])


def _handle(b: _Builder, name: str, handle: HandleSpec) -> None:
    """A bar with two posts, or a knob on a stem, standing 3 cm proud, in the photo's colour."""
    s0, t0, s1, t1 = handle.rect
    w, h, color = s1 - s0, t1 - t0, handle.color
    if max(w, h) > 2.0 * min(w, h):
        b.box(name, b.at(-0.036, s0, t0), b.at(-0.024, s1, t1), color=color)
        post = 0.5 * min(min(w, h), 0.012)
        for f in (0.12, 0.88):
            s = (s0 + f * w) if w > h else (s0 + s1) / 2
            t = (t0 + f * h) if h >= w else (t0 + t1) / 2
            low, high = b.at(-0.024, s - post, t - post), b.at(0.0, s + post, t + post)
            b.box(name, low, high, color=color)
    else:
        s, t = (s0 + s1) / 2, (t0 + t1) / 2
        b.box(name, b.at(-0.03, s0, t0), b.at(-0.014, s1, t1), color=color)
        low = b.at(-0.014, s - 0.25 * w, t - 0.25 * h)
        b.box(name, low, b.at(0.0, s + 0.25 * w, t + 0.25 * h), color=color)


def _handle_box(b: _Builder, cell: CellSpec) -> HintBox | None:
    if not cell.handles:
        return None
    s0, t0, s1, t1 = cell.handles[0].rect
    reach = -0.036 if cell.handles[0].seen else -0.004
    low, high = b.at(reach, s0, t0), b.at(0.0, s1, t1)
    lo, hi = np.minimum(low, high), np.maximum(low, high)
    return HintBox(tuple(map(float, (lo + hi) / 2)), tuple(map(float, hi - lo)))  # type: ignore[arg-type]


def _joint(b: _Builder, cell: CellSpec, r: tuple[float, float, float, float]) -> HintJoint:
    """Slide towards -X, or hinge on the front edge: that corner never sweeps into its neighbour."""
    s0, t0, s1, t1 = r
    if cell.kind == "drawer":
        origin = b.at(0, (s0 + s1) / 2, (t0 + t1) / 2)
        way = max(TRAVEL.drawer * (b.s.depth - 0.05), 0.1 * b.s.depth)  # of a flat body, something
        far = float(round(way, 4))
        return HintJoint("slide", (-1.0, 0.0, 0.0), _xyz(origin), 0.0, far, travel="depth")
    side = cell.hinge_side or "left"
    at = {
        "left": b.at(0, s0, (t0 + t1) / 2), "right": b.at(0, s1, (t0 + t1) / 2),
        "bottom": b.at(0, (s0 + s1) / 2, t0), "top": b.at(0, (s0 + s1) / 2, t1),
    }[side]  # fmt: skip
    axis = {
        "left": (0.0, 0.0, -1.0), "right": (0.0, 0.0, 1.0),
        "bottom": (0.0, -1.0, 0.0), "top": (0.0, 1.0, 0.0),
    }[side]  # fmt: skip
    upper = 1.5708 if side in ("bottom", "top") else 1.745
    return HintJoint("hinge", axis, _xyz(at), 0.0, upper, side, "usual")  # type: ignore[arg-type]


def _xyz(p: Array) -> tuple[float, float, float]:
    return float(p[0]), float(p[1]), float(p[2])
