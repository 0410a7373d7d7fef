"""Renders the example pictures in examples/: procedural furniture made by this project.

Usage: python scripts/example_photos.py [--out examples]
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import tyro

from mam_world.photos.furniture_scene import build_piece
from mam_world.photos.photo_renderer import Light, Scene, Surface, render
from mam_world.photos.synthetic_furniture import WOODS, Cell, Style
from mam_world.photos.synthetic_photo import frame_camera

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
OAK = Surface("wood", WOODS[1][0], WOODS[1][1], grain=1, scale=0.8, offset=(3, 1, 2), gloss=0.04)
SAGE = Surface("plain", (0.30, 0.38, 0.31), gloss=0.05)
BLACK = Surface("plain", (0.02, 0.02, 0.02), gloss=0.5)
WALL = Surface("plain", (0.78, 0.76, 0.72))
FLOOR = Surface("wood", WOODS[3][0], WOODS[3][1], grain=1, scale=0.5)


def palette(body: Surface, handle: Surface = BLACK) -> dict[str, Surface]:
    """Surfaces of one piece."""
    return {
        "body": body, "panel": body, "top": body, "inlay": body, "handle": handle,
        "dark": BLACK, "inside": body,
    }  # fmt: skip


def picture(
    category: str,
    size: tuple[float, float, float],
    cells: list[Cell],
    style: Style,
    body: Surface,
    view: tuple[float, float],
    room: bool,
) -> np.ndarray:
    """Render one piece, seen at yaw and pitch in degrees, before a plain backdrop or in a room."""
    rng = np.random.default_rng(4)
    scene = Scene()
    piece = build_piece(scene, rng, category, size, cells, style, palette(body))
    yaw, pitch = np.deg2rad(view)
    camera = frame_camera(piece, (960, 960), float(yaw), float(pitch), 0.0, 42.0)
    tone = Surface("plain", (1.2, 1.2, 1.2))
    ground = scene.material(FLOOR if room else tone)
    scene.box(np.array([-9, -9, -0.05]), np.array([9, 9, 0.0]), ground)
    if room:
        wall = scene.material(WALL)
        scene.box(np.array([size[1] + 0.15, -9, 0]), np.array([size[1] + 0.25, 9, 6]), wall)
    light = Light((-0.7, 0.5, 0.9), softness=0.35, key=0.7, ambient=0.5)
    return render(scene, camera, light, (1.0, 1.0, 1.0), supersample=3, seed=1)


def main(out: Path = EXAMPLES) -> None:
    """Write the examples.

    Args:
        out: folder for them.
    """
    out.mkdir(parents=True, exist_ok=True)
    stack = [Cell("drawer", (0, k / 3, 1, (k + 1) / 3)) for k in range(3)]
    mixed = [
        Cell("drawer", (0, 0, 0.5, 0.28)), Cell("drawer", (0.5, 0, 1, 0.28)),
        Cell("door", (0, 0.28, 0.5, 1), "left"), Cell("door", (0.5, 0.28, 1, 1), "right"),
    ]  # fmt: skip
    jobs = {
        "nightstand": picture(
            "nightstand", (0.45, 0.40, 0.55), stack,
            Style(gap=0.004, handle="bar", handle_size=0.14),
            OAK, (28, 16), False,
        ),
        "cabinet": picture(
            "cabinet", (0.90, 0.42, 0.80), mixed,
            Style(gap=0.004, frame=0.03, inset=True, panel="shaker", handle="knob", legs=0.12),
            SAGE, (-24, 12), True,
        ),
    }  # fmt: skip
    for name, image in jobs.items():
        file = out / f"{name}.jpg"
        cv2.imwrite(str(file), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
        print(file)


if __name__ == "__main__":
    tyro.cli(main)
