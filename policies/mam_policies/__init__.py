"""Experts, imitation, reinforcement learning, evaluation and LeRobot export."""
