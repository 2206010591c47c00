"""Update a belief about a shape, touch by touch.

A classifier names a shape, and its confusion matrix says how often it does so for each true shape. Bayes' rule
multiplies the belief with that column. Contradicting statements partly cancel; agreeing ones add up.

Run: python examples/gallery/update_a_belief.py [FIGURE.png]   (4 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from belief import Belief

SHAPES = ("sphere", "cube", "cylinder", "cone")
CONFUSION = np.array(  # p(it says column | the object is row)
    [[0.90, 0.02, 0.05, 0.03], [0.02, 0.70, 0.20, 0.08], [0.05, 0.20, 0.60, 0.15], [0.03, 0.10, 0.27, 0.60]]
)
SAID = ("cone", "cylinder", "cone", "cone")

beliefs = [Belief.uniform(SHAPES)]
for said in SAID:
    beliefs.append(beliefs[-1].update(np.log(CONFUSION[:, SHAPES.index(said)])))

figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
bottom = np.zeros(len(beliefs))
for shape, colour in zip(SHAPES, ("#9aa5b1", "#56b4e9", "#009e73", "#d55e00"), strict=True):
    probs = np.array([belief.prob(shape) for belief in beliefs])
    axes.bar(range(len(beliefs)), probs, bottom=bottom, color=colour, label=shape)
    bottom += probs
axes.set_xticks(range(len(beliefs)), ["before", *(f"it says\n{said}" for said in SAID)])
axes.set_ylabel("probability")
axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "update_a_belief.png")
print(f"after {len(SAID)} touches: {beliefs[-1]}")
