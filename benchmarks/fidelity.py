"""Agreement of the fast ways to press with each other and with a soft pad.

    python -m benchmarks.fidelity --presses 500 --soft-presses 40

The same placements are pressed with the same target force in every fidelity. The command also measures how well force
and depth alone predict the shape. For dynamic presses this should not be better than for quasistatic ones.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.poses import turn
from activetouch.pressing.contact import first_touch
from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press, Quasistatic
from activetouch.scene import Scene
from activetouch.shapes import SHAPES
from belief.files import require_writable_file, write_text
from belief.seeding import keyed_rng
from belief.table import Table
from benchmarks.neighbours import neighbour_guesses
from benchmarks.soft_pad import Deformable
from experiments.command_line.arguments import Count, CountOrNone, Jobs, JSONFile, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs, run_tasks
from experiments.scene_choice import SceneChoice

Floats = NDArray[np.float64]
_PER_TASK = 25
FORCES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Forces of the force-depth curves [N]."""


@dataclass(frozen=True, eq=False)
class Pressed:
    """n presses of one shape in one fidelity.

    Attributes:
        target: target force [N], ``(n,)``.
        force: measured force [N], ``(n,)``; NaN if the simulation failed.
        depth: of the imprint [m], ``(n,)``.
        engine_depth: of MuJoCo's soft contact [m], ``(n,)``; NaN without one.
        images: pressures, ``(n, taxels)``.
        bottomed_out: whether the layer bottomed out, ``(n,)``.
    """

    target: Floats
    force: Floats
    depth: Floats
    engine_depth: Floats
    images: Floats
    bottomed_out: NDArray[np.bool_]


@dataclass(frozen=True)
class Agreement:
    """Agreement of a fidelity with the quasistatic one.

    Attributes:
        num_presses: number of compared presses.
        unstable: number of failed simulations.
        correlation: median correlation of images.
        correlation_low: its fifth percentile.
        force_error: median absolute relative error of the force.
        force_error_high: its 95th percentile.
        bottomed_out: fraction of quasistatic presses in which the layer bottomed out.
    """

    num_presses: int
    unstable: int
    correlation: float
    correlation_low: float
    force_error: float
    force_error_high: float
    bottomed_out: float


