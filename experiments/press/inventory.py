"""The parts that a scene models, counted in the compiled model, and their purpose."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.press import Quasistatic
from activetouch.scene import Scene
from activetouch.shapes import Family

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class InventoryItem:
    """A kind of part of a scene: its number, its name and its purpose."""

    number: int
    part: str
    why: str


def inventory(scene: Scene) -> list[InventoryItem]:
    """The parts in the model of one press of the scene."""
    pad, faults = scene.pad, [type(fault).__name__ for fault in scene.faults]
    spacing = 1e3 * 2 * pad.half_width / pad.num_taxels
    entries = [
        InventoryItem(len(scene.shapes), "shapes", "what an object can be: " + ", ".join(scene.shape_labels)),
        InventoryItem(len(scene.poses), "poses", "sides of an object that can be turned to the pad"),
        InventoryItem(pad.num_taxels**2, "points of the pad", f"one ray each, {spacing:.2f} mm apart"),
        InventoryItem(len(scene.faults), "faults", "of the sensor: " + ", ".join(faults)),
    ]
    if families := scene.families:
        why = "shapes whose proportions differ from object to object: "
        entries.append(
            InventoryItem(
                len(families), "families", why + ", ".join(map(_ranges, *zip(*families.items(), strict=True)))
            )
        )
    entries.append(InventoryItem(len(scene.shapes), "surfaces", _surfaces(scene)))
    model = scene.press_model.compiled(scene.setup, next(iter(scene.solids.values())))
    if model is not None:
        entries += _rigid_bodies(model)
    return [entry for entry in entries if entry.number]


def _ranges(label: str, family: Family) -> str:
    """A family and the ranges of its parameters."""
    ranges = ("{} {:g} to {:g}".format(name, *given.support) for name, given in family.parameters)
    return f"{label} ({', '.join(ranges)})"


def _surfaces(scene: Scene) -> str:
    """Which surface is shown, and which is pressed."""
    shown = "the image shows the true surface"
    if not scene.press_model.moves:
        return f"{shown}, and it is what is pressed"
    hollow = {kind: [k for k, v in scene.solids.items() if v.geom.presses == kind] for kind in ("surface", "hull")}
    what = "the convex hull of what lies in front of the pad, which has the same first touch"
    parts = [f"of {', '.join(hollow['surface'])}, {what}"] if hollow["surface"] else []
    parts += [f"of {', '.join(hollow['hull'])}, the convex hull, so force and image may disagree"] * bool(
        hollow["hull"]
    )
    return f"{shown}, and it is what is pressed" + "".join(f"; {part}" for part in parts)


def _rigid_bodies(model: mujoco.MjModel) -> list[InventoryItem]:
    names = [model.geom(index).name for index in range(model.ngeom)]
    return [
        InventoryItem(
            2, "moving bodies", "the guide, and on it the object, so that turning it does not turn the guide"
        ),
        InventoryItem(1, "slide joint", "the guide's, along x"),
        InventoryItem(1, "actuator", "the servo that moves the guide"),
        InventoryItem(model.npair, "contact pair", "pad and pressed object; nothing else can touch"),
        InventoryItem(model.nsensor, "sensor", "force vector and contact point in every step"),
        InventoryItem(
            sum(name.startswith("finger") for name in names), "finger segments", "carry the pad, as in the paper"
        ),
        InventoryItem(
            sum(name.startswith("parked") for name in names), "parked objects", "fixed to the world, no contact"
        ),
    ]


def leaner(scene: Scene) -> tuple[str, Scene] | None:
    """The next simpler scene, and the difference; None for the simplest."""
    press = scene.press_model
    if scene.parking or scene.finger:
        return "without finger and parked objects", replace(scene, parking=False, finger=False)
    if press.traced:
        return "force control, no trace", replace(scene, press_model=Dynamic())
    return ("no time stepping", replace(scene, press_model=Quasistatic())) if press.moves else None


def richer(scene: Scene) -> tuple[str, Scene] | None:
    """The next richer scene, and the difference; None for the richest."""
    press = scene.press_model
    if not press.moves:
        return "stepped motion", replace(scene, press_model=Dynamic())
    if not press.traced:
        return "a trace of force and contact point", replace(scene, press_model=press.with_trace())
    if not scene.finger or not (scene.parking or scene.families):
        parks = not scene.families
        change = "the finger, and all objects loaded" if parks else "the finger"
        return change, replace(scene, parking=parks, finger=True)
    return None
