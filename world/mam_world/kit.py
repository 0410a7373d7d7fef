"""The kit that every category is built with: `Builder`, the core plus handles, fronts and fittings.

Fronts and drawers are stated as boxes that face -X; open a frame (`b.at`, `b.moved`) to turn them.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.types import FloatArray
from mam_world import shapes
from mam_world.core import Core

HandleKind = Literal["none", "bar", "bow", "knob", "double", "recessed", "cup", "strip", "ring"]
HANDLES: tuple[HandleKind, ...] = (
    "none", "bar", "bow", "knob", "double", "recessed", "cup", "strip", "ring",
)  # fmt: skip


class Builder(Core):
    """Collects the pieces, joints and grasps of one object; see `Core` for shapes and joints."""

    # -- handles --------------------------------------------------------------------------
    def handle(
        self, link: str, center: ArrayLike, normal: ArrayLike, along: ArrayLike, length: float,
        kind: HandleKind = "bar", material: str = "metal", standoff: float | None = None,
    ) -> None:  # fmt: skip
        """A handle on a surface, with its grasp.

        Args:
            center: point on the surface; normal: outwards; along: the long direction.
            length: of the handle, metres; its thickness follows.
            kind: one of HANDLES.
            standoff: distance of a bar from the surface, metres (default from the length).
        """
        if kind == "none":
            return
        thick = float(np.clip(length * self.uniform(0.06, 0.1), 0.004, 0.012))
        off = standoff or float(np.clip(0.25 * length, 0.018, 0.045)) + thick
        build = getattr(self, f"_{kind}")
        with self.facing(center, normal, along):
            build(link, length, thick, off, material)

    def _hold(self, link: str, z: float, width: float, kind: str = "handle") -> None:
        self.grasp(link, kind, (0, 0, z), (0, 0, -1), (0, 1, 0), width, depth=min(z, 0.02))

    def _bar(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        r, post = thick / 2, 0.5 * length - thick * (1 if self.chance(0.5) else 3)
        square = self.chance(0.35)
        for x in (-post, post):
            self.cylinder(link, (x, 0, 0), (x, 0, off), r * 0.9, None, material, "handle")
        if square:
            self.block(link, (0, 0, off), (length, thick, thick), material, "handle")
        else:
            self.rod(link, (-length / 2, 0, off), (length / 2, 0, off), r, None, material, "handle")
        self._hold(link, off, thick)

    def _bow(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        n = {"coarse": 7, "normal": 11, "dense": 19}[self.style.tessellation]
        t = np.linspace(0, np.pi, n)
        power = self.choice([0.35, 0.6, 1.0])
        path = np.stack([-np.cos(t) * length / 2, 0 * t, off * np.sin(t) ** power], axis=1)
        self.sweep(link, path, thick / 2, material, "handle")
        self._hold(link, off, thick)

    def _knob(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        r = float(np.clip(length * 0.14, 0.008, 0.02))
        profile = [
            [[0.55, 0], [0.45, 0.9], [1.0, 1.3], [1.0, 1.9], [0.7, 2.2]],
            [[0.5, 0], [0.5, 0.8], [0.85, 1.1], [1.0, 1.5], [0.85, 1.9], [0.5, 2.1]],
            [[1.0, 0], [1.0, 1.6]],
        ][self.integer(0, 2)]
        self.lathe(link, np.asarray(profile) * r, material, "handle")
        self._hold(link, 1.5 * r, 2 * r, "knob")

    def _double(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        for x in (-1.2 * length, 1.2 * length):
            with self.moved((x, 0, 0)):
                if self.chance(0.5):
                    self._knob(link, length, thick, off, material)
                else:
                    self._bar(link, 0.8 * length, thick, off, material)

    def _recessed(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        w, rim = max(0.3 * length, 0.02), max(0.6 * thick, 0.003)
        self.block(link, (0, 0, 0.0005), (length, w, 0.001), "dark", "decor")
        outline = shapes.rounded_rectangle(length + rim, w + rim, 0.2 * w, 3)
        path = np.c_[outline, np.full(len(outline), rim / 2)]
        self.sweep(link, path, rim / 2, material, "handle", loop=True)
        self._hold(link, rim, w, "rim")

    def _cup(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        h, d, t = 0.35 * length, 0.22 * length, max(0.25 * thick, 0.0015)
        angle = np.linspace(0, np.pi / 2, 7)
        outer = np.stack([h * np.cos(angle) - h / 2, d * np.sin(angle)], axis=1)
        inner = np.stack([(h - t) * np.cos(angle) - h / 2, (d - t) * np.sin(angle)], axis=1)
        strip = np.concatenate([outer, inner[::-1]])
        caps = np.concatenate([outer, [[-h / 2, 0]]])
        # the hood opens downwards when `along` is horizontal: local -y must point to the floor
        flip = -1.0 if self.direction((0, 1, 0))[2] < -1e-9 else 1.0
        matrix = np.eye(4)
        matrix[:3, :3] = np.array([[0, 0, flip], [flip, 0, 0], [0, 1, 0]])
        with self.at(matrix), self.moved((0, 0, -length / 2)):
            self.extrude(link, strip, length, material, "handle")
            for z in (0.0, length - t):
                with self.moved((0, 0, z)):
                    self.extrude(link, caps, t, material, "handle")
        self._hold(link, 0.7 * d, 2 * t, "rim")

    def _strip(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        d = max(off * 0.6, 0.01)
        lip = np.array([[0, 0], [d, 0], [d, thick * 1.2], [d - 0.4 * thick, thick * 1.2],
                        [d - 0.4 * thick, 0.4 * thick], [0, 0.4 * thick]])  # fmt: skip
        matrix = np.eye(4)  # profile x along the normal, profile y across, extrusion along
        matrix[:3, :3] = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]]) * [1, 1, 1]
        matrix[:3, 2] = np.cross(matrix[:3, 0], matrix[:3, 1])
        with self.at(matrix), self.moved((0, 0, -length / 2)):
            self.extrude(link, lip, length, material, "handle")
        self._hold(link, d, 1.2 * thick, "rim")

    def _ring(self, link: str, length: float, thick: float, off: float, material: str) -> None:
        r, t = max(0.22 * length, 0.012), 0.35 * thick
        self.block(link, (0, 0, t), (1.2 * r, 0.8 * r, 2 * t), material, "handle")
        # `along` may be horizontal: the ring hangs down from the plate
        with self.facing((0, 0, 3 * t), (0, 0, 1), (1, 0, 0)):
            self.torus(link, (0, 0, 0), (0, 0, 1), r, t, material, "handle")
        # round the whole ring, or its bar with one finger through it; its middle is a hole
        self._hold(link, 3 * t, 2 * (r + t), "knob")
        with self.moved((0, r, 0)):
            self._hold(link, 3 * t, 2 * t)

    # -- fronts ---------------------------------------------------------------------------
    def front(
        self, link: str, low: ArrayLike, high: ArrayLike, kind: str = "slab",
        material: str = "front",
    ) -> None:  # fmt: skip
        """A panel facing -X: slab, framed, glass, louvre, moulded or double (two fields)."""
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        d, w, h = high - low
        rail = float(np.clip(0.16 * min(w, h), 0.02, 0.09))
        if kind == "slab" or min(w, h) < 3.2 * rail:
            self.panel(link, low, high, material)
            return
        if kind in ("moulded", "double"):
            self.panel(link, low, high, material)
            cuts = [0.0, 1.0] if kind == "moulded" else [0.0, self.uniform(0.4, 0.65), 1.0]
            for a, b in pairwise(cuts):
                self._moulding(link, low, high, a, b, rail, "trim")
            return
        self.border(link, low, high, rail, material)
        edge = np.array([0, rail, rail])
        inner_low, inner_high = low + edge, high - edge
        if kind == "louvre":
            count = int(np.clip((h - 2 * rail) / 0.035, 3, 16))
            pitch = (h - 2 * rail) / count
            for k in range(count):
                z = low[2] + rail + (k + 0.5) * pitch
                self.block(link, (low[0] + d / 2, (low[1] + high[1]) / 2, z),
                           (0.6 * d, w - 2 * rail, 0.6 * pitch), material)  # fmt: skip
            return
        field = "glass" if kind == "glass" else material
        inner_low[0] += 0.45 * d
        inner_high[0] -= 0.2 * d
        self.panel(link, inner_low, inner_high, field)

    def border(
        self, link: str, low: ArrayLike, high: ArrayLike, rail: float, material: str = "front"
    ) -> None:
        """A frame of two stiles and two rails in the y-z plane, `rail` wide."""
        (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        self.box(link, (x0, y0, z0), (x1, y0 + rail, z1), material)
        self.box(link, (x0, y1 - rail, z0), (x1, y1, z1), material)
        self.box(link, (x0, y0 + rail, z0), (x1, y1 - rail, z0 + rail), material)
        self.box(link, (x0, y0 + rail, z1 - rail), (x1, y1 - rail, z1), material)

    def _moulding(
        self, link: str, low: FloatArray, high: FloatArray, a: float, b: float, rail: float,
        material: str,
    ) -> None:  # fmt: skip
        z0, z1 = low[2] + a * (high[2] - low[2]), low[2] + b * (high[2] - low[2])
        p = np.array([low[0] - 0.006, low[1] + rail, z0 + rail])
        q = np.array([low[0], high[1] - rail, z1 - rail])
        if (q - p)[1:].min() > 0.05:
            self.border(link, p, q, 0.012, material)

    def drawer_box(
        self, link: str, low: ArrayLike, high: ArrayLike, thickness: float = 0.01,
        material: str = "inside",
    ) -> None:  # fmt: skip
        """The box behind a drawer's front: bottom, two sides and back, open above and in front."""
        self.shell(link, low, high, thickness, "-x,+z", material, "drawer_box")

    # -- controls -------------------------------------------------------------------------
    def rotary(
        self, parent: str, center: ArrayLike, normal: ArrayLike, radius: float, depth: float,
        material: str = "dark", name: str = "knob", turn: float = 2 * np.pi * 0.75,
    ) -> str:  # fmt: skip
        """A rotary knob as its own link, spinning about the surface's normal; returns the link.

        `turn` is its range in radians; infinite for endless encoders.
        """
        link = self.link(name, "knob")
        g = max(self.gap * 0.2, 0.0004)
        with self.facing(center, normal):
            skirt = self.uniform(1.0, 1.25)
            taper = self.uniform(0.75, 1.0)
            profile = [[skirt * radius, g], [skirt * radius, g + 0.2 * depth],
                       [radius, g + 0.25 * depth], [taper * radius, depth]]  # fmt: skip
            self.lathe(link, profile, material)
            mark = self.integer(0, 2)
            if mark == 0:
                self.block(
                    link,
                    (0.5 * taper * radius, 0, depth),
                    (0.7 * radius, 0.12 * radius, 0.1 * depth),
                    "light",
                    "decor",
                )
            elif mark == 1:
                self.block(link, (0, 0, 1.2 * depth), (1.7 * taper * radius, 0.35 * radius,
                           0.5 * depth), material)  # fmt: skip
            upper = float(turn)
            lower = 0.0 if np.isfinite(upper) else -np.inf
            self.spin(link, parent, (0, 0, 0), (0, 0, 1), lower, upper)
            self.grasp(link, "knob", (0, 0, 0.7 * depth), (0, 0, -1), (0, 1, 0), 2 * radius)
        return link

    def button(
        self, parent: str, center: ArrayLike, normal: ArrayLike, width: float, height: float,
        travel: float = 0.003, material: str = "light", name: str = "button",
        shape: Literal["round", "square"] = "square", bezel: bool | None = None,
    ) -> str:  # fmt: skip
        """A push button as its own link; it goes into the surface by `travel`; returns the link.

        The cap hovers by its travel over the surface, behind a bezel, so it never cuts into it.
        """
        link = self.link(name, "button")
        cap = max(travel * 1.2, 0.25 * min(width, height))
        low, edge = travel + 0.0002, 0.12 * min(width, height)
        with self.facing(center, normal):
            if shape == "round":
                self.cylinder(link, (0, 0, low), (0, 0, low + cap), width / 2, 0.46 * width,
                              material)  # fmt: skip
            else:
                self.block(link, (0, 0, low + cap / 2), (height, width, cap), material)
            if self.chance(0.6) if bezel is None else bezel:
                tall = low + 0.4 * cap
                if shape == "round":
                    inner = width / 2 + 0.4 * edge
                    self.tube(parent, (0, 0, 0), (0, 0, tall), inner + edge, inner, "trim", "decor")
                else:
                    h, w = height / 2 + 0.4 * edge, width / 2 + 0.4 * edge
                    for s in (-1, 1):
                        self.block(parent, (s * (h + edge / 2), 0, tall / 2),
                                   (edge, 2 * w + 2 * edge, tall), "trim", "decor")  # fmt: skip
                        self.block(parent, (0, s * (w + edge / 2), tall / 2),
                                   (2 * h, edge, tall), "trim", "decor")  # fmt: skip
            self.slide(link, parent, (0, 0, -1), 0.0, travel, ajar=False)
            self.grasp(link, "push", (0, 0, low + cap), (0, 0, -1), (0, 1, 0), 0.0)
        return link

    # -- wheels, feet, trims --------------------------------------------------------------
    def wheel(
        self, link: str, center: ArrayLike, axis: ArrayLike, radius: float, width: float,
        spokes: int = 5, material: str = "rubber", hub: str = "metal",
    ) -> None:  # fmt: skip
        """Tyre, rim and spokes (0: a full disc) about `axis`, centred on `center`."""
        n = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
        with self.facing(center, n, (1, 0, 0) if abs(n[0]) < 0.9 else (0, 0, 1)):
            w, tyre = width / 2, radius * self.uniform(0.7, 0.85)
            profile = [[tyre, -w], [0.95 * radius, -w], [radius, -0.6 * w], [radius, 0.6 * w],
                       [0.95 * radius, w], [tyre, w]]  # fmt: skip
            shape = shapes.revolve(profile, self.segments(radius, low=16), loop=True)
            self.add(link, shape, _wheel_collision(radius, width), material)
            if spokes == 0:
                self.cylinder(link, (0, 0, -0.8 * w), (0, 0, 0.8 * w), tyre, None, hub,
                              collision=False)  # fmt: skip
                return
            self.cylinder(link, (0, 0, -w), (0, 0, w), 0.18 * radius, None, hub, collision=False)
            for k in range(spokes):
                with self.moved((0, 0, 0), (0, 0, 1), 2 * np.pi * k / spokes):
                    self.block(
                        link,
                        (0.58 * tyre, 0, 0),
                        (0.86 * tyre, 0.12 * radius, 0.6 * w),
                        hub,
                        collision=False,
                    )

    def feet(
        self, link: str, low: ArrayLike, high: ArrayLike, height: float, kind: str = "square",
        material: str = "trim", inset: float = 0.03,
    ) -> None:  # fmt: skip
        """Something that carries a body whose floor plan is low..high (x, y) up to z = height.

        Kinds: square, round, tapered, plinth, sled.
        """
        (x0, y0), (x1, y1) = np.asarray(low)[:2], np.asarray(high)[:2]
        r = float(np.clip(0.04 * min(x1 - x0, y1 - y0), 0.01, 0.035))
        m = inset + r
        if kind == "plinth":
            self.box(link, (x0 + inset, y0, 0), (x1, y1, height), material)
            return
        if kind == "sled":
            for y in (y0 + m, y1 - m):
                self.box(link, (x0 + inset, y - r, 0), (x1 - inset, y + r, height), material)
            return
        for x in (x0 + m, x1 - m):
            for y in (y0 + m, y1 - m):
                if kind == "square":
                    self.block(link, (x, y, height / 2), (2 * r, 2 * r, height), material)
                else:
                    low_r = r * (0.6 if kind == "tapered" else 1.0)
                    self.cylinder(link, (x, y, 0), (x, y, height), low_r, r, material)

    def cornice(
        self, link: str, low: ArrayLike, high: ArrayLike, reach: float, height: float,
        material: str = "trim",
    ) -> None:  # fmt: skip
        """A stepped top board over the floor plan low..high, standing at z = low[2]."""
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        steps = self.integer(1, 3)
        for k in range(steps):
            out = reach * (k + 1) / steps
            z0, z1 = low[2] + height * k / steps, low[2] + height * (k + 1) / steps
            self.box(link, (low[0] - out, low[1] - out, z0), (high[0], high[1] + out, z1), material)


def _wheel_collision(radius: float, width: float) -> list:
    from mam_world import collide

    return [collide.cylinder((0, 0, -width / 2), (0, 0, width / 2), radius)]
