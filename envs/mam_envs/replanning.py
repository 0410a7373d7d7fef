"""The arm's path to a grasp and along the joint, from where arm and object now stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mam_envs.grasping.candidates import Grasp, PlacementError, card_grasps, goal_values
from mam_envs.grasping.surface import surface_grasps
from mam_envs.placement.arm_path import ArmPath, Search, search
from mam_envs.planner_state import PlannerState
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.types import FloatArray

TILTS = (0, 15, 30, 45, 60)
"""Angles between the hand and the part's surface that are tried, degrees."""
_SURFACE: dict[tuple[object, ...], list[Grasp]] = {}


def arm_path(
    now: PlannerState,
    skip: Sequence[Grasp] = (),
    tilts: Sequence[int] = TILTS,
    surface_first: bool = False,
) -> ArmPath:
    """The path that is clear of all the arm may hit.

    The grasp and branch of the nominal placement are tried first, so that all episodes are alike
    (a learner needs that); then every grasp that the asset offers.

    Args:
        skip: grasps that were tried in vain. surface_first: those on the part's bare surface
            before those that the card names.

    Raises:
        NotPhysicalError: there is none; the message says why.
    """
    robot, goal, model = now.robot, now.goal, now.model
    q = goal_values(goal, q_now=now.q)

    def look(candidates: Sequence[Grasp], seeds: FloatArray | None = None) -> Search:
        base, asset = now.base[None], now.world_asset
        return search(
            model, goal, robot, candidates, base, asset, q, now.others, now.arm, 1, seeds=seeds
        )

    nominal = now.layout.placement.path
    if nominal.grasp.card.joint == goal.joint and not _tried(nominal.grasp, skip):
        found = look([nominal.grasp], np.stack([nominal.approach[-1], nominal.approach[0]]))
        if found.paths:
            return found.paths[0]
    found = Search((), 0, 0, 0)
    refusal: NotPhysicalError | None = None
    offers = [lambda: card_grasps(model, goal, robot, tilts), lambda: _surface(now)]
    for offer in offers[::-1] if surface_first else offers:
        try:
            candidates = [h for h in offer() if not _tried(h, skip)]
        except PlacementError as error:
            refusal = error
            continue
        here = look(candidates)
        if here.paths:
            return here.paths[0]
        found = max(found, here, key=lambda s: (s.followed, s.reached, s.tried))
    if refusal is not None and not found.tried:
        raise NotPhysicalError(str(refusal))
    raise NotPhysicalError(found.reason(f"{model.asset.card.name}: joint {goal.joint!r}"))


def _surface(now: PlannerState) -> list[Grasp]:
    """The grasps on the part's surface, found once for each task."""
    key = (now.model.asset.folder, now.model.scale, now.goal, now.robot.uid)
    if key not in _SURFACE:
        if len(_SURFACE) > 64:
            _SURFACE.clear()
        _SURFACE[key] = surface_grasps(now.model, now.goal, now.robot)
    return _SURFACE[key]


def _tried(grasp: Grasp, skip: Sequence[Grasp]) -> bool:
    return any(grasp.mode == s.mode and np.allclose(grasp.tool, s.tool, atol=1e-3) for s in skip)
