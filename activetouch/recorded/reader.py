"""A reader of recorded touches: from features to calibrated log likelihood ratios, with a classifier for each action.

The classifiers are discriminants; each action's is chosen by cross-validation, by the negative log-likelihood after
temperature scaling. Features are standardised by their spread within labels.

Labels may have different numbers of touches, and the classifiers take all as equally probable. The calibration is a
structured matrix, which learns the labels' shares, or a temperature with more than 30 labels, and for categories and
shapes: the touches of an object err alike, so that a matrix learns from a few objects of each. The ratios are without
the shares. What correlations are fitted to is calibrated by other sessions (decision 0042).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from activetouch.errors import BadRecording
from activetouch.recorded.touches import LARGEST, TASKS, RecordedTouches, Split
from belief.calibration import (
    Calibration,
    PerPose,
    StructuredMatrixScaling,
    TemperatureScaling,
    logits_from_probs,
)
from belief.errors import BrokenContract, InvalidArgument
from belief.metrics import negative_log_likelihood
from belief.naming import few
from belief.observation_model.action_kernel import ActionKernelModel
from belief.validation import Floats, as_real, require

Integers = NDArray[np.int64]

_MANY_LABELS = 30  # beyond, touches are too few to calibrate single labels
_POOLING = 20.0  # touches that the calibration of all actions counts as in that of each
_LEAST_SPREAD = 1e-3  # share of a feature's spread, so that a feature that is constant within labels does not dominate
_LEAST_VARIANCE = 1e-9  # so that constant features have one


@dataclass(eq=False)
class LinearDiscriminants:
    """A classifier with scikit-learn's interface: discriminants with a shrunk pooled covariance.

    With normal distributions and labels with equally many touches they equal scikit-learn's
    ``LinearDiscriminantAnalysis(solver="lsqr", shrinkage=s)``, but one covariance is shrunk instead of one for each
    label, which is much faster with a hundred labels. ``shrinkage`` is the weight of the diagonal part, the mean
    variance. With ``is_heavy``, labels have tails as Student's t: touches far from all labels then tell little.
    ``basis (F, D)`` spans the touches where they are fewer than features; otherwise None, and D = F. ``factor (D, D)``
    is the lower triangle of the covariance, ``means (K, D)`` are whitened, ``least`` is the variance outside the span.

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
        variance = float((rest**2).sum()) / rest.shape[0] / features.shape[1] or 1.0  # for one touch of each label
        covariance = (1.0 - self.shrinkage) * (rest.T @ rest) / len(rest)
        self.least = self.shrinkage * variance + _LEAST_VARIANCE
        covariance[np.diag_indices_from(covariance)] += self.least
        self.factor = np.asarray(np.linalg.cholesky(covariance), np.float64)
        self.means = solve_triangular(self.factor, means.T, lower=True).T
        return self

    def distances(self, features: Floats) -> tuple[Floats, Floats]:
        """Squared distance to each label within the span, ``(n, K)``, and that outside, ``(n,)``; rows ``(n, F)``."""
        inside, outside = features - self.centre, np.zeros(len(features))
        if self.basis is not None:
            norms = (inside**2).sum(axis=1)
            inside = inside @ self.basis
            outside = np.maximum(norms - (inside**2).sum(axis=1), 0.0) / self.least
        rows = solve_triangular(self.factor, inside.T, lower=True).T
        return (rows**2).sum(axis=1)[:, None] - 2.0 * rows @ self.means.T + (self.means**2).sum(axis=1), outside

    def decision_function(self, features: Floats) -> Floats:
        """Log density of each label up to a constant of each row, ``(n, K)``."""
        squares, outside = self.distances(features)
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


