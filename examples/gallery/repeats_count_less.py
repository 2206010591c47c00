"""Why repeats do not count twice: touches in one pose, counted as independent and counted with their correlation.

Touches of one object in one pose measure the same face, so an error repeats itself. A belief that multiplies their
likelihoods as if they were independent becomes certain without becoming right. The shipped model weights n touches
in a pose as n / (1 + (n - 1) ρ), with ρ fitted to objects that were touched repeatedly.

Run: python examples/gallery/repeats_count_less.py [FIGURE.png]   (15 s of processor time)
"""

import sys
from dataclasses import replace

import numpy as np
from matplotlib import pyplot as plt

from activetouch import TactileSensor, TouchWorld
from belief.observation_model.selection import log_posteriors
from belief.touch_batch import TouchBatch

NUMBER, TOUCHES = (8, 2) if "--short" in sys.argv else (300, 6)
sensor = TactileSensor.shipped("paper-independent")
shapes, rng = np.arange(NUMBER) % 4, np.random.default_rng(0)

sequences = []
for shape in shapes:
    world, pose = TouchWorld.sample(sensor, [int(shape)], rng), int(rng.integers(sensor.model.num_poses))
    sequences.append([world.touch(pose, rng) for _ in range(TOUCHES)])
batch = TouchBatch.of(sequences)

figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
numbers = range(1, TOUCHES + 1)
shipped = sensor.model
for model, colour, words in (
    (replace(shipped, correlation=0.0), "#d55e00", "as independent"),
    (shipped, "#0072b2", f"with ρ = {shipped.correlation:.2f}"),
):
    probs = [np.exp(log_posteriors(model, batch.first(n))) for n in numbers]
    axes.plot(numbers, [p.max(axis=1).mean() for p in probs], "--", color=colour, label=f"stated, {words}")
    right = [(p.argmax(axis=1) == shapes).mean() for p in probs]
    axes.plot(numbers, right, "o-", color=colour, label=f"right, {words}")
axes.set(xlabel="touches in one pose", ylabel="mean over objects", xticks=numbers)
axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "repeats_count_less.png")
print(f"{NUMBER} objects, {TOUCHES} touches of each in one pose")
