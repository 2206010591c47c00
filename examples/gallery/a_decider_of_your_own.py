"""A decider of your own, compared with built-in ones on the same searches.

A decider is an object with a method `decide`. This one touches every object twice, then gives the more probable answer.
`check_decider` tests that it keeps the contract of deciders.

Run: python examples/gallery/a_decider_of_your_own.py [FIGURE.png]   (6 s of processor time)
"""

import sys
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt

from belief import Confirm, Probe, Reject, SearchProblem
from belief.statistics import wilson_interval
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import Decision, check_decider, make_decider, search_lockstep

NUMBER = 20 if "--short" in sys.argv else 400


@dataclass(frozen=True)
class TwoTouches:
    """Touch every object twice, then decide."""

    def decide(self, info, rng):
        """The next action."""
        if len(info.history) < 2:
            return Decision(Probe(len(info.history)), {})
        return Decision(Confirm() if info.target_prob > 0.5 else Reject(), {"target_prob": info.target_prob})


check_decider(TwoTouches(), np.random.default_rng(0))
model = random_model(np.random.default_rng(0), num_shapes=4, num_poses=6, sharpness=4.5)
problem = SearchProblem(model.shape_labels, tuple(f"pose_{i}" for i in range(6)), num_objects=4)
table = model.outcome_table()
names = ("random_confirm", "threshold", "information_gain", "point_based")
deciders = {"TwoTouches": TwoTouches(), **{name: make_decider(name, table) for name in names}}

figure, axes = plt.subplots(figsize=(6, 3.4), layout="constrained")
seeds, targets = [(0, number) for number in range(NUMBER)], [number % 4 for number in range(NUMBER)]
for name, marker in zip(deciders, "osD^v", strict=True):
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([*seed, 2]))) for seed in seeds]
    episodes = search_lockstep(worlds, deciders[name], problem, targets, model, seeds)
    found, touches = sum(e.success for e in episodes), np.mean([e.num_touches for e in episodes])
    low, high = wilson_interval(found, NUMBER)
    bars = [[found / NUMBER - low], [high - found / NUMBER]]
    axes.errorbar(touches, found / NUMBER, bars, fmt=marker, markersize=7, label=name)
axes.set(xlabel="touches of a search", ylabel="success, 95 % interval", ylim=(-0.02, 1.04))
axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "a_decider_of_your_own.png")
print(f"{len(deciders)} deciders, {NUMBER} searches each")