@dataclass(eq=False)
class GivenLogits:
    """A classifier of features that are logits; column ``columns[k]`` is that of label k. Nothing is learned."""

    columns: NDArray[np.int64]
    classes_: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def of(cls, touches: RecordedTouches) -> GivenLogits:
        """The classifier of a set with features named as its labels; raises BadRecording where a label has none."""
        names, labels = touches.feature_names, touches.label_names
        if lacking := [label for label in labels if label not in names]:
            raise BadRecording(
                f"--logits takes a feature of the name of each of the {touches.task}, and {few(lacking)} have none; "
                f"the features are {few(names, 12) or 'without names: give the array feature_names'}"
            )
        return cls(np.array([names.index(label) for label in labels]))

    def fit(self, features: Floats, labels: NDArray[np.int64]) -> GivenLogits:
        """Return itself: all labels are known, whatever was touched."""
        self.classes_ = np.arange(len(self.columns))
        return self

    def decision_function(self, features: Floats) -> Floats:
        """The logits."""
        return features[:, self.columns]


@dataclass(eq=False)
class OwnClassifier:
    """A user's classifier with ``fit`` and ``predict_log_proba`` or ``predict_proba``, as in scikit-learn."""

    own: Any
    classes_: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    floor: float = 1e-12

    def fit(self, features: Floats, labels: NDArray[np.int64]) -> OwnClassifier:
        """Learn; the least probability is half a touch of all, because zeros have no logarithm."""
        self._call("fit", features, labels)
        self.classes_, self.floor = np.unique(labels), 0.5 / (1.0 + len(labels))
        return self

    def decision_function(self, features: Floats) -> Floats:
        """Logarithms of its probabilities."""
        has_logs = hasattr(self.own, "predict_log_proba")
        found = self._call("predict_log_proba" if has_logs else "predict_proba", features)
        rows, wanted = np.asarray(found, np.float64), (len(features), len(self.classes_))
        probs = np.exp(rows) if has_logs else rows
        if rows.shape != wanted or not np.all((probs >= 0.0) & (probs <= 1.001)):
            raise BrokenContract(f"{self.own!r:.80} must give probabilities {wanted}, got {rows.shape}: {rows!r:.80}")
        return logits_from_probs(probs, self.floor)

    def _call(self, name: str, *arguments: Any) -> Any:
        try:
            return getattr(self.own, name)(*arguments)
        except Exception as error:
            raise BrokenContract(f"{self.own!r:.80}.{name} failed on {len(arguments[0])} touches: {error!r}") from error


Classifier: TypeAlias = LinearDiscriminants | GivenLogits | OwnClassifier


@dataclass(frozen=True, eq=False)
class Fitted:
    """A classifier fitted to scaled features ``(n, F)``, with their centre and scale ``(F,)``, and K.

    ``usual``, the classifier itself if it is a discriminant, measures the distance of touches from the training's.
    """

    centre: Floats
    scale: Floats
    classifier: Classifier
    num_labels: int
    usual: LinearDiscriminants

    @classmethod
    def of(cls, kind: Classifier, features: Floats, labels: Integers, num_labels: int) -> Fitted:
        """Scale the features and fit a classifier."""
        known, number = np.unique(labels, return_inverse=True)
        means = np.array([features[number == k].mean(axis=0) for k in range(len(known))])
        spread = np.sqrt(((features - means[number]) ** 2).mean(axis=0))
        scale = spread + (_LEAST_SPREAD if spread.any() else 1.0) * features.std(axis=0)
        centre, scale = features.mean(axis=0), np.where(scale > 0.0, scale, 1.0)
        if isinstance(kind, GivenLogits):
            centre, scale = np.zeros_like(centre), np.ones_like(scale)
        rows = (features - centre) / scale
        made = deepcopy(kind).fit(rows, labels)
        usual = made if isinstance(made, LinearDiscriminants) else LinearDiscriminants(0.3).fit(rows, labels)
        return cls(centre, scale, made, num_labels, usual)

    def logits(self, features: Floats) -> Floats:
        """Scores ``(n, K)`` of features ``(n, F)``; the lowest of its row for labels that the training lacked."""
        scores = self.classifier.decision_function((features - self.centre) / self.scale)
        found = np.repeat(scores.min(axis=1, keepdims=True), self.num_labels, axis=1)
        found[:, self.classifier.classes_] = scores
        return found

    def novelty(self, features: Floats) -> Floats:
        """Log distance to the nearest label, ``(n,)``, of features ``(n, F)``; at most 100."""
        with np.errstate(over="ignore", invalid="ignore"):
            squares, outside = self.usual.distances((features - self.centre) / self.scale)
            found = np.log(np.maximum(squares.min(axis=1), 0.0) + outside + _LEAST_VARIANCE)
        return np.fmin(found, 100.0)


