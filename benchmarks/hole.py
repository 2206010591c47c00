"""How often touches show a small hole: a cube of 24 mm, with and without a round hole of 5 mm in one of its faces.

    python -m benchmarks.hole

Errors and shares are those of `benchmarks.alike`: with six poses, and for the same objects with the 26 directions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from activetouch import SCENES
from activetouch.distributions import Constant
from activetouch.shapes import Mesh
from benchmarks.alike import alike

HALF, RADIUS, DEPTH = 0.012, 0.0025, 0.008  # [m]
SIDES = 32
OBJECTS = 40


def cube(has_hole: bool) -> Mesh:
    """A cube; the hole, if any, is in the middle of the face at the top."""
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    square = circle / np.abs(circle).max(axis=1, keepdims=True) * HALF  # has the corners: 32 is a multiple of 8
    rings = [(square, -HALF), (square, HALF)]
    if has_hole:
        rings += [(RADIUS * circle, HALF), (RADIUS * circle, HALF - DEPTH)]
    ends = [[0.0, 0.0, -HALF], [0.0, 0.0, rings[-1][1]]]
    vertices = np.vstack([*(np.column_stack([ring, np.full(SIDES, z)]) for ring, z in rings), ends])
    here = np.arange(SIDES)
    after, faces = np.roll(here, -1), []
    for level in range(len(rings) - 1):
        low, high = level * SIDES, (level + 1) * SIDES
        faces += [
            np.stack([low + here, low + after, high + after], 1),
            np.stack([low + here, high + after, high + here], 1),
        ]
    bottom, top = len(vertices) - 2, len(vertices) - 1
    last = (len(rings) - 1) * SIDES
    faces += [np.stack([after, here, np.full(SIDES, bottom)], 1)]
    faces += [np.stack([last + here, last + after, np.full(SIDES, top)], 1)]
    return Mesh("cube with a hole" if has_hole else "cube", vertices, np.concatenate(faces))


def main() -> None:
    """Compare the two in the default scene, with sizes that do not vary."""
    scene = SCENES["gel"].scene
    constant = replace(scene.variation, size=Constant(1.0))
    scene = replace(scene, shapes={"cube": cube(False), "with a hole": cube(True)}, variation=constant)
    (pair,) = alike(scene, num_objects=OBJECTS).pairs
    assert pair.shown_from_26 is not None, "the pair is confused"
    print(f"{OBJECTS} tumbled objects of each, scene gel, hole of {2e3 * RADIUS:g} mm in a cube of {2e3 * HALF:g} mm")
    for touches, error, interval, compared in (
        ("one touch", pair.one, pair.one_interval, pair.one_compared),
        ("six touches", pair.all, pair.all_interval, pair.all_compared),
    ):
        low, high = interval
        print(f"after {touches}: error {error:.2f} [{low:.2f}, {high:.2f}], by comparing images {compared:.2f}")
    print(f"the hole shows in {pair.shown:.0%} of the objects with six poses, in {pair.shown_from_26:.0%} with 26")


if __name__ == "__main__":
    main()
