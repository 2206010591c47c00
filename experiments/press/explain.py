"""``activetouch explain``: what a scene models, and which of its shapes feel alike."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.errors import LabelMismatch, WrongScene
from activetouch.named_scenes import NamedScene
from activetouch.pressing.contact import surface_gap
from activetouch.rendering import read_out
from activetouch.scene import Scene
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import READER_FILE, reader_file, sensor_shift
from belief.observation_model.rigid_body import joint_model
from belief.table import Table
from experiments.command_line.arguments import Count, Jobs, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.press.alike import SHOWN, Alike, Likeness, alike
from experiments.press.inventory import Item, inventory, latent
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import sensor_folder

_PRESSES = 50  # of each shape, to see where the layer bottoms out
_FEW = 0.05  # share of presses that may bottom out
_FEWEST_PAIRS, _MOST_PAIRS = 3, 12
_WIDE = 0.95  # share of the surface below which an aim is offered


@dataclass(frozen=True)
class Explanation:
    """What a scene models; it prints as tables and sentences.

    Attributes:
        name: of the scene.
        items: the parts of the model.
        remarks: sentences about the belief, the time of a press, and presses that show less than they could.
        alike: how alike the shapes feel; None where they were not compared.
    """

    name: str
    items: Sequence[Item]
    remarks: Sequence[str]
    alike: Alike | None = None

    def tables(self) -> list[Table]:
        """What the scene models, and which shapes feel alike if they were compared."""
        rows = [(item.number, item.part, item.why) for item in self.items]
        columns = [("number", "d"), ("part", ""), ("what", "")]
        what = Table(f"what the scene '{self.name}' models", columns, rows)
        return [what, *([] if self.alike is None else [alike_table(self.alike)])]

    def __str__(self) -> str:
        return "\n\n".join([*(table.markdown() for table in self.tables()), *self.remarks])


def explain(
    named: NamedScene,
    *,
    name: str = "scene",
    presses: int = 60,
    compare: bool = True,
    jobs: int = 1,
    sensor: Path | None = None,
) -> Explanation:
    """What a scene models, which of its shapes feel alike, and how long a press takes.

    Args:
        named: the scene, and its search.
        name: of the scene.
        presses: number of presses to measure.
        compare: whether to compare all pairs of shapes, which takes about a quarter of a second for a pair.
        jobs: number of processes that compare shapes.
        sensor: folder of a sensor, whose belief is described if it fits the scene; None for none.
    """
    scene = named.scene
    remarks = [_belief_words(scene, sensor if sensor is not None and _fits(sensor, scene) else None)]
    likeness = None
    if scene.families:
        remarks.append(f"Shapes are not compared: the proportions of {', '.join(scene.families)} vary.")
    elif compare and len(scene.shapes) > 1:
        likeness = alike(scene, jobs=jobs)
    remarks.append(_cost_words(scene, presses))
    if scene.hand is not None and len(scene.hand) > 1:
        remarks.append(
            f"A grasp gives {len(scene.hand)} images at the cost of one touch. Its fingers share the force and the "
            "object's offset in the palm, drawn anew at each grasp; the belief takes both as each finger's own. A "
            "finger that misses gives an image of no contact, which is read as any other."
        )
    remarks += _bottoming_words(scene, np.random.default_rng(0))
    if likeness and (partly := [label for label, (ever, _) in likeness.reach.items() if ever < _WIDE]):
        remarks.append(f"No touch meets all of {', '.join(partly)}: aim beside the axis (activetouch.poses.aimed).")
    return Explanation(name, inventory(named), remarks, likeness)


@dataclass(frozen=True)
class Explain:
    """List what a scene models, and measure the time of a press.

    Also says what the belief about an object holds hidden (orientation and size, if touches share them), which shapes
    feel alike to the pad, and where touches show less than they could.

    For example:

        activetouch explain
        activetouch explain --scene paper
        activetouch explain --meshes mug.obj@0.001 bowl.stl
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    presses: Count = 60
    """Number of presses to measure."""
    alike: bool = True
    """Compare all pairs of shapes; a second for each shape and a quarter for each pair."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that compare shapes."""

    def run(self) -> None:
        """Measure and print; the belief only if a sensor of the package fits the scene."""
        check_arguments(self)
        folder, name = sensor_folder(None, self.choice.scene), self.choice.scene
        shipped = folder if folder.exists() else None
        found = explain(
            self.choice.named, name=name, presses=self.presses, compare=self.alike, jobs=self.jobs, sensor=shipped
        )
        console = plain_console()
        for table in found.tables():
            print(table, end="\n\n")
        for remark in found.remarks:
            console.print(f"- {remark}")


