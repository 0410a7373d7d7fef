"""What lies between primitives of one skin: a sheet's two sides, and a knob before it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.parts import solid
from mam_pipeline.parts.features import pair_features, primitive_features
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.types import Mesh, Primitives

FRONT, BACK, REST, KNOB = range(4)


def sheet_and_knob(inside_out: bool = False, merges: bool = True) -> Graph:
    """A sheet of 1 x 0.01 x 1, its sides and edges apart, and a cube 0.02 before its front."""
    sheet = trimesh.creation.box(bounds=[(0, 0, 0), (1, 0.01, 1)])
    knob = trimesh.creation.box(bounds=[(0.4, -0.12, 0.4), (0.6, -0.02, 0.6)])
    side = sheet.face_normals[:, 1]
    labels = np.concatenate([
        np.select([side < -0.5, side > 0.5], [FRONT, BACK], REST), np.full(len(knob.faces), KNOB)
    ])  # fmt: skip
    both: Any = trimesh.util.concatenate([sheet, knob])
    mesh = Mesh(both.vertices, both.faces[:, ::-1] if inside_out else both.faces)
    order = np.array([[0, 1], [4, 2], [5, 3]]) if merges else np.zeros((0, 2), dtype=np.int64)
    return build_graph(mesh, Primitives(labels, order))


@pytest.mark.parametrize("inside_out", [False, True])
def test_the_sides_of_a_sheet_have_each_other_behind_material(inside_out: bool) -> None:
    graph = sheet_and_knob(inside_out)
    ends = np.array([FRONT]), np.array([BACK])
    columns = solid.pair_columns(graph, *ends)
    assert columns["material_thin_ab"] == pytest.approx(1, abs=0.02)
    assert columns["material_thin_ba"] == pytest.approx(1, abs=0.02)
    assert columns["air_ab"] == columns["air_ba"] == 0


def test_a_knob_is_before_its_front_across_air() -> None:
    graph = sheet_and_knob()
    columns = solid.pair_columns(graph, np.array([FRONT]), np.array([KNOB]))
    assert columns["air_near_ab"] == pytest.approx(0.04, abs=0.02)  # the knob's share of the front
    assert columns["air_near_ba"] == pytest.approx(0.25, abs=0.05)  # its side's share of the knob
    assert columns["material_ab"] == columns["material_ba"] == 0
    assert solid.primitive_columns(graph)["material_self"][KNOB] == pytest.approx(1, abs=0.02)


def test_half_a_sheet_leaves_the_other_half_behind() -> None:
    graph = sheet_and_knob()
    masks = np.array([[1, 0, 0, 0], [1, 1, 1, 0], [0, 1, 0, 0]], dtype=bool)
    columns = solid.group_columns(graph, masks)
    assert columns["material_thin_out"] == pytest.approx([1, 0, 1], abs=0.05)
    chosen = np.array([[1, 0, 1], [0, 1, 0]], dtype=float)
    between = solid.between_columns(graph, masks, chosen)["material_thin_between"]
    assert between == pytest.approx([1, 0], abs=0.05)


def test_a_soup_has_no_inside() -> None:
    graph = sheet_and_knob(merges=False)
    assert not graph.is_fused
    assert solid.primitive_columns(graph) == {}
    unary = primitive_features(graph, None)
    names = (*unary.names, *pair_features(graph, unary, None).names)
    assert not any(name.startswith(("material", "air")) for name in names)
    fused = primitive_features(sheet_and_knob(), None)
    assert set(unary.names) < set(fused.names)
