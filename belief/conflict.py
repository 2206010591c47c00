"""A running test that touches come from the world that an observation model was fitted to.

Two scores of each touch are compared with those of calibration objects after equally many touches of one object: the
novelty of its embedding, and its misfit to the earlier touches of the object, relative to objects whose shape was known
as well before the touch (:mod:`belief.conflict_scores`). The object's own
earlier scores predict a part of each score, which is subtracted. Bets against the p-values multiply over all touches of
all objects of a search. A p-value is the rank of a score among those of the calibration objects: that of one touch of a
new object is at most u with a probability of about u. If all p-values were independent and uniform, the product would
ever exceed 1/α with probability at most α (Ville 1939; Shafer 2021).

They are nearly independent where objects differ moderately, and there alarms are rarer than α. They are dependent where
some objects are odd in all their touches, because such an object is bet on at every touch, and because all objects are
compared with the same calibration objects. Then the rate may exceed α: for α = 0.02, it is 0.047 with 3 % odd objects
and 1200 calibration objects (``python benchmarks/false_alarms.py``, decision 0039).

Scores of four touches of each of 200 objects, then an object that fits, and one that does not:

>>> rng = np.random.default_rng(0)
>>> test = ConflictTest.fit(rng.normal(size=(200, 4, 3)), rng.normal(size=(200, 4)), np.arange(200) % 2)
>>> typical, strange = test.start(), test.start()
>>> for _ in range(4):
...     typical = typical.update(np.ones(3), 0.0)
...     strange: ObjectConflict = strange.update(np.full(3, 9.0), 9.0)
>>> strange.p_values.round(3).tolist()
[0.005, 0.005]
>>> [round(log_conflict([one.log_bets]), 1) for one in (typical, strange)], round(float(np.log(1 / 0.02)), 1)
([-1.6, 16.1], 3.9)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from dataclasses import fields as dataclass_fields
from functools import cached_property
from math import log
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.conflict_scores import Novelty, UsualMisfit
from belief.files import from_field, to_field
from belief.frozen import FrozenArrays, frozen
from belief.validation import Floats

NOVELTY, MISFIT = 0, 1
"""Index of the two scores."""
MOST_TOUCHES = 12
"""Touches of an object that are tested, at most; later ones are not bet on."""
_FEWEST_OBJECTS = 20
_FOLDS = 5
_WIDEST = 1e3  # score
_RESOLUTION = 1e-6  # relative; scores that differ by less are equal
_QUANTILES = 40  # in each half of a distribution

_POWERS = np.array([[0.0, 0.8, 0.5, 0.0], [0.0, 0.0, 0.0, 0.4], [0.0, 0.8, 0.5, 0.0]])
"""Exponents κ of bets (1 - κ) p^-κ: on a high novelty, a low one, and a high misfit. A strategy is a column of the
first two rows with one of the first three columns of the third."""
_LOG_KEPT = np.log1p(-_POWERS)


@dataclass(frozen=True, eq=False)
class ConflictTest(FrozenArrays):
    """Distributions of the two scores of a touch in the world of the calibration objects.

    Attributes:
        novelty: of an embedding.
        usual_misfit: by number of earlier touches and by how certain the shape was.
        medians: of the novelty after 0, 1, … earlier touches of the object, ``(T,)``.
        correlations: of the scores of two touches of one object, ``(2,)``.
        quantiles: of both scores less their prediction, increasing, ``(2, T, Q)``.
        num_objects: calibration objects.
    """

    novelty: Novelty
    usual_misfit: UsualMisfit
    medians: Floats
    correlations: Floats
    quantiles: Floats
    num_objects: int

    @classmethod
    def fit(
        cls, embeddings: Floats, misfits: Floats, shapes: ArrayLike, certainties: Floats | None = None
    ) -> ConflictTest | None:
        """The test from sequences of touches, one of each calibration object.

        The novelty of each object is that to other objects.

        Args:
            embeddings: ``(S, T, D)``.
            misfits: to the earlier touches of the sequence, ``(S, T)``; those of first touches are not used.
            shapes: of the objects, ``(S,)``.
            certainties: largest posterior of a shape before each touch, ``(S, T)``; the same for all by default.

        Returns:
            The test; None for fewer than 20 objects, which cannot tell what is rare.
        """
        num_objects, length, _ = embeddings.shape
        if num_objects < _FEWEST_OBJECTS:
            return None
        truth, rows = np.asarray(shapes).repeat(length), embeddings.reshape(num_objects * length, -1)
        folds = (np.random.default_rng(0).permutation(num_objects) % _FOLDS).repeat(length)
        novelties = np.empty(len(rows))
        for fold in range(_FOLDS):
            out = folds == fold
            novelties[out] = Novelty.fit(rows[~out], truth[~out]).score(rows[out])
        scores = np.clip(novelties.reshape(num_objects, length), -_WIDEST, _WIDEST)
        medians = _single(np.median(scores, axis=0))
        before = np.ones_like(misfits) if certainties is None else certainties
        usual = UsualMisfit.fit(misfits, before)
        standardised = [usual.standardised(step, misfits[:, step], before[:, step]) for step in range(length)]
        centred = np.stack([scores - medians, np.stack(standardised, axis=1)])
        correlations = np.array([_correlation(centred[NOVELTY]), _correlation(centred[MISFIT][:, 1:])])
        found = np.zeros((2, length, len(_ranks(num_objects))))
        for kind in (NOVELTY, MISFIT):
            sums = np.zeros(num_objects)
            for step in range(kind, length):
                now = centred[kind][:, step]
                values = np.sort(now - _share(correlations[kind], step - kind) * sums)[_ranks(num_objects) - 1]
                sums += np.clip(now, values[0], values[-1])
                found[kind, step] = values
        return cls(Novelty.fit(rows, truth), usual, medians, correlations, _single(found), num_objects)

    @property
    def num_touches(self) -> int:
        """T, of an object that are tested."""
        return len(self.medians)

    @cached_property
    def _kept_ranks(self) -> NDArray[np.int64]:
        return _ranks(self.num_objects)

    def start(self) -> ObjectConflict:
        """The state before the first touch of an object."""
        return ObjectConflict(self, 0, frozen(np.zeros(2)), frozen(np.ones(2)), frozen(np.zeros(_NUM_BETS)))

    def p_values(self, kind: int, step: int, score: float) -> tuple[float, float]:
        """Conformal p-values of a score less its prediction: that it is so high, and that it is so low."""
        values, ranks, number = self.quantiles[kind, step], self._kept_ranks, self.num_objects
        margin = _RESOLUTION * (1.0 + abs(score))
        below = int(values.searchsorted(score - margin, side="left"))  # as many stored values are smaller
        above = int(values.searchsorted(score + margin, side="right"))  # index of the first larger one
        high = number + 1 - (ranks[below - 1] if below else 0)
        low = ranks[above] if above < len(values) else number + 1
        return float(high) / (number + 1), float(low) / (number + 1)

    def to_fields(self) -> dict[str, Any]:
        """All parameters, as JSON types; arrays in single precision, as :meth:`fit` has rounded them."""
        arrays = {
            **{field.name: getattr(self.novelty, field.name) for field in dataclass_fields(Novelty)},
            **{
                f"misfit_{field.name}": getattr(self.usual_misfit, field.name)
                for field in dataclass_fields(UsualMisfit)
            },
            "medians": self.medians,
            "quantiles": self.quantiles,
        }
        return {
            "num_objects": self.num_objects,
            "correlations": self.correlations.tolist(),
            **{name: to_field(array, "float32") for name, array in arrays.items()},
        }

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> ConflictTest:
        """The test of fields from :meth:`to_fields`."""
        novelty = Novelty(*(from_field(fields[field.name], "float32") for field in dataclass_fields(Novelty)))
        usual = UsualMisfit(
            *(from_field(fields[f"misfit_{field.name}"], "float32") for field in dataclass_fields(UsualMisfit))
        )
        medians, quantiles = (from_field(fields[name], "float32") for name in ("medians", "quantiles"))
        return cls(novelty, usual, medians, np.array(fields["correlations"]), quantiles, int(fields["num_objects"]))


@dataclass(frozen=True, eq=False)
class ObjectConflict:
    """The test of one object: a frozen value; each touch gives a new one, at the same cost.

    Attributes:
        test: the distributions.
        num_touches: of the object.
        sums: of both scores over all tested touches: the novelty less its median, the misfit standardised, ``(2,)``.
        p_values: of the last touch, ``(2,)``: its novelty, and its misfit to earlier touches; ones without a test.
        log_bets: log wealth of every strategy, ``(12,)``.
    """

    test: ConflictTest
    num_touches: int
    sums: Floats
    p_values: Floats
    log_bets: Floats

    def update(self, embedding: ArrayLike, misfit: float, certainty: float = 1.0) -> ObjectConflict:
        """The test with one more touch.

        Args:
            embedding: ``(D,)``.
            misfit: to the earlier touches.
            certainty: largest posterior of a shape before the touch, in [0, 1].
        """
        step, test = self.num_touches, self.test
        if step >= test.num_touches:
            return replace(self, num_touches=step + 1, p_values=frozen(np.ones(2)))
        novelty = float(test.novelty.score(np.asarray(embedding, np.float64)[None])[0])
        unusual = _limited(novelty, -_WIDEST, _WIDEST) - test.medians.item(step)
        standardised = float(test.usual_misfit.standardised(step, misfit, certainty))
        logs, sums, p_values = [0.0, 0.0, 0.0], self.sums.tolist(), [1.0, 1.0]
        for kind, centred in ((NOVELTY, unusual), (MISFIT, standardised)):
            if step < kind:
                continue
            share = _share(test.correlations.item(kind), step - kind)
            high, low = test.p_values(kind, step, centred - share * sums[kind])
            p_values[kind], logs[2 * kind] = high, log(high)
            if kind == NOVELTY:
                logs[1] = log(low)
            values = test.quantiles[kind, step]
            sums[kind] += _limited(centred, values.item(0), values.item(-1))
        log_bets = self.log_bets + _bets(np.array(logs), step)
        return ObjectConflict(test, step + 1, frozen(np.array(sums)), frozen(np.array(p_values)), frozen(log_bets))


def log_conflict(log_bets: Iterable[Floats]) -> float:
    """Log e-value of all touches of several objects: the mean over strategies of their wealth."""
    total = sum(log_bets, start=np.zeros(1))
    largest = total.max()
    return float(largest + np.log(np.exp(total - largest).mean()))


def continued_bets(log_bets: ArrayLike, like: ArrayLike | None) -> Floats:
    """Log wealth with which the test of a search begins that continues the test of an earlier one.

    Args:
        log_bets: :attr:`belief.SceneView.log_bets` of the earlier search, ``(J,)``; or 0.0 for none.
        like: log bets of an object in the search, ``(J,)``; None for a model without a test.
    """
    given, wanted = np.asarray(log_bets, np.float64), np.zeros(1) if like is None else np.zeros(np.shape(like))
    if given.shape not in ((), wanted.shape) or not np.isfinite(given).all():
        raise ValueError(
            f"log_bets must be {len(wanted)} finite numbers, from an earlier search with the same observation model, "
            f"got {given.tolist()}"
        )
    return frozen(wanted + given)


_NUM_BETS = 12


def _bets(logs: Floats, step: int) -> Floats:
    """Log of what each strategy multiplies its wealth by, ``(12,)``."""
    each = _LOG_KEPT - _POWERS * logs[:, None]  # (3, 4)
    misfit = each[2, :3] if step else np.zeros(3)
    return np.asarray((each[0] + each[1])[:, None] + misfit).ravel()


def _correlation(scores: Floats) -> float:
    """Mean correlation of two columns of scores ``(S, n)``, limited to [0, 0.9]."""
    number = scores.shape[1]
    if number < 2:
        return 0.0
    limited = np.clip(scores, *np.quantile(scores, [0.01, 0.99], axis=0))
    alone = limited.var(axis=0).sum()
    if alone <= 0.0:
        return 0.0
    return float(np.clip((limited.sum(axis=1).var() / alone - 1.0) / (number - 1), 0.0, 0.9))


def _limited(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)


def _share(correlation: float, number: int) -> float:
    """Factor by which the sum of so many earlier scores predicts the next one."""
    return float(correlation / (1.0 + (number - 1) * correlation)) if number > 0 else 0.0


def _ranks(number: int) -> NDArray[np.int64]:
    """Ranks from 1 to ``number`` that are kept: dense near both ends."""
    half = np.unique(np.geomspace(1, max(1, number // 2), _QUANTILES).round().astype(np.int64))
    return np.unique(np.concatenate([half, number + 1 - half]))


def _single(array: Floats) -> Floats:
    return array.astype(np.float32).astype(np.float64)
