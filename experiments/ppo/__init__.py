"""``train-ppo``: training PPO policies."""
