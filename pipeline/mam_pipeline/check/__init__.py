"""Is an asset ready for simulation? Lint, offline sweep and driving, with reason codes."""

from mam_pipeline.check.check import check_asset
from mam_pipeline.check.report import REASONS, CheckReport, Finding, JointReport

__all__ = ["REASONS", "CheckReport", "Finding", "JointReport", "check_asset"]
