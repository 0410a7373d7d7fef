"""LeRobot plug-in: the robot type `mam_sim`, a simulated arm."""

from lerobot_robot_mam_sim.config_mam_sim_robot import MamSimRobotConfig
from lerobot_robot_mam_sim.mam_sim_robot import MamSimRobot

__all__ = ["MamSimRobot", "MamSimRobotConfig"]
