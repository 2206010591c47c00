"""A running test that touches come from the world that an observation model was fitted to.

Two scores of each touch are compared with those of calibration objects after equally many touches of one object: the
novelty of its embedding, and its misfit to the earlier touches of the object, relative to objects whose shape was known
as well before the touch. The object's own earlier scores predict a part of each score, which is subtracted. Bets
against the p-values multiply over all touches of all objects of a search. A p-value is the rank of a score among those
of the calibration objects: that of one touch of a new object is at most u with a probability of about u. If all
p-values were independent and uniform, the product would ever exceed 1/α with probability at most α (Ville 1939; Shafer
2021).

They are nearly independent where objects differ moderately, and there alarms are rarer than α. They are dependent where
some objects are odd in all their touches, because such an object is bet on at every touch, and because all objects are
compared with the same calibration objects. Then the rate may exceed α: for α = 0.02, it is 0.047 with 3 % odd objects
and 1200 calibration objects (decision 0039).

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

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import log
from typing import Annotated, ClassVar, TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.codec import Merged, Stored
from belief.constraints import MOST_COUNT, Within, check
from belief.frozen import FrozenArrays, frozen
from belief.validation import Floats, require_number

Singles: TypeAlias = Annotated[Floats, Stored("float32")]  # as the fits have rounded them
NOVELTY, MISFIT = 0, 1
"""Index of the two scores."""
MOST_TOUCHES = 12
"""Touches of an object that are tested, at most; later ones are not bet on."""
_FEWEST_OBJECTS = 20
_FOLDS = 5
_AT_ONCE = 512  # rows of distances
_RESOLUTION = 1e-6  # relative; scores that differ by less are equal
_QUANTILES = 40  # in each half of a distribution

_POWERS = np.array([[0.0, 0.8, 0.5, 0.0], [0.0, 0.0, 0.0, 0.4], [0.0, 0.8, 0.5, 0.0]])
"""Exponents κ of bets (1 - κ) p^-κ: on a high novelty, a low one, and a high misfit. A strategy is a column of the
first two rows with one of the first three columns of the third."""
ON_MISFIT = slice(1, 3)
"""The strategies of :attr:`ObjectConflict.log_bets` that bet on a high misfit alone."""
_LOG_KEPT = np.log1p(-_POWERS)
_LARGEST = 1e30  # number in an embedding
_LARGEST_SINGLE = float(np.finfo(np.float32).max)
_LEAST_SHRINKAGE = 1e-6  # few samples can make the estimate zero and the covariance singular
_LEAST_WIDTH = 1e-2  # of log distances, and of misfits [nats]
_WIDEST = 1e3  # score
_MOST_GROUPS = 6
_IN_A_GROUP = 50  # objects, at least
_SMALLEST = 0.05  # quantile of distances that are taken as hardly different
_HIGH = 0.8  # quantile; its distance from the median is the width


@dataclass(frozen=True, eq=False)
class Novelty(FrozenArrays):
    """Log Mahalanobis distance to the nearest of C shapes, standardised by the distances of this shape's own touches.

    Some shapes look more alike from all sides than others, so distances are standardised before the least is taken.
    ``means (C, D)`` are of the shapes in the data; ``whitening (D, D)`` maps deviations to unit covariance, one for all
    shapes; ``levels (C,)`` and ``widths (C,)`` are means and standard deviations of the log distances.
    """

    means: Singles
    whitening: Singles
    levels: Singles
    widths: Singles

    @classmethod
    def fit(cls, embeddings: Floats, shapes: ArrayLike) -> Novelty:
        """Fit to embeddings ``(n, D)`` of touches of known shapes ``(n,)``, rounded to single precision."""
        limited, truth = np.clip(embeddings, -_LARGEST, _LARGEST), np.asarray(shapes)
        each, number = np.unique(truth, return_inverse=True)
        members = np.eye(len(each))[number]  # (n, C)
        means = (members / members.sum(axis=0)).T @ limited
        whitening = np.clip(_whitening(limited - means[number], limited), -_LARGEST_SINGLE, _LARGEST_SINGLE)
        blank = cls(means, whitening, np.zeros(len(each)), np.ones(len(each)))
        own = [blank.distances(limited[truth == shape])[:, number] for number, shape in enumerate(each)]
        levels = np.array([some.mean() for some in own])
        widths = np.maximum([some.std() for some in own], _LEAST_WIDTH)
        return cls(*map(_single, (means, whitening, levels, widths)))

    def distances(self, embeddings: Floats) -> Floats:
        """Log of 1 plus the squared distance to each shape, at most 1e3, ``(n, C)`` for embeddings ``(n, D)``."""
        centre, means = self._white
        with np.errstate(over="ignore", invalid="ignore"):
            points = (np.minimum(np.maximum(embeddings, -_LARGEST), _LARGEST) - centre) @ self.whitening
            away = points[:, None] - means
            found = np.log1p(np.square(away).sum(axis=2))
        return np.fmin(found, _WIDEST)  # also in place of NaN

    @cached_property
    def _white(self) -> tuple[Floats, Floats]:
        """A point near the data, so that a common offset loses no digits, and the means from there, whitened."""
        centre = self.means.mean(axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            return centre, (self.means - centre) @ self.whitening

    def score(self, embeddings: Floats) -> Floats:
        """Novelty of each embedding, ``(n,)`` for ``(n, D)``: about 0 ± 1 for touches of known shapes."""
        return np.asarray(((self.distances(embeddings) - self.levels) / self.widths).min(axis=1))


def _whitening(residuals: Floats, values: Floats) -> Floats:
    """Whitens residuals ``(n, D)`` from the right, by a covariance shrunk as by Ledoit and Wolf (2004, section 3.3)."""
    number, size = residuals.shape
    scale = float(np.abs(residuals).max())
    # Rounding of means leaves residuals of some units in the last place for constant features.
    if scale <= 16 * np.finfo(np.float64).eps * float(np.abs(values).max()):
        return np.eye(size)
    residuals = residuals / scale
    covariance = residuals.T @ residuals / number
    spread = np.trace(covariance) / size
    distance, shrinkage = np.square(covariance - spread * np.eye(size)).sum(), 1.0
    if distance > 0.0:
        # Σ_i |x_i x_iᵀ - S|² = Σ_i |x_i|⁴ - n |S|²
        error = (np.square(np.square(residuals).sum(axis=1)).sum() / number - np.square(covariance).sum()) / number
        shrinkage = float(np.clip(error / distance, _LEAST_SHRINKAGE, 1.0))
    root = scipy.linalg.cholesky((1.0 - shrinkage) * covariance + shrinkage * spread * np.eye(size), lower=True)
    return np.asarray(scipy.linalg.solve_triangular(root, np.eye(size), lower=True).T / scale)


@dataclass(frozen=True, eq=False)
class UsualMisfit(FrozenArrays):
    """Medians and widths of the misfit after T numbers of touches, in G groups by the certainty of the shape [nats].

    A touch fits the earlier ones less well where the shape is uncertain, and a search goes on with such objects. So
    misfits are compared within groups: ``edges (T, G - 1)`` are the certainties between them, increasing;
    ``medians (T, G)``; ``widths (T, G)`` are from the median to the 80 % quantile.
    """

    edges: Singles
    medians: Singles
    widths: Singles

    @classmethod
    def fit(cls, misfits: Floats, certainties: Floats) -> UsualMisfit:
        """Fit to misfits of T touches of S objects, and the certainty of the shape before each, ``(S, T)`` both."""
        number, length = misfits.shape
        groups = min(_MOST_GROUPS, max(1, number // _IN_A_GROUP))
        limited = np.clip(misfits, -_WIDEST, _WIDEST)
        edges = np.quantile(certainties, np.arange(1, groups) / groups, axis=0).T.astype(np.float32)
        medians, widths = np.empty((length, groups)), np.empty((length, groups))
        for step in range(length):
            group = edges[step].searchsorted(certainties[:, step], side="right")
            for one in range(groups):
                some = limited[group == one, step] if (group == one).any() else limited[:, step]
                medians[step, one], high = np.quantile(some, [0.5, _HIGH])
                widths[step, one] = max(high - medians[step, one], _LEAST_WIDTH)
        return cls(*map(_single, (edges, medians, widths)))

    def standardised(self, step: int, misfit: Floats | float, certainty: Floats | float) -> Floats:
        """Misfits ``(...)`` after ``step`` touches less the median of their group by certainty, in its widths."""
        group = self.edges[step].searchsorted(certainty, side="right")
        limited = np.minimum(np.maximum(misfit, -_WIDEST), _WIDEST)
        return np.asarray((limited - self.medians[step][group]) / self.widths[step][group])


@dataclass(frozen=True, eq=False)
class ConflictTest(FrozenArrays):
    """Distributions of the two scores of a touch in the world of the calibration objects.

    ``medians (T,)`` are of the novelty after 0, 1, … earlier touches of the object, ``correlations (2,)`` of the scores
    of two touches of one object, ``quantiles (2, T, Q)`` of both scores less their prediction, increasing.
    """

    last_in_file: ClassVar = ("num_objects", "correlations", "novelty", "usual_misfit", "medians", "quantiles")

    novelty: Annotated[Novelty, Merged()]
    usual_misfit: Annotated[UsualMisfit, Merged("misfit_")]
    medians: Singles
    correlations: Floats
    quantiles: Singles
    num_objects: Annotated[int, Within(_FEWEST_OBJECTS, MOST_COUNT)]

    def __post_init__(self) -> None:
        check(self)
        for correlation in self.correlations:
            require_number("a correlation", correlation, 0.0, 1.0)
        self.freeze()

    @classmethod
    def fit(
        cls, embeddings: Floats, misfits: Floats, shapes: ArrayLike, certainties: Floats | None = None
    ) -> ConflictTest | None:
        """The test from a sequence of touches of each of S calibration objects; None for too few objects.

        ``embeddings`` are ``(S, T, D)``. ``misfits (S, T)`` are to the earlier touches; those of first touches are not
        used. ``certainties (S, T)`` are the largest posterior of a shape before each touch, equal for all by default.
        The novelty of an object is that to other objects.
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
        ranks = _ranks(num_objects)
        found = np.zeros((2, length, len(ranks)))
        for kind in (NOVELTY, MISFIT):
            sums = np.zeros(num_objects)
            for step in range(kind, length):
                now = centred[kind][:, step]
                values = np.sort(now - _share(correlations[kind], step - kind) * sums)[ranks - 1]
                sums += np.clip(now, values[0], values[-1])
                found[kind, step] = values
        return cls(Novelty.fit(rows, truth), usual, medians, correlations, _single(found), num_objects)

    @property
    def num_touches(self) -> int:
        """T, the number of touches of an object that are tested."""
        return len(self.medians)

    def longer(self, num_touches: int) -> ConflictTest:
        """The test for more touches; the distributions of the last fitted touch stand for later ones."""

        def pad(array: Floats, axis: int = 0) -> Floats:
            return np.repeat(array, [1] * (self.num_touches - 1) + [num_touches - self.num_touches + 1], axis)

        usual = UsualMisfit(*map(pad, (self.usual_misfit.edges, self.usual_misfit.medians, self.usual_misfit.widths)))
        return replace(self, usual_misfit=usual, medians=pad(self.medians), quantiles=pad(self.quantiles, 1))

    def start(self) -> ObjectConflict:
        """The state before the first touch of an object."""
        return ObjectConflict(self, 0, frozen(np.zeros(2)), frozen(np.ones(2)), frozen(np.zeros(12)))

    def p_values(self, kind: int, step: int, score: float) -> tuple[float, float]:
        """Conformal p-values of a score less its prediction: that it is so high, and that it is so low."""
        values, ranks, number = self.quantiles[kind, step], _ranks(self.num_objects), self.num_objects
        margin = _RESOLUTION * (1.0 + abs(score))
        below = int(values.searchsorted(score - margin, side="left"))  # as many stored values are smaller
        above = int(values.searchsorted(score + margin, side="right"))  # index of the first larger one
        high = number + 1 - (ranks[below - 1] if below else 0)
        low = ranks[above] if above < len(values) else number + 1
        return float(high) / (number + 1), float(low) / (number + 1)


