"""A `.pomdp` file for another solver, and the value that the built-in solver finds for the same problem.

`to_pomdp` writes a touch problem in Cassandra's format, which SARSOP, pomdp-solve and others read. The figure shows
the best expected return for every belief: flat where touching is best.

Run: python examples/gallery/a_pomdp_file.py [FIGURE.png]   (3 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from planners.export import to_pomdp
from planners.solve import TouchProblem, solve

outcomes = np.array([[[0.8, 0.2], [0.3, 0.7]], [[0.6, 0.4], [0.05, 0.95]]])  # p(outcome | pose, shape)
problem = TouchProblem(outcomes, prior=[0.5, 0.5], target=0, touch_cost=0.05, discount=0.999)
text = to_pomdp(problem, ("mug", "ball"))
policy = solve(problem)

probs = np.linspace(0.0, 1.0, 201)
values = np.array([policy.q_values([p, 1.0 - p]) for p in probs])
figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
for action, words in enumerate(("touch pose 0", "touch pose 1", "confirm", "reject")):
    axes.plot(probs, values[:, action], label=words)
axes.plot(probs, values.max(axis=1), color="black", linewidth=3, alpha=0.25, label="best")
axes.set(xlabel="probability that it is the mug", ylabel="expected return", ylim=(-1.02, 1.02))
axes.legend(frameon=False, ncols=2)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "a_pomdp_file.png")
print(f"{len(text)} characters; the value at the start is {values[100].max():.3f}")
