"""Recurrent PPO of sb3-contrib: it sees single touches, and its LSTM has to remember them.

Run: python recurrent_ppo.py [STEPS]    (writes recurrent.zip; 20 000 steps by default, some minutes)
     activetouch compare --scene coarse --targets cone --deciders sb3:recurrent.zip threshold
"""

import sys

from sb3_contrib import RecurrentPPO
from stable_baselines3.common.env_util import make_vec_env

task = {"scene": "coarse", "target": "cone", "state": "paper", "target_prob": 0.25}
envs = make_vec_env("activetouch:activetouch/ObjectTest-v0", n_envs=4, seed=0, env_kwargs=task)
learner = RecurrentPPO("MlpLstmPolicy", envs, n_steps=128, batch_size=128, gamma=1.0, seed=0, device="cpu")
learner.learn(int(sys.argv[1]) if len(sys.argv) > 1 else 20_000)
learner.save("recurrent.zip")
print("wrote recurrent.zip")
