"""``activetouch explain``: what a scene models, and which of its shapes feel alike."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from activetouch.named_scenes import SCENES, NamedScene
from activetouch.orientations import Resampled, Upright
from activetouch.rendering import read_out
from activetouch.scene import Scene
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from belief.composition import Composition
from belief.table import Table, Tabular
from experiments.command_line.arguments import Count, Jobs, check_arguments
from experiments.command_line.console import plain_console
from experiments.meshes.near_twins import ALIKE, near_twins
from experiments.meshes.setting import model_of, plan_of, sensor_of
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice

_MOST_PAIRS = 12  # of shapes that feel alike, in a list
_PLAN = plan_of(check=0)  # two bodies of a list are compared, and none is a stranger


@dataclass(frozen=True)
class Explanation(Tabular):
    """Parts of a scene's model, and remarks on belief, similar shapes and times; prints as a table and sentences."""

    name: str
    items: Sequence[Item]
    remarks: Sequence[str]

    def table(self) -> Table:
        """What the scene models."""
        return Table(f"what the scene '{self.name}' models", [("number", "d"), ("part", ""), ("what", "")], self.items)

    def __str__(self) -> str:
        return "\n\n".join([self.table().markdown(), *self.remarks])


def explain(
    named: NamedScene,
    *,
    name: str = "scene",
    presses: int = 60,
    compare: bool = True,
    jobs: int = 1,
    pad: Path | None = None,
) -> Explanation:
    """List what a scene models; measure a press, and with ``compare`` find shapes that feel nearly alike.

    ``pad`` is the file that describes its pad, if there is one.
    """
    scene = named.scene
    hidden = latent(scene)
    words = f"The belief about an object holds its shape, {', '.join(hidden)}."
    remarks = [words if hidden else "The belief about an object holds its shape; each touch has its own orientation."]
    if compare:
        remarks += _alike_words(scene, name, pad, jobs)
    remarks.append(_cost_words(scene, presses))
    return Explanation(name, inventory(named), remarks)


@dataclass(frozen=True)
class Explain:
    """List what a scene models, and measure the time of a press.

    Also says what the belief about an object holds hidden (orientation and size, if touches share them), and which
    shapes feel alike to the pad.

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
    """Name the shapes that feel nearly alike; a few seconds for each shape, the first time."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that make views of shapes."""

    def run(self) -> None:
        """Measure and print."""
        check_arguments(self)
        name = self.choice.scene
        options: dict[str, Any] = {"presses": self.presses, "compare": self.alike, "jobs": self.jobs}
        found = explain(self.choice.named, name=name, pad=self.choice.pad, **options)
        console = plain_console()
        print(found.table(), end="\n\n")
        for remark in found.remarks:
            console.print(f"- {remark}")
        if self.choice.pad is not None:
            print("- activetouch compare searches with this pad, by the same options.")
        for line in self.choice.left_out:
            print(f"- {line}")


def _alike_words(scene: Scene, name: str, described: Path | None, jobs: int) -> list[str]:
    """The pairs of shapes that feel nearly alike to the sensor's reader of any object, from 26 directions."""
    if len(scene.shapes) < 2:
        return []
    if scene.families:
        return [f"Shapes are not compared: the proportions of {', '.join(scene.families)} vary."]
    if described is None:
        if not (MODELS / name / ANY_OBJECT_FILE).is_file():
            return ["Shapes are not compared: the scene has no sensor that reads any object."]
        own, parts = SCENES[name].scene, ("pad", "renderer", "hand")
        if changed := [part for part in parts if getattr(scene, part) != getattr(own, part)]:
            return [f"Shapes are not compared: the reader of {name} was trained for another {' and '.join(changed)}."]
    twins = near_twins(model_of(sensor_of(scene.solids, described or name, _PLAN, jobs)))
    found = [f"{twin}." for twin in twins[:_MOST_PAIRS]] or [
        f"No two shapes feel nearly alike: from 26 directions, a touch favours the true one {np.exp(ALIKE):.1f} times "
        f"or more against any other ({ALIKE} nats)."
    ]
    by = f"of {name}, by its reader" if described is None else f"in {described}, by the reader of any pad"
    return [f"Shapes are compared on the pad {by}; on another pad, others may feel alike.", *found]


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


class Item(NamedTuple):
    """A kind of part of a scene: its number, its name and its purpose."""

    number: int
    part: str
    why: str


def inventory(named: NamedScene) -> list[Item]:
    """The parts in the model of one press of a scene, and the hidden variables of the belief about a search."""
    scene, pad = named.scene, named.scene.pad
    spacing = 1e3 * 2 * pad.half_width / pad.num_taxels
    families = [
        "{} ({})".format(label, ", ".join("{} {:g} to {:g}".format(name, *d.support) for name, d in family.parameters))
        for label, family in scene.families.items()
    ]
    items = [
        Item(len(scene.shapes), "shapes", ", ".join(scene.shape_labels)),
        Item(len(families), "families", f"whose proportions differ by object: {', '.join(families)}"),
        Item(len(scene.poses), "poses", "sides of an object to turn to the pad"),
        Item(pad.num_taxels**2, "points of the pad", f"one height each, {spacing:.2f} mm apart"),
        *(Item(len(each.normals), "taxels", "means of parts of the pad") for each in [pad.layout] if each is not None),
        Item(len(scene.faults), "faults of the sensor", ", ".join(type(fault).__name__ for fault in scene.faults)),
    ]
    if scene.hand is not None:
        items.append(Item(len(scene.hand), "fingers", "close on the object together; one grasp counts as one touch"))
    model = scene.press_model.compiled(scene.pad, next(iter(scene.solids.values())))
    if model is not None:
        items += [
            *_surfaces(scene),
            Item(2, "moving bodies", "a guide, and on it the object"),
            Item(1, "slide joint", "of the guide, with a servo"),
            Item(model.npair, "contact pair", "pad and object; nothing else can touch"),
            Item(model.nsensor, "sensor", "force vector and contact point in every step"),
            Item(model.njnt - 1, "joints around them", "of --full or --robot, which meet nothing"),
        ]
    coupled = named.composition is Composition.DISTINCT
    number = len(scene.shapes) * (named.num_objects if coupled else 1)
    of = f"and each of {named.num_objects} objects, no two alike" if coupled else "of the current object"
    believed = Item(number, "probabilities of the belief", f"one for each shape {of}")
    return [item for item in (*items, believed) if item.number]


def latent(scene: Scene) -> list[str]:
    """What all touches of an object share besides its shape, and a joint belief can infer.

    >>> latent(Scene())
    ['orientation', 'size']
    """
    if isinstance(scene.presentation, Resampled):
        return []  # every touch has its own orientation
    low, high = scene.variation.size.support
    turned = ["heading", "tilt"] if isinstance(scene.presentation, Upright) else ["orientation"]
    kept = scene.hand is not None and scene.hand.offset == "kept"
    of_families = [f"{name} of {label}" for label, family in scene.families.items() for name, _ in family.parameters]
    return turned + (["size"] if low < high else []) + of_families + (["offset in the palm"] if kept else [])


def _surfaces(scene: Scene) -> list[Item]:
    """Hollow shapes, of which a convex hull is pressed instead of what the image shows."""
    hollow = {kind: [k for k, v in scene.solids.items() if v.geom.presses == kind] for kind in ("surface", "hull")}
    words = {
        "surface": "pressed as the convex hull of what lies in front of the pad, with the same first touch: ",
        "hull": "pressed as the convex hull, so force and image may disagree: ",
    }
    return [Item(len(found), "hollow shapes", words[kind] + ", ".join(found)) for kind, found in hollow.items()]
