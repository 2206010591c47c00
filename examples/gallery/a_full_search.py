"""A full search: the belief that each object is the target, step by step.

Four objects of four shapes come one at a time. Rejecting one tells something about those that follow: if the first is
surely no cone, the cone is among the others. The probability of an object that was not touched yet therefore rises.

Run: python examples/gallery/a_full_search.py [FIGURE.png]   (4 s of processor time)
"""

import sys

from matplotlib import pyplot as plt

from activetouch import TactileSensor

TARGET = "cone"
sensor = TactileSensor.shipped("coarse")
episode = sensor.search(TARGET, decider="information_gain", seed=8)
order = [sensor.scene.shape_labels[shape] for shape in episode.arrangement]
print(episode)

figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
probs = [step.belief.prob(TARGET) for step in episode.steps]
colours = ["#9aa5b1", "#56b4e9", "#d55e00", "#009e73"]
axes.bar(range(len(probs)), probs, color=[colours[step.object_index] for step in episode.steps])
for number, step in enumerate(episode.steps):
    action = step.decision.action
    words = f"touch\n{sensor.scene.pose_labels[action.pose]}" if step.touch else type(action).__name__.lower()
    axes.text(number, probs[number] + 0.02, words, ha="center", fontsize=8)
axes.set_xticks(range(len(probs)), [f"object {s.object_index + 1}\n{order[s.object_index]}" for s in episode.steps])
axes.tick_params(axis="x", labelsize=8)
axes.set(ylabel=f"probability of a {TARGET}\nbefore the step", ylim=(0, 1.18))
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "a_full_search.png")