@dataclass(frozen=True, eq=False)
class ObjectConflict:
    """The test of one object: a frozen value, of which each touch makes a new one at constant cost.

    ``sums (2,)`` are of both scores over all tested touches: the novelty less its median, and the standardised misfit.
    ``p_values (2,)`` are of the novelty and the misfit of the last touch, ones without a test; ``log_bets (12,)`` is
    the log wealth of every strategy.
    """

    test: ConflictTest
    num_touches: int
    sums: Floats
    p_values: Floats
    log_bets: Floats

    def update(self, embedding: ArrayLike, misfit: float, certainty: float = 1.0) -> ObjectConflict:
        """The test after a touch of ``embedding (D,)``; ``certainty`` is the largest posterior of a shape before it."""
        step, test = self.num_touches, self.test
        if step >= test.num_touches:
            return replace(self, num_touches=step + 1, p_values=frozen(np.ones(2)))
        novelty = float(test.novelty.score(np.asarray(embedding, np.float64)[None])[0])
        unusual = min(max(novelty, -_WIDEST), _WIDEST) - test.medians.item(step)
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
            sums[kind] += min(max(centred, values.item(0)), values.item(-1))
        log_bets = self.log_bets + _bets(np.array(logs), step)
        return ObjectConflict(test, step + 1, frozen(np.array(sums)), frozen(np.array(p_values)), frozen(log_bets))


