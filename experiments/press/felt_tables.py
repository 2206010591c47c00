"""Tables of ``activetouch explain`` about what can be felt: bottoming out, shapes that feel alike, and reach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import surface_gap
from activetouch.scene import Scene
from experiments.press.alike import SHOWN, Alike
from experiments.reporting.tables import Table, Value

_PRESSES = 50  # of each shape
_FEW = 0.05  # share of presses that may bottom out
_MOST_PAIRS = 12
_WIDE = 0.95  # share of the surface below which an aim is offered


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


def depth_table(name: str, scene: Scene) -> Table:
    """The share of presses of each shape in which the layer bottoms out, and the forces that avoid it."""
    rng, rows, ratios = np.random.default_rng(0), list[tuple[Value, ...]](), []
    for label in scene.shape_labels:
        carried = bearing_forces(scene, label, _PRESSES, rng)
        given = np.array([scene.variation.force.sample(rng) for _ in carried])
        rows.append((label, float((carried <= given).mean()) if len(given) else None))
        ratios.append(carried / given)
    low, high = scene.variation.force.support
    factor = float(np.quantile(np.concatenate(ratios), _FEW)) if any(map(len, ratios)) else 1.0
    say = (
        "Forces as they are."
        if factor >= 1.0
        else (
            f"At most {_FEW:.0%} do with forces of {low * factor:.2g} to {high * factor:.2g} N; in Python: "
            "dataclasses.replace(scene, variation=dataclasses.replace(scene.variation, "
            f"force=Uniform({low * factor:.2g}, {high * factor:.2g})))."
        )
    )
    return Table(
        f"presses of the scene '{name}' in which the pad's layer bottoms out, at {low:g} to {high:g} N",
        ["shape", ("share", ".0%")],
        rows,
        f"{_PRESSES} quasistatic presses of each shape. A layer that bottoms out carries less than the force, and "
        f"its image does not tell the force. {say}",
    )


def alike_table(name: str, found: Alike) -> Table:
    """The pairs of shapes that feel most alike."""
    touches = found.num_touches
    pairs = [pair for pair in found.pairs if max(pair.one_compared, pair.all_compared) > SHOWN][:_MOST_PAIRS]
    rows = [
        (
            *(*pair.shapes, pair.one, pair.one_interval, pair.one_compared),
            *(pair.all, pair.all_interval, pair.all_compared, pair.shown, pair.shown_from_26),
        )
        for pair in pairs
    ]
    same = [" and ".join(pair.shapes) for pair in found.pairs if pair.all_interval[1] >= 0.5 - SHOWN]
    told = f"The other {len(found.pairs) - len(pairs)} pairs are confused in less than {SHOWN:.0%}. "
    return Table(
        f"which shapes of the scene '{name}' feel alike: error of telling two apart (0.5 is chance)",
        [
            *("shape", ("other shape", ""), ("one touch", ".2f"), ("95 %", ".2f"), ("by comparing", ".2f")),
            *((f"{touches} touches", ".2f"), ("95 % ", ".2f"), ("by comparing ", ".2f")),
            *(("objects that show it", ".0%"), ("from 26 directions", ".0%")),
        ],
        rows,
        f"Estimates by simulated contacts, no bounds: for a reader that is told where to look, and for one that compares "
        f"images with those of 4 000 orientations. {told if len(pairs) < len(found.pairs) else ''}"
        f"Hardly told apart: {', '.join(same) or 'none'}"
        + ("; try --poses directions26, or aim beside the axis (activetouch.poses.aimed)." if same else "."),
    )


def reach_table(scene: Scene, found: Alike) -> Table:
    """What touches reach of each shape."""
    rows = [(label, *found.reach[label]) for label in scene.shape_labels]
    partly = [label for label, (ever, _) in found.reach.items() if ever < _WIDE]
    return Table(
        "where touches land, as shares of the surface that is seen from outside",
        ["shape", ("some touch of some object", ".0%"), (f"{found.num_touches} touches of one object", ".0%")],
        rows,
        f"Parts of {', '.join(partly)} are never met on the approach axis; activetouch.poses.aimed presses beside it."
        if partly
        else "Objects lie in any orientation.",
    )
