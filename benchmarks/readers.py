"""NLL after two touches, of a sensor and another one: `python -m benchmarks.readers coarse build/any/coarse 0 1`."""

import sys

import numpy as np
from scipy.special import log_softmax

from activetouch import SCENES, TactileSensor

scene, number = SCENES[sys.argv[1]].scene, 1000
sensors = TactileSensor.shipped(sys.argv[1]), TactileSensor.load(sys.argv[2], scene)
for seed in map(int, sys.argv[3:]):
    rng, losses = np.random.default_rng(seed), np.empty((number, 2))
    for index, shape in enumerate(np.arange(number) % len(scene.shapes)):
        body, poses = scene.sample_object(int(shape), rng), rng.permutation(len(scene.poses))[:2].tolist()
        images = np.stack([scene.press(body, pose, rng).image for pose in poses])
        losses[index] = [-log_softmax(one.model.log_likelihood(one.read(images, poses)))[shape] for one in sensors]
    (own, other), error = losses.mean(axis=0), np.diff(losses).std() / number**0.5
    print(f"seed {seed}: NLL {own:.4f}, other {other:.4f}, difference {other - own:+.4f} ± {error:.4f}")
