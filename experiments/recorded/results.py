"""What ``recorded`` measured, and its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from belief.metrics import expected_calibration_error, negative_log_likelihood
from belief.observation_model.action_kernel import Law
from belief.problem import Floats
from belief.statistics import cluster_bootstrap
from experiments.recorded.finding import ORACLE, Found
from experiments.recorded.fold import LAWS, Fold
from experiments.recorded.identifying import FIXED, GAIN, NUMBERS, RANDOM, AfterTouches, Named
from experiments.recorded.leaks import Control, control_table
from experiments.reporting.tables import Table, Value, interval
from experiments.sensor.scores import accuracy_of_objects
from planners.identification import Identification

LAW_NAMES: Mapping[Law, str] = {
    "none": "none",
    "repeats": "one ρ per action",
    "flat": "one ρ for all pairs",
    "kernel": "kernel by likeness",
}
"""The laws of correlation in words."""
SHOWN: Sequence[Law] = ("none", "kernel")
"""Laws of the tables and figures with many rows."""
STATED = (0.95, 0.98, 0.995)
"""Edges of the bins of stated probabilities, above the threshold."""
_STOPS = np.linspace(1.0, 0.0, 201)  # probabilities at which an identification might have stopped
_RESAMPLES = 4000
_ROUNDING = 1e-12  # of a share


@dataclass(frozen=True, eq=False)
class Part:
    """The results on one way to split.

    Attributes:
        name: of the split.
        folds: the splits.
        named: identifications.
        after: beliefs after numbers of touches.
        losses: for each fold, by law: mean loss of each sequence, and its object.
        fewest: for each fold, lower bounds on touches of its objects.
        found: searches.
        oracle: for each search the scene, and whether the oracle is right.
    """

    name: str
    folds: Sequence[Fold]
    named: Sequence[Named]
    after: Sequence[AfterTouches]
    losses: Sequence[Mapping[Law, tuple[Floats, np.ndarray]]]
    fewest: Sequence[Floats]
    found: Sequence[Found]
    oracle: Sequence[tuple[int, bool]]


@dataclass(frozen=True, eq=False)
class Measured:
    """All results.

    Attributes:
        main: on the main split.
        others: on other splits, as controls.
        controls: of leaks.
    """

    main: Part
    others: Sequence[Part]
    controls: Sequence[Control]

    def tables(self, threshold: float) -> list[Table]:
        """All tables, in the order of the report."""
        parts = [self.main, *self.others]
        tables = [
            identification_table(parts, threshold),
            law_table(self.main, threshold),
            stop_table(self.main, threshold),
            after_table(self.main),
        ]
        if self.main.found:
            tables.append(search_table(self.main))
        return [*tables, control_table(self.controls, len(self.main.folds[0].bank.label_names))]


def by_thing(chosen: Sequence[Named], value: Callable[[Identification], float]) -> tuple[Floats, np.ndarray]:
    """Mean of a value over the identifications of each object, and the objects, so that every object counts equally."""
    things = np.array([one.thing for one in chosen])
    values = np.array([value(one.result) for one in chosen], np.float64)
    known = np.unique(things)
    return np.array([values[things == thing].mean() for thing in known]), known


def touches_of(named: Sequence[Named], decider: str, law: Law) -> tuple[Floats, np.ndarray]:
    """Mean number of touches of each object, and the objects."""
    return by_thing([one for one in named if (one.decider, one.law) == (decider, law)], lambda one: len(one.poses))


def saving(named: Sequence[Named], decider: str, reference: str, law: Law = "kernel") -> tuple[float, float, float]:
    """Fraction of the reference's touches that a decider saves without being less accurate; an interval over objects.

    A reference that is more often right is stopped at the first lower probability at which it is as often right.
    """
    curves = [_stopped_earlier(named, one, law) for one in (decider, reference)]
    size = curves[0].shape[-1]
    drawn = np.random.default_rng(0).integers(size, size=(_RESAMPLES, size))
    weights = np.stack([np.bincount(row, minlength=size) for row in drawn]) / size
    saved = _saved(*(curve @ np.vstack([np.full(size, 1.0 / size), weights]).T for curve in curves))
    low, high = np.quantile(saved[1:], [0.025, 0.975])
    return float(saved[0]), float(low), float(high)


def _stopped_earlier(named: Sequence[Named], decider: str, law: Law) -> Floats:
    """Mean touches and accuracy of each object, had its identifications stopped at each probability, ``(2, G, N)``."""
    chosen = [one for one in named if (one.decider, one.law) == (decider, law)]
    things = np.array([one.thing for one in chosen])
    found = np.empty((len(chosen), 2, len(_STOPS)))
    for row, one in zip(found, chosen, strict=True):
        labels, stated = np.array(one.result.leading).T
        reached = np.maximum.accumulate(stated)[:-1, None] < _STOPS  # at the last touch every decider stops
        row[0] = reached.sum(axis=0)
        row[1] = labels[reached.sum(axis=0)] == one.result.truth
    return np.stack([found[things == thing].mean(axis=0) for thing in np.unique(things)], axis=2)


def _saved(mine: Floats, others: Floats) -> Floats:
    """Saved fraction of touches, ``(B,)``, by touches and accuracy at falling probabilities to stop, ``(2, G, B)``."""
    number, right = others[0], np.minimum.accumulate(others[1], axis=0)
    target = np.minimum(mine[1, 0], right[0])
    equal, replicas = np.argmax(right <= target + _ROUNDING, axis=0), np.arange(len(target))
    before = np.maximum(equal - 1, 0)
    high, low = right[before, replicas], right[equal, replicas]
    share = np.clip((high - target) / np.maximum(high - low, _ROUNDING), 0.0, 1.0)  # of the way down to the target
    needed = (1.0 - share) * number[before, replicas] + share * number[equal, replicas]
    return np.asarray(1.0 - mine[0, 0] / np.maximum(needed, _ROUNDING))


def identification_table(parts: Sequence[Part], threshold: float) -> Table:
    """Touches until an object is named, by decider and split."""
    rows: list[Sequence[Value]] = []
    for part in parts:
        for decider in (RANDOM, FIXED, GAIN):
            chosen = [one for one in part.named if one.decider == decider and one.law == "kernel"]
            if not chosen:
                continue
            touches = cluster_bootstrap(*touches_of(part.named, decider, "kernel"), np.random.default_rng(0))
            right = accuracy_of_objects(*by_thing(chosen, lambda one: one.is_right), np.random.default_rng(0))
            certain = float(by_thing(chosen, lambda one: one.is_certain)[0].mean())
            fewer = [
                "–" if decider == other else interval(*saving(part.named, decider, other), spec=".1%")
                for other in (RANDOM, FIXED)
            ]
            rows.append((part.name, decider, interval(*touches, spec=".2f"), *fewer, interval(*right), certain))
        fewest = np.concatenate(list(part.fewest)) if part.fewest else np.empty(0)
        if fewest.size:
            rows.append((part.name, "bound: outcomes known in advance", f"{fewest.mean():.2f}", "–", "–", "–", None))
        labels = len(part.folds[0].bank.label_names)
        rows.append((part.name, "no touch: a guess", "0", "–", "–", f"{1 / labels:.3f}", 0.0))
    return Table(
        f"Identification: touches until a label has probability {threshold:g}",
        (
            "split",
            "decider",
            "touches [95 %]",
            "fewer than random [95 %]",
            "than fixed [95 %]",
            "right [95 %]",
            ("share that reached it", ".3f"),
        ),
        rows,
        "Intervals resample objects. Fewer touches are those of a decider that is not less accurate: a reference that "
        "is more accurate stops at a lower probability, where it is right as often. The bound is the fewest touches "
        "after which some set of actions reaches the probability, with the same belief and recordings.",
        "identification",
    )


def law_table(part: Part, threshold: float) -> Table:
    """Laws of correlation: loss of sequences, and calibration of the identifications that reached the threshold."""
    rows = []
    base = _losses(part, "none")
    for law in LAWS:
        values, owners = _losses(part, law)
        cells = []
        if values.size:
            loss = cluster_bootstrap(values, owners, np.random.default_rng(0))
            change = cluster_bootstrap(values - base[0], owners, np.random.default_rng(0))
            cells = [interval(*loss), "–" if law == "none" else interval(*change, spec="+.3f")]
        else:
            cells = ["–", "–"]
        for decider in (RANDOM, GAIN):
            chosen = [one for one in part.named if (one.decider, one.law) == (decider, law) and one.result.is_certain]
            if not chosen:
                cells += ["–", "–"]
                continue
            cells += [f"{np.mean([one.result.stated for one in chosen]):.3f}", interval(*_share_right(chosen))]
        rows.append((LAW_NAMES[law], *cells))
    return Table(
        f"Correlation of touches: loss of unseen sequences, and stops that state at least {threshold:g}",
        ("correlated", "loss [nats]", "change", "random: stated", "right [95 %]", "gain: stated", "right [95 %]"),
        rows,
        "The loss is the negative log posterior of the true label, averaged over the second to last touch of random "
        "sequences of test touches. Intervals resample objects.",
        "correlation",
    )


@dataclass(frozen=True)
class StatedBin:
    """Identifications that stated nearly the same probability.

    Attributes:
        first, last: of the probabilities; the last is not included.
        stated: mean probability.
        right: share that is right, with its interval over objects.
        stops, objects: how many there are.
    """

    first: float
    last: float
    stated: float
    right: tuple[float, float, float]
    stops: int
    objects: int


def stated_bins(part: Part, law: Law, threshold: float) -> list[StatedBin]:
    """Identifications by random order and information gain that reached the threshold, by what they state."""
    edges = np.append(np.unique([threshold, *(edge for edge in STATED if edge > threshold)]), np.inf)
    chosen = [one for one in part.named if one.law == law and one.decider in (RANDOM, GAIN) and one.result.is_certain]
    found = []
    for first, last in pairwise(edges.tolist()):
        inside = [one for one in chosen if first <= one.result.stated < last]
        if inside:
            stated = float(np.mean([one.result.stated for one in inside]))
            num_objects = len({one.thing for one in inside})
            found.append(StatedBin(first, last, stated, _share_right(inside), len(inside), num_objects))
    return found


def _share_right(some: Sequence[Named]) -> tuple[float, float, float]:
    """Share of identifications that are right, with its 95 % interval over objects."""
    right, things = np.array([(one.result.is_right, one.thing) for one in some]).T
    return accuracy_of_objects(right, things, np.random.default_rng(0))


def stop_table(part: Part, threshold: float) -> Table:
    """Identifications that reached the threshold, by the probability that they state."""
    rows = [
        (
            LAW_NAMES[law],
            f"{one.first:g} to {min(one.last, 1.0):g}",
            one.stated,
            interval(*one.right),
            one.stops,
            one.objects,
        )
        for law in SHOWN
        for one in stated_bins(part, law, threshold)
    ]
    return Table(
        "Stops by the probability that they state",
        ("correlated", "states", ("stated", ".3f"), "right [95 %]", "stops", "objects"),
        rows,
        "Stops of random order and information gain together. Intervals resample objects.",
        "stops",
    )


def after_table(part: Part) -> Table:
    """Accuracy and calibration after numbers of touches."""
    rows = []
    for law in SHOWN:
        for number in NUMBERS:
            chosen = [one for one in part.after if (one.law, one.number) == (law, number)]
            if not chosen:
                continue
            probs = np.concatenate([one.probs for one in chosen])
            labels = np.concatenate([one.labels for one in chosen])
            things = np.concatenate([one.things for one in chosen])
            right = accuracy_of_objects(probs.argmax(axis=1) == labels, things, np.random.default_rng(0))
            error = expected_calibration_error(probs, labels)
            loss = negative_log_likelihood(probs, labels)
            stated = float(probs.max(axis=1).mean())
            rows.append((LAW_NAMES[law], number, interval(*right), stated, error, loss, len(np.unique(things))))
    columns = (
        "correlated",
        "touches",
        "right [95 %]",
        ("stated", ".3f"),
        ("ECE", ".3f"),
        ("loss [nats]", ".3f"),
        "objects",
    )
    return Table(
        "Beliefs after touches with actions in random order",
        columns,
        rows,
        "ECE: expected calibration error of the most probable label. Objects with fewer recordings are left out.",
        "after_touches",
    )


def search_table(part: Part) -> Table:
    """Searches for a target among objects of known, different labels."""
    rows: list[Sequence[Value]] = []
    deciders = list(dict.fromkeys(one.decider for one in part.found))
    words = [name.split("(")[0] for name in deciders]
    for name, word in zip(deciders, words, strict=True):
        chosen = [one for one in part.found if one.decider == name]
        scenes, rng = np.array([one.scene for one in chosen]), np.random.default_rng(0)
        success = accuracy_of_objects(np.array([one.episode.success for one in chosen]), scenes, rng)
        touches = cluster_bootstrap([one.episode.num_touches for one in chosen], scenes, rng)
        reward = cluster_bootstrap([one.reward for one in chosen], scenes, rng)
        shown = word if words.count(word) == 1 else name
        rows.append((shown, interval(*success), interval(*touches, spec=".2f"), interval(*reward), len(chosen)))
    places, right = np.array(part.oracle).T
    rows.append((ORACLE, interval(*accuracy_of_objects(right, places, np.random.default_rng(0))), "–", "–", len(right)))
    guess = 1.0 / len(part.found[0].episode.arrangement)
    rows.append(("no touch: a guess", f"{guess:.3f}", "0", f"{2.0 * guess - 1.0:.3f}", None))
    return Table(
        "Searches: find the target among objects of known, different labels",
        ("decider", "success [95 %]", "touches [95 %]", "return [95 %]", "searches"),
        rows,
        "Success is 1, failure -1, a touch costs 0.02. Intervals resample scenes; those of touches and returns are too "
        "narrow for few scenes. The oracle uses as many recordings of each action as every object has.",
        "searches",
    )


def _losses(part: Part, law: Law) -> tuple[Floats, np.ndarray]:
    values = [fold[law][0] for fold in part.losses]
    return np.concatenate(values), np.concatenate([fold[law][1] for fold in part.losses])
