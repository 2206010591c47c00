"""``activetouch explain``: what a scene models, and which of its shapes feel alike."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.errors import LabelMismatch, WrongScene
from activetouch.hand import Hand
from activetouch.named_scenes import NamedScene
from activetouch.orientations import Resampled, Upright
from activetouch.pressing.contact import surface_gap
from activetouch.rendering import read_out
from activetouch.scene import Scene
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS, READER_FILE, reader_file, sensor_shift
from belief.composition import Composition
from belief.observation_model.rigid_body import joint_model
from belief.table import Table
from experiments.command_line.arguments import Count, Jobs, check_arguments
from experiments.command_line.console import plain_console
from experiments.meshes.near_twins import ALIKE, near_twins
from experiments.meshes.setting import MeshSetting
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import sensor_folder

if TYPE_CHECKING:
    import mujoco

_PRESSES = 50  # of each shape, to see where the layer bottoms out
_FEW = 0.05  # share of presses that may bottom out
_MOST_PAIRS = 12  # of shapes that feel alike, in a list


@dataclass(frozen=True)
class Explanation:
    """What a scene models; it prints as a table and sentences.

    Attributes:
        name: of the scene.
        items: the parts of the model.
        remarks: sentences about the belief, shapes that feel alike, the time of a press, and presses that show less
            than they could.
    """

    name: str
    items: Sequence[Item]
    remarks: Sequence[str]

    def table(self) -> Table:
        """What the scene models."""
        rows = [(item.number, item.part, item.why) for item in self.items]
        return Table(f"what the scene '{self.name}' models", [("number", "d"), ("part", ""), ("what", "")], rows)

    def __str__(self) -> str:
        return "\n\n".join([self.table().markdown(), *self.remarks])


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
        compare: whether to look for shapes that feel nearly alike.
        jobs: number of processes that make views of shapes.
        sensor: folder of a sensor, whose belief is described if it fits the scene; None for none.
    """
    scene = named.scene
    remarks = [_belief_words(scene, sensor if sensor is not None and _fits(sensor, scene) else None)]
    if compare:
        remarks += _alike_words(scene, name, jobs)
    remarks.append(_cost_words(scene, presses))
    if scene.hand is not None and len(scene.hand) > 1:
        remarks.append(_grasp_words(scene.hand))
    return Explanation(name, inventory(named), remarks + _bottoming_words(scene, np.random.default_rng(0)))


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
    """Name the shapes that feel nearly alike; a few seconds for each shape, the first time."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that make views of shapes."""

    def run(self) -> None:
        """Measure and print; the belief only if a sensor of the package fits the scene."""
        check_arguments(self)
        folder, name = sensor_folder(None, self.choice.scene), self.choice.scene
        shipped = folder if folder.exists() else None
        found = explain(
            self.choice.named, name=name, presses=self.presses, compare=self.alike, jobs=self.jobs, sensor=shipped
        )
        console = plain_console()
        print(found.table(), end="\n\n")
        for remark in found.remarks:
            console.print(f"- {remark}")


def _alike_words(scene: Scene, name: str, jobs: int) -> list[str]:
    """The pairs of shapes that feel nearly alike to the sensor's reader of any object, from 26 directions."""
    if len(scene.shapes) < 2:
        return []
    if not (MODELS / name / ANY_OBJECT_FILE).is_file():
        return ["Shapes are not compared: the scene has no sensor that reads any object."]
    twins = near_twins(MeshSetting.of(scene.solids, sensor=name, jobs=jobs))
    return [f"{twin}." for twin in twins[:_MOST_PAIRS]] or [
        f"No two shapes feel nearly alike: from 26 directions, a touch tells {ALIKE} nats or more against any other."
    ]


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


def _grasp_words(hand: Hand) -> str:
    """What the fingers of a hand share, and what of it the belief holds."""
    belief = "takes both as each finger's own" if hand.offset == "averaged" else "sums over the offset"
    return (
        f"A grasp gives {len(hand)} images at the cost of one touch. Its fingers share the force and the object's "
        f"offset in the palm, drawn anew at each grasp; the belief {belief}. A finger that misses gives an image of no "
        "contact, which is read as any other."
    )


def _fits(sensor: Path, scene: Scene) -> bool:
    """Whether the sensor in a folder was fitted to a scene, or to one that differs by a known shift."""
    try:
        if reader_file(sensor, scene).name != READER_FILE:
            return False
        sensor_shift(sensor, scene)
    except (LabelMismatch, WrongScene):
        return False
    return True


@dataclass(frozen=True)
class Item:
    """A kind of part of a scene: its number, its name and its purpose."""

    number: int
    part: str
    why: str


def inventory(named: NamedScene) -> list[Item]:
    """The parts in the model of one press of a scene, and the hidden variables of the belief about a search."""
    scene, pad = named.scene, named.scene.pad
    spacing = 1e3 * 2 * pad.half_width / pad.num_taxels
    items = [
        Item(len(scene.shapes), "shapes", ", ".join(scene.shape_labels)),
        Item(len(scene.poses), "poses", "sides of an object to turn to the pad"),
        Item(pad.num_taxels**2, "points of the pad", f"one ray each, {spacing:.2f} mm apart"),
        Item(len(scene.faults), "faults of the sensor", ", ".join(type(fault).__name__ for fault in scene.faults)),
    ]
    if scene.hand is not None:
        items.append(Item(len(scene.hand), "fingers", "close on the object together; one grasp counts as one touch"))
    model = scene.press_model.compiled(scene.setup, next(iter(scene.solids.values())))
    if model is not None:
        items += [*_surfaces(scene), *_rigid_bodies(model)]
    coupled = named.composition is Composition.DISTINCT
    number = len(scene.shapes) * (named.num_objects if coupled else 1)
    of = f"of {named.num_objects} objects, no two alike" if coupled else "of the current object; others are independent"
    return [item for item in (*items, Item(number, "hidden probabilities", f"shape {of}")) if item.number]


def latent(scene: Scene) -> list[str]:
    """What all touches of an object share besides its shape, and a joint belief can infer.

    >>> latent(Scene())
    ['orientation', 'size']
    """
    if isinstance(scene.presentation, Resampled):
        return []  # every touch has its own orientation
    low, high = scene.variation.size.support
    turned = ["heading", "tilt"] if isinstance(scene.presentation, Upright) else ["orientation"]
    return turned + (["size"] if low < high else [])


def _surfaces(scene: Scene) -> list[Item]:
    """Shapes of which something simpler is pressed than the image shows."""
    hollow = {kind: [k for k, v in scene.solids.items() if v.geom.presses == kind] for kind in ("surface", "hull")}
    words = {
        "surface": "pressed as the convex hull of what lies in front of the pad, with the same first touch: ",
        "hull": "pressed as the convex hull, so force and image may disagree: ",
    }
    return [Item(len(found), "hollow shapes", words[kind] + ", ".join(found)) for kind, found in hollow.items()]


def _rigid_bodies(model: mujoco.MjModel) -> list[Item]:
    names = [model.geom(index).name for index in range(model.ngeom)]
    return [
        Item(2, "moving bodies", "a guide, and on it the object"),
        Item(1, "slide joint", "of the guide, with a servo"),
        Item(model.npair, "contact pair", "pad and object; nothing else can touch"),
        Item(model.nsensor, "sensor", "force vector and contact point in every step"),
        Item(sum(name.startswith("finger") for name in names), "finger segments", "carry the pad, as in the paper"),
        Item(sum(name.startswith("parked") for name in names), "parked objects", "fixed to the world, no contact"),
    ]
