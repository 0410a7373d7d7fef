"""Repairs of anybody's URDF, MJCF or USD by the reasons of the check; each change is a line."""

from mam_pipeline.mend.repairs import REPAIRS
from mam_pipeline.mend.run import Mended, Order, mend
from mam_pipeline.mend.work import Change

__all__ = ["REPAIRS", "Change", "Mended", "Order", "mend"]
