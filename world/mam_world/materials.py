"""Procedural materials: palettes of colours, and wood, metal, fabric and stone pictures as PNG."""

from __future__ import annotations

import colorsys
import io
import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import ndimage

from mam_pipeline.types import FloatArray, Material

Colour = tuple[float, float, float]
TILE = 0.5  # metres of surface that one texture picture covers


@dataclass(frozen=True)
class Paint:
    """A material before its picture is drawn: colour (0..1), pattern and shine."""

    color: Colour
    pattern: str = "plain"  # plain | wood | brushed | fabric | stone
    metallic: float = 0.0
    roughness: float = 0.7
    alpha: float = 1.0


def hsv(h: float, s: float, v: float) -> Colour:
    """RGB colour of hue, saturation, value (each 0..1; the hue wraps)."""
    return colorsys.hsv_to_rgb(h % 1.0, min(max(s, 0.0), 1.0), min(max(v, 0.0), 1.0))


def draw_palette(rng: np.random.Generator, theme: str = "any") -> dict[str, Paint]:
    """Role name -> paint. Themes: wood, paint, white, steel, dark, plastic, any."""
    if theme == "any":
        theme = str(rng.choice(["wood", "wood", "paint", "white", "dark", "plastic"]))
    u = rng.random
    hue = u()
    wood = Paint(hsv(0.05 + 0.06 * u(), 0.25 + 0.5 * u(), 0.3 + 0.55 * u()), "wood", 0.0, 0.6)
    body = {
        "wood": wood,
        "paint": Paint(hsv(hue, 0.15 + 0.6 * u(), 0.35 + 0.6 * u())),
        "white": Paint(hsv(hue, 0.05 * u(), 0.82 + 0.16 * u())),
        "steel": Paint(hsv(0.6, 0.05 * u(), 0.5 + 0.35 * u()), "brushed", 0.9, 0.35),
        "dark": Paint(hsv(hue, 0.25 * u(), 0.08 + 0.2 * u())),
        "plastic": Paint(hsv(hue, 0.1 + 0.85 * u(), 0.3 + 0.65 * u()), "plain", 0.0, 0.45),
    }[theme]
    h, s, v = colorsys.rgb_to_hsv(*body.color)
    near = Paint(hsv(h, s * (0.6 + 0.6 * u()), v * (0.75 + 0.4 * u())), body.pattern,
                 body.metallic, body.roughness)  # fmt: skip
    far = Paint(hsv(h + 0.3 + 0.4 * u(), 0.2 + 0.6 * u(), 0.25 + 0.7 * u()))
    front = [body, near, far, Paint(hsv(0.1, 0.05, 0.93))][
        int(rng.choice(4, p=[0.45, 0.3, 0.15, 0.1]))
    ]
    grey = 0.25 + 0.6 * u()
    return {
        "body": body,
        "front": front,
        "trim": near,
        "inside": Paint(hsv(h, 0.3 * s, 0.75 + 0.2 * u())),
        "metal": Paint(hsv(0.1 * u(), 0.25 * u() * u(), grey), "brushed", 0.9, 0.3),
        "accent": far,
        "dark": Paint(hsv(h, 0.1, 0.06 + 0.14 * u()), "plain", 0.0, 0.5),
        "light": Paint(hsv(h, 0.03, 0.9 + 0.08 * u())),
        "glass": Paint(hsv(0.5 + 0.1 * u(), 0.15, 0.55 + 0.3 * u()), "plain", 0.0, 0.05, 0.5),
        "screen": Paint(hsv(0.6, 0.4 * u(), 0.08 + 0.1 * u()), "plain", 0.0, 0.1),
        "rubber": Paint(hsv(0.0, 0.0, 0.08 + 0.1 * u()), "plain", 0.0, 0.95),
        "wood": wood,
        "fabric": Paint(hsv(u(), 0.5 * u(), 0.25 + 0.6 * u()), "fabric", 0.0, 0.95),
        "stone": Paint(hsv(0.1, 0.08 * u(), 0.4 + 0.5 * u()), "stone", 0.0, 0.4),
        "red": Paint(hsv(0.99, 0.85, 0.75)),
        "green": Paint(hsv(0.36, 0.7, 0.6)),
        "gold": Paint(hsv(0.12, 0.55, 0.8), "brushed", 0.9, 0.3),
        "skin": Paint(hsv(0.08, 0.3 * u(), 0.85)),
    }


def to_material(name: str, paint: Paint, textures: bool) -> Material:
    """The mesh material of a paint; with `textures` a PNG picture carries colour and pattern."""
    if not textures or paint.alpha < 1.0:
        rgba = (*paint.color, paint.alpha)
        return Material(name, rgba, None, None, paint.metallic, paint.roughness)
    image = picture(paint)
    return Material(name, (1.0, 1.0, 1.0, 1.0), image, "png", paint.metallic, paint.roughness)


@lru_cache(maxsize=256)
def picture(paint: Paint, size: int = 128) -> bytes:
    """PNG bytes of a tileable picture of a paint (TILE metres wide)."""
    from PIL import Image

    rng = np.random.default_rng(zlib.crc32(repr(paint).encode()))
    shade = _pattern(paint.pattern, size, rng)
    rgb = np.clip(np.asarray(paint.color) * shade[..., None] * 255, 0, 255).astype(np.uint8)
    out = io.BytesIO()
    Image.fromarray(rgb).save(out, format="PNG", optimize=False)
    return out.getvalue()


def _pattern(kind: str, size: int, rng: np.random.Generator) -> FloatArray:
    """(size, size) brightness factors around 1, tileable."""

    def smooth(sy: float, sx: float) -> FloatArray:
        field = ndimage.gaussian_filter(rng.standard_normal((size, size)), (sy, sx), mode="wrap")
        return field / max(float(field.std()), 1e-9)

    if kind == "wood":
        x = np.linspace(0, 2 * np.pi, size, endpoint=False)[None, :]
        rings = np.sin(6 * x + 1.2 * smooth(size / 4, size / 16))
        return 1 + 0.09 * rings + 0.06 * smooth(size / 10, 0.7)
    if kind == "brushed":
        return 1 + 0.05 * smooth(0.5, size / 6)
    if kind == "fabric":
        y, x = np.mgrid[0:size, 0:size]
        return 1 + 0.12 * np.where((x // 2 + y // 2) % 2, 1.0, -1.0) + 0.06 * smooth(1, 1)
    if kind == "stone":
        return 1 + 0.1 * smooth(6, 6) - 0.25 * np.exp(-((smooth(9, 9) * 6) ** 2))
    return 1 + 0.015 * smooth(2, 2)
