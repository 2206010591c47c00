"""Real pads, read by a reader that was trained in simulation only: balls, blocks and cylinders of the set ``sdh2``.

    python -m benchmarks.sdh2_zero_shot sdh2

Each grasp gives one touch: the frame of the largest total pressure, and in it the pad of the largest sum, centred at
its centroid and drawn at the size of the simulated pad. Its forces are unknown, so it is scaled to the mean force of
scene ``gel``. Hypotheses are spheres and boxes of half to 1.75 times the size of the scene's, and cylinders of 0.5 to
4 times the length. Nothing is fitted to real touches. Prints the share that is right and the stated probability, by
object. Then, in how many sessions that name an object something is named, by a sensor as described, one that doubts
its description, and one in an unknown state: the grasps of the object come in random order, and whatever pose is asked
for, as its pose is not known.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import softmax

from activetouch import SCENES, Scene, TactileSensor
from activetouch.distributions import Uniform
from activetouch.shapes import Box, Cylinder, Sphere
from activetouch.solids.family import Family
from belief import Confirm, Probe
from belief.statistics import wilson_interval
from benchmarks.recorded_sets.dsa import read_dsa
from benchmarks.recorded_sets.sdh2 import SHAPES

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
    parser.add_argument("--sessions", type=int, default=3, help="of each object and sensor")
    given = parser.parse_args()
    folder, scene = given.folder, real_scene()
    top = folder / "grasps" if (folder / "grasps").is_dir() else folder
    sensor = TactileSensor.shipped("gel", scene)
    hits: list[bool] = []
    stated: list[float] = []
    grasps: list[tuple[str, np.ndarray]] = []
    for shape, names in SHAPES.items():
        for name in names:
            found = [image_of(path, scene) for path in sorted((top / name).glob("*.dsa"))]
            images = [image for image in found if image is not None]
            if not images:
                continue
            touches = sensor.read(np.stack(images), [0] * len(images))
            evidence = [sensor.model.start().update(touch) for touch in touches]
            posteriors = softmax([one.log_likelihood for one in evidence], axis=1)
            grasps.append((shape, np.stack(images)))
            right = posteriors.argmax(axis=1) == list(scene.shapes).index(shape)
            hits += right.tolist()
            stated += posteriors.max(axis=1).tolist()
            print(f"  {shape:8} {name:24} {len(images):3} grasps, right {right.mean():.3f}")
    low, high = wilson_interval(sum(hits), len(hits))
    print(f"{len(hits)} grasps: right {np.mean(hits):.3f} [{low:.3f}, {high:.3f}], stated {np.mean(stated):.3f}")
    for name, state in {"as described": False, "in doubt": None, "unknown state": True}.items():
        named(name, TactileSensor.shipped("gel", scene, unknown_state=state), grasps, given.sessions)


def named(name: str, sensor: TactileSensor, grasps: Sequence[tuple[str, np.ndarray]], number: int) -> None:
    """Print how many sessions about objects with these shapes and images name something, and how many rightly."""
    stops, touches, larger = [], [], sensor.scene.image_shape[0] // PIXELS
    for place, (shape, images) in enumerate(grasps):
        for seed in range(number):
            session = sensor.naming(seed=seed, unlisted=0.0)  # all have a listed shape
            order = np.random.default_rng([place, seed]).permutation(len(images))
            while isinstance(session.ask(), Probe):
                image = images[order[session.step % len(order)]]
                session.tell(image=np.kron(image, np.ones((larger, larger), np.uint8)))
            touches.append(session.step)
            if isinstance(session.ask(), Confirm):
                stops.append((session.stated, session.answer == shape))
    stated, right = np.array(stops or [(np.nan, np.nan)]).mean(axis=0)
    print(
        f"{name:13} {len(stops)} of {len(touches)} sessions name something, after {np.mean(touches):.2f} touches; "
        f"stated {stated:.3f}, right {right:.3f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
