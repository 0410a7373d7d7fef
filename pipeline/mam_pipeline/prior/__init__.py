"""Kinematic priors: what may move, and what can only move together (paper 3.2)."""
