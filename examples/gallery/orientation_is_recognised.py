"""Orientation is recognised: what a belief about one body holds possible, touch by touch.

The belief is about shape, orientation and size together. Each picture is the mean over the orientations and sizes that
a shape may still have, so an unknown orientation is a blur. Touches rule out orientations, and with them shapes.

Run: python examples/gallery/orientation_is_recognised.py [FIGURE.png]   (9 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from activetouch import TactileSensor
from activetouch.view import Bodies, coloured
from belief import Belief, BeliefTracker

SEED, POSES = 1, ("y45", "front", "z45", "y90")
PIXELS, DRAWS = (24, 4) if "--short" in sys.argv else (96, 96)
sensor = TactileSensor.shipped("coarse")
labels, rng = sensor.scene.shape_labels, np.random.default_rng(SEED)
bodies = Bodies.of(sensor, pixels=PIXELS, draws=DRAWS)
cone = sensor.scene.sample_object("cone", rng)
outline = bodies.outline("cone", cone)

tracker, evidence = BeliefTracker(Belief.uniform(labels), sensor.model), sensor.model.start()
columns = 1 + len(POSES)
figure, places = plt.subplots(1 + len(labels), columns, figsize=(1.5 * columns, 8.0), layout="constrained")
for column, pose in enumerate((None, *POSES)):
    if pose is None:
        places[0, 0].text(0.5, 0.5, "no touch\nyet", ha="center", va="center", transform=places[0, 0].transAxes)
    else:
        image = sensor.scene.press(cone, pose, rng).image
        touch = sensor.read(image[None], [pose])[0]
        tracker.update(touch)
        evidence = evidence.update(touch)
        places[0, column].imshow(image, cmap="magma", vmin=0, vmax=255, origin="lower")
    places[0, column].set_title("before" if pose is None else f"touch {column}: {pose}", fontsize=10)
    probs = tracker.belief.probs
    for label, prob, picture in bodies.likeliest(evidence, probs, len(labels)):
        axes = places[1 + labels.index(label), column]
        axes.imshow(coloured(picture, 0.15 + 0.85 * prob), origin="lower", alpha=0.1 + 0.9 * min(1.0, 2.0 * prob))
        if label == "cone":
            axes.contour(outline, levels=[0.5], colors="#009e73", linewidths=1.2)
        axes.set_title(f"{prob:.2f}", fontsize=10, fontweight="bold" if prob == probs.max() else "normal", pad=1)
for axes in places.flat:
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
for row, label in enumerate(labels, start=1):
    places[row, 0].set_ylabel(label)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "orientation_is_recognised.png", dpi=80)
print(f"after {len(POSES)} touches: {tracker.belief}")
