"""Damping, friction, effort and speed of joints, so that a door stays where it is left.

Friction on the card is Coulomb: newton metres for hinges, newtons for slides. URDF's `friction`
has the same meaning, but SAPIEN ignores it, and its own joint friction is a dimensionless factor
on the force that the joint transmits (PhysX): a vertical slide does not feel it at all. A velocity
drive towards zero whose force is limited to the friction behaves as Coulomb friction should, so
`coulomb_drive` gives its numbers. What keeps a joint closed besides is its catch, which no such
format and no drive has either: `catch_pull` says what is to be applied at each step. Where springs
carry a part (`Joint.balance`), a simulator that can leaves gravity out for its links
(`carry`), and only what rubs is left (`rubbing`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.matter import balance_of, bearing_of, catch_of
from mam_pipeline.holding import Balance, Catch, Held
from mam_pipeline.types import Articulation, Inertial, Joint

GRAVITY = 9.81


@dataclass(frozen=True)
class DynamicsSettings:
    """What is assumed of a joint whose dynamics nobody states.

    Attributes:
        hold: friction over the largest gravity load that must be held, so that nothing sags.
        stopped: share of the range by which a closed part may be off the end of it.
        stop_seconds: a part that is let go comes to rest within about this time through damping.
        creep: speed (rad/s or m/s), by type of joint, at which a coulomb drive develops its whole
            friction.
        other_creep: that of any other type.
    """

    hold: float = 1.3
    stopped: float = 0.02
    stop_seconds: float = 0.6
    creep: Mapping[str, float] = field(
        default_factory=lambda: {"revolute": 0.001, "continuous": 0.001, "prismatic": 1e-4}
    )
    other_creep: float = 0.002


DYNAMICS = DynamicsSettings()


def with_dynamics(
    articulation: Articulation, inertials: Sequence[Inertial], thing: str = ""
) -> Articulation:
    """Fill in damping, friction, effort and velocity where the joints leave them at zero, and the
    catch and the balance that such a part of such a thing has where they say nothing of one.

    Args:
        thing: the kind of object, "" where nobody knows.
    """
    joints = [_joint(articulation, j, inertials, thing) for j in articulation.joints]
    return replace(articulation, joints=tuple(joints))


def coulomb_drive(type_: str, friction: float, damping: float = 0.0) -> tuple[float, float]:
    """(damping, force_limit) of a stiffness-free drive that acts as Coulomb friction.

    Without friction the drive is the plain viscous damping, unlimited.
    """
    if friction <= 0.0:
        return damping, float(np.finfo(np.float32).max)
    return max(damping, friction / DYNAMICS.creep.get(type_, DYNAMICS.other_creep)), friction


def set_joint_friction(joint: Any, type_: str, friction: float, damping: float = 0.0) -> None:
    """Give a SAPIEN articulation joint the card's friction (see the module's first words)."""
    drive_damping, limit = coulomb_drive(type_, friction, damping)
    joint.set_friction(0.0)
    joint.set_drive_properties(0.0, drive_damping, limit, "force")
    joint.set_drive_velocity_target(0.0)


def rubbing(joint: Held) -> tuple[float, tuple[float, float]]:
    """Friction of a joint, and its range, where what carries the part is simulated too."""
    held = 0.0 if joint.balance is None else joint.balance.friction
    low, high = joint.friction_range
    return joint.friction - held, (max(low - held, 0.0), max(high - held, 0.0))


def carry(links: Iterable[Any], balanced: Collection[str]) -> None:
    """Leave gravity out for SAPIEN's links that the joints named move."""
    for link in links:
        above = link
        while above is not None and above.joint.name not in balanced:
            above = above.parent
        if above is not None:
            link.disable_gravity = True


class Catches(Protocol):
    """What is asked of a joint that may have a catch: one of the engine's, or one of a card."""

    @property
    def catch(self) -> Catch | None: ...
    @property
    def closed(self) -> float: ...
    @property
    def open(self) -> float: ...


def opening(joint: Catches) -> float:
    """Which way opens a joint, as a sign."""
    return 1.0 if joint.open >= joint.closed else -1.0


def catch_pull(joint: Catches, q: float) -> float:
    """Force (N) or torque (N m) of a joint's catch at the joint value `q`, along the joint."""
    if joint.catch is None:
        return 0.0
    way = opening(joint)
    left = 1.0 - way * (q - joint.closed) / joint.catch.width
    return -way * joint.catch.force * min(max(left, 0.0), 1.0)


