"""Ways to take hold of a moving part or to push it."""
