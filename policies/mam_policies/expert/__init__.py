"""The scripted expert: inverse kinematics from asset.json's grasps, on any asset."""

from __future__ import annotations

from mam_policies.expert.config import ExpertConfig
from mam_policies.expert.plan import Plan, PlanningError, plan
from mam_policies.expert.policy import Episode, Expert, run_episode

__all__ = ["Episode", "Expert", "ExpertConfig", "Plan", "PlanningError", "plan", "run_episode"]
