"""A sensor in changed worlds: its own reader, and its reader of any object, which knows the state of the sensor.

    python -m benchmarks.sensor_states coarse "noise × 2" "stiffness × 0.4" "force 0.3 to 1 N" "6 % stuck at full scale"

Touches one object after the other in poses in random order, until a shape is stated with 0.95 or all poses were felt.
Prints, for each world and reader: objects with such a stop, mean stated probability there, and the share that is right
with its 95 % Wilson interval, and the touches of an object. ``usual`` is the sensor's own world. A world may also be a
family of shapes, such as cylinder:half_length=0.5..2, as the option ``--family`` of commands has it.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.special import softmax

from activetouch import SCENES, Scene, TactileSensor
from activetouch.sensor_files import MODELS
from belief.statistics import wilson_interval
from experiments.robustness.conditions import CONDITIONS
from experiments.scene_choice import SceneChoice

STATED = 0.95


def measured(sensors: dict[str, TactileSensor], scene: Scene, num_objects: int, seed: int) -> None:
    """Touch objects of a scene, read with every sensor, and print a line for each."""
    rng, most = np.random.default_rng([seed, 0x701D]), len(scene.poses)
    truth = np.arange(num_objects) % len(scene.shapes)
    stops: dict[str, list[tuple[float, bool]]] = {name: [] for name in sensors}
    touched = dict.fromkeys(sensors, 0)
    for shape in truth.tolist():
        thing, poses = scene.sample_object(shape, rng), rng.permutation(most)
        images = np.stack([scene.press(thing, int(pose), rng).image for pose in poses])
        for name, sensor in sensors.items():
            evidence = sensor.model.start()
            for touch in sensor.read(images, poses.tolist()):
                touched[name] += 1
                evidence = evidence.update(touch)
                posterior = softmax(evidence.log_likelihood)
                if posterior.max() >= STATED:
                    stops[name].append((float(posterior.max()), int(posterior.argmax()) == shape))
                    break
    for name, found in stops.items():
        right, stated = sum(hit for _, hit in found), float(np.mean([most for most, _ in found] or [np.nan]))
        low, high = wilson_interval(right, len(found)) if found else (0.0, 1.0)
        share = f"right {right / len(found):.3f} [{low:.3f}, {high:.3f}]" if found else "none right"
        touches = touched[name] / num_objects
        print(f"  {name:11} {len(found)} stops of {num_objects}, stated {stated:.3f}, {share}, {touches:.2f} touches")


def _changed(name: str, world: str) -> Scene:
    if world in CONDITIONS:
        return CONDITIONS[world](SCENES[name].scene)
    return SceneChoice(name, family=(world,)).named.scene


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("worlds", nargs="*", default=["noise × 2"])
    parser.add_argument("--objects", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    scene, folder = SCENES[given.scene].scene, MODELS / given.scene
    print(f"scene {given.scene}, {given.objects} objects, seed {given.seed}")
    for world in ["usual", *given.worlds]:
        changed = scene if world == "usual" else _changed(given.scene, world)
        sensors = {
            "own": TactileSensor.load(folder, scene),
            "any object": TactileSensor.load(folder, changed, anyway=True),
        }
        print(world)
        measured(sensors if world != "usual" else {"own": sensors["own"]}, changed, given.objects, given.seed)


if __name__ == "__main__":
    main()
