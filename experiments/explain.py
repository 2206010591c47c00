"""``activetouch explain``: what a scene models, why, and what that costs, beside the next leaner and richer scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import tyro
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

from activetouch.cost import Cost, measure
from activetouch.errors import MissingRobot
from activetouch.inventory import Entry, inventory, leaner, richer
from activetouch.scenes import NamedScene
from belief import Composition
from experiments.scene_choice import SceneChoice


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


def _what_table(name: str, entries: list[Entry]) -> Table:
    table = Table(title=f"what the scene '{name}' models", box=box.SIMPLE_HEAD)
    for heading, justify in (("number", "right"), ("part", "left"), ("why", "left")):
        table.add_column(heading, justify=justify)
    for entry in entries:
        table.add_row(str(entry.number), entry.part, entry.why)
    return table


def _cost_table(rows: list[tuple[str, str, Cost]]) -> Table:
    table = Table(title="what a press costs, on one core", box=box.SIMPLE_HEAD)
    for heading in ("scene", "µs/step", "steps", "ms/press", "ms/image", "MB"):
        table.add_column(heading, justify="left" if heading == "scene" else "right")
    for relation, change, cost in rows:
        table.add_row(
            f"{relation}: {change}" if relation else change,
            f"{1e6 * cost.step:.1f}" if cost.num_steps else "–",
            f"{cost.num_steps:.0f}",
            f"{1e3 * cost.press:.2f}",
            f"{1e3 * cost.image:.2f}",
            f"{cost.memory:.0f}",
            style="bold" if not relation else "",
        )
    loaded = [f"{relation or 'this'}: {', '.join(cost.imports) or 'none'}" for relation, _, cost in rows]
    table.caption = "heavy imports; " + "; ".join(loaded)
    return table
