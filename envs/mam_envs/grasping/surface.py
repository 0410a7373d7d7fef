"""Grasps read off a part's own surface, for parts whose card names none that the hand can use.

Three kinds, from the collision pieces that the simulator uses: pinching a free edge between two
faces (Nguyen's antipodal condition, Constructing Force-Closure Grasps, IJRR 1988: opposite faces
in line with the fingers), hooking closed fingers behind a face so that their side drags it along,
and pressing a fingertip on a face from behind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from mam_envs.grasping.candidates import Grasp, fit_to_hand, push_variants, turn
from mam_envs.grasping.force_closure import first_hit
from mam_envs.grasping.limits import LIMITS, SEARCH
from mam_envs.object_model import ObjectModel
from mam_envs.robots import RobotSpec
from mam_envs.tasks.base import JointGoal
from mam_pipeline.asset.card import CardGrasp
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class SurfaceSamples:
    """Outer surface samples of the moving links at the start pose, asset frame.

    Attributes:
        points, normals: (N, 3). velocity: (N, 3) metres per unit of joint motion towards the goal.
        start: the object's joint values. moving: links that the joint carries.
    """

    points: FloatArray
    normals: FloatArray
    velocity: FloatArray
    start: dict[str, float]
    moving: tuple[str, ...]

    @property
    def heading(self) -> FloatArray:
        """(N, 3) unit velocity."""
        size = np.linalg.norm(self.velocity, axis=1, keepdims=True)
        return np.asarray(self.velocity / np.maximum(size, 1e-12))

    @property
    def lever(self) -> FloatArray:
        """(N,) how far each point travels over the farthest, 0..1."""
        size = np.linalg.norm(self.velocity, axis=1)
        return np.asarray(size / max(float(size.max(initial=0.0)), 1e-12))


def surface_grasps(model: ObjectModel, goal: JointGoal, robot: RobotSpec) -> list[Grasp]:
    """Grasps on the part's surface at which the hand fits, cheapest first; empty if there are none.

    Tools are given at the rest pose, like those of the card's grasps.
    """
    surface = _sample_surface(model, goal)
    if not len(surface.points):
        return []
    rest = np.linalg.inv(model.motion(goal.joint, np.array([goal.q_start]), {})[0])
    found: list[Grasp] = []
    kinds = ((_pinches, SEARCH.pinches), (_hooks, SEARCH.hooks), (_pushes, SEARCH.pushes))
    for make, keep in kinds:
        rows = make(model, goal, robot, surface)
        if make is _hooks:
            rows = _catching(model, robot, surface, rows)
        rows = sorted(_roomy(model, robot, surface, rows), key=lambda h: h.cost)
        kept: list[Grasp] = []
        for grasp in _spread(rows, SEARCH.tries):
            fits = fit_to_hand(model, goal, robot, _moved(grasp, rest))
            if fits is not None:
                kept.append(fits)
            if len(kept) >= keep:
                break
        found += kept
    return sorted(found, key=lambda h: h.cost)


def _sample_surface(model: ObjectModel, goal: JointGoal) -> SurfaceSamples:
    """Even samples of the moving links' pieces, without what other pieces cover."""
    moving = model.moving_links(goal.joint)
    start = {goal.joint: goal.q_start}
    poses = model.kinematics.link_poses(start)
    points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    meshes = [
        (trimesh.convex.convex_hull(piece.points), poses[name][0])
        for name in moving
        for piece in model.pieces.get(name, ())
    ]
    total = sum(m.area for m, _ in meshes) or 1.0
    for mesh, pose in meshes:
        # by area, and some on each piece: handles are small
        count = int(SEARCH.samples * (0.6 * mesh.area / total + 0.4 / len(meshes))) + 4
        where, face = trimesh.sample.sample_surface(mesh, count, seed=0)
        points.append(where @ pose[:3, :3].T + pose[:3, 3])
        normals.append(mesh.face_normals[face] @ pose[:3, :3].T)
    p, n = np.concatenate(points), np.concatenate(normals)
    outside = model.depth(p + 0.002 * n, start) < 0.0
    p, n = p[outside], n[outside]
    step = 0.02 * (goal.q_goal - goal.q_start)
    motion = model.motion(goal.joint, np.array([goal.q_start, goal.q_start + step]), {})
    carry = motion[1] @ np.linalg.inv(motion[0])
    velocity = (p @ carry[:3, :3].T + carry[:3, 3] - p) / abs(step)
    return SurfaceSamples(p, n, velocity, start, moving)


