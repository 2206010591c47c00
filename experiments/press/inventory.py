"""The parts that a scene models, counted in the compiled model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from activetouch.named_scenes import NamedScene
from activetouch.orientations import Resampled, Upright
from activetouch.scene import Scene
from belief.composition import Composition

if TYPE_CHECKING:
    import mujoco


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
    families = [
        "{} ({})".format(label, ", ".join("{} {:g} to {:g}".format(name, *d.support) for name, d in family.parameters))
        for label, family in scene.families.items()
    ]
    items = [
        Item(len(scene.shapes), "shapes", ", ".join(scene.shape_labels)),
        Item(len(families), "families", f"whose proportions differ by object: {', '.join(families)}"),
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
    of_families = [f"{name} of {label}" for label, family in scene.families.items() for name, _ in family.parameters]
    kept = scene.hand is not None and scene.hand.offset == "kept"
    return turned + (["size"] if low < high else []) + of_families + (["offset in the palm"] if kept else [])


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
