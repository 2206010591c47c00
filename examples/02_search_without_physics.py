"""Compare deciders in a world that samples touches from an observation model, without MuJoCo or a network, in seconds.

Run: python examples/02_search_without_physics.py   (4 s of processor time)
"""

import numpy as np

from belief import SearchProblem
from belief.statistics import wilson_interval
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import make_decider, search_lockstep

NUM_EPISODES = 100
NAMES = ("random_confirm", "threshold", "fixed_poses", "information_gain", "value_of_information", "point_based")

model = random_model(np.random.default_rng(0), num_shapes=4, num_poses=6, sharpness=4.5)
problem = SearchProblem(model.shape_labels, tuple(f"pose_{i}" for i in range(6)), num_objects=4)
seeds = [(0, number) for number in range(NUM_EPISODES)]
targets = [number % 4 for number in range(NUM_EPISODES)]
for name in NAMES:
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([*seed, 2]))) for seed in seeds]
    episodes = search_lockstep(worlds, make_decider(name, model.outcome_table()), problem, targets, model, seeds)
    found = sum(episode.success for episode in episodes)
    low, high = wilson_interval(found, NUM_EPISODES)
    touches = np.mean([episode.num_touches for episode in episodes])
    print(f"{name:<20} success {found / NUM_EPISODES:.3f} [{low:.3f}, {high:.3f}]   touches {touches:.2f}")