def _round(axis: FloatArray) -> FloatArray:
    """(SEARCH.directions, 3) unit directions across `axis`, the first as level as possible."""
    level = np.cross([0.0, 0.0, 1.0], axis)
    if np.linalg.norm(level) < 0.2:
        level = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
    level = level / np.linalg.norm(level)
    return np.stack(
        [turn(axis, 2 * np.pi * k / SEARCH.directions) @ level for k in range(SEARCH.directions)]
    )


def _frame(approach: FloatArray, closing: FloatArray, position: FloatArray) -> FloatArray:
    out = np.eye(4)
    out[:3, :3] = np.stack([np.cross(closing, approach), closing, approach], axis=1)
    out[:3, 3] = position
    return out


def _march(
    model: ObjectModel,
    surface: SurfaceSamples,
    origins: FloatArray,
    directions: FloatArray,
    far: float,
) -> FloatArray:
    """(N,) metres from inside the part until its material ends, `far` where it does not."""
    steps = np.arange(0.002, far, 0.003)
    fixed = tuple(name for name in model.boxes if name not in surface.moving)
    points = origins[:, None] + steps[None, :, None] * directions[:, None]
    inside = model.depth(points.reshape(-1, 3), surface.start, fixed).reshape(len(origins), -1) > 0
    ends = np.where(inside.all(axis=1), far, steps[np.argmin(inside, axis=1)])
    return np.asarray(ends)


def _pinches(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec, surface: SurfaceSamples
) -> list[Grasp]:
    widest = robot.max_width - SEARCH.room
    thick = _march(model, surface, surface.points, -surface.normals, widest + 0.006)
    good = np.flatnonzero((thick < widest) & (surface.lever > 0.25))
    along = np.abs((surface.heading * surface.normals).sum(axis=1))
    out: list[Grasp] = []
    for i in good:
        across = _round(surface.normals[i])
        middle = surface.points[i] - 0.5 * thick[i] * surface.normals[i]
        free = _march(model, surface, np.repeat(middle[None], len(across), 0), -across, 0.25)
        for a, edge in zip(across, free):
            if edge >= 0.25:
                continue
            spot = middle - a * max(edge - SEARCH.depth, 0.0)
            card = _card(
                goal, model, "edge", spot, a, surface.normals[i], float(thick[i]) + SEARCH.room
            )
            ahead = max(0.0, robot.tip_ahead - SEARCH.depth)
            tool = _frame(a, surface.normals[i], spot - a * ahead)
            # a grip in line with the motion cannot slip; a far one needs the least force
            cost = 0.5 + 0.4 * (1 - along[i]) + 0.8 * (1 - surface.lever[i]) + 0.3 * max(0.0, a[2])
            for flipped in (tool, tool @ np.diag([-1.0, -1.0, 1.0, 1.0])):
                lags = (1.0, 0.6, 0.25)
                out.append(Grasp(card, "grip", flipped, 1.0, float(cost), lags, room=SEARCH.room))
    return out


def _hooks(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec, surface: SurfaceSamples
) -> list[Grasp]:
    """Closed fingers behind a face, along it, or slanting over its edge with the hand outside."""
    behind = -(surface.heading * surface.normals).sum(axis=1)
    fingers, _ = robot.hand_surface(robot.closed)
    tips = fingers[fingers[:, 2] > fingers[:, 2].max() - SEARCH.depth - SEARCH.room]
    half = np.abs(tips[:, :2]).max(axis=0)  # across and along the closing direction
    out: list[Grasp] = []
    for i in np.flatnonzero((behind > 0.6) & (surface.lever > 0.35)):
        normal = surface.normals[i]
        for a in _round(normal):
            for slant, down in SEARCH.leans:
                c, s = np.cos(slant), np.sin(slant)
                into, off = c * a + s * normal, c * normal - s * a
                start = surface.points[i] - a * down
                for closing, gap in ((off, half[1]), (np.cross(off, into), half[0])):
                    spot = start + off * (gap + 0.001) + into * (SEARCH.depth - robot.tip_ahead)
                    card = _card(goal, model, "hook", start, into, closing, 0.0)
                    cost = 0.7 + 0.6 * (1 - behind[i]) + 0.8 * (1 - surface.lever[i]) + 0.3 * slant
                    cost += 0.3 * max(0.0, float(into[2]))
                    tool = _frame(into, closing, spot)
                    out.append(Grasp(card, "push", tool, 1.0, float(cost), (1.0, 0.6, 0.25)))
    return out


