"""Flat procedural surfaces: paint, wood, stone, brushed metal, weave, tiles, in random colours."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]
KINDS = ("plain", "wood", "stone", "brushed", "weave", "tiles")
SHARES = (0.46, 0.34, 0.07, 0.06, 0.03, 0.04)


@dataclass(frozen=True)
class Texture:
    """A surface of one kind; every `draw` gives another piece of it.

    Attributes:
        colour, second: RGB 0..1 as a picture holds them.
        contrast: 0..1 between the two.
        scale: of the pattern; grain runs upright where `upright`.
    """

    kind: str
    colour: NDArray[np.float32]
    second: NDArray[np.float32] | None = None
    contrast: float = 0.5
    scale: float = 1.0
    upright: bool = True

    def draw(self, rng: np.random.Generator, h: int, w: int) -> Picture:
        """(h, w, 3) float32 of it."""
        if h < 1 or w < 1:
            return np.zeros((h, w, 3), np.float32)
        first = self.colour
        second = first * 0.8 if self.second is None else self.second
        t = self._mix(rng, h, w)[..., None] * self.contrast
        return np.ascontiguousarray(np.clip(first + (second - first) * t, 0, 1), np.float32)

    def _mix(self, rng: np.random.Generator, h: int, w: int) -> Picture:
        s = self.scale
        if self.kind == "wood":
            long, thin = (h, w) if self.upright else (w, h)
            base = _noise(rng, long, thin, 90 / s, 9 / s)
            fine = _noise(rng, long, thin, 40 / s, 1.6)
            x = np.linspace(0, thin / (24 / s), thin, dtype=np.float32)
            t = 0.5 + 0.3 * np.sin(3.0 * base + x[None] * 3) + 0.18 * fine
            return np.asarray(t if self.upright else t.T, np.float32)
        if self.kind == "stone":
            return 0.5 + 0.3 * _noise(rng, h, w, 30 / s, 30 / s) + 0.2 * _noise(rng, h, w, 3, 3)
        if self.kind == "brushed":
            return 0.5 + 0.25 * (
                _noise(rng, h, w, 60, 1.2) if self.upright else _noise(rng, h, w, 1.2, 60)
            )
        y, x = np.mgrid[0:h, 0:w].astype(np.float32)
        if self.kind == "weave":
            k = 0.55 / max(s, 0.3)
            return np.asarray(0.5 + 0.5 * np.sin(k * x) * np.sin(k * y), np.float32)
        if self.kind == "tiles":
            size = 46.0 * s
            joint = np.minimum(x % size, y % size) < 2.0
            return np.asarray(joint, np.float32)
        return 0.3 * _noise(rng, h, w, 40, 40) + 0.1 * _noise(rng, h, w, 2, 2)


def _noise(rng: np.random.Generator, h: int, w: int, down: float, across: float) -> Picture:
    """Smooth noise of about unit variance with these lengths, pixels."""
    n = max(2, int(h / max(down, 1.0)) + 2), max(2, int(w / max(across, 1.0)) + 2)
    grid = rng.standard_normal(n).astype(np.float32)
    return np.asarray(cv2.resize(grid, (w, h), interpolation=cv2.INTER_CUBIC), np.float32)


def random_colour(rng: np.random.Generator) -> NDArray[np.float32]:
    """RGB 0..1: whites, greys and blacks, woods, and now and then any colour."""
    pick = rng.random()
    if pick < 0.3:
        tone = rng.uniform(0.7, 0.97) * np.array([1.0, rng.uniform(0.96, 1), rng.uniform(0.88, 1)])
    elif pick < 0.5:
        tone = np.full(3, rng.uniform(0.02, 0.65)) * rng.normal(1, 0.03, 3)
    elif pick < 0.8:
        tone = np.array(
            colorsys.hsv_to_rgb(
                rng.uniform(0.03, 0.12), rng.uniform(0.2, 0.75), rng.uniform(0.15, 0.85)
            )
        )
    else:
        tone = np.array(
            colorsys.hsv_to_rgb(rng.uniform(0, 1), rng.uniform(0.1, 0.8), rng.uniform(0.1, 0.9))
        )
    return np.clip(tone, 0, 1).astype(np.float32)


def random_texture(rng: np.random.Generator, kind: str | None = None) -> Texture:
    """A surface of a random kind (or of `kind`)."""
    kind = str(rng.choice(KINDS, p=SHARES)) if kind is None else kind
    first = random_colour(rng)
    texture = Texture(
        kind, first, None, float(rng.uniform(0.2, 1.0)), float(np.exp(rng.normal(0, 0.4))),
        bool(rng.random() < 0.6),
    )  # fmt: skip
    if kind == "wood":
        hue = (rng.uniform(0.03, 0.12), rng.uniform(0.15, 0.75), rng.uniform(0.15, 0.9))
        first = np.array(colorsys.hsv_to_rgb(*hue), np.float32)
        return replace(texture, colour=first, second=first * float(rng.uniform(0.5, 0.9)))
    if kind == "plain":
        return replace(texture, contrast=float(rng.uniform(0.0, 0.5)))
    return replace(texture, second=np.clip(first * float(rng.uniform(0.4, 1.5)), 0, 1))
