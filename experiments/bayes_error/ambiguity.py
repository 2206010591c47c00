"""Estimator for fine images: how many misread touches have an indistinguishable press of another shape.

The search for these is in :mod:`experiments.bayes_error.counterparts`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.scene import Scene
from belief.seeding import keyed_rng
from experiments.bayes_error.counterparts import (
    Counterpart,
    Pressing,
    Sensing,
    Start,
    Target,
    bank_slice,
    find_counterpart,
    nearest_starts,
)
from experiments.bayes_error.estimator import Findings, LimitStudy, share, words
from experiments.bayes_error.held_out import Stream, held_out_touch
from experiments.bayes_error.image_bank import ideal_symmetry
from experiments.command_line.arguments import Count
from experiments.parallel import run_tasks
from experiments.reporting.tables import Table

Floats = NDArray[np.float64]
_PRESSES_PER_SLICE = 1000
NEAR = (1.0, 2.0, 3.0)
"""Distances below which counterparts are counted; the least possible error rates are 0.31, 0.16 and 0.07."""
_NUM_DRAWN = 6


@dataclass(frozen=True)
class Wanted:
    """One search: the group it belongs to, the number and shape of the touch, and the shape of the press to find."""

    group: str
    number: int
    shape: int
    rival: int


GROUPS = {
    "misread": "misread, press of the predicted shape",
    "right": "read correctly, press of the second most likely shape",
    "control": "misread, press of the true shape (control)",
}
"""Groups of searches, and their names in tables."""


@dataclass(frozen=True)
class AmbiguitySearch:
    """Estimator that searches for presses of other shapes with the same image up to noise."""

    pairs: Count = 100
    """Number of misread touches to search for, and of correctly read ones."""
    bank: Count = 8_000
    """Presses per shape to start from, in steps of 1000."""
    starts: Count = 8
    """Starting points of each search."""

    def measure(self, study: LimitStudy) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        from experiments.bayes_error.figures import draw_counterparts  # loads matplotlib

        scene, labels = study.scene, study.scene.shape_labels
        Sensing.of(scene)  # raises before anything is pressed
        ranked = np.argsort(-study.classify(study.read()), axis=1, kind="stable")
        right = ranked[:, 0] == study.shapes
        wanted = self._choose(study, right, ranked)
        starts = self._starts(study, wanted)
        tasks = [partial(_search, scene, search, starts[search]) for search in wanted]
        found = {
            # The last bit of the heights depends on the number of threads; a thousandth is more than enough.
            search: replace(counterpart, distance=round(counterpart.distance, 3))
            for search, counterpart in run_tasks(tasks, study.jobs, "searching counterparts")
        }
        groups = {
            group: tally([found[search].distance for search in wanted if search.group == group]) for group in GROUPS
        }
        misread = [search for search in wanted if search.group == "misread"]
        confused: dict[str, list[float]] = {}
        for search in misread:
            pair = f"{labels[search.shape]} taken for {labels[search.rival]}"
            confused.setdefault(pair, []).append(found[search].distance)
        numbers: dict[str, Any] = {
            "estimator": "counterparts",
            "classifier": share(right),
            "groups": groups,
            "pairs": {pair: tally(confused[pair]) for pair in sorted(confused, key=lambda pair: -len(confused[pair]))},
            "searches": [
                {
                    "group": search.group,
                    "touch": search.number,
                    "shape": labels[search.shape],
                    "other": labels[search.rival],
                    "distance": found[search].distance,
                }
                for search in wanted
            ],
        }
        nearest: dict[tuple[int, int], Wanted] = {}  # the nearest of every pair of shapes
        for search in sorted(misread, key=lambda search: found[search].distance):
            nearest.setdefault((search.shape, search.rival), search)
        shown = [search for search in nearest.values() if found[search].distance < NEAR[-1]][:_NUM_DRAWN]
        if shown:
            pictures = [(labels[search.shape], labels[search.rival], found[search]) for search in shown]
            draw_counterparts(study.folder / "counterparts.png", pictures, Sensing.of(scene).std)
        return Findings("Ambiguous touches", _say(study, numbers), _tables(numbers), numbers)

    def _choose(self, study: LimitStudy, right: NDArray[np.bool_], ranked: NDArray[np.int64]) -> list[Wanted]:
        """Random misread touches, correctly read ones, and the control; independent of the number of workers."""
        rng = keyed_rng([study.seed, len(right)], is_fixed_length=True)
        shapes = study.shapes
        misread, others = (rng.permutation(np.flatnonzero(kind))[: self.pairs] for kind in (~right, right))
        wanted = [Wanted("misread", int(n), int(shapes[n]), int(ranked[n, 0])) for n in misread]
        wanted += [Wanted("right", int(n), int(shapes[n]), int(ranked[n, 1])) for n in others]
        return wanted + [Wanted("control", int(n), int(shapes[n]), int(shapes[n])) for n in misread]

    def _starts(self, study: LimitStudy, wanted: list[Wanted]) -> dict[Wanted, list[Start]]:
        """Starting points of each search."""
        scene, sensing, starts = study.scene, Sensing.of(study.scene), {}
        tasks = [
            partial(bank_slice, scene, rival, number, _PRESSES_PER_SLICE, study.seed)
            for rival in sorted({search.rival for search in wanted})
            for number in range(max(1, self.bank // _PRESSES_PER_SLICE))
        ]
        slices = sorted(run_tasks(tasks, study.jobs, "bank of presses"), key=lambda part: part[:2])
        for rival in sorted({search.rival for search in wanted}):
            pressings = [pressing for shape, _, some, _ in slices if shape == rival for pressing in some]
            images = np.concatenate([images for shape, _, _, images in slices if shape == rival])
            for search in (search for search in wanted if search.rival == rival):
                targets = _target(study, search.number).views(ideal_symmetry(scene))
                starts[search] = nearest_starts(targets, pressings, images, sensing, self.starts)
        return starts


def _target(study: LimitStudy, number: int) -> Target:
    """The image that counterparts of a test touch are compared with."""
    touch = held_out_touch(study.scene, study.seed, Stream.TEST, number)
    pressing = Pressing(touch.placement, touch.contact.force)
    ideal = pressing.image(study.scene)
    square = float(np.vdot(ideal, ideal))
    return Target.of(study.scene, pressing, float(np.vdot(touch.clean, ideal)) / square if square else 1.0)


def _search(scene: Scene, search: Wanted, starts: list[Start]) -> tuple[Wanted, Counterpart]:
    return search, find_counterpart(scene, starts)


def tally(distances: list[float]) -> dict[str, Any]:
    """Number of touches, shares with a counterpart within each of :data:`NEAR`, and median distance."""
    array = np.array(distances)
    near = {f"{limit:g}": share(array < limit) for limit in NEAR} if len(array) else {}
    return {"touches": len(array), "near": near, "median": float(np.median(array)) if len(array) else None}


def _say(study: LimitStudy, numbers: dict[str, Any]) -> list[str]:
    groups = numbers["groups"]
    lines = [
        "Why this estimator: the images are too fine for a bank of ideal images. A press of another shape with the "
        "same image up to noise (a counterpart) proves that a touch is ambiguous.",
        f"{study.touches} held-out touches, each of another object, seed {study.seed}; the classifier reads "
        f"{words(numbers['classifier'])} of them correctly.",
    ]
    if groups["misread"]["touches"]:
        near = {group: words(entry["near"]["2"]) if entry["touches"] else "none" for group, entry in groups.items()}
        lines.append(
            f"Of {groups['misread']['touches']} misread touches {near['misread']} have a counterpart of the predicted "
            "shape at a distance below 2, where even a reader that knows both presses errs at least 16 % of the time; "
            f"of {groups['right']['touches']} correctly read touches {near['right']} have one of the second most "
            f"likely shape. The same search finds a press of the true shape in {near['control']} of cases, where one "
            "always exists, so the shares are lower bounds."
        )
    else:
        lines.append("It misread none, so there is nothing to search for; use more touches.")
    lines.append(
        "A counterpart shows that such a press exists within the scene's ranges, not how often it occurs, so the "
        "shares are not error rates."
    )
    return lines


def _tables(numbers: dict[str, Any]) -> list[Table]:
    headings = ("", "touches", *(f"d < {limit:g}" for limit in NEAR), "median d")
    groups = [_row(GROUPS[group], entry) for group, entry in numbers["groups"].items() if entry["touches"]]
    pairs = [_row(pair, entry) for pair, entry in numbers["pairs"].items()]
    return [
        Table("Share of touches with a counterpart within a distance d", headings, groups),
        Table("Misread touches, by pair of shapes", headings, pairs),
    ]


def _row(name: str, entry: dict[str, Any]) -> tuple[str, ...]:
    near = (f"{value['value']:.0%}" for value in entry["near"].values())
    return (name, str(entry["touches"]), *near, f"{entry['median']:.2f}")
