"""PPO of Stable-Baselines3 inside VecNormalize, which learns in a Gymnasium environment that it knows by id.

Run: python sb3_ppo.py [STEPS]          (writes cone.zip and cone.pkl; 20 000 steps by default, a minute or more)
     activetouch compare --scene coarse --targets cone --deciders "sb3:cone.zip(normalize='cone.pkl')" information_gain
"""

import sys

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

task = {"scene": "coarse", "target": "cone", "state": "posterior", "target_prob": (0.05, 0.95)}
envs = VecNormalize(make_vec_env("activetouch:activetouch/ObjectTest-v0", n_envs=1, seed=0, env_kwargs=task))
learner = PPO("MlpPolicy", envs, n_steps=256, batch_size=128, gamma=1.0, learning_rate=1e-3, seed=0, device="cpu")
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
print(f"learning {steps} steps; 20000 take about a minute", flush=True)
learner.learn(steps)
learner.save("cone.zip")
envs.save("cone.pkl")
print("wrote cone.zip and cone.pkl")
