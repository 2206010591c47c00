"""Tables of ``activetouch explain`` about what can be felt of shapes, and which of them feel alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import surface_gap
from activetouch.scene import Scene
from experiments.press.alike import SHOWN, Alike, Likeness
from experiments.reporting.tables import Table, Value

_PRESSES = 50  # of each shape
_FEW = 0.05  # share of presses that may bottom out
_FEWEST_PAIRS, _MOST_PAIRS = 3, 12
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


def felt_table(name: str, scene: Scene, likeness: Alike | None) -> Table:
    """Where touches of each shape land, if known, and how often the layer bottoms out; what would change both."""
    rng, rows, ratios = np.random.default_rng(0), list[tuple[Value, ...]](), []
    reach = likeness.reach if likeness else {}
    for label in scene.shape_labels:
        carried = bearing_forces(scene, label, _PRESSES, rng)
        given = np.array([scene.variation.force.sample(rng) for _ in carried])
        rows.append((label, float((carried <= given).mean()) if len(given) else None, *reach.get(label, (None, None))))
        ratios.extend(carried[given > 0.0] / given[given > 0.0])
    low, high = scene.variation.force.support
    notes = ["A layer that bottoms out carries less than the force."]
    if ratios and (factor := float(np.quantile(ratios, _FEW))) < 1.0:
        least, most = f"{low * factor:.2g}", f"{high * factor:.2g}"
        notes.append(
            f"It does in {_FEW:.0%} of the presses at {least} to {most} N; in Python: replace(scene, "
            f"variation=replace(scene.variation, force=Uniform({least}, {most})))."
        )
    if partly := [label for label, (ever, _) in reach.items() if ever < _WIDE]:
        notes.append(f"To meet all of {', '.join(partly)}, aim beside the axis (activetouch.poses.aimed).")
    return Table(
        f"what touches of the scene '{name}' meet",
        [
            *("shape", (f"layer bottoms out at {low:g} to {high:g} N", ".0%")),
            *(("surface that some touch meets", ".0%"), ("surface that all touches of an object meet", ".0%")),
        ],
        rows,
        f"{_PRESSES} quasistatic presses of each shape; surface as a share of what is seen from outside. "
        + " ".join(notes),
    )


def alike_table(name: str, found: Alike) -> Table:
    """The pairs of shapes that feel most alike: all that are confused at times, and three at least."""
    confused = {pair: max(pair.one_compared, pair.all_compared) > SHOWN for pair in found.pairs}
    pairs = sorted(found.pairs, key=lambda pair: not confused[pair])
    pairs = pairs[: min(max(sum(confused.values()), _FEWEST_PAIRS), _MOST_PAIRS)]
    rows = [
        (
            *pair.shapes,
            (pair.one_interval[0], max(pair.one_interval[1], pair.one_compared)),
            (pair.all_interval[0], max(pair.all_interval[1], pair.all_compared)),
            pair.shown,
            pair.shown_from_26,
        )
        for pair in pairs
    ]
    hard = [pair for pair in found.pairs if pair.all_interval[1] >= 0.5 - SHOWN]
    same, hard = ([pair for pair in hard if (pair.all_interval[0] == 0.5) == is_same] for is_same in (True, False))
    return Table(
        f"which shapes of the scene '{name}' feel most alike: error of telling two apart (0.5 is chance)",
        [
            *("shape", ("other shape", ""), ("one touch", ".2f"), (f"{found.num_touches} touches", ".2f")),
            *(("objects that show it", ".0%"), ("from 26 directions", ".0%")),
        ],
        rows,
        "Estimates by simulated contacts, no bounds: from that of a reader told where to look, at the lower end of its "
        "95 % interval, to that of one that compares images with those of 4 000 orientations, or the upper end. "
        + (f"The same body: {_names(same)}. " if same else "")
        + f"Hardly told apart: {_names(hard) or 'none'}"
        + ("; try --poses directions26, or aim beside the axis (activetouch.poses.aimed)." if hard else "."),
    )


def _names(pairs: list[Likeness]) -> str:
    return ", ".join(" and ".join(pair.shapes) for pair in pairs)
