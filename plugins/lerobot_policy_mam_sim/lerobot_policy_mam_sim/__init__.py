"""LeRobot plug-in: the policy type `mam_sim`, and the environment type `mam_sim`."""

from lerobot_policy_mam_sim.configuration_mam_sim import MamSimConfig
from lerobot_policy_mam_sim.environment import MamSimEnvConfig
from lerobot_policy_mam_sim.modeling_mam_sim import MamSimPolicy
from lerobot_policy_mam_sim.processor_mam_sim import make_mam_sim_pre_post_processors

__all__ = ["MamSimConfig", "MamSimEnvConfig", "MamSimPolicy", "make_mam_sim_pre_post_processors"]