@dataclass(frozen=True, eq=False)
class RecordedReader:
    """A classifier and a calibration for each action.

    ``log_prior (K,)`` is the log share of each label in the calibration, equal for a temperature; ``chosen`` names each
    action's classifier. ``usual (P, 2)`` are median and width of the novelty of touches with each action. The array
    ``blank``, ``(2, F)``, is the row of no contact, and weights so that rows at a distance of up to one are taken for
    it. Both are empty in files of older versions.
    """

    classifiers: tuple[Fitted, ...]
    calibration: PerPose
    log_prior: Floats
    chosen: tuple[str, ...]
    label_names: tuple[str, ...]
    action_names: tuple[str, ...]
    feature_names: tuple[str, ...] = ()
    usual: Floats = field(default_factory=lambda: np.empty((0, 2)))
    blank: Floats = field(default_factory=lambda: np.empty((2, 0)))

    @property
    def num_features(self) -> int:
        """F."""
        return len(self.classifiers[0].centre)

    def checked(self, features: ArrayLike, number: int) -> Floats:
        """Features as an array ``(number, F)`` that the reader can read."""
        rows = np.asarray(as_real(features, "features"), np.float64)
        if rows.shape != (number, self.num_features):
            names = f" ({few(self.feature_names)})" if self.feature_names else ""
            wanted = f"({number}, {self.num_features}), a row for each action"
            raise InvalidArgument(f"features{names} must be {wanted}; got {rows.shape}")
        wanted = f"a number that is not finite and of a size up to {LARGEST:g}"
        require(np.abs(rows) <= LARGEST, rows, "features", wanted)
        return rows

    def ratios(self, features: Floats, actions: Integers) -> Floats:
        """Log likelihood ratios log q(label | touch) - log π, ``(n, K)``, of features ``(n, F)`` by action ``(n,)``.

        They are 0 for a label that was never touched with the action.
        """
        if not len(features):
            return np.empty((0, len(self.label_names)))
        logits = label_logits(self.classifiers, features, actions)
        return _without_unknown(
            self.calibration.predict_log_proba(logits, actions) - self.log_prior, actions, _known(self.classifiers)
        )

    def novelties(self, features: Floats, actions: Integers) -> Floats:
        """Distance of touches from all labels, relative to other touches with their action, ``(n,)``."""
        found = _by_action(self.classifiers, features, actions, Fitted.novelty)
        return np.asarray((found - self.usual[actions, 0]) / self.usual[actions, 1])

    def is_blank(self, row: Floats) -> bool:
        """Whether a row ``(F,)`` could be one of no contact."""
        nothing, weights = self.blank
        return bool(nothing.size and (((row - nothing) * weights) ** 2).sum() <= 1.0)


@dataclass(frozen=True, eq=False)
class Reading:
    """A reader fitted to the training and calibration touches, and its results for touches that it did not learn from.

    These are the log likelihood ratios of the rows of calibration, ``(c, K)``, from which neither the classifiers nor
    the calibration of each learned, their novelties ``(c,)``, and the ratios of the test touches, ``(t, K)``.
    """

    reader: RecordedReader
    calibration_rows: Integers
    calibration_ratios: Floats
    novelties: Floats
    test_ratios: Floats

    def model(self, touches: RecordedTouches, repeats: int | None = None) -> ActionKernelModel:
        """The observation model fitted to the calibration touches; ``repeats`` as in :class:`ActionKernelModel`."""
        rows = self.calibration_rows
        return ActionKernelModel.fit(
            touches.labelled(rows, self.calibration_ratios, self.novelties).batch.sequence(0),
            touches.labels[rows],
            touches.objects[rows],
            sessions=touches.sessions_of(rows),
            shape_labels=touches.label_names,
            num_poses=touches.num_actions,
            repeats=repeats,
            is_tested=repeats is None,
        )


