"""ManiSkill environments in which a robot arm operates a mam-sim asset."""
