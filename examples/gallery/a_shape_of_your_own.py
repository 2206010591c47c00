"""A shape of your own: a four-sided roof as a mesh, pressed against the pad in six poses.

Any closed triangle mesh is a shape; `Mesh.from_file` reads STL, OBJ and others. The sensor of `gel` reads the new shape
without training: `TactileSensor.shipped("gel", scene)` predicts its contacts and fits the observation model.

Run: python examples/gallery/a_shape_of_your_own.py [FIGURE.png]   (3 s of processor time)
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from activetouch import SHAPES, Scene
from activetouch.solids.mesh import Mesh

corners = 0.018 * np.array([[-1, -1, -0.7], [1, -1, -0.7], [1, 1, -0.7], [-1, 1, -0.7], [0, 0, 0.8]])
faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
scene = Scene(shapes={**SHAPES, "roof": Mesh("roof", corners, faces)})

rng = np.random.default_rng(1)
roof = scene.sample_object("roof", rng)
figure, places = plt.subplots(2, 3, figsize=(6, 4.4), layout="constrained")
for axes, pose in zip(places.flat, scene.pose_labels, strict=True):
    axes.imshow(scene.press(roof, pose, rng).image, cmap="magma", origin="lower")
    axes.set(xticks=[], yticks=[], title=pose)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "a_shape_of_your_own.png")
print(f"the scene knows {', '.join(scene.shape_labels)}")
