"""From a policy to a real arm: calibration, perception by markers, limits, and the rollout."""
