"""What ``recorded`` measured, and its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from belief.metrics import expected_calibration_error, negative_log_likelihood
from belief.observation_model.action_kernel import Law
from belief.statistics import cluster_bootstrap
from belief.table import Table, Value, interval
from belief.validation import Floats
from experiments.recorded.finding import ORACLE, Found
from experiments.recorded.fold import LAWS, Fold
from experiments.recorded.identifying import FIXED, GAIN, NUMBERS, RANDOM, AfterTouches, Named
from experiments.recorded.leaks import Control, control_table
from experiments.sensor.scores import accuracy_of_objects
from planners.identification import Identification

_STOPS = np.linspace(1.0, 0.0, 201)  # probabilities at which an identification might have stopped
_RESAMPLES = 4000
_ROUNDING = 1e-12  # of a share


@dataclass(frozen=True, eq=False)
class Measured:
    """All results.

    Attributes:
        split: name of the way to split.
        folds: the splits.
        named: identifications.
        after: beliefs after numbers of touches.
        losses: for each fold, by law: mean loss of each sequence, and its object.
        found: searches.
        oracle: for each search the scene, and whether the oracle is right.
        controls: of leaks.
        threshold: probability at which identifications stop.
    """

    split: str
    folds: Sequence[Fold]
    named: Sequence[Named]
    after: Sequence[AfterTouches]
    losses: Sequence[Mapping[Law, tuple[Floats, np.ndarray]]]
    found: Sequence[Found]
    oracle: Sequence[tuple[int, bool]]
    controls: Sequence[Control]
    threshold: float

    def tables(self) -> list[Table]:
        """All tables, in the order of the report."""
        searches = [search_table(self)] if self.found else []
        leaks = control_table(self.controls, len(self.folds[0].bank.label_names))
        return [identification_table(self), law_table(self), after_table(self), *searches, leaks]

    def named_by(self, decider: str, law: Law = "kernel") -> list[Named]:
        """The identifications by a decider with an observation model."""
        return [one for one in self.named if (one.decider, one.law) == (decider, law)]


def by_object(chosen: Sequence[Named], value: Callable[[Identification], float]) -> tuple[Floats, np.ndarray]:
    """Mean of a value over the identifications of each object, and the objects, so that every object counts equally."""
    objects = np.array([one.object_index for one in chosen])
    values = np.array([value(one.result) for one in chosen], np.float64)
    known = np.unique(objects)
    return np.array([values[objects == index].mean() for index in known]), known


def num_touches(chosen: Sequence[Named]) -> tuple[Floats, np.ndarray]:
    """Mean number of touches of each object, and the objects."""
    return by_object(chosen, lambda one: len(one.poses))


def saving(mine: Sequence[Named], reference: Sequence[Named]) -> tuple[float, float, float]:
    """Fraction of the reference's touches that a decider saves without being less accurate; an interval over objects.

    A reference that is more often right is stopped at the first lower probability at which it is as often right.
    """
    curves = [_stopped_earlier(chosen) for chosen in (mine, reference)]
    size = curves[0].shape[-1]
    drawn = np.random.default_rng(0).integers(size, size=(_RESAMPLES, size))
    weights = np.stack([np.bincount(row, minlength=size) for row in drawn]) / size
    saved = _saved(*(curve @ np.vstack([np.full(size, 1.0 / size), weights]).T for curve in curves))
    low, high = np.quantile(saved[1:], [0.025, 0.975])
    return float(saved[0]), float(low), float(high)


def _stopped_earlier(chosen: Sequence[Named]) -> Floats:
    """Mean touches and accuracy of each object, had its identifications stopped at each probability, ``(2, G, N)``."""
    objects = np.array([one.object_index for one in chosen])
    found = np.empty((len(chosen), 2, len(_STOPS)))
    for row, one in zip(found, chosen, strict=True):
        labels, stated = np.array(one.result.leading).T
        reached = np.maximum.accumulate(stated)[:-1, None] < _STOPS  # at the last touch every decider stops
        row[0] = reached.sum(axis=0)
        row[1] = labels[reached.sum(axis=0)] == one.result.truth
    return np.stack([found[objects == index].mean(axis=0) for index in np.unique(objects)], axis=2)


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


def identification_table(measured: Measured) -> Table:
    """Touches until an object is named, by decider."""
    rows: list[Sequence[Value]] = []
    for decider in (RANDOM, FIXED, GAIN):
        chosen = measured.named_by(decider)
        touches = cluster_bootstrap(*num_touches(chosen), np.random.default_rng(0))
        right = accuracy_of_objects(*by_object(chosen, lambda one: one.is_right), np.random.default_rng(0))
        certain = float(by_object(chosen, lambda one: one.is_certain)[0].mean())
        fewer = [
            "–" if decider == other else interval(*saving(chosen, measured.named_by(other)), spec=".1%")
            for other in (RANDOM, FIXED)
        ]
        rows.append((decider, interval(*touches, spec=".2f"), *fewer, interval(*right), certain))
    guess = 1 / len(measured.folds[0].bank.label_names)
    rows.append(("no touch: a guess", "0", "–", "–", f"{guess:.3f}", 0.0))
    fewer_than = "fewer than random [95 %]", "than fixed [95 %]"
    return Table(
        f"Identification, {measured.split}: touches until a label has probability {measured.threshold:g}",
        ("decider", "touches [95 %]", *fewer_than, "right [95 %]", ("share that reached it", ".3f")),
        rows,
        "Intervals resample objects. Fewer touches are those of a decider that is not less accurate: a reference that "
        "is more accurate stops at a lower probability, where it is right as often.",
        "identification",
    )


def law_table(measured: Measured) -> Table:
    """Laws of correlation: loss of sequences, and calibration of the identifications that reached the threshold."""

    def losses(law: Law) -> tuple[Floats, np.ndarray]:
        values, owners = zip(*(fold[law] for fold in measured.losses), strict=True)
        return np.concatenate(values), np.concatenate(owners)

    rows = []
    base, _ = losses("none")
    for law in LAWS:
        values, owners = losses(law)
        cells = ["–", "–"]
        if values.size:
            loss = cluster_bootstrap(values, owners, np.random.default_rng(0))
            change = cluster_bootstrap(values - base, owners, np.random.default_rng(0))
            cells = [interval(*loss), "–" if law == "none" else interval(*change, spec="+.3f")]
        for decider in (RANDOM, GAIN):
            chosen = [one for one in measured.named_by(decider, law) if one.result.is_certain]
            if not chosen:
                cells += ["–", "–"]
                continue
            right, objects = np.array([(one.result.is_right, one.object_index) for one in chosen]).T
            stated = np.mean([one.result.stated for one in chosen])
            cells += [f"{stated:.3f}", interval(*accuracy_of_objects(right, objects, np.random.default_rng(0)))]
        rows.append((law, *cells))
    return Table(
        f"Correlation of touches: loss of unseen sequences, and stops that state at least {measured.threshold:g}",
        ("correlated", "loss [nats]", "change", "random: stated", "right [95 %]", "gain: stated", "right [95 %]"),
        rows,
        "The loss is the negative log posterior of the true label, averaged over the second to last touch of random "
        "sequences of test touches. Intervals resample objects.",
        "correlation",
    )


def after_table(measured: Measured) -> Table:
    """Accuracy and calibration after numbers of touches, without correlations and with the kernel."""
    rows = []
    for law in LAWS:
        for number in NUMBERS:
            chosen = [one for one in measured.after if (one.law, one.number) == (law, number)]
            if not chosen:
                continue
            columns = zip(*((one.probs, one.labels, one.objects) for one in chosen), strict=True)
            probs, labels, objects = map(np.concatenate, columns)
            right = accuracy_of_objects(probs.argmax(axis=1) == labels, objects, np.random.default_rng(0))
            error, loss = expected_calibration_error(probs, labels), negative_log_likelihood(probs, labels)
            stated = float(probs.max(axis=1).mean())
            rows.append((law, number, interval(*right), stated, error, loss, len(np.unique(objects))))
    numbers = [("stated", ".3f"), ("ECE", ".3f"), ("loss [nats]", ".3f"), "objects"]
    return Table(
        "Beliefs after touches with actions in random order",
        ("correlated", "touches", "right [95 %]", *numbers),
        rows,
        "ECE: expected calibration error of the most probable label. Objects with fewer recordings are left out.",
        "after_touches",
    )


def search_table(measured: Measured) -> Table:
    """Searches for a target among objects of known, different labels."""
    rows: list[Sequence[Value]] = []
    deciders = list(dict.fromkeys(one.decider for one in measured.found))
    words = [name.split("(")[0] for name in deciders]
    for name, word in zip(deciders, words, strict=True):
        chosen = [one for one in measured.found if one.decider == name]
        scenes, rng = np.array([one.scene for one in chosen]), np.random.default_rng(0)
        success = accuracy_of_objects(np.array([one.episode.success for one in chosen]), scenes, rng)
        touches = cluster_bootstrap([one.episode.num_touches for one in chosen], scenes, rng)
        reward = cluster_bootstrap([one.reward for one in chosen], scenes, rng)
        shown = word if words.count(word) == 1 else name
        rows.append((shown, interval(*success), interval(*touches, spec=".2f"), interval(*reward), len(chosen)))
    places, right = np.array(measured.oracle).T
    rows.append((ORACLE, interval(*accuracy_of_objects(right, places, np.random.default_rng(0))), "–", "–", len(right)))
    guess = 1.0 / len(measured.found[0].episode.arrangement)
    rows.append(("no touch: a guess", f"{guess:.3f}", "0", f"{2.0 * guess - 1.0:.3f}", None))
    return Table(
        "Searches: find the target among objects of known, different labels",
        ("decider", "success [95 %]", "touches [95 %]", "return [95 %]", "searches"),
        rows,
        "Success is 1, failure -1, a touch costs 0.02. Intervals resample scenes; those of touches and returns are too "
        "narrow for few scenes. The oracle uses as many recordings of each action as every object has.",
        "searches",
    )
