"""Real pads, read by a reader that was trained in simulation only: balls, blocks and cylinders of the set ``sdh2``.

    python -m benchmarks.sdh2_zero_shot sdh2

Each grasp gives one touch: the frame of the largest total pressure, and in it the pad of the largest sum, centred at
its centroid and drawn at the size of the simulated pad. Its forces are unknown, so it is scaled to the mean force of
scene ``gel``. Hypotheses are spheres and boxes of half to 1.75 times the size of the scene's, and cylinders of 0.5 to
4 times the length. Nothing is fitted to real touches. Prints the share that is right and the stated probability, by
object, and in how many grasps a session would answer: the stated probability is 0.95, and the conflict test is not
suspicious (:class:`planners.abstaining.Abstaining`).
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import softmax

from activetouch import SCENES, Scene, TactileSensor
from activetouch.distributions import Uniform
from activetouch.shapes import Box, Cylinder, Sphere
from activetouch.solids.family import Family
from belief.conflict import log_conflict
from belief.statistics import wilson_interval
from benchmarks.recorded_sets.dsa import read_dsa
from benchmarks.recorded_sets.sdh2 import SHAPES
from planners.abstaining import Abstaining

TAXEL = 3.4e-3
"""Edge of a taxel of the real pads [m]."""
PIXELS = 32


def real_scene() -> Scene:
    """Scene ``gel`` with the shapes of the real objects."""
    scene = SCENES["gel"].scene
    rods = Family(Cylinder(0.016, 0.020), half_length=Uniform(0.010, 0.080))
    shapes = {"sphere": Sphere(0.020), "box": Box((0.016, 0.016, 0.024)), "cylinder": rods}
    return replace(scene, shapes=shapes, variation=replace(scene.variation, size=Uniform(0.5, 1.75)))


def image_of(path: Path, scene: Scene) -> np.ndarray | None:
    """The touch of a grasp as an image of the simulated pad, ``(PIXELS, PIXELS)`` uint8; None if nothing was felt."""
    film = read_dsa(path)
    pads = film.pads(film.frames[film.frames.sum(axis=1).argmax()])
    felt = max(pads, key=lambda pad: pad.sum())
    if not felt.sum() > 0:
        return None
    rows, columns = np.indices(felt.shape)
    middle = [(axis * felt).sum() / felt.sum() for axis in (rows, columns)]
    pixel = 2 * scene.pad.half_width / PIXELS
    places = (np.arange(PIXELS) + 0.5 - PIXELS / 2) * pixel / TAXEL
    z, y = (np.rint(places + centre).astype(int) for centre in middle)
    inside = ((z >= 0) & (z < felt.shape[0]))[:, None] & ((y >= 0) & (y < felt.shape[1]))
    seen = np.where(inside, felt[z.clip(0, felt.shape[0] - 1)][:, y.clip(0, felt.shape[1] - 1)], 0.0)
    low, high = scene.variation.force.support
    pressure = (low + high) / 2 / (seen.sum() * pixel**2) * seen
    return np.rint(255 * np.clip(pressure / (scene.pad.stiffness * scene.pad.max_depth), 0, 1)).astype(np.uint8)


def main() -> None:
    """Read all grasps and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder, scene = parser.parse_args().folder, real_scene()
    top = folder / "grasps" if (folder / "grasps").is_dir() else folder
    sensor = TactileSensor.shipped("gel", scene)
    hits: list[bool] = []
    stated: list[float] = []
    conflicts: list[float] = []
    for shape, names in SHAPES.items():
        for name in names:
            found = [image_of(path, scene) for path in sorted((top / name).glob("*.dsa"))]
            images = [image for image in found if image is not None]
            if not images:
                continue
            touches = sensor.read(np.stack(images), [0] * len(images))
            evidence = [sensor.model.start().update(touch) for touch in touches]
            posteriors = softmax([one.log_likelihood for one in evidence], axis=1)
            conflicts += [log_conflict([one.log_bets]) for one in evidence]
            right = posteriors.argmax(axis=1) == list(scene.shapes).index(shape)
            hits += right.tolist()
            stated += posteriors.max(axis=1).tolist()
            print(f"  {shape:8} {name:24} {len(images):3} grasps, right {right.mean():.3f}")
    is_sure = np.array(stated) >= Abstaining.promise
    is_answered = is_sure & (np.array(conflicts) < np.log(Abstaining.suspicion))
    print(
        f"of these, {is_sure.mean():.3f} state {Abstaining.promise}, {is_answered.mean():.3f} are answered by a session"
    )
    low, high = wilson_interval(sum(hits), len(hits))
    print(f"{len(hits)} grasps: right {np.mean(hits):.3f} [{low:.3f}, {high:.3f}], stated {np.mean(stated):.3f}")


if __name__ == "__main__":
    main()
