"""Ways to grasp or push a moving part."""
