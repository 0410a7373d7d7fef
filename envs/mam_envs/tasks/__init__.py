"""Tasks: what is asked of the robot, when it is done, and what is rewarded."""
