"""Joints: contact, initialisation, optimisation, hypotheses, limits, solvers (paper 3.3, 3.4)."""