@dataclass(frozen=True)
class FidelityCommand:
    """Press the same placements quasistatically, dynamically and on the soft pad, and compare images and forces.

    For example:

        python -m benchmarks.fidelity --presses 500 --soft-presses 40
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world; its own fidelity is not used."""
    presses: Count = 500
    """Number of presses of every shape, quasistatic and dynamic."""
    soft_presses: CountOrNone = 40
    """Number of presses of every shape on the soft pad; 0 for none."""
    seed: Seed = 0
    """Seed of the placements."""
    out: JSONFile = Path("runs/fidelity.json")
    """File for the results (JSON)."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""

    def run(self) -> None:
        """Press, compare, print and write."""
        check_arguments(self)
        require_writable_file(self.out)
        scene, console = self.choice.named.scene, plain_console()
        plain = self._press(scene, Quasistatic(), self.presses, "quasistatic")
        stepped = self._press(scene, Dynamic(traced=True), self.presses, "dynamic")
        others = {"dynamic": stepped}
        if self.soft_presses:
            others["deformable"] = self._press(scene, Deformable(), self.soft_presses, "deformable")
        agreement = {
            name: {label: agreement_of(plain[label], pressed) for label, pressed in other.items()}
            for name, other in others.items()
        }
        leaks = {
            "quasistatic": shape_accuracy(plain, "depth"),
            "dynamic": shape_accuracy(stepped, "depth"),
            "dynamic, with the depth of MuJoCo's contact": shape_accuracy(stepped, "engine_depth"),
        }
        curves = self._curves() if self.soft_presses else {}
        for name, rows in agreement.items():
            print(_table(f"{name} against quasistatic", rows))
        for name, accuracy in leaks.items():
            console.print(f"shape from force and depth alone, {name}: {accuracy:.3f}")
        for name, depths in curves.items():
            print(_curve_table(name, depths))
        numbers = {
            "seed": self.seed,
            "agreement": {n: {k: asdict(row) for k, row in rows.items()} for n, rows in agreement.items()},
            "shape_from_force_and_depth": leaks,
            "forces": FORCES,
            "depths": curves,
        }
        write_text(self.out, json.dumps(numbers, indent=1) + "\n")
        print(f"wrote {self.out}")

    def _curves(self) -> dict[str, dict[str, list[float]]]:
        """Depth [m] by force of a sphere and an edge, on the foundation and on the soft pad."""
        placements = {
            "sphere": Placement(SHAPES["sphere"], 1.0, turn("x", 0.0)),
            "cube on an edge": Placement(SHAPES["cube"], 1.0, turn("z", np.pi / 4)),
        }
        tasks = [
            partial(_depth, name, kind, press, placement, force)
            for name, placement in placements.items()
            for kind, press in (("quasistatic", Quasistatic()), ("deformable", Deformable()))
            for force in FORCES
        ]
        curves: dict[str, dict[str, list[float]]] = {name: {"quasistatic": [], "deformable": []} for name in placements}
        for name, kind, _, depth in sorted(run_tasks(tasks, self.jobs, "force and depth")):
            curves[name][kind].append(depth)
        return curves

    def _press(self, scene: Scene, press: Press, number: int, what: str) -> dict[str, Pressed]:
        """``number`` presses of every shape, by label."""
        scene = replace(scene, press_model=press)
        tasks = [
            partial(_press_some, scene, shape, range(first, min(first + _PER_TASK, number)), self.seed)
            for shape in range(len(scene.shapes))
            for first in range(0, number, _PER_TASK)
        ]
        parts: dict[str, list[Pressed]] = {label: [] for label in scene.shape_labels}
        for shape, _, pressed in sorted(run_tasks(tasks, self.jobs, f"pressing, {what}"), key=lambda part: part[:2]):
            parts[scene.shape_labels[shape]].append(pressed)
        return {
            label: Pressed(*(np.concatenate(column) for column in zip(*(vars(p).values() for p in some), strict=True)))
            for label, some in parts.items()
            if some
        }


def _depth(name: str, kind: str, press: Press, placement: Placement, force: float) -> tuple[str, str, float, float]:
    return name, kind, force, press.press(Pad(), placement, force).depth


def _press_some(scene: Scene, shape: int, numbers: range, seed: int) -> tuple[int, int, Pressed]:
    rows, images = [], []
    for number in numbers:
        rng = keyed_rng([seed, shape, number], is_fixed_length=True)
        thing = scene.sample_object(shape, rng)
        placement = scene.place(thing, number % len(scene.poses), rng)
        target = scene.variation.force.sample(rng)
        try:
            contact = scene.press_model.press(scene.pad, placement, target)
        except UnstablePress:
            rows.append((target, np.nan, np.nan, np.nan, False))
            images.append(np.full(scene.pad.num_taxels**2, np.nan))
            continue
        engine_depth = np.nan
        if contact.trace is not None and contact.trace.end_of_pause:
            held = contact.trace.position[contact.trace.end_of_pause - 1, 0]
            engine_depth = first_touch(scene.pad, placement)[1] - held
        rows.append((target, contact.force, contact.depth, engine_depth, contact.is_bottomed_out))
        images.append(contact.pressure.ravel())
    target_, force, depth, engine, bottomed_out = (np.array(column) for column in zip(*rows, strict=True))
    return shape, numbers[0], Pressed(target_, force, depth, engine, np.array(images), bottomed_out)


def agreement_of(reference: Pressed, other: Pressed) -> Agreement:
    """Agreement of ``other`` with the first presses of ``reference``."""
    n = len(other.force)
    good = np.isfinite(other.force) & (other.force > 0.0) & (reference.force[:n] > 0.0)
    first, second = (p - p.mean(axis=1, keepdims=True) for p in (reference.images[:n][good], other.images[good]))
    norms = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    # Constant images of an evenly pressed pad have no correlation.
    flat = norms == 0.0
    correlations = np.where(flat, 1.0, np.einsum("ij,ij->i", first, second) / np.where(flat, 1.0, norms))
    errors = np.abs(other.force[good] / other.target[good] - 1.0)
    return Agreement(
        num_presses=int(good.sum()),
        unstable=int(np.isnan(other.force).sum()),
        correlation=float(np.median(correlations)),
        correlation_low=float(np.quantile(correlations, 0.05)),
        force_error=float(np.median(errors)),
        force_error_high=float(np.quantile(errors, 0.95)),
        bottomed_out=float(reference.bottomed_out.mean()),
    )


def shape_accuracy(pressed: dict[str, Pressed], depth: str) -> float:
    """Fraction of odd presses whose shape is predicted from force and depth by their neighbours among the even ones."""
    numbers = np.concatenate([np.column_stack([p.force, getattr(p, depth)]) for p in pressed.values()])
    shapes = np.concatenate([np.full(len(p.force), k) for k, p in enumerate(pressed.values())])
    good = np.isfinite(numbers).all(axis=1)
    numbers, shapes = numbers[good], shapes[good]
    guesses = neighbour_guesses(numbers[::2], shapes[::2], numbers[1::2], num_neighbours=25)
    return float(np.mean(guesses == shapes[1::2]))


def _table(title: str, rows: dict[str, Agreement]) -> Table:
    return Table(
        title,
        [
            *("shape", ("presses", "d"), ("unstable", "d"), ("correlation", ".4f"), ("5 %", ".4f")),
            *(("force error", ".1%"), ("95 %", ".1%"), ("bottomed out", ".0%")),
        ],
        [
            (
                *(label, row.num_presses, row.unstable, row.correlation, row.correlation_low),
                *(row.force_error, row.force_error_high, row.bottomed_out),
            )
            for label, row in rows.items()
        ],
    )


def _curve_table(name: str, depths: dict[str, list[float]]) -> Table:
    columns = ["force [N]", *((f"{force:g}", ".2f") for force in FORCES)]
    return Table(f"depth of a {name} [mm]", columns, [(kind, *(1e3 * d for d in row)) for kind, row in depths.items()])


if __name__ == "__main__":
    tyro.cli(FidelityCommand, config=(tyro.conf.OmitSubcommandPrefixes,)).run()
