"""``activetouch explain``: what a scene models, why, and what that costs, beside the next leaner and next richer scene."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import tyro
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

from activetouch.inventory import Entry, inventory, leaner, richer
from activetouch.robot import MissingRobot
from activetouch.scene import Scene
from activetouch.scenes import NamedScene
from belief import Composition
from experiments.scene_choice import SceneChoice

_HEAVY = ("mujoco", "scipy", "trimesh", "matplotlib", "torch", "transformers")


@dataclass(frozen=True)
class Cost:
    """What presses of a scene cost, in a process of their own.

    Attributes:
        step: mean time of a step of MuJoCo [s]; 0 where none is made.
        num_steps: mean number of them in a press.
        press: median time of a press, its image aside [s].
        image: median time of rendering and reading out [s].
        memory: of the process [MB].
        imports: heavy packages it loaded.
    """

    step: float
    num_steps: float
    press: float
    image: float
    memory: float
    imports: tuple[str, ...]


@dataclass(frozen=True)
class Explain:
    """Say what a scene models and why, and measure what it costs next to the next leaner and next richer scene.

    For example:

        activetouch explain
        activetouch explain --scene paper --robot panda_allegro
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    presses: int = 60
    """Presses to measure in each scene."""

    def run(self) -> None:
        """Print two tables."""
        named, console = self.choice.named, Console()
        console.print(_what_table(self.choice.scene, [*inventory(named.scene), *hidden_variables(named)]))
        variants = [("", "this scene", named.scene)]
        for position, found, relation in ((0, leaner(named.scene), "leaner"), (2, richer(named.scene), "richer")):
            if found is not None:
                variants.insert(position, (relation, *found))
        rows = []
        for relation, change, scene in track(variants, "measuring", console=console, transient=True):
            try:
                rows.append((relation, change, measure(scene, self.presses)))
            except MissingRobot:
                console.print(f"not measured: {change} (no Menagerie checkout; set MENAGERIE_ROOT)")
        console.print(_cost_table(rows))


def hidden_variables(named: NamedScene) -> list[Entry]:
    """What the belief about the scene is a distribution over."""
    shapes, objects = len(named.scene.shapes), named.num_objects
    if named.composition is Composition.DISTINCT:
        return [
            Entry(objects * shapes, "hidden probabilities", "shape of every object, coupled because no two are alike"),
            Entry(
                objects,
                "objects",
                f"their coupling is summed exactly over {2**shapes} subsets of shapes, not {shapes}! orders",
            ),
        ]
    return [
        Entry(shapes, "hidden probabilities", "shape of the current object; the others are independent of it"),
        Entry(objects, "objects", "any mixture of shapes"),
    ]


def measure(scene: Scene, num_presses: int) -> Cost:
    """Press objects of all shapes in a fresh process and see what it takes."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measure_here, scene, num_presses).result()


def _measure_here(scene: Scene, num_presses: int) -> Cost:
    from activetouch.rendering import read_out

    rng = np.random.default_rng(0)
    things = [scene.sample_object(number % len(scene.shapes), rng) for number in range(num_presses)]
    for thing in things[: len(scene.shapes)]:
        scene.press(thing, 0, rng)  # compile what is compiled once
    steps: list[float] = []
    if "mujoco" in sys.modules:
        import mujoco

        original = mujoco.mj_step

        def timed(*arguments: object) -> None:
            started = time.perf_counter()
            original(*arguments)
            steps.append(time.perf_counter() - started)

        mujoco.mj_step = timed
    presses, images = [], []
    for number, thing in enumerate(things):
        placement = scene.place(thing, number % len(scene.poses), rng)
        started = time.perf_counter()
        contact = scene.press_model.press(scene.stage, placement, scene.variation.force.sample(rng))
        pressed = time.perf_counter()
        read_out(scene.renderer(contact), scene.faults, rng)
        presses.append(pressed - started)
        images.append(time.perf_counter() - pressed)
    return Cost(
        step=float(np.mean(steps)) if steps else 0.0,
        num_steps=len(steps) / num_presses,
        press=float(np.median(presses)),
        image=float(np.median(images)),
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        imports=tuple(name for name in _HEAVY if name in sys.modules),
    )


def _what_table(name: str, entries: list[Entry]) -> Table:
    table = Table(title=f"what the scene '{name}' models", box=box.SIMPLE_HEAD)
    for heading, justify in (("number", "right"), ("part", "left"), ("why", "left")):
        table.add_column(heading, justify=justify)
    for entry in entries:
        table.add_row(str(entry.number), entry.part, entry.why)
    return table


def _cost_table(rows: list[tuple[str, str, Cost]]) -> Table:
    table = Table(title="what a press costs, on one core", box=box.SIMPLE_HEAD)
    for heading in ("", "scene", "µs/step", "steps", "ms/press", "ms/image", "MB", "imports"):
        table.add_column(heading, justify="left" if heading in ("", "scene", "imports") else "right")
    for relation, change, cost in rows:
        table.add_row(
            relation,
            change,
            f"{1e6 * cost.step:.1f}" if cost.num_steps else "–",
            f"{cost.num_steps:.0f}",
            f"{1e3 * cost.press:.2f}",
            f"{1e3 * cost.image:.2f}",
            f"{cost.memory:.0f}",
            " ".join(cost.imports),
            style="bold" if not relation else "",
        )
    return table
