"""Which pose to touch next: the expected information gain of every pose, before each touch of a search.

The gain is about one question: is this object the target? It is large where the answer is open and the outcome of the
touch depends on it. After touches of one body, the gain of each pose depends on their images.

Run: python examples/gallery/which_pose_next.py [FIGURE.png]   (5 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from activetouch import TactileSensor, TouchWorld
from belief import SearchProblem
from planners import make_decider, search

sensor = TactileSensor.shipped("coarse")
scene = sensor.scene
problem = SearchProblem(scene.shape_labels, scene.pose_labels, num_objects=4)
world = TouchWorld.sample(sensor, ("cylinder", "cone", "cube", "sphere"), np.random.default_rng(2))
decider = make_decider("information_gain", sensor.model.outcome_table(), sensor.model)
episode = search(world, decider, problem, target="cone", model=sensor.model, seed=2)

touches = [step for step in episode.steps if step.touch is not None]
gains = np.array([[step.decision.scores[f"gain_{pose}"] for pose in scene.pose_labels] for step in touches])
figure, axes = plt.subplots(figsize=(6, 0.5 * len(touches) + 1.4), layout="constrained")
picture = axes.imshow(gains, cmap="Blues", vmin=0.0, aspect="auto")
axes.scatter([step.touch.pose for step in touches], range(len(touches)), color="#d55e00", label="chosen")
axes.set_xticks(range(len(scene.pose_labels)), scene.pose_labels)
axes.set_yticks(range(len(touches)), [f"object {s.object_index + 1}, target {s.belief.probs[3]:.2f}" for s in touches])
figure.colorbar(picture, label="expected gain [nats]")
axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "which_pose_next.png")
print(f"{len(touches)} touches, {'found' if episode.success else 'not found'}")