def gravity_load(
    articulation: Articulation, joint: Joint, inertials: Sequence[Inertial]
) -> tuple[float, float, float]:
    """Largest gravity force along the joint over its range, moved inertia, and lever arm.

    Where the part hangs on another that tilts, the largest over all directions is taken.

    Returns:
        (load, inertia, arm): N m, kg m2 and m for rotations; N, kg and 1 for slides.
    """
    links = articulation.carried_links(joint)
    mass = sum(inertials[i].mass for i in links)
    tilts = _tilts(articulation, joint)
    if joint.type == "prismatic":
        share = 1.0 if tilts else abs(float(joint.axis[2]))
        return mass * GRAVITY * share, mass, 1.0
    inertia, moment = 0.0, np.zeros(3)
    for i in links:
        body = inertials[i]
        r = body.center - joint.origin
        across = r - (r @ joint.axis) * joint.axis
        turned = float(joint.axis @ body.inertia @ joint.axis)
        inertia += turned + body.mass * float(across @ across)
        moment += body.mass * r
    if tilts:
        across = moment - (moment @ joint.axis) * joint.axis
        return GRAVITY * float(np.linalg.norm(across)), inertia, _arm(articulation, joint, links)
    low = joint.lower if np.isfinite(joint.lower) else -np.pi
    high = joint.upper if np.isfinite(joint.upper) else np.pi
    down = np.array([0.0, 0.0, -GRAVITY])
    load = 0.0
    for q in np.linspace(low, high, 25):
        turned_moment = Rotation.from_rotvec(float(q) * joint.axis).apply(moment)
        load = max(load, abs(float(joint.axis @ np.cross(turned_moment, down))))
    return load, inertia, _arm(articulation, joint, links)


def _tilts(articulation: Articulation, joint: Joint) -> bool:
    """Whether a joint nearer to the base turns this one against gravity."""
    above = articulation.joint_of(joint.parent)
    while above is not None:
        if above.type in ("revolute", "continuous") and abs(float(above.axis[2])) < 0.999:
            return True
        above = articulation.joint_of(above.parent)
    return False


def _joint(
    articulation: Articulation, joint: Joint, inertials: Sequence[Inertial], thing: str
) -> Joint:
    if joint.type == "fixed":
        return joint
    load, inertia, arm = gravity_load(articulation, joint, inertials)
    slides = joint.type == "prismatic"
    bearing = bearing_of(articulation.links[joint.child].kind, joint.type)
    weight = GRAVITY * sum(inertials[i].mass for i in articulation.carried_links(joint))
    running, held = bearing.friction(weight, arm, slides), DYNAMICS.hold * load
    friction, between, balance = joint.friction, joint.friction_range, joint.balance
    if friction <= 0.0:
        friction = running + held
        between = (held + bearing.spread[0] * running, held + bearing.spread[1] * running)
        springs = balance_of(articulation.links[joint.child].kind, thing, joint.type)
        if balance is None and springs is not None and load > 0.0:
            balance = Balance(springs.name, held, springs.source)
    damping = joint.damping if joint.damping > 0 else inertia / DYNAMICS.stop_seconds
    catch = joint.catch
    if catch is None and _closes(joint):
        kind = catch_of(articulation.links[joint.child].kind, thing)
        catch = None if kind is None else kind.on(arm, slides)
    against = friction + load + (0.0 if catch is None else catch.force)
    effort = max(joint.effort, 4.0 * against)
    return replace(
        joint, friction=friction, friction_range=between, catch=catch, damping=damping,
        effort=effort, balance=balance,
    )  # fmt: skip


def _closes(joint: Joint) -> bool:
    """Whether the joint's closed value is known, and is where the part is stopped."""
    near = min(abs(joint.closed - joint.lower), abs(joint.closed - joint.upper))
    span = joint.upper - joint.lower
    return (
        joint.open != joint.closed and bool(np.isfinite(span)) and near <= DYNAMICS.stopped * span
    )


def _arm(articulation: Articulation, joint: Joint, links: Sequence[int]) -> float:
    """Distance of the farthest carried vertex from the axis, metres."""
    far = 0.0
    for i in links:
        faces = articulation.links[i].faces
        if not len(faces):
            continue
        r = articulation.mesh.vertices[articulation.mesh.faces[faces].reshape(-1)] - joint.origin
        across = r - (r @ joint.axis)[:, None] * joint.axis
        far = max(far, float(np.linalg.norm(across, axis=1).max()))
    return max(far, 0.005)
