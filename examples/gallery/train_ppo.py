"""Train PPO in Gymnasium: the return of the paper's test while Stable-Baselines3 learns it.

`BankEpisodes` plays many tests at once on touches that were recorded and come with the package, so that a step takes
microseconds. The horizontal lines are the returns of a policy that never touches, and of one that gives the
right answer at once.

Run: python examples/gallery/train_ppo.py [FIGURE.png]   (30 s of processor time; needs the extra rl)
"""

from activetouch.extras import script_needs

script_needs("rl")

import sys

import numpy as np
from matplotlib import pyplot as plt
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.sb3 import BankVecEnv

ENVS, STEPS, TOTAL = (4, 16, 64) if "--short" in sys.argv else (64, 64, 120_000)


class Returns(BaseCallback):
    """Keeps the return of every finished episode."""

    def __init__(self):
        super().__init__()
        self.steps, self.values = [], []

    def _on_step(self):
        for info in self.locals["infos"]:
            if "episode" in info:
                self.steps.append(self.num_timesteps)
                self.values.append(info["episode"]["r"])
        return True


envs = BankVecEnv(BankEpisodes.shipped("paper", target="cone", num_envs=ENVS, state="posterior"), seed=(0,))
returns = Returns()
PPO("MlpPolicy", envs, n_steps=STEPS, batch_size=min(512, ENVS * STEPS), device="cpu", seed=0).learn(TOTAL, returns)

figure, axes = plt.subplots(figsize=(6, 3.4), layout="constrained")
blocks = np.array_split(np.arange(len(returns.values)), min(40, max(len(returns.values), 1)))
blocks = [block for block in blocks if len(block)]
steps, values = np.array(returns.steps), np.array(returns.values)
axes.plot([steps[b].mean() for b in blocks], [values[b].mean() for b in blocks], "o-", label="PPO, mean of a block")
axes.axhline(0.0, color="#555", linestyle=":", label="no-touch baseline")
axes.axhline(1.0, color="#009e73", linestyle="--", label="right at once: upper bound")
axes.set(xlabel="steps", ylabel="return of a test")
axes.legend(frameon=False, loc="lower right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "train_ppo.png")
print(f"{len(values)} tests in {TOTAL} steps")
