"""Measures how assets behave in two simulators: what stays where it is left, and what falls alike.

    python benchmarks/behaviour.py generated:test --limit 30

Every object is written as an asset. Each joint is put half-way open and left alone for two seconds
under gravity, in SAPIEN and in MuJoCo: the drift is given as a share of its range. Then its
friction is taken away and both let it fall for 0.3 s: the difference is a share of its range.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import tyro
from common import save
from mam_sim_bench.runner import find_tasks
from mam_sim_formats.mjcf_export import export_mjcf
from tyro.conf import Positional

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.asset.dynamics import set_joint_friction
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.simulate import load_physics, physics_scene

STEP = 1 / 500
HOLD, FALL = 2.0, 0.3


def main(
    dataset: Positional[str],
    /,
    only: tuple[str, ...] = (),
    limit: int | None = None,
    joints: int = 3,
    out: Path | None = None,
) -> None:
    """Print a line per object, then the totals by kind of joint.

    Args:
        dataset: folder of ground-truth URDFs, or generated:test.
        only: these objects. limit: so many objects at most. joints: of one object at most.
        out: JSON file for the figures.
    """
    rows: list[tuple[str, float, float, float]] = []
    objects = 0
    for task in find_tasks(dataset, only, limit):
        with tempfile.TemporaryDirectory() as folder:
            asset = write_asset(task.load().truth_articulation(), Path(folder) / "a", name="a")
            model = str(export_mjcf(asset))
            chosen = asset.card.movable[:joints]
            mine = [(j.subtype, *_compare(asset, model, j)) for j in chosen]
        rows += mine
        objects += bool(mine)
        worst = np.max([r[1:] for r in mine], axis=0) if mine else np.zeros(3)
        print(f"{task.id}: {len(mine)} joints, drift SAPIEN {worst[0]:.4f} MuJoCo {worst[1]:.4f}, "
              f"fall differs by {worst[2]:.3f}", flush=True)  # fmt: skip
    for kind in sorted({r[0] for r in rows}):
        found = np.array([r[1:] for r in rows if r[0] == kind])
        sags, worst = (found[:, :2] > 0.02).sum(axis=0), found.max(axis=0)
        print(
            f"{kind}: {len(found)} joints; drift over 0.02: SAPIEN {sags[0]} (most "
            f"{worst[0]:.4f}), MuJoCo {sags[1]} (most {worst[1]:.4f}); falls differ by "
            f"{np.median(found[:, 2]):.4f} median, {worst[2]:.4f} at most"
        )
    print(f"{objects} objects, {len(rows)} joints")
    columns = ("kind", "drift_sapien", "drift_mujoco", "fall_difference")
    save(out, [dict(zip(columns, row)) for row in rows])


def _compare(asset: Asset, model: str, joint: CardJoint) -> tuple[float, float, float]:
    """Drift in SAPIEN and in MuJoCo, and the difference of the falls; shares of the range."""
    low = -np.pi if joint.lower is None else joint.lower
    high = np.pi if joint.upper is None else joint.upper
    half, span = 0.5 * (low + high), max(high - low, 1e-9)
    frictions = {j.name: replace(j) for j in asset.card.joints}
    held = [run(asset, model, frictions, joint, half, HOLD) for run in (_sapien, _mujoco)]
    loose = {**frictions, joint.name: replace(joint, friction=0.0)}
    fell = [run(asset, model, loose, joint, half, FALL) for run in (_sapien, _mujoco)]
    drift = [abs(q - half) / span for q in held]
    return drift[0], drift[1], abs(fell[0] - fell[1]) / span


def _sapien(
    asset: Asset, _model: str, joints: Mapping[str, CardJoint], moved: CardJoint, start: float,
    seconds: float,
) -> float:  # fmt: skip
    scene = physics_scene(STEP)
    robot = load_physics(scene, asset.urdf_path)
    q = np.zeros(len(robot.active_joints), np.float32)
    for k, joint in enumerate(robot.active_joints):
        card = joints[joint.name]
        set_joint_friction(joint, card.type, card.friction, card.damping)
        if joint.name == moved.name:
            index, q[k] = k, start
    robot.set_qpos(q)
    for _ in range(round(seconds / STEP)):
        scene.step()
    return float(robot.get_qpos()[index])


def _mujoco(
    _asset: Asset, path: str, joints: Mapping[str, CardJoint], moved: CardJoint, start: float,
    seconds: float,
) -> float:  # fmt: skip
    model = mujoco.MjModel.from_xml_path(path)
    model.opt.timestep = STEP
    model.dof_frictionloss[model.joint(moved.name).dofadr[0]] = joints[moved.name].friction
    data = mujoco.MjData(model)
    data.joint(moved.name).qpos[0] = start
    for _ in range(round(seconds / STEP)):
        mujoco.mj_step(model, data)
    return float(data.joint(moved.name).qpos[0])


if __name__ == "__main__":
    tyro.cli(main)
