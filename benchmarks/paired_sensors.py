"""Two sensors on the same touches of the same objects: what each states after some touches, and how often it is right.

    python -m benchmarks.paired_sensors many many any:gel --objects 1000
    python -m benchmarks.paired_sensors gel gel --meshes mug.obj cup.obj --only

The first argument is the scene, the others are sensors: names of shipped ones, or folders; any:NAME is the reader of
any object of a shipped one, also where it has another for the objects of the scene. Prints, after 1, 2, 3, 4 and 6
touches in poses in random order: accuracy with its 95 % Wilson interval, mean stated probability, and negative
log-likelihood [nats]; for the second sensor also the mean difference of the latter, with its standard error.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from activetouch import Scene, TactileSensor
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from belief.statistics import wilson_interval
from experiments.scene_choice import SceneChoice

TOUCHES = (1, 2, 3, 4, 6)
Floats = NDArray[np.floating]


def measured(
    sensors: list[TactileSensor], choice: SceneChoice, num_objects: int, seed: int
) -> tuple[Floats, NDArray[np.intp]]:
    """Log posteriors of every sensor after each number of touches, ``(S, T, N, K)``, and the true shapes ``(N,)``."""
    scene, rng = choice.named.scene, np.random.default_rng([seed, 0x70AD])
    truth = np.arange(num_objects) % len(scene.shapes)
    found = np.zeros((len(sensors), len(TOUCHES), num_objects, len(scene.shapes)))
    for number, shape in enumerate(truth.tolist()):
        thing, poses = scene.sample_object(shape, rng), rng.permutation(len(scene.poses))[: max(TOUCHES)]
        images = np.stack([scene.press(thing, int(pose), rng).image for pose in poses])
        for which, sensor in enumerate(sensors):
            evidence = sensor.model.start()
            for touches, touch in enumerate(sensor.read(images, poses.tolist()), 1):
                evidence = evidence.update(touch)
                if touches in TOUCHES:
                    found[which, TOUCHES.index(touches), number] = evidence.log_likelihood
    return log_softmax(found, axis=3), truth


def loaded(name: str, scene: Scene) -> TactileSensor:
    """A sensor by name."""
    if name.startswith("any:"):
        with TemporaryDirectory() as folder:
            copyfile(MODELS / name[4:] / ANY_OBJECT_FILE, Path(folder) / ANY_OBJECT_FILE)
            return TactileSensor.load(folder, scene)
    return TactileSensor.load(MODELS / name if (MODELS / name).is_dir() else Path(name), scene, anyway=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("sensors", nargs="+")
    parser.add_argument("--meshes", nargs="*", type=Path, default=())
    parser.add_argument("--only", action="store_true")
    parser.add_argument("--poses")
    parser.add_argument("--objects", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    choice = SceneChoice(given.scene, meshes=tuple(given.meshes), only=given.only, poses=given.poses)
    sensors = [loaded(name, choice.named.scene) for name in given.sensors]
    logs, truth = measured(sensors, choice, given.objects, given.seed)
    own = np.take_along_axis(logs, truth[None, None, :, None], axis=3)[..., 0]
    print(f"scene {given.scene}, {len(choice.named.scene.shapes)} shapes, {given.objects} objects, seed {given.seed}")
    for which, name in enumerate(given.sensors):
        print(name)
        for step, touches in enumerate(TOUCHES[: len([t for t in TOUCHES if t <= len(choice.named.scene.poses)])]):
            hits = logs[which, step].argmax(axis=1) == truth
            low, high = wilson_interval(int(hits.sum()), len(hits))
            stated = float(np.exp(logs[which, step].max(axis=1)).mean())
            line = f"  {touches}: right {hits.mean():.3f} [{low:.3f}, {high:.3f}], stated {stated:.3f}"
            line += f", NLL {-own[which, step].mean():.4f}"
            if which:
                more = own[0, step] - own[which, step]
                line += f", {more.mean():+.4f} ± {more.std() / np.sqrt(len(more)):.4f} against {given.sensors[0]}"
            print(line)


if __name__ == "__main__":
    main()