@dataclass(frozen=True, eq=False)
class SimulatedTouches(FrozenArrays):
    """Tests that a touch is like those simulated in some state of a sensor, by distances between embeddings.

    A strange touch is far from the nearest one, as far as few are from theirs. And it is far from the touches of every
    state, for distances within this state: touches of a noisy sensor are far from each other. The smaller of the two
    e-values counts, so a touch is strange only if it is so in both ways.

    Attributes:
        embeddings: of the simulated touches, state by state, ``(B, D)``.
        starts: place of the first touch of each state, ``(S,)``.
        levels: median of the log squared distances within each state, ``(S,)``.
        widths: their spread above the median, ``(S,)``.
        scores: of each touch, the log squared distance to the nearest other one, and the least of the standardised
            distances to the others of a state, each increasing, ``(2, B)``.
        nearest: a squared distance that is added to all, so that the logarithm of the smallest ones is not extreme.

    >>> known = SimulatedTouches.of(np.random.default_rng(0).normal(size=(500, 3)))
    >>> [round(known.e_value(np.full(3, place)), 1) for place in (0.0, 9.0)]
    [0.6, 13.7]
    """

    embeddings: NDArray[np.float32]
    starts: NDArray[np.int64]
    levels: Floats
    widths: Floats
    scores: Floats
    nearest: float = 0.0

    @classmethod
    def of(
        cls, embeddings: NDArray[np.floating], states: ArrayLike | None = None, owners: ArrayLike | None = None
    ) -> SimulatedTouches:
        """Of the embeddings ``(B, D)`` of touches in ``states (B,)``, one state by default.

        Those of one of the ``owners (B,)``, as of one body, are not compared; each state has two owners or more.
        """
        number = len(embeddings)
        group = np.zeros(number, int) if states is None else np.unique(np.asarray(states), return_inverse=True)[1]
        order = np.argsort(group, kind="stable")
        group, owner = group[order], (np.arange(number) if owners is None else np.asarray(owners))[order]
        starts, flat = group.searchsorted(np.arange(group[-1] + 1)), np.zeros(group[-1] + 1)
        found = cls(np.asarray(embeddings, np.float32)[order], starts, flat, flat + 1.0, np.zeros((2, number)))
        away = np.empty((number, len(starts)))
        for first in range(0, number, _AT_ONCE):
            some = np.arange(first, min(first + _AT_ONCE, number))
            each = found._to_each(found.embeddings[some])
            each[owner[some][:, None] == owner] = np.inf
            away[some] = np.minimum.reduceat(each, starts, axis=1)
        nearest = float(np.quantile(away.min(axis=1), _SMALLEST))
        logs = _logs(away + nearest)
        within = np.split(logs[np.arange(number), group], starts[1:])
        levels = np.array([np.median(one) for one in within])
        highs = np.array([np.quantile(one, _HIGH) for one in within])
        widths = np.maximum(highs - levels, _LEAST_WIDTH)
        scores = np.sort(_scores(logs, levels, widths), axis=1)
        return replace(found, levels=levels, widths=widths, scores=scores, nearest=nearest)

    @property
    def states(self) -> NDArray[np.int64]:
        """State of each touch, ``(B,)``."""
        return np.arange(len(self.starts)).repeat(np.diff(self.starts, append=len(self.embeddings)))

    def e_value(self, embedding: Floats) -> float:
        """E-value of ``embedding (D,)`` against "one more simulated touch": the mean of bets on a low p-value."""
        away = np.minimum.reduceat(self._to_each(np.asarray(embedding)[None]), self.starts, axis=1)
        felt, number = _scores(_logs(away + self.nearest), self.levels, self.widths), self.scores.shape[1]
        rank = min(int(known.searchsorted(score)) for known, (score,) in zip(self.scores, felt, strict=True))
        log_p = log((1 + number - rank) / (number + 1))
        return float(np.exp(_LOG_KEPT[NOVELTY, :3] - _POWERS[NOVELTY, :3] * log_p).mean())

    def _to_each(self, embeddings: NDArray[np.floating]) -> NDArray[np.float32]:
        """Squared distances of ``embeddings (n, D)`` to each simulated touch, ``(n, B)``."""
        some = np.asarray(embeddings, np.float32)
        return self._squares - 2.0 * (some @ self.embeddings.T) + np.square(some).sum(axis=1, keepdims=True)

    @cached_property
    def _squares(self) -> NDArray[np.float32]:
        return np.square(self.embeddings).sum(axis=1)


