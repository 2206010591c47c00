"""Measure what finger, parked objects and robot cost that change no touch: time, size of the model, time to compile.

Run: python benchmarks/paper_world.py --menagerie mujoco_menagerie

Times of a touch are processor time with its image, medians of interleaved rounds, with ratios within a round to the
scene alone. The same touches in each world are compared byte by byte.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import mujoco
import numpy as np
from rounds import time_in_rounds

from activetouch import SCENES, Scene
from activetouch.pressing.rig import Rig

ROUNDS, TOUCHES = 7, 24


def felt(scene: Scene, index: int) -> bytes:
    """All that one touch of a new object gives."""
    rng = np.random.default_rng(index)
    thing = scene.sample_object(index % len(scene.shapes), rng)
    contact, image, *_ = scene.press(thing, index % len(scene.poses), rng)
    traced = () if contact.trace is None else (contact.trace.force, contact.trace.position)
    return b"".join(part.tobytes() for part in (image, contact.pressure, np.float64(contact.force), *traced))


def compiled(scene: Scene) -> tuple[mujoco.MjModel, float]:
    """The model of a press of the first shape, and the time to make it again [s]."""
    shape = next(iter(scene.solids.values()))
    seconds = []
    for _ in range(3):
        started = time.process_time()
        model = Rig(scene.pad, shape.geom, 0.002, around=scene.around(shape)).model
        seconds.append(time.process_time() - started)
    return model, min(seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--menagerie", type=Path, help="copy of MuJoCo Menagerie; without it, no robot")
    parser.add_argument("--touches", type=int, default=400, help="touches of each world that are compared")
    given = parser.parse_args()
    head = f"{'':<36}{'ms':>8}{'ratio':>7}{'bodies':>8}{'joints':>8}{'geoms':>7}{'MB':>8}{'compile s':>11}  same bytes"
    for name in ("paper", "gel"):
        alone = SCENES[name].scene
        worlds = {"pad and object": alone, "--full": alone.with_surroundings()}
        if given.menagerie is not None:
            worlds["--robot panda_allegro"] = alone.with_surroundings(False, given.menagerie)
            worlds["--full --robot panda_allegro"] = alone.with_surroundings(True, given.menagerie)
        cases = {world: (lambda index, scene=scene: felt(scene, index)) for world, scene in worlds.items()}
        times = time_in_rounds(cases, ROUNDS, TOUCHES)
        print(f"scene {name}\n{head}")
        for world, scene in worlds.items():
            model, seconds = compiled(scene)
            ratio = np.median(times[world] / times["pad and object"])
            same = sum(felt(scene, index) == felt(alone, index) for index in range(given.touches))
            sizes = f"{model.nbody:8d}{model.njnt:8d}{model.ngeom:7d}{mujoco.mj_sizeModel(model) / 1e6:8.3f}"
            milliseconds = f"{np.median(times[world]):8.2f}{ratio:7.2f}"
            print(f"{world:<36}{milliseconds}{sizes}{seconds:11.3f}  {same} of {given.touches}")
        print()


if __name__ == "__main__":
    main()
