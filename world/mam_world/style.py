"""The styles of real meshes: independent switches between an exact object and what a user has."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

Tessellation = Literal["coarse", "normal", "dense"]
Setting = Literal["none", "board", "table", "wall", "corner", "niche"]
SETTINGS: tuple[Setting, ...] = ("none", "board", "table", "wall", "corner", "niche")
UNITS: dict[str, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "inch": 1.0 / 0.0254}


@dataclass(frozen=True)
class Style:
    """How the static file differs from the exact object (design.md section 8).

    Attributes:
        gap: clearance between neighbouring parts, as a share of the object's size (0: faces touch).
        double_sided: every face twice, the second reversed.
        unshared: no two triangles share a vertex.
        components: "parts" as built, "split" into flat sides, "welded" across touching shapes.
        sheets: thin panels become sheets without thickness.
        open_shells: hidden sides of boxes are missing.
        drawer_boxes: False leaves only the fronts of drawers.
        fasteners: screws and bolts as extra components.
        tessellation: few, some or many triangles.
        yaw, tilt, tilt_towards: rotation of the file's axes, radians.
        y_up, unit: axes and unit of the file.
        ajar: probability that a joint of the source is partly open.
        nodes: names of the file's nodes: one "object", one per "component", one per true "part".
        fused: one watertight outer surface with `fuse_resolution` cells along the longest side and
            noise of `fuse_noise` of the diagonal (standard deviation).
        textures: procedural pictures on the materials.
        setting: what the object stands on or before; it belongs to the base.
        decoys: how many fixed things stick to the body where nothing moves.
        overlap: boxes of the file are up to this share of the diagonal larger than the true ones,
            so that they sink into each other.
    """

    gap: float = 0.002
    double_sided: bool = False
    unshared: bool = False
    components: Literal["parts", "split", "welded"] = "parts"
    sheets: bool = False
    open_shells: bool = False
    drawer_boxes: bool = True
    fasteners: bool = False
    tessellation: Tessellation = "normal"
    yaw: float = 0.0
    tilt: float = 0.0
    tilt_towards: float = 0.0
    y_up: bool = False
    unit: Literal["m", "cm", "mm", "inch"] = "m"
    ajar: float = 0.0
    nodes: Literal["object", "component", "part"] = "component"
    fused: bool = False
    fuse_noise: float = 0.0
    fuse_resolution: int = 160
    textures: bool = False
    setting: Setting = "none"
    decoys: int = 0
    overlap: float = 0.0

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of all switches."""
        return tuple(f.name for f in fields(cls))


def draw_style(rng: np.random.Generator, fused: float = 0.2) -> Style:
    """A random style; each switch is drawn on its own. `fused` is the share of fused meshes."""

    def chance(p: float) -> bool:
        return bool(rng.random() < p)

    turned = chance(0.25)
    return Style(
        gap=float(rng.choice([0.0, 0.001, 0.002, rng.uniform(0.0, 0.01)])),
        double_sided=chance(0.25),
        unshared=chance(0.3),
        components=str(rng.choice(["parts", "parts", "split", "welded"])),  # type: ignore[arg-type]
        sheets=chance(0.12),
        open_shells=chance(0.15),
        drawer_boxes=chance(0.8),
        fasteners=chance(0.2),
        tessellation=str(rng.choice(["coarse", "normal", "normal", "dense"])),  # type: ignore[arg-type]
        yaw=float(rng.uniform(-np.pi, np.pi)) if turned else 0.0,
        tilt=float(abs(rng.normal(0, np.radians(3)))) if turned and chance(0.4) else 0.0,
        tilt_towards=float(rng.uniform(0, 2 * np.pi)),
        y_up=chance(0.35),
        unit=str(rng.choice(["m", "m", "m", "cm", "mm", "inch"])),  # type: ignore[arg-type]
        ajar=float(rng.choice([0.0, 0.0, 0.0, 0.3])),
        nodes=str(rng.choice(["object", "component", "component", "part"])),  # type: ignore[arg-type]
        fused=chance(fused),
        fuse_noise=float(rng.choice([0.0, 0.0005, 0.001, 0.002])),
        fuse_resolution=int(rng.choice([96, 128, 160, 192])),
        setting=str(rng.choice(SETTINGS, p=[0.72, 0.1, 0.06, 0.06, 0.03, 0.03])),  # type: ignore[arg-type]
        decoys=int(rng.choice([0, 1, 2, 4, 8], p=[0.7, 0.1, 0.08, 0.07, 0.05])),
        overlap=float(rng.choice([0.0, 0.0, 0.0, 0.0, rng.uniform(0.0, 0.006)])),
    )
