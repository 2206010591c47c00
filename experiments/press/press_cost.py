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
        press: median time of a press without its image [s].
        image: median time of rendering and read-out [s].
        memory: of the process [MB]; NaN if the system does not report it.
        imports: large packages that the process loaded.
    """

    press: float
    image: float
    memory: float
    imports: tuple[str, ...]


def press_cost(scene: Scene, num_presses: int) -> Cost:
    """Cost of ``num_presses`` presses of all shapes, measured in a new process."""
    return in_own_process(multiprocessing.get_context("spawn"), _measure_here, scene, num_presses)


def _measure_here(scene: Scene, num_presses: int) -> Cost:
    rng = np.random.default_rng(0)
    pressed = [scene.sample_object(number % len(scene.shapes), rng) for number in range(num_presses)]
    for each in pressed[: len(scene.shapes)]:
        scene.press(each, 0, rng)  # compiles the models
    presses, images = [], []
    for number, each in enumerate(pressed):
        started = time.perf_counter()
        contact = scene.press(each, number % len(scene.poses), rng).contact
        ended = time.perf_counter()
        read_out(scene.image(contact), scene.faults, rng)  # again, to measure its time
        images.append(time.perf_counter() - ended)
        presses.append(ended - started - images[-1])
    loaded = tuple(name for name in _HEAVY if name in sys.modules)
    return Cost(float(np.median(presses)), float(np.median(images)), _resident_megabytes(), loaded)


def _resident_megabytes() -> float:
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])  # the peak would include the parent's
    except OSError:
        return float("nan")
    return pages * mmap.PAGESIZE / 1e6
