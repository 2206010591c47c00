"""One press in MuJoCo: the tactile images of a cone in six poses.

Each press moves the object against the pad until a set force is reached. The image is the pressure on 128 × 128
taxels (tactile pixels). One pose shows a point, another an edge: several touches of one body tell more than one.

Run: python examples/gallery/one_press.py [FIGURE.png]   (4 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from activetouch import Scene

scene, rng = Scene(), np.random.default_rng(3)
cone = scene.sample_object("cone", rng)

figure, places = plt.subplots(2, 3, figsize=(6, 4.4), layout="constrained")
for axes, pose in zip(places.flat, scene.pose_labels, strict=True):
    pressed = scene.press(cone, pose, rng)
    axes.imshow(pressed.image, cmap="magma", origin="lower")
    axes.set(xticks=[], yticks=[])
    axes.set_title(f"{pose}: {pressed.contact.force:.1f} N, {1e3 * pressed.contact.depth:.1f} mm", fontsize=9)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "one_press.png")
print(f"pressed a cone of size {cone.scale:.2f} in {len(scene.pose_labels)} poses")