def read(touches: RecordedTouches, split: Split, kinds: Mapping[str, Classifier] | None = None) -> Reading:
    """Fit a reader to a split, and read the calibration and test touches; classifiers are from ``kinds``, or KINDS.

    The calibration touches are read by classifiers of the training touches; those of the result learn from both. So
    calibration, as the test, is on touches that were recorded after those that were learned from: in order of
    recording, the gap between learning and reading is one share of the sessions in both.
    """
    kinds, features, num_labels = kinds or KINDS, touches.features, len(touches.label_names)
    num_actions = touches.num_actions
    x, y, a = features[split.train], touches.labels[split.train], touches.actions[split.train]
    held, novelties, chosen = np.zeros((len(x), num_labels)), np.zeros(len(x)), list[str]()
    is_crossed, is_across = not len(split.calibration), not len(split.inner)
    made = {n: learn(touches, features, split.train, [k] * num_actions) for n, k in kinds.items() if is_across}
    for action in range(num_actions):
        here = np.flatnonzero(a == action)
        truth, known = y[here], split.calibration[touches.actions[split.calibration] == action]
        if is_across:
            truth = touches.labels[known]
            tried = {name: some[action].logits(features[known]) for name, some in made.items()}
        else:
            part = x[here], truth, num_labels, split.inner[here]
            tried = {name: _held_out(kind, *part, Fitted.logits) for name, kind in kinds.items()}
        losses = {name: _loss(logits, truth) for name, logits in tried.items()}
        chosen.append(min(losses, key=lambda name: losses[name]))
        if is_crossed:
            held[here] = tried[chosen[-1]]
            novelties[here] = _held_out(kinds[chosen[-1]], *part, Fitted.novelty)

    def learned(rows: Integers) -> tuple[Fitted, ...]:
        return learn(touches, features, rows, [kinds[name] for name in chosen])

    rows, logits = split.train, held
    if not is_crossed:
        rows, classifiers = split.calibration, learned(split.train)
        logits = label_logits(classifiers, features[rows], touches.actions[rows])
        novelties = _by_action(classifiers, features[rows], touches.actions[rows], Fitted.novelty)
    knows_labels = touches.task == TASKS[0] and num_labels <= _MANY_LABELS
    knows_labels &= len(np.unique(touches.labels[rows])) == num_labels
    kind = StructuredMatrixScaling() if knows_labels else TemperatureScaling()
    if not is_across:
        classifiers = learned(np.concatenate([split.train, split.calibration]))
    ratios = _cross_calibrated(kind, touches, rows, logits, split.folds)
    ratios = _without_unknown(ratios, touches.actions[rows], _known(classifiers))
    calibration, log_prior = _calibrated(kind, touches, rows, logits)
    names = touches.label_names, touches.action_names, touches.feature_names
    usual = _usual(novelties, touches.actions[rows], num_actions)
    reader = RecordedReader(classifiers, calibration, log_prior, tuple(chosen), *names, usual, _blank(touches))
    novelties = (novelties - usual[touches.actions[rows], 0]) / usual[touches.actions[rows], 1]
    test_ratios = reader.ratios(features[split.test], touches.actions[split.test])
    return Reading(reader, rows, ratios, novelties, test_ratios)


def kinds_of(touches: RecordedTouches, classifier: Any, is_logits: bool) -> Mapping[str, Classifier]:
    """The classifiers to choose from: ours, a user's own, or none where the features are logits."""
    if is_logits and classifier is not None:
        raise InvalidArgument("logits are taken as they are: give a classifier or logits, not both")
    if is_logits:
        return {"logits as given": GivenLogits.of(touches)}
    if classifier is None:
        return KINDS
    if not hasattr(classifier, "fit") or not any(hasattr(classifier, f"predict_{n}") for n in ("proba", "log_proba")):
        raise InvalidArgument(f"a classifier has fit and predict_proba or predict_log_proba, got {classifier!r:.80}")
    return {f"{classifier!r:.80}": OwnClassifier(classifier)}


def learn(
    touches: RecordedTouches, features: Floats, rows: Integers, kinds: Sequence[Classifier]
) -> tuple[Fitted, ...]:
    """A classifier for each action from some rows of features; from all actions where it has none."""
    parts = [rows[touches.actions[rows] == action] for action in range(touches.num_actions)]
    return tuple(
        Fitted.of(kind, features[part], touches.labels[part], len(touches.label_names))
        for kind, part in zip(kinds, (part if len(part) else rows for part in parts), strict=True)
    )


