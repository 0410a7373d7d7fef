"""The place that a part has at rest is no obstacle to it; a wall, a rod and a stop are."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mam_pipeline.geometry.motion import Motion
from mam_pipeline.geometry.paths import PartPaths, Rule, steps_to
from mam_pipeline.types import FloatArray, Mesh

X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def box(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def wheel(sections: int = 24, radius: float = 0.3) -> trimesh.Trimesh:
    """A disc about the Y axis."""
    made = trimesh.creation.cylinder(radius, 0.1, sections=sections)
    made.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return made


def blocked(
    part: list[trimesh.Trimesh], static: list[trimesh.Trimesh], motion: Motion,
    axis: FloatArray, end: float,
) -> bool:  # fmt: skip
    """Whether the check's rule stops the part on its way."""
    whole = [*part, *static]
    count = sum(len(p.faces) for p in part)
    start = np.cumsum([0, *[len(p.vertices) for p in whole]])
    mesh = Mesh(
        np.concatenate([p.vertices for p in whole]),
        np.concatenate([p.faces + s for p, s in zip(whole, start)]),
    )
    paths = PartPaths(mesh, np.arange(count), np.arange(count, len(mesh.faces)))
    rule = Rule(0.005 * mesh.diagonal, 0.004)
    found = paths.crossing(motion, axis, np.zeros(3), steps_to(end), rule)
    return found.value is not None


def test_a_wheel_turns_in_an_arch_that_cuts_through_it() -> None:
    arch = trimesh.Trimesh(  # a sheet
        [[-1, -0.2, 0.25], [1, -0.2, 0.25], [1, 0.2, 0.25], [-1, 0.2, 0.25]],
        [[0, 1, 2], [0, 2, 3]], process=False,
    )  # fmt: skip
    for end in (np.pi, -np.pi):
        assert not blocked([wheel()], [arch], "revolute", Y, end)


def test_a_spoke_does_not_turn_through_a_rod() -> None:
    spokes = [
        box((-0.3, -0.02, -0.02), (0.3, 0.02, 0.02)),
        box((-0.02, -0.02, -0.3), (0.02, 0.02, 0.3)),
    ]
    rod = box((0.13, -0.2, 0.13), (0.15, 0.2, 0.15))
    assert blocked(spokes, [rod, box((-0.5, -0.3, -0.5), (0.5, -0.2, 0.5))], "revolute", Y, np.pi)


@pytest.mark.parametrize("wall", [False, True])
def test_a_board_slides_through_the_rail_that_holds_it(wall: bool) -> None:
    """The board passes within the rail's own thickness, and out of it again."""
    board = box((-0.3, -0.2, 0.0), (0.3, 0.2, 0.01))
    rail = box((0.0, -0.25, -0.001), (0.1, 0.25, 0.0025))
    ahead = box((0.5, -0.2, -0.1), (0.52, 0.2, 0.1))
    static = [rail, ahead] if wall else [rail]
    assert blocked([board], static, "prismatic", X, 0.45) == wall


def test_a_part_that_touches_a_stop_is_not_pressed_into_it() -> None:
    door, stop = box((0, 0, 0), (0.02, 0.5, 0.5)), box((0.02, 0.3, 0.0), (0.1, 0.6, 0.5))
    assert blocked([door], [stop], "prismatic", X, 0.2)
    assert not blocked([door], [stop], "prismatic", -X, 0.2)
