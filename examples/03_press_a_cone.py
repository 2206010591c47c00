"""Press a cone against the pad in MuJoCo in all six poses, and print the measurements of the sensor.

Run: python examples/03_press_a_cone.py   (1 s of processor time)
"""

import numpy as np

from activetouch import Scene

scene = Scene()
rng = np.random.default_rng(3)
cone = scene.sample_object("cone", rng)
for label in scene.pose_labels:
    contact, image, *_ = scene.press(cone, label, rng)
    touched = (contact.pressure > 0).mean()
    print(
        f"{label:<7} force {contact.force:.2f} N, depth {1e3 * contact.depth:.2f} mm, {touched:5.1%} of taxels, ",
        end="",
    )
    print("the layer bottomed out" if contact.is_bottomed_out else f"brightest pixel {image.max()}")
