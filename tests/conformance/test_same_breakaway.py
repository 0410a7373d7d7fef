"""The same force starts a part, and the same limits stop it, in every program that runs here.

MuJoCo reads joint friction from the MJCF. SAPIEN and PyBullet read a URDF's and do not act on it as
Coulomb friction, so it is given to them as our environments give it: a drive, or a motor, towards
standstill whose force is limited. What keeps a door closed besides is an actuator of the MJCF, and
a force at each step in the two others, as in our environments. Where springs carry a door, MuJoCo
compensates its bodies, SAPIEN leaves gravity out for its links, and PyBullet, which can do neither,
holds it by friction, as any program that reads the URDF alone. Drake has no joint friction; Newton
has what the USD says, and its solvers were not run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.asset.dynamics import rubbing
from mam_pipeline.asset.writer import write_asset
from mam_world import make_object
from tests.conformance.bullet import empty_world

STEP = 1 / 500
NEAR = 0.05
"""Share of the force, and of the range."""
LASTS, TRAVELS = 500, 2500
"""Steps: 1 s in which a part starts or does not, 5 s in which it comes to its stop."""
HALVINGS = 9
MOVED, GATHERS = 1e-4, 1.5
"""Metres or radians that count as moved, and how many times as far as in the first half second a
part that starts goes in the second: one that creeps goes as far, a pushed one thrice as far."""

Push = Callable[[float, float, int], float]
"""(joint value to begin at, force or torque, steps) -> joint value at the end."""


@dataclass(frozen=True)
class Handled:
    """An asset and the joint that is pushed."""

    asset: Asset
    joint: CardJoint

    @property
    def opening(self) -> float:
        """Which way opens, as a sign."""
        return 1.0 if self.joint.open >= self.joint.closed else -1.0


def handled(asset: Asset, caught: bool = False) -> Handled:
    """An asset with the joint of its heaviest part; `caught`: of those with a catch."""
    mass = {p.link: p.mass for p in asset.card.parts}
    limited = [
        j for j in asset.card.movable
        if j.lower is not None and j.upper is not None and (j.catch is not None or not caught)
    ]  # fmt: skip
    return Handled(asset, max(limited, key=lambda j: mass[j.child]))


def _sapien(asset: Asset, joint: CardJoint) -> Push:
    from mam_pipeline.asset.dynamics import carry, catch_pull, rubbing, set_joint_friction
    from mam_pipeline.check.simulate import load_physics, physics_scene

    scene = physics_scene(STEP)
    robot = load_physics(scene, asset.urdf_path)
    cards = [_card(asset, j.name) for j in robot.active_joints]
    for active, card in zip(robot.active_joints, cards):
        set_joint_friction(active, card.type, rubbing(card)[0], card.damping)
    carry(robot.links, [c.name for c in cards if c.balance is not None])
    at = cards.index(joint)

    def push(start: float, force: float, steps: int) -> float:
        q = np.array([c.closed for c in cards], np.float32)
        q[at] = start
        robot.set_qpos(q)
        robot.set_qvel(np.zeros_like(q))
        for _ in range(steps):
            forces = [catch_pull(c, float(v)) for c, v in zip(cards, robot.get_qpos())]
            forces[at] += force
            robot.set_qf(np.array(forces, np.float32))
            scene.step()
        return float(robot.get_qpos()[at])

    return push


def _mujoco(asset: Asset, joint: CardJoint) -> Push:
    mujoco = pytest.importorskip("mujoco")
    from mam_sim_formats.mjcf_export import export_mjcf

    file = export_mjcf(asset, asset.folder.parent / f"{asset.folder.name}_pushed" / "object.xml")
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep = STEP
    data: Any = mujoco.MjData(model)

    def push(start: float, force: float, steps: int) -> float:
        mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
        data.joint(joint.name).qpos[0] = start
        data.joint(joint.name).qfrc_applied[0] = force
        mujoco.mj_step(model, data, steps)
        return float(data.joint(joint.name).qpos[0])

    return push


def _pybullet(asset: Asset, joint: CardJoint) -> Push:
    from mam_pipeline.asset.dynamics import catch_pull

    library = empty_world()
    library.setGravity(0, 0, -9.81)
    library.setTimeStep(STEP)
    flags = library.URDF_USE_INERTIA_FROM_FILE
    body = library.loadURDF(str(asset.urdf_path), useFixedBase=True, flags=flags)
    names = [
        library.getJointInfo(body, i)[1].decode() for i in range(library.getNumJoints(body))
    ]  # fmt: skip
    at = names.index(joint.name)

    def push(start: float, force: float, steps: int) -> float:
        for i, name in enumerate(names):
            card = _card(asset, name)
            library.setJointMotorControl2(
                body, i, library.VELOCITY_CONTROL, targetVelocity=0, force=card.friction
            )
            library.resetJointState(body, i, start if i == at else card.closed)
        for _ in range(steps):
            caught = catch_pull(joint, float(library.getJointState(body, at)[0]))
            library.setJointMotorControl2(body, at, library.TORQUE_CONTROL, force=force + caught)
            library.stepSimulation()
        return float(library.getJointState(body, at)[0])

    return push


PROGRAMS: dict[str, Callable[[Asset, CardJoint], Push]] = {
    "MuJoCo": _mujoco, "SAPIEN": _sapien, "PyBullet": _pybullet,
}  # fmt: skip


@pytest.mark.parametrize("name", ["nightstand", "fridge", "oven", "washer"])
@pytest.mark.parametrize("program", list(PROGRAMS))
def test_a_part_starts_at_the_same_force_and_stops_at_its_limits(
    program: str,
    name: str,
    asset_named: Callable[[str], Asset],
    breakaway: list[dict[str, Any]],
) -> None:
    part = handled(asset_named(name))
    push, joint = PROGRAMS[program](part.asset, part.joint), part.joint
    wanted = _wanted(part, springs=program != "PyBullet")
    found = _least(push, part, 3.0 * wanted)
    ends = _stops(push, part, found)
    row = {"asset": name, "joint": joint.name, "simulator": program, "wanted": wanted,
           "found": found, "lower": ends[0], "upper": ends[1]}  # fmt: skip
    breakaway.append({**row, "unit": "N" if joint.type == "prismatic" else "N m"})
    assert found == pytest.approx(wanted, rel=NEAR), row
    assert max(ends) < NEAR, row


@pytest.mark.parametrize("program", ["MuJoCo", "SAPIEN"])
@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("category", "at_rest"), [("microwave", "closed"), ("dryer", "open")])
def test_a_catch_lets_go_at_the_same_force_whichever_way_opens(
    category: str, at_rest: str, way: float, program: str, tmp_path: Path
) -> None:
    """Also of a door that stands open at q = 0, and of one that opens towards smaller values."""
    made = make_object(category, 1).articulation
    joints = [
        replace(j, axis=way * j.axis, lower=min(way * j.lower, way * j.upper),
                upper=max(way * j.lower, way * j.upper), closed=way * j.closed, open=way * j.open)
        for j in made.joints
    ]  # fmt: skip
    whole = replace(made, joints=tuple(joints))
    part = handled(write_asset(whole, tmp_path / "a", name="a", thing=category), caught=True)
    assert part.opening == way and (abs(part.joint.closed) < 0.1) == (at_rest == "closed")
    catch = part.joint.catch
    assert catch is not None and catch.force > 5 * part.joint.friction
    push, wanted = PROGRAMS[program](part.asset, part.joint), _wanted(part)
    assert _least(push, part, 3.0 * wanted) == pytest.approx(wanted, rel=NEAR)
    # left ajar it closes; left where nothing pulls any more, it stays
    for share, stays in ((0.3, False), (1.5, True)):
        start = part.joint.closed + part.opening * share * catch.width
        off = abs(push(start, 0.0, TRAVELS) - (start if stays else part.joint.closed))
        assert off < 0.05 * catch.width


def _wanted(part: Handled, springs: bool = True) -> float:
    """What must start a closed part: friction, its catch, and what gravity adds or takes.

    Args:
        springs: what carries the part is simulated.
    """
    joint = part.joint if springs else replace(part.joint, balance=None)
    caught = 0.0 if joint.catch is None else joint.catch.force
    gravity = 0.0 if joint.balance is not None else part.opening * _gravity(part)
    return rubbing(joint)[0] + caught + gravity


def _gravity(part: Handled) -> float:
    """What must be applied at the closed pose so that gravity does not move the part."""
    import mujoco
    from mam_sim_formats.mjcf_export import export_mjcf

    folder = part.asset.folder.parent / f"{part.asset.folder.name}_weighed"
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(part.asset, folder / "object.xml")))
    data: Any = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
    mujoco.mj_forward(model, data)
    return float(data.joint(part.joint.name).qfrc_bias[0])


def _least(push: Push, part: Handled, most: float) -> float:
    """Least force with which the part gathers speed, by halving.

    Below it MuJoCo's soft friction lets a part creep at a constant speed, and so does a drive.
    """
    start, sign = part.joint.closed, part.opening
    assert part.joint.lower is not None and part.joint.upper is not None
    width = part.joint.upper - part.joint.lower
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        half, whole = (abs(push(start, sign * middle, n) - start) for n in (LASTS // 2, LASTS))
        if whole > 0.5 * width or (whole > MOVED and whole - half > GATHERS * half):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _stops(push: Push, part: Handled, force: float) -> tuple[float, float]:
    """How far from its lower and upper limit a pushed part stops, as shares of the range."""
    joint = part.joint
    assert joint.lower is not None and joint.upper is not None
    width = joint.upper - joint.lower
    strong = 2.0 * force + 2.0 * width * joint.damping
    middle = joint.lower + 0.5 * width
    low, high = push(middle, -strong, TRAVELS), push(middle, strong, TRAVELS)
    return abs(low - joint.lower) / width, abs(high - joint.upper) / width


def _card(asset: Asset, name: str) -> CardJoint:
    return next(j for j in asset.card.joints if j.name == name)
