"""A sensor and another one: `python -m benchmarks.readers gel activetouch/models/gel-convnext 0 1`.

NLL after one touch and after two of 1 000 objects, for each seed; and the time to read a touch, on one thread.
"""

import sys
from time import process_time

import numpy as np
from scipy.special import log_softmax

from activetouch import SCENES, TactileSensor

scene, number = SCENES[sys.argv[1]].scene, 1000
sensors = TactileSensor.shipped(sys.argv[1]), TactileSensor.load(sys.argv[2], scene)
for seed in map(int, sys.argv[3:]):
    rng, losses = np.random.default_rng(seed), np.empty((2, number, 2))
    for index, shape in enumerate(np.arange(number) % len(scene.shapes)):
        body, poses = scene.sample_object(int(shape), rng), rng.permutation(len(scene.poses))[:2].tolist()
        images = np.stack([scene.press(body, pose, rng).image for pose in poses])
        for place, sensor in enumerate(sensors):
            touches = sensor.read(images, poses)
            for few in (1, 2):
                losses[few - 1, index, place] = -log_softmax(sensor.model.log_likelihood(touches[:few]))[shape]
    for few, some in enumerate(losses, 1):
        (own, other), error = some.mean(axis=0), np.diff(some).std() / number**0.5
        words = f"NLL {own:.5f}, other {other:.5f}, difference {other - own:+.5f} ± {error:.5f}"
        print(f"seed {seed}, {few} touch{'es' * (few > 1)}: {words}")
for size in (1, 64):
    several, repeats = np.concatenate([images] * 32)[:size], 256 // size
    times = np.empty((9, 2))
    for row, place in np.ndindex(times.shape):
        started = process_time()
        for _ in range(repeats):
            sensors[place].reader.run(several)
        times[row, place] = (process_time() - started) / repeats / size * 1e3
    own, other = np.median(times, axis=0)
    print(f"{size} at once: {own:.3f} ms a touch, other {other:.3f}, ratio {np.median(times[:, 1] / times[:, 0]):.2f}")
