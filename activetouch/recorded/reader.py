"""A reader of recorded touches: from features to calibrated log likelihood ratios, with a classifier for each action.

The classifiers are discriminants; each action's is chosen by cross-validation, by the negative log-likelihood after
temperature scaling. Features are standardised by their spread within labels.

Labels may have different numbers of touches, and the classifiers take all as equally probable. The calibration is a
structured matrix, which learns the labels' shares, or a temperature with more than 30 labels, and for categories and
shapes: the touches of an object err alike, so that a matrix learns from a few objects of each. The ratios are without
the shares. What correlations are fitted to is calibrated by other sessions (decision 0073).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from activetouch.recorded.touches import LARGEST, TASKS, RecordedTouches, Split
from belief.calibration import Calibration, PerPose, StructuredMatrixScaling, TemperatureScaling
from belief.errors import InvalidArgument
from belief.metrics import negative_log_likelihood
from belief.naming import few
from belief.observation_model.action_kernel import ActionKernelModel
from belief.validation import Floats, as_real, require

Integers = NDArray[np.int64]

_MANY_LABELS = 30  # beyond, touches are too few to calibrate single labels
_POOLING = 20.0  # touches that the calibration of all actions counts as in that of each
_LEAST_SPREAD = 1e-3  # of a feature's spread, so that a feature that is constant within labels does not dominate
_LEAST_VARIANCE = 1e-9  # so that constant features have one


@dataclass(eq=False)
class LinearDiscriminants:
    """A classifier with scikit-learn's interface: discriminants with a shrunk pooled covariance.

    With normal distributions they equal scikit-learn's ``LinearDiscriminantAnalysis(solver="lsqr", shrinkage=s)`` for
    labels with equally many touches, but shrink one pooled covariance instead of one for each label, which is much
    faster with a hundred labels.

    Attributes:
        shrinkage: weight of the diagonal part, the mean variance, in the covariance; in [0, 1].
        is_heavy: whether labels have heavy tails, as Student's t distributions, instead of normal ones. Touches far
            from all labels then tell little; normal distributions overstate what such touches tell.
        classes_: the labels, K.
        centre: mean of the features, ``(F,)``.
        basis: of the span of the touches, ``(F, D)``, where there are fewer than features; otherwise None, and D = F.
        factor: lower triangle of the covariance, ``(D, D)``.
        means: of the labels, whitened, ``(K, D)``.
        least: variance outside the span.

    >>> rows = np.array([[0.0, 0.1], [0.1, 0.0], [1.0, 1.1], [1.1, 1.0]])
    >>> LinearDiscriminants(0.5).fit(rows, np.array([0, 0, 3, 3])).decision_function(rows).argmax(axis=1).tolist()
    [0, 0, 1, 1]
    """

    shrinkage: float
    is_heavy: bool = False
    classes_: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    centre: Floats = field(default_factory=lambda: np.empty(0))
    factor: Floats = field(default_factory=lambda: np.empty((0, 0)))
    means: Floats = field(default_factory=lambda: np.empty((0, 0)))
    basis: Floats | None = None
    least: float = _LEAST_VARIANCE

    def fit(self, features: Floats, labels: NDArray[np.int64]) -> LinearDiscriminants:
        """Learn from features ``(n, F)`` with labels ``(n,)``."""
        self.classes_, number, counts = np.unique(labels, return_inverse=True, return_counts=True)
        self.centre, self.basis = features.mean(axis=0), None
        inside = features - self.centre
        if len(features) < features.shape[1]:  # the same result in the span of the touches, in which the means differ
            self.basis = np.linalg.qr(inside.T)[0]
            inside = inside @ self.basis
        means = np.zeros((len(counts), inside.shape[1]))
        np.add.at(means, number, inside)
        means /= counts[:, None]
        rest = inside - means[number]
        variance = (rest**2).sum() / rest.shape[0] / features.shape[1]
        covariance = (1.0 - self.shrinkage) * (rest.T @ rest) / len(rest)
        self.least = self.shrinkage * variance + _LEAST_VARIANCE
        covariance[np.diag_indices_from(covariance)] += self.least
        self.factor = np.asarray(np.linalg.cholesky(covariance), np.float64)
        self.means = solve_triangular(self.factor, means.T, lower=True).T
        return self

    def decision_function(self, features: Floats) -> Floats:
        """Log density of each label up to a constant of each row, ``(n, K)``."""
        inside, outside = features - self.centre, np.zeros(len(features))
        if self.basis is not None:
            norms = (inside**2).sum(axis=1)
            inside = inside @ self.basis
            outside = np.maximum(norms - (inside**2).sum(axis=1), 0.0) / self.least
        rows = solve_triangular(self.factor, inside.T, lower=True).T
        squares = (rows**2).sum(axis=1)[:, None] - 2.0 * rows @ self.means.T + (self.means**2).sum(axis=1)
        if not self.is_heavy:
            return np.asarray(-0.5 * squares)
        size = features.shape[1]
        return np.asarray(-0.5 * size * np.log1p((np.maximum(squares, 0.0) + outside[:, None]) / size))


KINDS: Mapping[str, LinearDiscriminants] = MappingProxyType(
    {
        f"{'heavy-tailed' if is_heavy else 'linear'} discriminants, shrinkage {s}": LinearDiscriminants(s, is_heavy)
        for is_heavy in (False, True)
        for s in (0.1, 0.3, 0.6)
    }
)
"""The classifiers to choose from, not fitted, by name."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A classifier with the scaling of its features.

    Attributes:
        centre, scale: of the features, ``(F,)``.
        classifier: fitted to scaled features.
        num_labels: K.
    """

    centre: Floats
    scale: Floats
    classifier: LinearDiscriminants
    num_labels: int

    @classmethod
    def of(cls, kind: LinearDiscriminants, features: Floats, labels: Integers, num_labels: int) -> Fitted:
        """Scale the features and fit a classifier."""
        known, number = np.unique(labels, return_inverse=True)
        means = np.array([features[number == k].mean(axis=0) for k in range(len(known))])
        scale = np.sqrt(((features - means[number]) ** 2).mean(axis=0)) + _LEAST_SPREAD * features.std(axis=0)
        centre, scale = features.mean(axis=0), np.where(scale > 0.0, scale, 1.0)
        return cls(centre, scale, replace(kind).fit((features - centre) / scale, labels), num_labels)

    def logits(self, features: Floats) -> Floats:
        """Scores ``(n, K)`` of features ``(n, F)``; the lowest of its row for labels that the training lacked."""
        scores = self.classifier.decision_function((features - self.centre) / self.scale)
        found = np.repeat(scores.min(axis=1, keepdims=True), self.num_labels, axis=1)
        found[:, self.classifier.classes_] = scores
        return found


@dataclass(frozen=True, eq=False)
class RecordedReader:
    """A classifier and a calibration for each action.

    Attributes:
        classifiers: of each action.
        calibration: of the logits, per action.
        log_prior: log share of each label that the calibration has learned, equal for a temperature, ``(K,)``.
        chosen: name of each action's kind of classifier.
        label_names, action_names: of the K labels and P actions.
        feature_names: F names, or none.
    """

    classifiers: tuple[Fitted, ...]
    calibration: PerPose
    log_prior: Floats
    chosen: tuple[str, ...]
    label_names: tuple[str, ...]
    action_names: tuple[str, ...]
    feature_names: tuple[str, ...] = ()

    @property
    def num_features(self) -> int:
        """F."""
        return len(self.classifiers[0].centre)

    def checked(self, features: ArrayLike, number: int) -> Floats:
        """Features as an array ``(number, F)`` that the reader can read.

        Raises:
            InvalidArgument: they have another shape, are not finite or larger than those of recordings may be.
        """
        rows = np.asarray(as_real(features, "features"), np.float64)
        if rows.shape != (number, self.num_features):
            names = f" ({few(self.feature_names)})" if self.feature_names else ""
            wanted = f"({number}, {self.num_features}), a row for each action"
            raise InvalidArgument(f"features{names} must be {wanted}; got {rows.shape}")
        wanted = f"a number that is not finite and of a size up to {LARGEST:g}"
        require(np.abs(rows) <= LARGEST, rows, "features", wanted)
        return rows

    def ratios(self, features: Floats, actions: Integers) -> Floats:
        """Log likelihood ratios log q(label | touch) - log π, ``(n, K)``, of features ``(n, F)`` by action ``(n,)``."""
        if not len(features):
            return np.empty((0, len(self.label_names)))
        logits = _logits(self.classifiers, features, actions)
        return np.asarray(self.calibration.predict_log_proba(logits, actions) - self.log_prior)


@dataclass(frozen=True, eq=False)
class Reading:
    """A fitted reader, and the log likelihood ratios of touches that it did not learn from.

    Attributes:
        reader: fitted to the training and calibration touches.
        calibration_rows: of the set, ``(c,)``.
        calibration_ratios: their log likelihood ratios, ``(c, K)``; neither the classifiers nor the calibration of
            each learned from it.
        test_ratios: those of the test touches, ``(t, K)``.
    """

    reader: RecordedReader
    calibration_rows: Integers
    calibration_ratios: Floats
    test_ratios: Floats

    def model(self, touches: RecordedTouches, repeats: int | None = None) -> ActionKernelModel:
        """The observation model that is fitted to the calibration touches.

        Args:
            touches: the set that was read.
            repeats: number of different touches of an object with an action; None if every touch is a new one.
        """
        rows = self.calibration_rows
        return ActionKernelModel.fit(
            touches.labelled(rows, self.calibration_ratios).batch.sequence(0),
            touches.labels[rows],
            touches.objects[rows],
            sessions=touches.sessions_of(rows),
            shape_labels=touches.label_names,
            num_poses=touches.num_actions,
            repeats=repeats,
        )


def read(touches: RecordedTouches, split: Split) -> Reading:
    """Fit a reader to a split, and read the calibration and test touches.

    The calibration touches are read by classifiers that learned from the training touches. The classifiers of the
    result learn from both. So the calibration knows touches that were recorded after those that were learned from, as
    test touches are: in order of recording, the gap between learning and reading is one share of the sessions in both.

    Args:
        touches: the set.
        split: what to learn from, to calibrate on and to test on.
    """
    features, num_labels = touches.features, len(touches.label_names)
    num_actions = touches.num_actions
    x, y, a = features[split.train], touches.labels[split.train], touches.actions[split.train]
    held, chosen = np.zeros((len(x), num_labels)), list[str]()
    for action in range(num_actions):
        here = np.flatnonzero(a == action)
        tried = {name: _held_out(kind, x[here], y[here], split.inner[here], num_labels) for name, kind in KINDS.items()}
        losses = {name: _loss(logits, y[here]) for name, logits in tried.items()}
        chosen.append(min(losses, key=lambda name: losses[name]))
        held[here] = tried[chosen[-1]]

    def learned(rows: Integers) -> tuple[Fitted, ...]:
        parts = [rows[touches.actions[rows] == action] for action in range(num_actions)]
        return tuple(
            Fitted.of(KINDS[name], features[part], touches.labels[part], num_labels)
            for name, part in zip(chosen, parts, strict=True)
        )

    rows, logits = split.train, held
    if len(split.calibration):
        rows = split.calibration
        logits = _logits(learned(split.train), features[rows], touches.actions[rows])
    knows_labels = touches.task == TASKS[0] and num_labels <= _MANY_LABELS
    kind = StructuredMatrixScaling() if knows_labels else TemperatureScaling()
    ratios = _cross_calibrated(kind, touches, rows, logits, split.folds)
    calibration, log_prior = _calibrated(kind, touches, rows, logits)
    classifiers = learned(np.concatenate([split.train, split.calibration]))
    names = touches.label_names, touches.action_names, touches.feature_names
    reader = RecordedReader(classifiers, calibration, log_prior, tuple(chosen), *names)
    return Reading(reader, rows, ratios, reader.ratios(features[split.test], touches.actions[split.test]))


def _cross_calibrated(
    kind: Calibration, touches: RecordedTouches, rows: Integers, logits: Floats, folds: Integers
) -> Floats:
    """Log likelihood ratios of touches, ``(c, K)``, each by a calibration of the other folds."""
    ratios = np.empty_like(logits)
    for fold in np.unique(folds).tolist():
        held = folds == fold
        calibration, log_prior = _calibrated(kind, touches, rows[~held], logits[~held])
        ratios[held] = calibration.predict_log_proba(logits[held], touches.actions[rows[held]]) - log_prior
    return ratios


def _calibrated(kind: Calibration, touches: RecordedTouches, rows: Integers, logits: Floats) -> tuple[PerPose, Floats]:
    """A calibration of each action, and the log shares of the labels in it."""
    labels, num_labels = touches.labels[rows], logits.shape[1]
    calibration = PerPose(kind, _POOLING).fit(logits, labels, touches.actions[rows], touches.num_actions)
    learns_shares = isinstance(kind, StructuredMatrixScaling)
    counts = np.bincount(labels, minlength=num_labels) + 0.5 if learns_shares else np.ones(num_labels)
    return calibration, np.log(counts / counts.sum())


def _logits(classifiers: tuple[Fitted, ...], features: Floats, actions: Integers) -> Floats:
    found = np.zeros((len(features), classifiers[0].num_labels))
    for action in np.unique(actions).tolist():
        here = actions == action
        found[here] = classifiers[action].logits(features[here])
    return found


def _held_out(
    kind: LinearDiscriminants, features: Floats, labels: Integers, folds: Integers, num_labels: int
) -> Floats:
    """Logits of touches by classifiers that learned from the other folds, ``(n, K)``."""
    found = np.zeros((len(features), num_labels))
    for fold in np.unique(folds).tolist():
        held = folds == fold
        if len(np.unique(labels[~held])) > 1:
            found[held] = Fitted.of(kind, features[~held], labels[~held], num_labels).logits(features[held])
    return found


def _loss(logits: Floats, labels: Integers) -> float:
    return negative_log_likelihood(TemperatureScaling().fit(logits, labels).predict_proba(logits), labels)
