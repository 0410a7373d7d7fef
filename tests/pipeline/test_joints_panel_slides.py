"""Leaves of one skin: where they would slide into the material beside them, and where they may."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from mam_pipeline.joints.candidates import kind_probabilities, rank_hypotheses
from mam_pipeline.joints.panel_slides import slides_into_material
from mam_pipeline.types import IntArray, Mesh

AXES = np.eye(3)


def slabs(*boxes: tuple[tuple[float, ...], tuple[float, ...]]) -> Mesh:
    """Closed boxes of (middle, size), cut into fine triangles."""
    made = []
    for middle, size in boxes:
        box = trimesh.creation.box(size)
        box.apply_translation(middle)
        made.append(box.subdivide_to_size(0.08))
    whole: Any = trimesh.util.concatenate(made)
    return Mesh(np.asarray(whole.vertices, dtype=float), np.asarray(whole.faces))


def within(mesh: Mesh, low: tuple[float, ...], high: tuple[float, ...]) -> IntArray:
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    return np.flatnonzero(((middle > low) & (middle < high)).all(axis=1))


def test_a_leaf_in_the_plane_of_its_wall_slides_out_of_it_only() -> None:
    wall = slabs(((0, 0, 0), (3.0, 0.06, 3.0)))
    leaf = within(wall, (-0.5, -1, -0.5), (0.5, 1, 0.5))
    assert slides_into_material(wall, leaf, AXES).tolist() == [True, False, True]
    static = np.setdiff1d(np.arange(len(wall.faces)), leaf)
    ways = [
        np.abs(c.axis).round(2).tolist()
        for c in rank_hypotheses(wall, leaf, static, fused=True, top=50)
        if c.subtype == "slide" and c.within_kind
    ]
    assert ways and all(way[1] == 1 for way in ways)


def test_a_leaf_before_another_slides_past_it() -> None:
    pair = slabs(((-0.5, 0, 0), (1.0, 0.06, 2.0)), ((0.45, 0.1, 0), (1.0, 0.06, 2.0)))
    leaf = within(pair, (-2, -0.05, -2), (2, 0.05, 2))
    assert not slides_into_material(pair, leaf, AXES).any()


def test_what_is_no_panel_is_not_judged() -> None:
    block = slabs(((0, 0, 0), (1.0, 0.8, 1.0)))
    inside = within(block, (-0.2, -1, -0.2), (0.2, 1, 0.2))
    assert not slides_into_material(block, inside, AXES).any()
    assert not slides_into_material(block, within(block, (-1, -1, -1), (1, -0.39, 1)), AXES).any()
    assert not slides_into_material(block, np.zeros(0, dtype=np.int64), AXES).any()


def test_probabilities_sum_to_one_without_what_is_impossible() -> None:
    wall = slabs(((0, 0, 0), (3.0, 0.06, 3.0)))
    leaf = within(wall, (-0.5, -1, -0.5), (0.5, 1, 0.5))
    static = np.setdiff1d(np.arange(len(wall.faces)), leaf)
    found = rank_hypotheses(wall, leaf, static, fused=True, top=1000)
    assert np.isclose(sum(c.evidence["probability"] for c in found), 1.0, atol=1e-3)
    assert np.isclose(sum(kind_probabilities(found).values()), 1.0, atol=1e-6)
