"""Coupled joints in the environment: one value moves both, whichever is pushed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf.read import read_urdf

pytestmark = pytest.mark.sim

BODY = (
    ("0.09 0 0.2", "0.02 0.6 0.4"),
    ("0 -0.31 0.2", "0.2 0.02 0.4"),
    ("0 0.31 0.2", "0.2 0.02 0.4"),
    ("0 0 0.01", "0.16 0.6 0.02"),
    ("0 0 0.39", "0.16 0.6 0.02"),
)


def shapes(*boxes: tuple[str, str]) -> str:
    return "".join(
        f'<visual><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></visual>'
        for at, size in boxes
    )


def double_door(folder: Path, carrier: str = "body") -> Asset:
    """A cupboard whose right door opens half as far as its left one."""
    robot = f'<robot name="doors"><link name="body">{shapes(*BODY)}</link><link name="frame">'
    robot += f'{shapes(("0 0 0.2", "0.02 0.02 0.36"))}</link><joint name="slide" type="prismatic">'
    robot += '<parent link="body"/><child link="frame"/><axis xyz="1 0 0"/><limit lower="0"'
    robot += ' upper="0.02" effort="5" velocity="1"/></joint>'
    limits = {"left": 'lower="0" upper="1.57"', "right": 'lower="-0.785" upper="0"'}
    for name, side, hangs in (("left", 1, "body"), ("right", -1, carrier)):
        door = shapes((f"0 {-0.148 * side} 0", "0.018 0.296 0.35"),
                      (f"-0.04 {-0.26 * side} 0", "0.012 0.012 0.12"))  # fmt: skip
        follows = '<mimic joint="left_hinge" multiplier="-0.5"/>' if name == "right" else ""
        robot += f'<link name="{name}">{door}</link><joint name="{name}_hinge" type="revolute">'
        robot += f'<origin xyz="-0.09 {0.3 * side} 0.2"/><axis xyz="0 0 -1"/>'
        robot += f'<parent link="{hangs}"/><child link="{name}"/>'
        robot += f'<limit {limits[name]} effort="50" velocity="2"/>{follows}</joint>'
    (folder / "doors.urdf").write_text(robot + "</robot>")
    return write_asset(read_urdf(folder / "doors.urdf"), folder / "asset", name="doors")


def test_both_doors_move(tmp_path: Path) -> None:
    asset = double_door(tmp_path)
    env: Any = gym.make(
        "mam_envs:OperateJoint-v1", asset=asset.folder, joint="left_hinge", render_backend="none"
    )
    try:
        env.reset(seed=0)
        body = env.unwrapped.objects[0]._objs[0]
        names = [j.name for j in body.active_joints]
        left, right = (next(k for k, n in enumerate(names) if n.endswith(f"{s}_hinge"))
                       for s in ("left", "right"))  # fmt: skip
        for pushed, effort in ((left, 2.0), (right, 2.0)):
            force = np.zeros(len(names), np.float32)
            force[pushed] = effort
            body.set_qf(force)
            for _ in range(60):
                env.unwrapped.scene.step()
            q = body.get_qpos()
            assert q[right] == pytest.approx(-0.5 * q[left], abs=1e-3)
            assert (q[left] > 0.5) if pushed == left else (q[left] < 0.1)
    finally:
        env.close()


def test_joints_that_sapien_cannot_couple_are_refused(tmp_path: Path) -> None:
    asset = double_door(tmp_path, carrier="frame")
    with pytest.raises(InputError, match="'right_hinge' follows 'left_hinge', and SAPIEN"):
        gym.make(
            "mam_envs:OperateJoint-v1", asset=asset.folder, joint="left_hinge",
            render_backend="none",
        ).reset(seed=0)  # fmt: skip