def _scores(logs: Floats, levels: Floats, widths: Floats) -> Floats:
    """Both scores of n touches, ``(2, n)``, from log squared distances to the nearest one of each state, ``(n, S)``."""
    return np.stack([logs.min(axis=1), ((logs - levels) / widths).min(axis=1)])


def _logs(squares: NDArray[np.floating]) -> Floats:
    """Logarithms of squared distances, finite for those that rounding made negative and for infinite ones."""
    limits = np.finfo(np.float32)
    return np.asarray(np.log(np.clip(squares, limits.tiny, limits.max)), np.float64)


def log_conflict(log_bets: Iterable[Floats]) -> float:
    """Log e-value of all touches of several objects: the mean over strategies of their wealth."""
    total = sum(log_bets, start=np.zeros(1))
    largest = total.max()
    return float(largest + np.log(np.exp(total - largest).mean()))


def continued_bets(log_bets: ArrayLike, like: ArrayLike | None) -> Floats:
    """Log wealth ``(J,)`` with which a search begins if it continues the test of an earlier one.

    ``log_bets`` are :attr:`belief.SceneView.log_bets` of the earlier search, or 0.0; ``like`` has the shape of an
    object's log bets, or is None for a model without a test.
    """
    given, wanted = np.asarray(log_bets, np.float64), np.zeros(1) if like is None else np.zeros(np.shape(like))
    if given.shape not in ((), wanted.shape) or not np.isfinite(given).all():
        raise ValueError(
            f"log_bets must be {len(wanted)} finite numbers, from an earlier search with the same observation model, "
            f"got {given.tolist()}"
        )
    return frozen(wanted + given)


def _bets(logs: Floats, step: int) -> Floats:
    """Log factors of the wealth of each strategy, ``(12,)``."""
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


def _share(correlation: float, number: int) -> float:
    """Factor by which the sum of so many earlier scores predicts the next one."""
    return float(correlation / (1.0 + (number - 1) * correlation)) if number > 0 else 0.0


@lru_cache
def _ranks(number: int) -> NDArray[np.int64]:
    """Ranks from 1 to ``number`` that are kept: dense near both ends."""
    half = np.unique(np.geomspace(1, max(1, number // 2), _QUANTILES).round().astype(np.int64))
    return np.unique(np.concatenate([half, number + 1 - half]))


def _single(array: Floats) -> Floats:
    return array.astype(np.float32).astype(np.float64)
