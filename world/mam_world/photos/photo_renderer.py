"""A small ray-cast renderer with procedural materials, for synthetic photographs with truth.

Scenes are boxes, cylinders and ellipsoids. Surfaces are coloured by solid textures (wood grain,
stone, weave) evaluated at the hit points, lit by one soft key light with shadows and by ambient
light with occlusion: enough realism to have shadows in gaps, gloss and grain.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import open3d as o3d  # its stubs know few overloads
from numpy.typing import NDArray
from scipy import ndimage

from mam_pipeline.photo.camera import Camera
from mam_pipeline.render.tracer import Tracer

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """A procedural material. Colours are linear RGB 0..1; `grain` is the axis of wood fibres.

    `kind`: plain | wood | noise | weave | tiles | glyph (ornament) | mirror (fake reflection).
    """

    kind: str = "plain"
    color: tuple[float, float, float] = (0.7, 0.7, 0.7)
    second: tuple[float, float, float] = (0.5, 0.5, 0.5)
    grain: int = 2
    scale: float = 1.0
    gloss: float = 0.05
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass
class Scene:
    """Triangles with a surface index each, in metres (asset frame)."""

    vertices: list[Array] = field(default_factory=list)
    faces: list[NDArray[np.int64]] = field(default_factory=list)
    surface_of: list[NDArray[np.int64]] = field(default_factory=list)
    surfaces: list[Surface] = field(default_factory=list)
    count: int = 0

    def material(self, surface: Surface) -> int:
        """Register a surface and return its index."""
        self.surfaces.append(surface)
        return len(self.surfaces) - 1

    def add(self, vertices: Array, faces: NDArray[np.int64], surface: int) -> None:
        """Add triangles."""
        self.vertices.append(np.asarray(vertices, dtype=np.float64))
        self.faces.append(np.asarray(faces, dtype=np.int64) + self.count)
        self.surface_of.append(np.full(len(faces), surface))
        self.count += len(vertices)

    def box(self, low: Array, high: Array, surface: int, yaw: float = 0.0) -> None:
        """Add an axis-aligned box between two corners (turned by `yaw` about its own centre)."""
        lo, hi = np.minimum(low, high), np.maximum(low, high)
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        v = lo + corners * (hi - lo)
        if yaw:
            c, s = np.cos(yaw), np.sin(yaw)
            mid = (lo + hi) / 2
            v = (v - mid) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + mid
        self.add(v, BOX_FACES, surface)

    def tube(self, a: Array, b: Array, r0: float, r1: float, surface: int, n: int = 20) -> None:
        """Add a capped cone frustum from `a` (radius r0) to `b` (radius r1)."""
        a, b = np.asarray(a, float), np.asarray(b, float)
        axis = (b - a) / (np.linalg.norm(b - a) + 1e-12)
        side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.8 else [0, 1.0, 0])
        side /= np.linalg.norm(side)
        up = np.cross(axis, side)
        t = np.linspace(0, 2 * np.pi, n, endpoint=False)
        ring = np.cos(t)[:, None] * side + np.sin(t)[:, None] * up
        v = np.concatenate([a + r0 * ring, b + r1 * ring, [a, b]])
        i = np.arange(n)
        j = (i + 1) % n
        f = np.concatenate(
            [
                np.stack([i, j, n + i], 1),
                np.stack([j, n + j, n + i], 1),
                np.stack([j, i, np.full(n, 2 * n)], 1),
                np.stack([n + i, n + j, np.full(n, 2 * n + 1)], 1),
            ]
        )
        self.add(v, f, surface)

    def ellipsoid(self, center: Array, radii: Array, surface: int) -> None:
        """Add an ellipsoid."""
        ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
        v = np.asarray(ball.vertices) * np.asarray(radii) + np.asarray(center)
        self.add(v, np.asarray(ball.triangles).astype(np.int64), surface)


BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def _noise_volume() -> Array:
    rng = np.random.default_rng(7)
    volume = ndimage.gaussian_filter(rng.standard_normal((48, 48, 48)), 1.0, mode="wrap")
    return volume / volume.std()


_VOLUME = _noise_volume()


def noise(points: Array) -> Array:
    """Smooth tileable noise of about unit variance at (n, 3) points, lattice spacing 1."""
    return ndimage.map_coordinates(_VOLUME, (points % 48).T, order=1, mode="grid-wrap")


def albedo(surface: Surface, p: Array, normal: Array) -> Array:
    """(n, 3) linear colour of a surface at world points `p` (metres)."""
    a, b = np.asarray(surface.color), np.asarray(surface.second)
    q = p + np.asarray(surface.offset)
    if surface.kind == "wood":
        stretch = np.full(3, 14.0 * surface.scale)
        stretch[surface.grain] = 1.1 * surface.scale
        base = noise(q * stretch)
        fine = noise(q * stretch * 6 + 11)
        rings = 0.5 + 0.5 * np.sin(5.0 * base + 22 * surface.scale * q[:, (surface.grain + 1) % 3])
        t = np.clip(0.55 * rings + 0.25 * fine * 0.6 + 0.2, 0, 1)
    elif surface.kind == "noise":
        t = np.clip(0.5 + 0.3 * noise(q * 9 * surface.scale) + 0.2 * noise(q * 60), 0, 1)
    elif surface.kind == "weave":
        u = q * (110.0 * surface.scale)
        t = 0.5 + 0.5 * np.sin(u[:, 1]) * np.sin(u[:, 2]) + 0.1 * noise(q * 300)
        t = (t > 0.62).astype(float) * 0.9
    elif surface.kind == "tiles":
        u = np.abs(((q * 4.0 * surface.scale) % 1.0) - 0.5)
        t = 0.25 * np.clip(noise(np.floor(q * 4.0 * surface.scale) * 3.1), -1, 2) + 0.3
        t = np.where((u[:, :2].max(axis=1) > 0.488), 1.0, np.clip(t, 0, 1))
    elif surface.kind == "glyph":
        u = q * (28.0 * surface.scale)
        r = np.hypot((u[:, 1] % 2) - 1, (u[:, 2] % 2) - 1)
        t = (np.abs(r - 0.8) < 0.12).astype(float)
    elif surface.kind == "mirror":
        t = np.clip(0.5 + 0.5 * noise(q * 3.0 * surface.scale) + 0.2 * noise(q * 14), 0, 1)
    else:
        t = np.clip(0.06 * noise(q * 25) + 0.04 * noise(q * 160), -0.12, 0.12)
        return np.clip(a * (1 + t[:, None]), 0, 1)
    return np.clip(a + (b - a) * t[:, None], 0, 1)


@dataclass(frozen=True)
class Light:
    """Key light direction (towards the light), softness (radians), key and ambient strength."""

    direction: tuple[float, float, float] = (-0.6, 0.4, 0.8)
    softness: float = 0.25
    key: float = 0.75
    ambient: float = 0.45
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)


def render(
    scene: Scene,
    camera: Camera,
    light: Light,
    background: tuple[float, float, float] = (1.0, 1.0, 1.0),
    supersample: int = 2,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Render (H, W, 3) uint8 sRGB."""
    rng = np.random.default_rng(seed)
    tracer = Tracer(np.concatenate(scene.vertices), np.concatenate(scene.faces))
    owner = np.concatenate(scene.surface_of)
    h, w = camera.height, camera.width
    sky = np.asarray(background, dtype=float)
    y, x = np.mgrid[0:h, 0:w]
    centre = np.stack([x.ravel() + 0.5, y.ravel() + 0.5], 1)

    def shade(pixel: Array, shadows: int, skies: int) -> tuple[Array, NDArray[np.int64]]:
        colors, ids = [], []
        for part in np.array_split(pixel, max(1, len(pixel) // 300_000)):
            color, of = _shade(
                scene, tracer, owner, camera, light, part, sky, rng, shadows, skies
            )  # fmt: skip
            colors.append(color)
            ids.append(of)
        return np.concatenate(colors), np.concatenate(ids)

    color, ids = shade(centre, 2, 3)
    if supersample > 1:  # edges only: the rest is smooth enough with one sample
        edge = np.flatnonzero(_edges(color.reshape(h, w, 3), ids.reshape(h, w)))
        k = (np.arange(supersample) + 0.5) / supersample - 0.5
        total = np.zeros((len(edge), 3))
        for dy in k:
            for dx in k:
                total += shade(centre[edge] + [dx, dy], 1, 1)[0]
        color[edge] = total / supersample**2
    srgb = np.clip(color.reshape(h, w, 3), 0, 1) ** (1 / 2.2)
    return (srgb * 255 + 0.5).astype(np.uint8)


def _edges(color: Array, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(h, w) pixels at an outline or a strong step of colour."""
    step = np.zeros(ids.shape, bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(np.sqrt(np.clip(color, 0, 1)), axis=axis)).max(axis=2) > 0.09
        jump |= np.diff(ids, axis=axis) != 0
        one = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        two = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        step[one] |= jump
        step[two] |= jump
    return step


def _shade(
    scene: Scene, tracer: Tracer, owner: NDArray[np.int64], camera: Camera, light: Light,
    pixel: Array, sky: Array, rng: np.random.Generator, shadows: int, skies: int,
) -> tuple[Array, NDArray[np.int64]]:  # fmt: skip
    """((n, 3) linear colour, (n,) which surface and orientation) at (n, 2) pixel positions."""
    origin, direction = camera.rays(pixel)
    out = np.tile(sky, (len(pixel), 1))
    ids = np.full(len(pixel), -1)
    found = tracer.cast(origin, direction)
    seen, d, p, normal = found.hit, found.rays, found.at, found.normal
    if not seen.any():
        return out, ids
    which = owner[found.face]
    ids[seen] = which * 27 + (np.round(normal) + 1).astype(int) @ [9, 3, 1]
    color = np.zeros((len(p), 3))
    gloss = np.zeros(len(p))
    for index in np.unique(which):
        of = which == index
        color[of] = albedo(scene.surfaces[index], p[of], normal[of])
        gloss[of] = scene.surfaces[index].gloss
    to_light = np.asarray(light.direction) / np.linalg.norm(light.direction)
    start = p + 1e-4 * normal
    key = np.zeros(len(p))
    spark = np.zeros(len(p))
    for _ in range(shadows):
        sun = to_light + light.softness * rng.standard_normal(p.shape)
        sun /= np.linalg.norm(sun, axis=1)[:, None]
        lambert = np.clip((normal * sun).sum(1), 0, None)
        lit = ~tracer.blocked(start, sun, 6.0)
        half = sun - d
        half /= np.linalg.norm(half, axis=1)[:, None] + 1e-9
        key += lambert * lit / shadows
        spark += np.clip((half * normal).sum(1), 0, 1) ** 40 * lit * 2.0 / shadows
    open_sky = np.zeros(len(p))
    for _ in range(skies):
        around = normal + _sphere(rng, len(p))
        around /= np.linalg.norm(around, axis=1)[:, None] + 1e-9
        open_sky += np.clip(tracer.distance(start, around) / 0.35, 0.12, 1.0) ** 0.5 / skies
    shade = light.key * key + light.ambient * open_sky * (0.85 + 0.15 * normal[:, 2])
    out[seen] = color * shade[:, None] * np.asarray(light.tint) + (gloss * spark)[:, None]
    return out, ids


def _sphere(rng: np.random.Generator, n: int) -> Array:
    v = rng.standard_normal((n, 3))
    return v / (np.linalg.norm(v, axis=1)[:, None] + 1e-9)
