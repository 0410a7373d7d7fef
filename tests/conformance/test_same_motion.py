"""A drawer under the same spring and damper travels the same way in three simulators."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mam_pipeline.asset.card import Asset, CardJoint
from tests.conformance.bullet import bullet, empty_world

STEP = 1 / 500
DRIVEN, LEFT = 1000, 2500
"""Steps: 2 s towards the target, 5 s left alone."""
NEAR = 0.02
"""Share of the range."""

Force = Callable[[float, float], float]


def test_a_drawer_moves_alike(
    asset_named: Callable[[str], Asset], motion: dict[str, dict[str, float]]
) -> None:
    pytest.importorskip("mujoco")
    bullet()
    asset = asset_named("generated")
    slide = next(j for j in asset.card.joints if j.type == "prismatic")
    assert slide.lower is not None and slide.upper is not None
    width = slide.upper - slide.lower
    target = slide.lower + 0.6 * width
    mass = next(p.mass for p in asset.card.parts if p.link == slide.child)

    def force(q: float, v: float) -> float:
        return 200.0 * mass * (target - q) - 30.0 * mass * v

    runs = {"SAPIEN": _sapien, "MuJoCo": _mujoco, "PyBullet": _pybullet}
    ways = {name: run(asset, slide, force) for name, run in runs.items()}
    for name, (way, drift) in ways.items():
        apart = float(np.abs(way - ways["MuJoCo"][0]).max()) / width
        end = abs(float(way[-1]) - target) / width
        motion[name] = {"way": apart, "end": end, "drift": drift}
        assert end < NEAR and apart < NEAR, name
        assert drift < 1e-6, name  # closed stays closed under gravity


def _sapien(asset: Asset, slide: CardJoint, force: Force) -> tuple[np.ndarray, float]:
    from mam_pipeline.asset.dynamics import set_joint_friction
    from mam_pipeline.check.simulate import load_physics, physics_scene

    scene = physics_scene(STEP)
    robot = load_physics(scene, asset.urdf_path)
    cards = [_card(asset, j.name) for j in robot.active_joints]
    for joint, card in zip(robot.active_joints, cards):
        set_joint_friction(joint, card.type, card.friction, card.damping)
    closed = np.array([c.closed for c in cards], np.float32)
    at, way, push = cards.index(slide), [], np.zeros(len(cards), np.float32)
    robot.set_qpos(closed)
    for _ in range(DRIVEN):
        push[at] = force(float(robot.get_qpos()[at]), float(robot.get_qvel()[at]))
        robot.set_qf(push)
        scene.step()
        way.append(float(robot.get_qpos()[at]))
    robot.set_qf(np.zeros_like(push))
    robot.set_qpos(closed)
    robot.set_qvel(np.zeros_like(push))
    for _ in range(LEFT):
        scene.step()
    return np.array(way), float(np.abs(robot.get_qpos() - closed).max())


def _mujoco(asset: Asset, slide: CardJoint, force: Force) -> tuple[np.ndarray, float]:
    import mujoco
    from mam_sim_formats.mjcf_export import export_mjcf

    file = export_mjcf(asset, asset.folder.parent / "moved_mjcf" / "object.xml")
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep = STEP
    data: Any = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
    joint, way = data.joint(slide.name), []
    for _ in range(DRIVEN):
        joint.qfrc_applied[0] = force(joint.qpos[0], joint.qvel[0])
        mujoco.mj_step(model, data)
        way.append(float(joint.qpos[0]))
    mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
    for _ in range(LEFT):
        mujoco.mj_step(model, data)
    return np.array(way), float(np.abs(data.qpos - model.key("closed").qpos).max())


def _pybullet(asset: Asset, slide: CardJoint, force: Force) -> tuple[np.ndarray, float]:
    pybullet = empty_world()
    pybullet.setGravity(0, 0, -9.81)
    pybullet.setTimeStep(STEP)
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    body = pybullet.loadURDF(str(asset.urdf_path), useFixedBase=True, flags=flags)
    count = pybullet.getNumJoints(body)
    names = [pybullet.getJointInfo(body, i)[1].decode() for i in range(count)]
    cards = [_card(asset, n) for n in names]
    for i, card in enumerate(cards):
        # PyBullet reads friction, but a motor against it is what holds a joint still
        pybullet.setJointMotorControl2(
            body, i, pybullet.VELOCITY_CONTROL, targetVelocity=0, force=card.friction
        )
        pybullet.resetJointState(body, i, card.closed)
    at, way = cards.index(slide), []
    for _ in range(DRIVEN):
        q, v = pybullet.getJointState(body, at)[:2]
        pybullet.setJointMotorControl2(body, at, pybullet.TORQUE_CONTROL, force=force(q, v))
        pybullet.stepSimulation()
        way.append(pybullet.getJointState(body, at)[0])
    for i, card in enumerate(cards):
        pybullet.resetJointState(body, i, card.closed)
    for _ in range(LEFT):
        pybullet.stepSimulation()
    ends = [pybullet.getJointState(body, i)[0] - c.closed for i, c in enumerate(cards)]
    return np.array(way), float(np.abs(ends).max())


def _card(asset: Asset, name: str) -> CardJoint:
    return next(j for j in asset.card.joints if j.name == name)