def _usual(novelties: Floats, actions: Integers, num_actions: int) -> Floats:
    """Median and width of the novelties with each action, ``(P, 2)``; of all touches where an action has few."""
    found = []
    for action in range(num_actions):
        some = novelties[actions == action] if (actions == action).sum() > 4 else novelties
        low, median, high = np.quantile(some, [0.2, 0.5, 0.8])
        found.append((median, max(high - low, _LEAST_SPREAD)))
    return np.array(found)


def _blank(touches: RecordedTouches) -> Floats:
    """The row of no contact and the weights of its features, ``(2, F)``.

    The row is the mean of the ``untouched`` rows, or zeros. Rows within the distance of 98 of 100 of these are taken
    for it, but none beyond half the distance of the nearest hundredth of the touches.
    """
    known = touches.controls.get("untouched", np.zeros((1, 0)))
    known = known if known.shape[1] == touches.features.shape[1] else np.zeros((1, touches.features.shape[1]))
    nothing, spread = known.mean(axis=0), touches.features.std(axis=0)
    weights = 1.0 / np.where(spread > 0.0, spread, 1.0)
    touched, untouched = (
        np.sqrt((((rows - nothing) * weights) ** 2).sum(axis=1)) for rows in (touches.features, known)
    )
    radius = min(max(np.quantile(untouched, 0.98), 1e-3), np.quantile(touched, 0.01) / 2)
    return np.stack([nothing, weights / max(radius, 1e-9)])


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
    calibration = PerPose(kind, _POOLING).fit_logits(logits, labels, touches.actions[rows], touches.num_actions)
    learns_shares = isinstance(kind, StructuredMatrixScaling)
    counts = np.bincount(labels, minlength=num_labels) + 0.5 if learns_shares else np.ones(num_labels)
    return calibration, np.log(counts / counts.sum())


def _by_action(
    classifiers: Sequence[Fitted], features: Floats, actions: Integers, what: Callable[[Fitted, Floats], Floats]
) -> Floats:
    """Results of the classifier of each action for its touches: ``Fitted.logits`` or ``Fitted.novelty``."""
    found = np.zeros((len(features), *what(classifiers[0], features[:1]).shape[1:]))
    for action in np.unique(actions).tolist():
        here = actions == action
        found[here] = what(classifiers[action], features[here])
    return found


def label_logits(classifiers: Sequence[Fitted], features: Floats, actions: Integers) -> Floats:
    """Scores of touches by the classifiers of their actions, ``(n, K)``."""
    return _by_action(classifiers, features, actions, Fitted.logits)


def _known(classifiers: Sequence[Fitted]) -> NDArray[np.bool_]:
    """Which labels the classifier of each action has learned, ``(P, K)``."""
    found = np.zeros((len(classifiers), classifiers[0].num_labels), np.bool_)
    for row, fitted in zip(found, classifiers, strict=True):
        row[fitted.classifier.classes_] = True
    return found


def _without_unknown(ratios: Floats, actions: Integers, known: NDArray[np.bool_]) -> Floats:
    """Ratios ``(n, K)``, set to 0 for labels that an action has not learned."""
    return np.where(known[actions], ratios, 0.0)


def _held_out(
    kind: Classifier,
    features: Floats,
    labels: Integers,
    num_labels: int,
    folds: Integers,
    what: Callable[[Fitted, Floats], Floats],
) -> Floats:
    """Results for touches of classifiers that learned from the other folds."""
    found = np.zeros((len(features), num_labels) if what is Fitted.logits else len(features))
    for fold in np.unique(folds).tolist():
        held = folds == fold
        if len(np.unique(labels[~held])) > 1:
            found[held] = what(Fitted.of(kind, features[~held], labels[~held], num_labels), features[held])
    return found


def _loss(logits: Floats, labels: Integers) -> float:
    if not len(labels):
        return 0.0
    return negative_log_likelihood(TemperatureScaling().fit_logits(logits, labels).predict_proba(logits), labels)
