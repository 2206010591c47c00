"""Time and memory of the presses of a scene."""

from __future__ import annotations

import mmap
import multiprocessing
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activetouch.rendering import read_out
from activetouch.scene import Scene
from experiments.command_line.workers import in_own_process

_HEAVY = ("mujoco", "scipy", "trimesh", "matplotlib", "torch", "transformers")


@dataclass(frozen=True)
class Cost:
    """Cost of the presses of a scene, in a process of their own.

    Attributes:
        step: mean time of a step of MuJoCo [s]; 0 without steps.
        num_steps: mean number of steps per press.
        press: median time of a press without its image [s].
        image: median time of rendering and read-out [s].
        memory: of the process [MB].
        imports: large packages that the process loaded.
    """

    step: float
    num_steps: float
    press: float
    image: float
    memory: float
    imports: tuple[str, ...]


def press_cost(scene: Scene, num_presses: int) -> Cost:
    """Cost of ``num_presses`` presses of all shapes, measured in a new process."""
    return in_own_process(multiprocessing.get_context("spawn"), _measure_here, scene, num_presses)


def _measure_here(scene: Scene, num_presses: int) -> Cost:
    rng = np.random.default_rng(0)
    things = [scene.sample_object(number % len(scene.shapes), rng) for number in range(num_presses)]
    steps: list[float] = []
    if scene.press_model.compiled(scene.setup, next(iter(scene.solids.values()))) is not None:
        import mujoco

        original = mujoco.mj_step

        def timed(*arguments: object) -> None:
            started = time.perf_counter()
            original(*arguments)
            steps.append(time.perf_counter() - started)

        mujoco.mj_step = timed  # before there are models, which look it up once
    for thing in things[: len(scene.shapes)]:
        scene.press(thing, 0, rng)  # compiles the models
    steps.clear()
    presses, images = [], []
    for number, thing in enumerate(things):
        started = time.perf_counter()
        contact = scene.press(thing, number % len(scene.poses), rng).contact
        pressed = time.perf_counter()
        read_out(scene.image(contact), scene.faults, rng)  # again, to measure its time
        images.append(time.perf_counter() - pressed)
        presses.append(pressed - started - images[-1])
    return Cost(
        step=float(np.mean(steps)) if steps else 0.0,
        num_steps=len(steps) / num_presses,
        press=float(np.median(presses)),
        image=float(np.median(images)),
        memory=_resident_megabytes(),
        imports=tuple(name for name in _HEAVY if name in sys.modules),
    )


def _resident_megabytes() -> float:
    """Memory of this process [MB]; NaN if the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])  # the peak would include the parent's
    except OSError:
        return float("nan")
    return pages * mmap.PAGESIZE / 1e6
