"""PPO of Stable-Baselines3 for `activetouch benchmark`: one policy for all targets, from touches of a sensor's model.

python train_ppo.py     (writes ppo-coarse.zip; 120 000 steps, 4 to 5 minutes of processor time; the extra rl)
activetouch benchmark --task coarse-v1 --agent sb3:ppo-coarse.zip --out ppo.jsonl.gz
"""

import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # threads wait for each other in matrices so small: three times as long

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from activetouch import TactileSensor
from activetouch.envs.touch_source import SampledTouches

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 120_000
sensor = TactileSensor.shipped("coarse")
task = {"touches": SampledTouches(sensor.model, sensor.pose_labels), "state": "posterior", "target_prob": (0.05, 0.95)}
envs = make_vec_env("activetouch:activetouch/ObjectTestGoal-v0", n_envs=16, seed=0, env_kwargs=task)
settings = {"n_steps": 256, "batch_size": 512, "gamma": 1.0, "ent_coef": 0.003}
learner = PPO("MlpPolicy", envs, lambda left: 3e-3 * left, seed=0, device="cpu", verbose=1, **settings)
learner.learn(steps, log_interval=2)  # prints time and mean return every 8192 steps
learner.save("ppo-coarse.zip")
print("wrote ppo-coarse.zip")
