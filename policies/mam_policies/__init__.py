"""Experts, imitation, reinforcement learning, evaluation and LeRobot export."""

from mam_pipeline.optional import require as _require

_require("training or running a policy", "torch", "h5py", "safetensors", "gymnasium")
