"""Measure the time of presses, images, and MuJoCo's own tactile sensor, as ratios within one run.

Run: python benchmarks/world.py

Presses per second are of all cores. Other times are medians of interleaved rounds on one core, with ratios within a
round to the first row of the block.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import joblib
import mujoco
import numpy as np
from mujoco import rollout
from mujoco_tactile import NativeSensor
from rounds import time_in_rounds

from activetouch import SCENES, Quasistatic, Scene
from activetouch.poses import Placement
from activetouch.pressing.contact import Pad, first_touch
from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.rig import Rig
from activetouch.shapes import EXTENDED_SHAPES, SHAPES

ROUNDS, NUM_CORES = 7, joblib.cpu_count()


def press_many(scene: Scene, seed: int, number: int) -> None:
    rng = np.random.default_rng(seed)
    for index in range(number):
        scene.press(scene.sample_object(index % len(scene.shapes), rng), index % 6, rng)


def presses_per_second(scene: Scene, number: int) -> float:
    """Presses with images per second on all cores: the median of several rounds."""
    rates = []
    with joblib.parallel_config("loky", inner_max_num_threads=1), joblib.Parallel(n_jobs=NUM_CORES) as parallel:
        for _ in range(ROUNDS + 1):
            started = time.perf_counter()
            parallel(joblib.delayed(press_many)(scene, seed, number) for seed in range(NUM_CORES))
            rates.append(NUM_CORES * number / (time.perf_counter() - started))
    return float(np.median(rates[1:]))  # the first round starts the processes and compiles


def rollouts_per_second(number: int = 256) -> float:
    """Presses per second stepped by ``mujoco.rollout`` on all cores, each to a depth of about 2 N."""
    press, rng = Dynamic(), np.random.default_rng(0)
    rigs = {name: Rig(Pad(), shape.geom, press.timestep, traced=True) for name, shape in SHAPES.items()}
    models, states, controls = [], [], []
    scene = SCENES["gel"].scene
    for index in range(number):
        placement = scene.place(scene.sample_object(index % len(SHAPES), rng), index % 6, rng)
        rig = rigs[list(SHAPES)[index % len(SHAPES)]]
        rig.place(press.start, placement)
        models.append(copy.copy(rig.model))
        state = np.empty(mujoco.mj_stateSize(rig.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(rig.model, rig.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states.append(state)
        deepest = first_touch(scene.pad, placement)[1] - 0.002
        approach = np.arange(press.start, deepest, -press.speed * press.timestep)
        controls.append(
            np.concatenate([approach, np.full(round(press.pause / press.timestep), deepest), approach[::-1]])
        )
    longest = max(len(control) for control in controls)
    padded = np.array([np.pad(control, (0, longest - len(control)), mode="edge") for control in controls])
    datas = [mujoco.MjData(models[0]) for _ in range(NUM_CORES)]
    rates = []
    with rollout.Rollout(nthread=NUM_CORES) as pool:
        for _ in range(ROUNDS + 1):
            started = time.perf_counter()
            _, sensed = pool.rollout(models, datas, np.array(states), padded[:, :, None])
            rates.append(number / (time.perf_counter() - started))
    felt = np.asarray(sensed)[:, :, 0].max(axis=1)
    assert (felt > 0.5).all(), "a press of the rollout never met the pad"
    return float(np.median(rates[1:]))


def table(title: str, cases: Mapping[str, Callable[[int], object]], per_round: int) -> None:
    milliseconds = time_in_rounds(cases, ROUNDS, per_round)
    base = next(iter(milliseconds.values()))
    print(f"\n{title:<58}{'ms':>9}{'ratio':>8}")
    for name, times in milliseconds.items():
        print(f"{name:<58}{np.median(times):9.3f}{np.median(times / base):8.2f}")


def presses(scene: Scene) -> Callable[[int], object]:
    rng = np.random.default_rng(0)
    things = [scene.sample_object(index % len(scene.shapes), rng) for index in range(24)]
    placements = [scene.place(thing, index % 6, rng) for index, thing in enumerate(things)]
    return lambda index: scene.press_model.press(scene.pad, placements[index % 24], 2.0)


def native_sensor(num_taxels: int) -> Callable[[int], object]:
    sensor = NativeSensor(Pad(num_taxels=num_taxels), SHAPES["cylinder"])
    placement = Placement(
        SHAPES["cylinder"], 1.0, np.array([0.9, 0.1, 0.3, 0.3]) / np.linalg.norm([0.9, 0.1, 0.3, 0.3])
    )
    _, touching = first_touch(Pad(num_taxels=num_taxels), placement)
    return lambda index: sensor.depth(placement, touching - 0.002)


def height_map(name: str, num_taxels: int = 128) -> Callable[[int], object]:
    pad, rng = Pad(num_taxels=num_taxels), np.random.default_rng(0)
    scene = Scene(shapes={name: EXTENDED_SHAPES[name]}, pad=pad)
    placements = [scene.place(scene.sample_object(0, rng), index % 6, rng) for index in range(24)]
    return lambda index: first_touch(pad, placements[index % 24])


def main() -> None:
    gel = SCENES["gel"].scene
    print(f"presses per second on {NUM_CORES} cores")
    print(f"  quasistatic, with image       {presses_per_second(replace(gel, press_model=Quasistatic()), 400):8.0f}")
    print(f"  dynamic, with image           {presses_per_second(gel, 200):8.0f}")
    print(f"  dynamic, mujoco.rollout       {rollouts_per_second():8.0f}")
    print(f"  paper's guarded move          {presses_per_second(SCENES['paper'].scene, 60):8.0f}")
    traced = replace(gel, press_model=Dynamic(traced=True))
    stages = {
        "minimal scene": presses(gel),
        "and a trace": presses(traced),
    }
    table("one dynamic press, without image", stages, 24)
    table("height map of all twelve shapes, 128 × 128", {name: height_map(name) for name in EXTENDED_SHAPES}, 24)
    both = {f"height map, {n} × {n}": height_map("cylinder", n) for n in (32, 64, 128)}
    both |= {f"MuJoCo's tactile sensor, {n} × {n}": native_sensor(n) for n in (32, 64, 128)}
    table("a cylinder's height map, and the native sensor's", both, 24)


if __name__ == "__main__":
    main()
