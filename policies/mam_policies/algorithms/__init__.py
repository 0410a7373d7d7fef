"""Learning algorithms: behaviour cloning, PPO and SAC."""
