"""The command's imports are lean, and what was left out is there when it is asked for."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import sys
from mam_sim import lean
lean.install(), lean.install()
import lightgbm, open3d, numpy, trimesh
left_out = ("sklearn", "pandas", "plotly", "dash", "networkx", "cascadio", "rtree",
            "scipy.optimize", "scipy.ndimage", "numpy.f2py", "numpy.testing")
heavy = [m for m in left_out if m in sys.modules]
assert not heavy, heavy
x = numpy.arange(40.0).reshape(20, 2)
model = lightgbm.train(dict(verbose=-1, min_data_in_leaf=1), lightgbm.Dataset(x, x[:, 0]), 2)
assert lightgbm.Booster(model_str=model.model_to_string()).predict(x).shape == (20,)
drawing = sys.modules["open3d.visualization.draw_plotly"]
import pandas, plotly.graph_objects, dash
assert drawing.go.Figure is plotly.graph_objects.Figure
assert drawing.html.Div is dash.html.Div
assert type(drawing.Dash("x")) is dash.Dash
box = trimesh.creation.box()
assert len(list(box.triangles_tree.intersection((-1, -1, 0.4, 1, 1, 0.6)))) == 10
box.faces[0] = box.faces[0][::-1]
trimesh.repair.fix_winding(box)
assert box.is_winding_consistent and "networkx" in sys.modules and "rtree" in sys.modules
import scipy
assert trimesh.bounds.minimum_cylinder(trimesh.creation.icosphere())["radius"] > 0.9
assert scipy.optimize.minimize_scalar(lambda v: (v - 2) ** 2).success
assert scipy.optimize is sys.modules["scipy.optimize"] and numpy.f2py.run_main
numpy.testing.assert_allclose(scipy.ndimage.sum_labels(x), x.sum())
print(len(sys.meta_path))
"""


def test_what_is_left_out_comes_when_it_is_asked_for() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
