"""Pictures show the scene as one would see it: left is left, near hides far, shadows are dark."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mam_pipeline.render.mesh_pictures import render_mesh
from mam_pipeline.render.scene_pictures import render_scene
from mam_pipeline.types import FloatArray, IntArray, Mesh


def _box(size: float, at: tuple[float, float, float]) -> tuple[FloatArray, IntArray]:
    box = trimesh.creation.box((size, size, size)).apply_translation(at)
    return np.asarray(box.vertices), np.asarray(box.faces)


@pytest.mark.parametrize("renderer", ["mesh", "scene"])
def test_what_is_at_the_viewers_left_is_left_in_the_picture(renderer: str) -> None:
    # the viewer looks along +X with Z up, so +Y is left; the left box is larger than the right one
    a, b = _box(0.6, (0, 0.5, 0)), _box(0.3, (0, -0.5, 0))
    vertices, faces = np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1] + len(a[0])])
    if renderer == "mesh":
        picture = render_mesh(Mesh(vertices, faces), (64, 64), azimuth=0.0, elevation=0.0)
    else:
        eye, target, gray = np.array([-4.0, 0, 0]), np.zeros(3), np.full((len(faces), 3), 0.5)
        picture = render_scene(vertices, faces, gray, eye, target, (64, 64))
    drawn = np.abs(picture.astype(int) - picture[0, 0]).sum(axis=2) > 0
    assert drawn[:, :32].sum() > 2 * drawn[:, 32:].sum() > 0


def test_the_far_box_is_hidden_and_the_floor_lies_in_shadow() -> None:
    near, far = _box(0.5, (0, 0, 1.0)), _box(0.3, (1, 0, 1.0))
    floor = np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], dtype=float)
    vertices = np.concatenate([near[0], far[0], floor])
    faces = np.concatenate([near[1], far[1] + 8, np.array([[0, 1, 2], [0, 2, 3]]) + 16])
    colors = np.zeros((len(faces), 3))
    colors[:12, 0], colors[12:24, 1], colors[24:, 2] = 1.0, 1.0, 1.0
    level = (vertices, faces, colors, np.array([-4.0, 0, 1.0]), np.array([0, 0, 1.0]), (64, 64))
    picture = render_scene(*level)
    red, green, blue = np.moveaxis(picture, 2, 0)
    assert ((red > 100) & (blue == 0)).any() and not ((green > 100) & (red == 0)).any()
    above = render_scene(*level[:3], np.array([-0.01, 0, 9.0]), np.zeros(3), (64, 64))
    ground = above[..., 2][(above[..., 0] == 0) & (above[..., 1] == 0)]
    assert int(ground.max()) > 1.5 * int(ground.min()) > 0
