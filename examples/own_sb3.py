"""Your own stable-baselines3 code on an asset of mam-sim: only gymnasium and SB3.

python examples/own_sb3.py ASSET --steps 200000 --out mine.zip
mam-sim eval mine.zip --asset ASSET --control pd_joint_delta_pos --trust
"""

import argparse

import gymnasium as gym
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor


def make(asset: str, steps: int = 120) -> gym.Env:
    """One plain environment: NumPy in and out; success does not end an episode, time does."""
    env = gym.make(
        "mam_envs:OperateJointNumpy-v1", asset=asset, obs_mode="state",
        control_mode="pd_joint_delta_pos", max_episode_steps=steps,
    )  # fmt: skip
    return Monitor(env, info_keywords=("is_success",))


def main() -> None:
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("asset")
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--rollout", type=int, default=2048)
    parser.add_argument("--out", default="mine.zip")
    args = parser.parse_args()
    batch = min(256, args.rollout)
    model = PPO("MlpPolicy", make(args.asset), n_steps=args.rollout, batch_size=batch, verbose=1)
    model.learn(args.steps)
    model.save(args.out)


if __name__ == "__main__":
    main()
