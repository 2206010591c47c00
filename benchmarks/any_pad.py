"""Six pads that no training saw: the reader of any pad, and a reader that went on from it to each of them.

    python -m benchmarks.any_pad
    activetouch train --pad pads/long.toml --out pads/long  # of the files that --write pads makes
    python -m benchmarks.any_pad --own pads --only long

The twelve shapes of ``hard`` are touched from three sides, each object by a pad with another response, which the sensor
infers: stiffness from 0.3 to 3 times the middle, law from ^0.7 to ^2, and the other numbers in the ranges that a
description has by default. Prints, after one, two and three touches, the mean negative log probability of the true
shape with its 95 % interval, the share that is right and the stated probability, and both where 0.95 is stated.
Guessing gives 2.485 and 0.083.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import softmax

from activetouch import SCENES, PadDescription, Response, TactileSensor, Taxels
from activetouch.scene import Scene
from activetouch.sensor.any_pad import sensor_of_pad
from belief.statistics import cluster_bootstrap

TOUCHES = (1, 2, 3)
_SIDES = ("front", "z90", "y90")
_STOP = 0.95
_OUTLINE = ["..##..", ".####.", *["######"] * 10, ".####.", "..##.."]
_WIDTH = 0.007 * np.array([-1.0, 0.0, 1.0])  # of a hexagon and its six neighbours: rows of 2, 3 and 2
_HEXAGONS = [(0.0, y, z) for y in _WIDTH for z in (0.0,)] + [
    (0.0, y, z) for z in (-0.007 * 0.75**0.5, 0.007 * 0.75**0.5) for y in (-0.0035, 0.0035)
]


def _curved() -> Taxels:
    """The tip of a finger of 12 mm radius, with 45 taxels."""
    angles, z = np.meshgrid(np.deg2rad(np.linspace(-50, 50, 9)), np.linspace(-0.006, 0.006, 5))
    normals = np.stack([np.cos(angles), np.sin(angles), 0 * z], axis=-1).reshape(-1, 3)
    return Taxels(0.012 * (normals - [1, 0, 0]) + np.outer(z.ravel(), [0, 0, 1]), normals, 4e-6)


_FLAT = np.tile([1.0, 0.0, 0.0], (len(_HEXAGONS), 1))
_RANGES = Response.of({"stiffness": [3.7e7, 3.7e8], "law": [0.7, 2.0]})
PADS = {
    "long": PadDescription(Taxels.grid(12, 3, 0.002), _RANGES, is_relative=True),
    "outline": PadDescription(Taxels.grid(14, 6, 0.0034, _OUTLINE), _RANGES, (1.0, 6.0), is_relative=True),
    "wide": PadDescription(Taxels.grid(4, 4, 0.0047), _RANGES, full_scale=2e5),
    "hexagons": PadDescription(Taxels(np.array(_HEXAGONS), _FLAT, 4.2e-5), _RANGES, is_relative=True),
    "tip": PadDescription(_curved(), _RANGES, is_relative=True),
    "fine": PadDescription(Taxels.grid(64, 64, 0.0005), _RANGES, full_scale=2e5),
}
"""12 × 3 taxels, 14 × 6 with an outline, 4 × 4 of 4.7 mm, seven hexagons of 7 mm, a curved tip, and 64 × 64."""


def base_scene() -> Scene:
    """The twelve shapes of ``hard``, which lie anyhow, and three sides of them."""
    hard = SCENES["hard"].scene
    return replace(hard, poses={side: hard.rotations[side] for side in _SIDES})


def touched(pad: PadDescription, objects: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Images of objects that are each touched by another pad, ``(objects, 3, m, m)``, and their shapes."""
    rng, base = np.random.default_rng(seed), base_scene()
    truths = np.arange(objects) % len(base.shapes)
    images = []
    for truth in truths:
        scene = pad.scene(base, rng.uniform(size=7))
        body = scene.sample_object(truth, rng)
        images.append([scene.press(body, side, rng).image for side in _SIDES])
    return np.array(images), truths


def posteriors(sensor: TactileSensor, images: np.ndarray) -> np.ndarray:
    """Probabilities of the shapes of each object after one, two and three touches, ``(objects, 3, K)``."""
    found = []
    for own in images:
        evidence, after = sensor.model.start(), []
        for touch in sensor.read(own, range(len(own))):
            evidence = evidence.update(touch)
            after.append(softmax(evidence.log_likelihood))
        found.append(after)
    return np.array(found)


def told(probabilities: np.ndarray, truths: np.ndarray) -> str:
    """A line on the probabilities ``(n, K)`` of n objects."""
    losses, stated = -np.log(probabilities[np.arange(len(truths)), truths]), probabilities.max(axis=1)
    right, stops = probabilities.argmax(axis=1) == truths, stated >= _STOP
    mean, low, high = cluster_bootstrap(losses, np.arange(len(losses)), np.random.default_rng(0))
    line = f"loss {mean:.3f} [{low:.3f}, {high:.3f}], right {right.mean():.3f}, stated {stated.mean():.3f}"
    if not stops.any():
        return f"{line}; no stops"
    return f"{line}; {stops.mean():.3f} stop: right {right[stops].mean():.3f}, stated {stated[stops].mean():.3f}"


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PADS, default=list(PADS))
    parser.add_argument("--objects", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="only write the descriptions, into this folder")
    parser.add_argument("--own", type=Path, help="folder with a sensor NAME for each pad, compared on the same touches")
    given = parser.parse_args()
    if given.write:
        given.write.mkdir(parents=True, exist_ok=True)
        for name, pad in PADS.items():
            pad.save(given.write / f"{name}.toml")
        return
    for name in given.only:
        pad = PADS[name]
        images, truths = touched(pad, given.objects, given.seed)
        folders = {"any pad": sensor_of_pad(pad)}
        if given.own:
            folders["own"] = given.own / name
        for what, folder in folders.items():
            found = posteriors(TactileSensor.load(folder, pad.scene(base_scene())), images)
            for row, number in enumerate(TOUCHES):
                print(f"{name:9} {what:8} {number} touches: {told(found[:, row], truths)}", flush=True)


if __name__ == "__main__":
    main()
