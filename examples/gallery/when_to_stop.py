"""When to stop: success against touches, for thresholds on the posterior and for the planner.

A higher threshold costs touches and saves errors. The point-based planner has no threshold: it stops where the expected
return of another touch is below that of the answer. Touches are sampled from a model, so beliefs are exactly right.

Run: python examples/gallery/when_to_stop.py [FIGURE.png]   (15 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from belief import SearchProblem
from belief.statistics import wilson_interval
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import make_decider, search_lockstep

SHORT = "--short" in sys.argv
NUMBER, THRESHOLDS = (20, (0.8, 0.99)) if SHORT else (400, (0.8, 0.9, 0.95, 0.98, 0.99, 0.999))

model = random_model(np.random.default_rng(0), num_shapes=4, num_poses=6, sharpness=3.0)
problem = SearchProblem(model.shape_labels, tuple(f"pose_{i}" for i in range(6)), num_objects=4)
seeds = [(0, number) for number in range(NUMBER)]
targets = [number % 4 for number in range(NUMBER)]


def play(name):
    """Success with its interval, and mean number of touches, of the same searches for every decider."""
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([*seed, 2]))) for seed in seeds]
    episodes = search_lockstep(worlds, make_decider(name, model.outcome_table()), problem, targets, model, seeds)
    found = sum(episode.success for episode in episodes)
    low, high = wilson_interval(found, NUMBER)
    return np.mean([episode.num_touches for episode in episodes]), found / NUMBER, low, high


figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
rows = [play(f"information_gain(confirm={value}, reject={1 - value:.4f})") for value in THRESHOLDS]
for (touches, success, low, high), value in zip(rows, THRESHOLDS, strict=True):
    axes.errorbar(touches, success, [[success - low], [high - success]], fmt="o", color="#0072b2")
    axes.annotate(f"{value}", (touches, success), (0, -12), textcoords="offset points", ha="center", fontsize=8)
touches, success, low, high = play("point_based")
axes.errorbar(touches, success, [[success - low], [high - success]], fmt="D", color="#d55e00", label="point_based")
touches, success, low, high = play("random_confirm")
axes.errorbar(touches, success, [[success - low], [high - success]], fmt="x", color="#555", label="no-touch baseline")
axes.set(xlabel="touches of a search", ylabel="success, 95 % interval", title="Threshold of information_gain")
axes.legend(frameon=False, loc="lower right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "when_to_stop.png")
print(f"{NUMBER} searches at each of {len(THRESHOLDS)} thresholds")
