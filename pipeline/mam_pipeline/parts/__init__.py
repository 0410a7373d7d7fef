"""Reasoners: primitives and priors to parts, tree and joint types (paper 3.2, 3.3)."""
