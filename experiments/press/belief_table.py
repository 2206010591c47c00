"""What a belief about one object holds hidden in a scene, and what that costs, with the joint model and without."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from activetouch.errors import NoIndependentModel
from activetouch.orientations import Resampled, Upright
from activetouch.scene import Scene
from activetouch.sensor import TactileSensor
from belief.observation_model.rigid_body import RigidBodyModel
from experiments.reporting.tables import Table, Value
from experiments.sensor.belief_cost import belief_cost


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
    return turned + (["size"] if low < high else []) + of_families


def belief_table(name: str, scene: Scene, folder: Path | None) -> Table:
    """The belief about one object of a scene: jointly about the body, and with touches taken as independent.

    Args:
        name: of the scene.
        scene: the scene.
        folder: of its sensor, which is measured if it has a joint model; None for none.
    """
    hidden, rows = latent(scene), list[tuple[Value, ...]]()
    words = f"shape, {', '.join(hidden)}" if hidden else "shape; each touch has its own orientation"
    joint, independent = "joint: one rigid body", "independent: touches given the shape"
    sensor = None if folder is None else TactileSensor.load(folder, scene, anyway=True)
    if folder is not None and sensor is not None and isinstance(sensor.model, RigidBodyModel):
        width = sensor.reader.card.embedding
        cost = belief_cost(sensor.model, width)
        rows.append((joint, words, sensor.model.num_hypotheses, cost.memory, cost.update))
        with suppress(NoIndependentModel):
            cost = belief_cost(TactileSensor.load(folder, scene, anyway=True, independent=True).model, width)
            rows.append((independent, "shape", None, cost.memory, cost.update))
    else:
        rows = [(joint, words, None, None, None), (independent, "shape", None, None, None)]
    return Table(
        f"the belief about one object of the scene '{name}'",
        ["observation model", ("hidden", ""), ("hypotheses a shape", "d"), ("MB", ".1f"), ("ms/update", ".2f")],
        rows,
        "The cost of an update does not depend on the number of earlier touches. "
        + ("" if hidden else "Nothing is shared by the touches of an object, so the independent model is exact here. ")
        + ("A sensor that learned the nominal solids does not infer the proportions. " if scene.families else "")
        + ("" if rows[0][2] is not None else "No shipped sensor with a joint model was fitted to these objects."),
    )