def _catching(
    model: ObjectModel, robot: RobotSpec, surface: SurfaceSamples, rows: list[Grasp]
) -> list[Grasp]:
    """Those whose fingers meet the part when they move as it should: material lies ahead of the tip
    and of the finger behind it."""
    if not rows:
        return []
    along = np.linspace(robot.tip_ahead - 0.002, robot.tip_ahead - SEARCH.depth, 4)
    tools = np.stack([h.tool for h in rows])
    origins = tools[:, None, :3, 3] + along[:, None] * tools[:, None, :3, 2]
    _, nearest = cKDTree(surface.points).query(tools[:, :3, 3])
    ways = np.repeat(surface.heading[nearest], len(along), axis=0)
    ahead, _ = first_hit(model, origins.reshape(-1, 3), ways, surface.moving, surface.start)
    caught = (ahead.reshape(len(rows), -1) < SEARCH.catch).sum(axis=1) >= 2
    return [h for h, ok in zip(rows, caught) if ok]


def _pushes(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec, surface: SurfaceSamples
) -> list[Grasp]:
    behind = -(surface.heading * surface.normals).sum(axis=1)
    rows = np.flatnonzero((behind > 0.5) & (surface.lever > 0.35))
    rows = rows[np.argsort((1 - surface.lever[rows]) + (1 - behind[rows]), kind="stable")][:14]
    out: list[Grasp] = []
    for i in rows:
        approach = surface.heading[i] - surface.normals[i]
        approach = approach / np.linalg.norm(approach)
        card = _card(goal, model, "push", surface.points[i], approach, _round(approach)[0], 0.0)
        extra = 0.3 + 0.8 * (1 - float(surface.lever[i])) + 0.4 * (1 - float(behind[i]))
        out += push_variants(robot, card, extra)
    return out


def _roomy(
    model: ObjectModel, robot: RobotSpec, surface: SurfaceSamples, rows: list[Grasp]
) -> list[Grasp]:
    """Those whose hand, seen as a few points, is outside the object: thousands at little cost.

    The hand is looked at at the grasp and on its way in, as `fit_to_hand` does in full later.
    """
    if not rows:
        return []
    opened = robot.closed if rows[0].mode == "push" else robot.opening(0.6 * robot.max_width)
    fingers, palm = robot.hand_surface(opened)
    few = [p[:: max(1, len(p) // 12)] for p in (fingers[fingers[:, 2] < -0.005], palm) if len(p)]
    shape = np.concatenate(few)
    # the way in, close enough together to notice a thin wall: no hand from inside a closed body
    size = float(np.linalg.norm(np.diff(model.footprint, axis=0)))
    way_in = np.outer(np.arange(0.015, max(0.5, size), 0.008), [0.0, 0.0, -1.0])
    backs = [shape - [0.0, 0.0, d] for d in (0.5 * LIMITS.back_off, LIMITS.back_off)]
    for points, most in ((shape, 0.006), (np.concatenate([way_in, *backs]), 0.0)):
        tools = np.stack([h.tool for h in rows])
        at = np.einsum("nij,pj->npi", tools[:, :3, :3], points) + tools[:, None, :3, 3]
        depth = model.depth(at.reshape(-1, 3), surface.start).reshape(len(rows), -1).max(axis=1)
        # what lies on a face is outside
        rows = [h for h, d in zip(rows, depth) if d <= most]
        if not rows:
            break
    return rows


def _card(
    goal: JointGoal, model: ObjectModel, kind: str, position: FloatArray, approach: FloatArray,
    closing: FloatArray, width: float,
) -> CardGrasp:  # fmt: skip
    link = model.kinematics.joint(goal.joint).child
    return CardGrasp(
        goal.joint, link, kind,  # type: ignore[arg-type]  # "hook" is found here, never written
        position.tolist(), approach.tolist(), closing.tolist(), width,
        depth=SEARCH.depth, confidence=0.5,
    )  # fmt: skip


def _moved(grasp: Grasp, by: FloatArray) -> Grasp:
    """The grasp moved by (4, 4)."""
    g, turned = grasp.card, by[:3, :3]
    card = replace(
        g,
        position=(turned @ np.array(g.position) + by[:3, 3]).tolist(),
        approach=(turned @ np.array(g.approach)).tolist(),
        closing=(turned @ np.array(g.closing)).tolist(),
    )
    return replace(grasp, card=card, tool=by @ grasp.tool)


def _spread(rows: list[Grasp], count: int) -> list[Grasp]:
    """The cheapest rows that are not next to each other (2.5 cm, 30 degrees)."""
    out: list[Grasp] = []
    taken: set[tuple[int, ...]] = set()
    for grasp in rows:
        place = np.round(grasp.tool[:3, 3] / 0.025).astype(int)
        facing = np.round(grasp.tool[:3, 1:3].T.reshape(-1) * 2).astype(int)
        key = (*place.tolist(), *facing.tolist())
        if key not in taken:
            taken.add(key)
            out.append(grasp)
        if len(out) >= count:
            break
    return out
