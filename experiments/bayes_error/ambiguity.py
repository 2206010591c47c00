"""Ambiguity of fine images: twins of the touches a classifier misread (:mod:`experiments.bayes_error.counterparts`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.scene import Scene
from belief.seeding import keyed_rng
from experiments.bayes_error.counterparts import (
    Pressing,
    Sensing,
    Start,
    Target,
    Twin,
    bank_slice,
    find_twin,
    nearest_starts,
)
from experiments.bayes_error.estimator import Findings, Grid, Study, share, words
from experiments.bayes_error.held_out import Stream, fresh_touch
from experiments.bayes_error.image_bank import ideal_symmetry
from experiments.command_line.arguments import Count
from experiments.parallel import run_tasks

Floats = NDArray[np.float64]
_PRESSES_PER_SLICE = 1000
NEAR = (1.0, 2.0, 3.0)
"""Distances up to which twins are counted; the least errors between two are .31, .16 and .07."""
_NUM_DRAWN = 6


@dataclass(frozen=True)
class Wanted:
    """A search: which touch, and among the presses of which shape; ``group`` says why."""

    group: str
    number: int
    shape: int
    rival: int


GROUPS = {
    "misread": "misread, twin of the shape it was taken for",
    "right": "read right, twin of the runner-up",
    "control": "misread, press of its own shape (control)",
}
"""What is searched, and how tables say it."""


@dataclass(frozen=True)
class TwinSearch:
    """Search for presses of other shapes whose images noise hides from those of touches."""

    pairs: Count = 100
    """Misread touches to search, and as many read right."""
    bank: Count = 8_000
    """Presses a shape to start from, in thousands."""
    starts: Count = 8
    """Searches for each twin."""

    def measure(self, study: Study) -> Findings:
        """See :class:`experiments.bayes_error.estimator.Estimator`."""
        from experiments.bayes_error.figures import draw_twins  # loads matplotlib

        scene, labels = study.scene, study.scene.shape_labels
        Sensing.of(scene)  # or say what it lacks, before anything is pressed
        ranked = np.argsort(-study.classify(study.read()), axis=1, kind="stable")
        right = ranked[:, 0] == study.shapes
        wanted = self._choose(study, right, ranked)
        starts = self._starts(study, wanted)
        tasks = [partial(_search, scene, search, starts[search]) for search in wanted]
        found = {
            # Heights follow the number of the library's threads in their last bit; a thousandth is more than enough.
            search: replace(twin, distance=round(twin.distance, 3))
            for search, twin in run_tasks(tasks, study.jobs, "searching twins")
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
            "estimator": "twins",
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
        nearest: dict[tuple[int, int], Wanted] = {}  # one of every pair, to show different things
        for search in sorted(misread, key=lambda search: found[search].distance):
            nearest.setdefault((search.shape, search.rival), search)
        shown = [search for search in nearest.values() if found[search].distance < NEAR[-1]][:_NUM_DRAWN]
        if shown:
            pictures = [(labels[search.shape], labels[search.rival], found[search]) for search in shown]
            draw_twins(study.folder / "twins.png", pictures, Sensing.of(scene).std)
        return Findings("Ambiguous touches, by their twins", _say(study, numbers), _grids(numbers), numbers)

    def _choose(self, study: Study, right: NDArray[np.bool_], ranked: NDArray[np.int64]) -> list[Wanted]:
        """Misread touches, as many others, and the control: at random, but the same whatever the number of workers."""
        rng = keyed_rng([study.seed, len(right)], is_fixed_length=True)
        shapes = study.shapes
        misread, others = (rng.permutation(np.flatnonzero(kind))[: self.pairs] for kind in (~right, right))
        wanted = [Wanted("misread", int(n), int(shapes[n]), int(ranked[n, 0])) for n in misread]
        wanted += [Wanted("right", int(n), int(shapes[n]), int(ranked[n, 1])) for n in others]
        return wanted + [Wanted("control", int(n), int(shapes[n]), int(shapes[n])) for n in misread]

    def _starts(self, study: Study, wanted: list[Wanted]) -> dict[Wanted, list[Start]]:
        """Where each search begins."""
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


def _target(study: Study, number: int) -> Target:
    """What twins of the test touch of that number are looked for."""
    touch = fresh_touch(study.scene, study.seed, Stream.TEST, number)
    pressing = Pressing(touch.placement, touch.contact.force)
    ideal = pressing.image(study.scene)
    square = float(np.vdot(ideal, ideal))
    return Target.of(study.scene, pressing, float(np.vdot(touch.clean, ideal)) / square if square else 1.0)


def _search(scene: Scene, search: Wanted, starts: list[Start]) -> tuple[Wanted, Twin]:
    return search, find_twin(scene, starts)


def tally(distances: list[float]) -> dict[str, Any]:
    """How near twins are: number of touches, shares within :data:`NEAR`, median."""
    array = np.array(distances)
    near = {f"{limit:g}": share(array < limit) for limit in NEAR} if len(array) else {}
    return {"touches": len(array), "near": near, "median": float(np.median(array)) if len(array) else None}


def _say(study: Study, numbers: dict[str, Any]) -> list[str]:
    groups = numbers["groups"]
    lines = [
        "Why this estimator: the images are too fine for a bank to hold one like each, but a press of another shape "
        "with the same image up to noise can be constructed, and proves that the touch is ambiguous.",
        f"{study.touches} fresh touches, each of another object, seed {study.seed}; the classifier reads "
        f"{words(numbers['classifier'])} of them right.",
    ]
    if groups["misread"]["touches"]:
        near = {group: words(entry["near"]["2"]) if entry["touches"] else "none" for group, entry in groups.items()}
        lines.append(
            f"Of {groups['misread']['touches']} misread touches {near['misread']} have a twin of "
            "the shape they were taken for at a distance below 2, where even a reader that knows both presses, and is "
            "told that it was one of them, errs at least 16 % of the time; of "
            f"{groups['right']['touches']} touches read right "
            f"{near['right']} have one of the runner-up. The same search finds a press of the "
            f"touch's own shape in {near['control']} of cases, where one always exists: so the "
            "shares are lower bounds."
        )
    else:
        lines.append("It misread none, so there is nothing to search; more touches would bring some.")
    lines.append(
        "A twin says that such a press exists within the scene's ranges, not how often it occurs: the shares are no "
        "error rates."
    )
    return lines


def _grids(numbers: dict[str, Any]) -> list[Grid]:
    headings = ("", "touches", *(f"d < {limit:g}" for limit in NEAR), "median d")
    groups = [_row(GROUPS[group], entry) for group, entry in numbers["groups"].items() if entry["touches"]]
    pairs = [_row(pair, entry) for pair, entry in numbers["pairs"].items()]
    return [
        Grid("Touches with a twin within a distance d", headings, groups),
        Grid("Misread touches, by pair", headings, pairs),
    ]


def _row(name: str, entry: dict[str, Any]) -> tuple[str, ...]:
    near = (f"{value['value']:.0%}" for value in entry["near"].values())
    return (name, str(entry["touches"]), *near, f"{entry['median']:.2f}")
