"""``activetouch explain``: parts of a scene, and lower bounds on the touches that its sensor needs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Annotated

import tyro
from rich.progress import track

from activetouch.errors import LabelMismatch, NoIndependentModel, WrongScene
from activetouch.named_scenes import NamedScene
from activetouch.scene import Scene
from activetouch.sensor_files import READER_FILE, load_observation_model, reader_file, sensor_shift
from belief import Composition
from belief.observation_model import OutcomeTable
from experiments.command_line.arguments import Count, Jobs, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.press.alike import alike as compare_shapes
from experiments.press.belief_table import belief_table
from experiments.press.felt_tables import alike_table, felt_table
from experiments.press.inventory import InventoryItem, inventory, leaner, richer
from experiments.press.step_counter import Cost, press_cost
from experiments.reporting.tables import Table
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import sensor_folder
from planners.bounds.touch_count import touch_count_bounds

_HARDEST = 6  # pairs of shapes to show
_SECONDS = (1.0, 0.25)  # that comparing takes for each shape and for each pair, about


@dataclass(frozen=True)
class Explain:
    """List what a scene models, and measure its cost and that of the next simpler and next richer scene.

    Also shows what the belief about an object holds hidden (orientation and size, if touches share them), and its
    memory and time beside the leaner model that takes touches as independent. Says which shapes feel alike to the pad,
    where touches land, and at which force the pad's layer bottoms out.

    For example:

        activetouch explain
        activetouch explain --scene paper
        activetouch explain --meshes mug.obj bowl.stl --mesh-scale 0.001
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    presses: Count = 60
    """Number of presses to measure in each scene."""
    alike: bool = True
    """Compare all pairs of shapes."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that compare shapes."""

    def run(self) -> None:
        """Print the tables; the lower bounds only for solids, if a sensor of the package fits the scene."""
        check_arguments(self)
        named, console = self.choice.named, plain_console()
        console.print(_what_table(self.choice.scene, [*inventory(named.scene), *hidden_variables(named)]).rich())
        likeness = None
        if named.scene.families:
            console.print(f"shapes are not compared: the proportions of {', '.join(named.scene.families)} vary")
        elif self.alike and len(named.scene.shapes) > 1:
            shapes = len(named.scene.shapes)
            seconds = (_SECONDS[0] * shapes + _SECONDS[1] * shapes * (shapes - 1) / 2) / self.jobs
            console.print(f"comparing {shapes} shapes takes about {seconds:.0f} s; --no-alike leaves it out")
            likeness = compare_shapes(named.scene, jobs=self.jobs)
            console.print(alike_table(self.choice.scene, likeness).rich())
        console.print(felt_table(self.choice.scene, named.scene, likeness).rich())
        folder, scene = sensor_folder(None, self.choice.scene), named.scene
        shipped = folder if folder.exists() and _fits(folder, scene) else None
        if shipped is not None and not scene.families:  # it knows the nominal solids
            with suppress(NoIndependentModel):
                model = load_observation_model(shipped, independent=True)
                console.print(limits_table(model.outcome_table(), model.shape_labels).rich())
        console.print(belief_table(self.choice.scene, scene, shipped).rich())
        variants = [("", "this scene", scene)]
        for position, found, relation in ((0, leaner(scene), "leaner"), (2, richer(scene), "richer")):
            if found is not None:
                variants.insert(position, (relation, *found))
        rows = []
        for relation, change, variant in track(variants, "measuring", console=console, transient=True):
            rows.append((relation, change, press_cost(variant, self.presses)))
        console.print(_cost_table(rows).rich())


def _fits(sensor: Path, scene: Scene) -> bool:
    """Whether the sensor in a folder was fitted to a scene, or to one that differs by a known shift."""
    try:
        if reader_file(sensor, scene).name != READER_FILE:
            return False
        sensor_shift(sensor, scene)
    except (LabelMismatch, WrongScene):
        return False
    return True


def hidden_variables(named: NamedScene) -> list[InventoryItem]:
    """The hidden variables of the belief about the scene."""
    shapes, objects = len(named.scene.shapes), named.num_objects
    if named.composition is Composition.DISTINCT:
        return [
            InventoryItem(
                objects * shapes, "hidden probabilities", "shape of every object, coupled because no two are alike"
            ),
            InventoryItem(
                objects,
                "objects",
                f"their coupling is summed exactly over {2**shapes} subsets of shapes, not {shapes}! orders",
            ),
        ]
    return [
        InventoryItem(shapes, "hidden probabilities", "shape of the current object; the others are independent of it"),
        InventoryItem(objects, "objects", "any mixture of shapes"),
    ]


def limits_table(table: OutcomeTable, shape_labels: Sequence[str], error: float = 0.01) -> Table:
    """The pairs of shapes that are hardest to distinguish, and lower bounds on the touches that this takes."""
    limits = touch_count_bounds(table, error)
    pairs = sorted(combinations(range(table.num_shapes), 2), key=lambda pair: limits.chernoff[pair])[:_HARDEST]
    rows = [
        (
            *(shape_labels[one], shape_labels[other]),
            *(limits.least_touches[pair] for pair in ((one, other), (other, one))),
            limits.chernoff[one, other],
        )
        for one, other in pairs
    ]
    alike = [f"{shape_labels[one]} and {shape_labels[other]}" for one, other in limits.indistinguishable]
    return Table(
        f"lower bounds on the touches that distinguish two shapes with {error:.0%} error",
        [
            "true shape",
            ("other shape", ""),
            ("touches", ".1f"),
            ("with shapes exchanged", ".1f"),
            ("Chernoff, nats", ".2f"),
        ],
        rows,
        "Mean over searches, for any decider: Wald's bound for independent touches in the best pose. Pairs that no "
        f"pose distinguishes: {', '.join(alike) or 'none'}.",
    )


def _what_table(name: str, entries: list[InventoryItem]) -> Table:
    rows = [(entry.number, entry.part, entry.why) for entry in entries]
    return Table(f"what the scene '{name}' models", [("number", "d"), ("part", ""), ("why", "")], rows)


def _cost_table(rows: list[tuple[str, str, Cost]]) -> Table:
    loaded = [f"{relation or 'this'}: {', '.join(cost.imports) or 'none'}" for relation, _, cost in rows]
    return Table(
        "what a press costs on one core",
        ["scene", ("µs/step", ".1f"), ("steps", ".0f"), ("ms/press", ".2f"), ("ms/image", ".2f"), ("MB", ".0f")],
        [
            (
                *(f"{relation}: {change}" if relation else change, 1e6 * cost.step if cost.num_steps else None),
                *(cost.num_steps, 1e3 * cost.press, 1e3 * cost.image, cost.memory),
            )
            for relation, change, cost in rows
        ],
        f"Heavy imports: {'; '.join(loaded)}.",
    )
