"""``touch-bank`` and ``train-ppo``: training PPO policies."""
