"""What Newton makes of USD exports: bodies, joints, masses, limits, frames, friction; run where it
is installed.

    pip install newton newton-usd-schemas usd-core scipy        (in an environment of its own)
    python benchmarks/open_in_newton.py FOLDER/object.usd ...

It needs nothing of this project, and no GPU. The joint that fixes the base to the world is one too.
With --json, the frames of all links are given for each of the configurations (joint name: value)
that standard input holds as a list; tests/conformance reads that.
"""

from __future__ import annotations

import importlib
import json
import sys
from importlib.metadata import version
from typing import Any


def model_of(file: str) -> Any:
    """A stage as Newton's model on the CPU."""
    importlib.import_module("newton_usd_schemas")  # before USD is asked for schemas
    newton = importlib.import_module("newton")
    builder = newton.ModelBuilder()
    builder.add_usd(file)
    return builder.finalize(device="cpu")


def opened(file: str, configurations: list[dict[str, float]]) -> dict[str, Any]:
    """One stage as Newton has it; poses are (4, 4), links in the frame of the fixed base."""
    newton, warp, np = (importlib.import_module(n) for n in ("newton", "warp", "numpy"))
    turn = importlib.import_module("scipy.spatial.transform").Rotation
    model = model_of(file)
    links, names = (
        [label.rsplit("/", 1)[-1] for label in labels]
        for labels in (model.body_label, model.joint_label)
    )
    starts = model.joint_q_start.numpy()
    moving = {n: int(a) for n, a, b in zip(names, starts, starts[1:]) if b - a == 1}
    low, high = model.joint_limit_lower.numpy(), model.joint_limit_upper.numpy()
    poses = []
    for values in configurations:
        q, state = np.zeros(model.joint_coord_count, np.float32), model.state()
        for name, at in moving.items():
            q[at] = values[name]
        newton.eval_fk(model, warp.array(q, dtype=float, device="cpu"), model.joint_qd, state)
        frames = {}
        for name, row in zip(links, state.body_q.numpy().astype(float)):
            frames[name] = np.eye(4)
            frames[name][:3, :3], frames[name][:3, 3] = turn.from_quat(row[3:]).as_matrix(), row[:3]
        root = np.linalg.inv(frames[links[0]])
        poses.append({name: (root @ frame).tolist() for name, frame in frames.items()})
    flags, body = model.shape_flags.numpy(), model.shape_body.numpy()
    visible, collides = newton.ShapeFlags.VISIBLE, newton.ShapeFlags.COLLIDE_SHAPES
    seen = (flags & visible != 0) & (flags & collides == 0)
    shown = [s for s, yes in zip(model.shape_source, seen & (body >= 0)) if yes]
    ends = {n: (float(low[k]), float(high[k])) for n, k in moving.items()}
    return {
        "version": version("newton"),
        "links": links,
        "joints": list(moving),
        "visuals": len(shown),
        "faces": sum(len(mesh.indices) // 3 for mesh in shown),
        "masses": dict(zip(links, model.body_mass.numpy().astype(float))),
        "limits": {n: pair for n, pair in ends.items() if max(map(abs, pair)) < 1e6},
        "poses": poses,
    }


def main(files: list[str]) -> None:
    """Print a line per file."""
    for file in files:
        model = model_of(file)
        print(
            f"{file}: {model.body_count} bodies, {model.joint_count} joints, "
            f"{model.joint_dof_count} degrees of freedom, {model.shape_count} shapes, "
            f"{model.body_mass.numpy().sum():.3f} kg, "
            f"{getattr(model, 'constraint_mimic_count', 0)} couplings, "
            f"friction {model.joint_friction.numpy().round(3).tolist()}"
        )


if __name__ == "__main__":
    if "--json" in sys.argv:
        importlib.import_module("warp").config.quiet = True
        print(json.dumps(opened(sys.argv[1], json.load(sys.stdin))))
    else:
        main(sys.argv[1:])
