"""Is a sensor calibrated? Stated confidence against accuracy, after one and after two touches.

Objects that the sensor was not trained on are pressed in MuJoCo. Where 0.8 is stated, eight of ten should be right. The
bands hold 95 % of the points of a perfectly calibrated sensor.

Run: python examples/gallery/is_it_calibrated.py [FIGURE.png]   (15 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from activetouch import TactileSensor, TouchWorld
from belief import Belief, BeliefTracker
from belief.metrics import reliability_curve

NUMBER = 12 if "--short" in sys.argv else 800
sensor = TactileSensor.shipped("coarse")
labels, rng = sensor.scene.shape_labels, np.random.default_rng(0)

shapes, stated = np.arange(NUMBER) % len(labels), [[], []]
for shape in shapes:
    world = TouchWorld.sample(sensor, [int(shape)], rng)
    tracker = BeliefTracker(Belief.uniform(labels), sensor.model)
    for number, pose in enumerate(rng.choice(sensor.model.num_poses, 2, replace=False)):
        stated[number].append(tracker.update(world.touch(int(pose), rng)).probs)

figure, places = plt.subplots(1, 2, figsize=(7, 3.5), layout="constrained", sharey=True)
for axes, probs, words in zip(places, stated, ("one touch", "two touches"), strict=True):
    curve = reliability_curve(np.array(probs), shapes, num_bins=8, binning="mass")
    axes.fill_between(curve.mean_confidence, curve.band_low, curve.band_high, color="#ddd", label="chance alone")
    axes.plot([0, 1], [0, 1], color="#888", linewidth=1)
    axes.plot(curve.mean_confidence, curve.accuracy, "o-", color="#0072b2", label="scene coarse")
    right = (np.argmax(probs, axis=1) == shapes).mean()
    axes.set(xlabel="stated confidence", title=f"{words}: accuracy {right:.3f}", xlim=(0.25, 1.01), ylim=(0.2, 1.02))
places[0].set_ylabel("accuracy")
places[0].legend(frameon=False, loc="upper left")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "is_it_calibrated.png")
print(f"{NUMBER} objects")
