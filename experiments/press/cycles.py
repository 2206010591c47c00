"""The paper's data collection: cycles of approach, contact, pause, withdraw, rotate (paper §5.3, §5.4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from activetouch.poses import random_orientation
from activetouch.pressing.trace import Trace, join
from activetouch.scene import Scene, WorldObject


def record_cycles(scene: Scene, pressed: WorldObject, num_cycles: int, rng: np.random.Generator) -> list[Trace]:
    """Press an object repeatedly, with a rotation to a new random orientation after each press.

    Args:
        scene: its presses must simulate rotations, as guarded moves do.
        pressed: the object.
        num_cycles: number of presses.
        rng: of offsets, thresholds and rotations.

    Returns:
        One trace per cycle with all five phases; a miss has no phase ``contact``.

    Raises:
        WrongPress: the scene's presses do not simulate rotations.
        UnstablePress: the simulation diverged.
    """
    scene = replace(scene, press_model=scene.press_model.with_trace())
    placement = scene.place(pressed, 0, rng)
    cycles = []
    for _ in range(num_cycles):
        contact = scene.contact(placement, rng)
        orientation = random_orientation(rng)
        rotation = scene.press_model.rotate(scene.setup, placement, orientation)
        assert contact.trace is not None, "presses that rotate are traced"
        cycles.append(join([contact.trace, rotation]))
        offset = scene.variation.sample_offset(rng) + scene.aim_offsets[0]
        placement = replace(placement, orientation=orientation, offset=offset)
    return cycles
