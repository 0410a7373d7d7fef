"""Is an asset ready for simulation? Lint, offline sweep and driving, with reason codes."""