def alike_table(found: Alike) -> Table:
    """The pairs of shapes that feel most alike: all that are confused at times, and three at least."""
    confused = {pair: max(pair.one_compared, pair.all_compared) > SHOWN for pair in found.pairs}
    pairs = sorted(found.pairs, key=lambda pair: not confused[pair])
    rows = [
        (
            *pair.shapes,
            (pair.one_interval[0], max(pair.one_interval[1], pair.one_compared)),
            (pair.all_interval[0], max(pair.all_interval[1], pair.all_compared)),
            pair.shown,
            pair.shown_from_26,
        )
        for pair in pairs[: min(max(sum(confused.values()), _FEWEST_PAIRS), _MOST_PAIRS)]
    ]
    hard = [pair for pair in found.pairs if pair.all_interval[1] >= 0.5 - SHOWN]
    same, hard = ([pair for pair in hard if (pair.all_interval[0] == 0.5) == is_same] for is_same in (True, False))
    columns = ["shape", ("other shape", ""), ("one touch", ".2f"), (f"{found.num_touches} touches", ".2f")]
    return Table(
        "shapes that feel most alike: error of distinguishing two (0.5 is chance)",
        [*columns, ("objects that show it", ".0%"), ("from 26 directions", ".0%")],
        rows,
        "Estimated by simulated contacts (see activetouch.alike). "
        + (f"The same body: {_names(same)}. " if same else "")
        + f"Hardly distinguished: {_names(hard) or 'none'}"
        + ("; try --poses directions26, or aim beside the axis (activetouch.poses.aimed)." if hard else "."),
    )


def _names(pairs: list[Likeness]) -> str:
    return ", ".join(" and ".join(pair.shapes) for pair in pairs)


def bearing_forces(scene: Scene, shape: str, num_presses: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """The forces that the pad's layer carries before it bottoms out under a shape, in random presses ``(n,)`` [N].

    Args:
        scene: sizes, offsets, orientations, stiffness and poses.
        shape: its label.
        num_presses: how many; those that miss are left out.
        rng: generator for objects and presses.
    """
    pad, forces = scene.pad, []
    for number in range(num_presses):
        placement = scene.place(scene.sample_object(shape, rng), number % len(scene.poses), rng)
        most = np.maximum(pad.max_depth - surface_gap(pad, placement), 0.0).sum()
        forces.append(most * pad.stiffness * placement.stiffness * pad.taxel_area)
    return np.array([force for force in forces if force > 0.0])


def _bottoming_words(scene: Scene, rng: np.random.Generator) -> list[str]:
    """How often the layer bottoms out, and the forces at which it rarely does; nothing where it rarely does."""
    shares, ratios = {}, [np.empty(0)]
    for label in scene.shape_labels:
        carried = bearing_forces(scene, label, _PRESSES, rng)
        given = np.array([scene.variation.force.sample(rng) for _ in carried])
        if (share := float((carried <= given).mean()) if len(given) else 0.0) > _FEW:
            shares[label] = f"{share:.0%} of {label}"
        ratios.append(carried[given > 0.0] / given[given > 0.0])
    together, (low, high) = np.concatenate(ratios), scene.variation.force.support
    if not shares or (factor := float(np.quantile(together, _FEW))) >= 1.0:
        return []
    forces = f"{low * factor:.2g}, {high * factor:.2g}"
    return [
        f"The pad's layer bottoms out in presses with {low:g} to {high:g} N: {', '.join(shares.values())}. With "
        f"force=Uniform({forces}) in the scene's variation it does in {_FEW:.0%}."
    ]


def _cost_words(scene: Scene, num_presses: int) -> str:
    """The median times of a press and of its image, on one core."""
    rng = np.random.default_rng(0)
    pressed = [scene.sample_object(number % len(scene.shapes), rng) for number in range(num_presses)]
    for each in pressed[: len(scene.shapes)]:
        scene.press(each, 0, rng)  # compiles the models
    presses, images = [], []
    for number, each in enumerate(pressed):
        started = time.perf_counter()
        contacts = scene.press(each, number % len(scene.poses), rng).contacts
        ended = time.perf_counter()
        for contact in contacts:
            read_out(scene.image(contact), scene.faults, rng)  # again, to measure its time
        images.append(time.perf_counter() - ended)
        presses.append(ended - started - images[-1])
    press, image = 1e3 * float(np.median(presses)), 1e3 * float(np.median(images))
    what = "press" if scene.hand is None else "grasp"
    return f"A {what} takes {press:.2f} ms on one core, and its image {image:.2f} ms."


def _belief_words(scene: Scene, folder: Path | None) -> str:
    """What the belief about one object holds, with a sensor in a folder."""
    hidden = latent(scene)
    words = f"The belief about an object holds its shape, {', '.join(hidden)}"
    if not hidden:
        words = "The belief about an object holds its shape; each touch has its own orientation"
    model = None if folder is None else joint_model(TactileSensor.load(folder, scene, anyway=True).model)
    if model is None:
        return f"{words}. No shipped sensor with a joint model was fitted to these objects."
    return f"{words}: {model.num_hypotheses} hypotheses for each shape."


def _fits(sensor: Path, scene: Scene) -> bool:
    """Whether the sensor in a folder was fitted to a scene, or to one that differs by a known shift."""
    try:
        if reader_file(sensor, scene).name != READER_FILE:
            return False
        sensor_shift(sensor, scene)
    except (LabelMismatch, WrongScene):
        return False
    return True
