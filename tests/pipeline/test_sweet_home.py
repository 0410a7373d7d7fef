"""The converter of a home designer's models, on one made here: what turns, slides and stays."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mam_world.ground_truth import read_object

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "sweet_home_dataset.py"
CATALOGUE = """
name#1=Box
model#1=/a/box.obj
category#1=Storage
width#1=100
depth#1=40
height#1=80
name#2=Lamp
model#2=/a/lamp.dae
"""


def quad(name: str, low: tuple[float, ...], high: tuple[float, ...], first: int) -> str:
    """A named rectangle between two corners that share one coordinate."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    if x0 == x1:
        corners = [(x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1)]
    else:
        corners = [(x0, y0, z0), (x1, y0, z0), (x1, y1, z1), (x0, y1, z1)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    return "\n".join([f"g {name}", *lines, "f " + " ".join(str(first + k) for k in range(4))])


def model() -> str:
    """2 wide, 2 high, 1 deep: a back, a door on a hinge at its left, a drawer on a rail."""
    return "\n".join([
        quad("body", (-1, 0, -0.5), (1, 2, -0.5), 1),
        quad("sweethome3d_hinge_1_1", (-1, 0.2, 0.5), (-0.98, 0.4, 0.5), 5),
        quad("sweethome3d_hinge_1_2", (-1, 1.6, 0.5), (-0.98, 1.8, 0.5), 9),
        quad("sweethome3d_opening_on_hinge_1_door", (-1, 0, 0.5), (0, 2, 0.5), 13),
        quad("sweethome3d_window_pane_on_hinge_1", (-0.8, 0.5, 0.5), (-0.2, 1.5, 0.5), 17),
        quad("sweethome3d_unique_rail", (0, 0.5, -0.5), (0, 0.6, 0.5), 21),
        quad("sweethome3d_opening_on_rail_1_drawer", (0, 0, 0.5), (1, 2, 0.5), 25),
    ])  # fmt: skip


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("sweet_home_dataset", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules[spec.name] = module  # its dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_named_groups_become_links_and_joints(script: ModuleType, tmp_path: Path) -> None:
    (entry,) = script.catalogue(CATALOGUE)
    assert entry.name == "box" and entry.size == (1.0, 0.8, 0.4)
    assert script.write_object(entry, script.read_groups(model()), tmp_path / "box")
    truth = read_object(tmp_path / "box" / "object.urdf")
    assert truth.mesh.bounds[1] - truth.mesh.bounds[0] == pytest.approx([1.0, 0.4, 0.8])
    kinds = {j.type: j for j in truth.joints}
    assert set(kinds) == {"revolute", "prismatic"}
    door, drawer = kinds["revolute"], kinds["prismatic"]
    assert np.allclose(np.abs(door.axis), [0, 0, 1]) and np.allclose(np.abs(drawer.axis), [0, 1, 0])
    front = truth.mesh.bounds[0][1]  # the designer's front is ours towards -Y
    assert door.origin[:2] == pytest.approx([-0.495, front], abs=1e-6)
    faces = {j.child: len(truth.links[j.child].faces) for j in truth.joints}
    assert faces[door.child] == 4 and faces[drawer.child] == 2  # the pane goes with its door
    assert len(truth.links[0].faces) == 8  # hinges and the rail stay


def test_what_no_joint_describes_is_left_out(script: ModuleType, tmp_path: Path) -> None:
    (entry,) = script.catalogue(CATALOGUE)
    still = quad("body", (-1, 0, -0.5), (1, 2, -0.5), 1)
    assert not script.write_object(entry, script.read_groups(still), tmp_path / "a")
    ball = still + "\n" + quad("sweethome3d_opening_on_hinge_7", (0, 0, 0), (1, 1, 0), 5)
    assert not script.write_object(entry, script.read_groups(ball), tmp_path / "b")
    assert not any(tmp_path.iterdir())
