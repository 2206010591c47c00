"""Calibrations and observation models as estimators of scikit-learn, for pipelines, cross-validation and grid search.

Labels are of any kind: strings, numbers, booleans. Only this module needs scikit-learn, the extra ``recorded``. Keep
``calibration_.to_fields()`` and ``model_.to_json()`` in files: reading them runs no code, which loading a pickle does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration import CALIBRATIONS, Calibration
from belief.errors import InvalidArgument, MissingPackage, install_command
from belief.observation_model.registry import Fit
from belief.observation_model.selection import NUM_FOLDS, fit_observation_model, log_posteriors
from belief.touch_batch import TouchBatch, grouped
from belief.validation import Floats, require_choice

try:
    from sklearn.base import BaseEstimator, ClassifierMixin, MetaEstimatorMixin, clone
    from sklearn.model_selection import StratifiedGroupKFold, check_cv
    from sklearn.utils import _safe_indexing, column_or_1d, get_tags, indexable
    from sklearn.utils.multiclass import check_classification_targets
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError as error:
    raise MissingPackage(f"scikit-learn is not installed: {install_command('recorded')}") from error

__all__ = ["CalibratedClassifier", "ObservationModelClassifier"]


class _OverLogits(ClassifierMixin, MetaEstimatorMixin, BaseEstimator):
    """A classifier that is fitted to the logits which another gives to rows that it was not fitted to."""

    def predict(self, X: Any, **params: Any) -> NDArray[Any]:
        """The most probable label of each row, ``(n,)``; ``params`` are those of ``predict_proba``."""
        columns = self.predict_proba(X, **params).argmax(axis=1)
        return self.classes_[columns]

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.sparse = self.estimator is not None and get_tags(self.estimator).input_tags.sparse
        return tags

    def _labelled(self, X: Any, y: Any, groups: Any) -> tuple[Floats, NDArray[np.intp]]:
        """Logits ``(n, K)`` and labels ``(n,)``, which are columns of these."""
        X, y = validate_data(self, X, y) if self.estimator is None else indexable(X, y)
        y = column_or_1d(y, warn=True)
        check_classification_targets(y)
        self.classes_ = np.unique(y) if self.classes is None else np.asarray(self.classes)
        names = self.classes_.tolist()
        if unknown := {*y.tolist()}.difference(names):
            raise InvalidArgument(f"y has the label {unknown.pop()!r}, which is not in classes={names!r:.80}")
        if not len(y) or len(names) < 2:
            raise InvalidArgument(f"y has {len(y)} labels of {len(names)} class; name the others in classes=")
        column = {name: place for place, name in enumerate(names)}
        labels = np.array([column[label] for label in y.tolist()])
        if self.estimator is None:
            return self._scores(None, X), labels
        folds, logits = check_cv(self.cv, y, classifier=True), np.full((len(y), len(names)), np.nan)
        if groups is not None and isinstance(self.cv, int | None):
            folds = StratifiedGroupKFold(folds.get_n_splits())
        for kept, held in folds.split(X, y, groups):
            fitted = clone(self.estimator).fit(_safe_indexing(X, kept), y[kept])
            logits[held] = self._scores(fitted, _safe_indexing(X, held))
        self.floor_ = logits[np.isfinite(logits)].min(initial=0.0) - np.log(2.0)
        self.estimator_ = clone(self.estimator).fit(X, y)
        for name in ("n_features_in_", "feature_names_in_"):
            if hasattr(self.estimator_, name):
                setattr(self, name, getattr(self.estimator_, name))
        return np.where(logits == -np.inf, self.floor_, logits), labels

    def _scores(self, fitted: Any, X: Any) -> Floats:
        """Logits ``(n, K)`` of a fitted classifier, or X as such; -inf for what has no vote, or is not known."""
        names = self.classes_.tolist()
        known = names if fitted is None else fitted.classes_.tolist()
        if fitted is None or hasattr(fitted, "decision_function"):
            found = np.asarray(X if fitted is None else fitted.decision_function(X), float)
            if found.ndim == 1 or found.shape[1] == 1:  # log-odds of the second class
                found = np.stack([np.zeros(len(found)), found.ravel()], axis=1)
        else:
            probs = np.asarray(fitted.predict_proba(X), float)
            found = np.where(probs == 0.0, -np.inf, np.log(np.maximum(probs, 1e-12)))
        if found.shape[1] != len(known) or not {*known} <= {*names}:
            raise InvalidArgument(
                f"X has {found.shape[1]} columns of logits for {len(names)} classes; name the classes of all columns "
                "in classes=, or give an estimator if X holds features"
            )
        scores = np.full((len(found), len(names)), -np.inf)
        scores[:, [names.index(name) for name in known]] = found
        return scores

    def _read(self, X: Any) -> Floats:
        """Logits of new rows, ``(n, K)``."""
        check_is_fitted(self)
        if self.estimator is None:
            return self._scores(None, validate_data(self, X, reset=False))
        scores = self._scores(self.estimator_, X)
        return np.where(scores == -np.inf, self.floor_, scores)


class CalibratedClassifier(_OverLogits):
    """A classifier with calibrated probabilities, like ``CalibratedClassifierCV`` of scikit-learn.

    Args:
        estimator: the classifier. By default X holds the logits of one, a column for each class. Probabilities of
            zero, as of a forest, count as half of the least that was seen in the fit.
        calibration: a key of :data:`~belief.calibration.CALIBRATIONS`, or a calibration.
        classes: labels in the order of the columns; by default those of the fit, sorted.
        cv: folds that hold rows out, for the logits to which the calibration is fitted; as of scikit-learn.

    Attributes:
        calibration_: the fitted :class:`~belief.calibration.Calibration`.
        estimator_: the classifier, fitted to all rows.
        classes_: labels, ``(K,)``.

    >>> from sklearn.datasets import load_wine
    >>> from sklearn.naive_bayes import GaussianNB
    >>> X, y = load_wine(return_X_y=True)
    >>> fitted = CalibratedClassifier(GaussianNB(), "temperature").fit(X[:, :3], np.array(["a", "b", "c"])[y])
    >>> fitted.predict(X[:1, :3]).tolist(), fitted.predict_proba(X[:1, :3]).round(2).tolist()
    (['a'], [[0.78, 0.03, 0.19]])
    """

    def __init__(
        self,
        estimator: Any = None,
        calibration: str | Calibration = "structured_matrix",
        *,
        classes: Sequence[Any] | None = None,
        cv: Any = None,
    ) -> None:
        self.estimator, self.calibration, self.classes, self.cv = estimator, calibration, classes, cv

    def fit(self, X: Any, y: Any, groups: ArrayLike | None = None) -> Self:
        """Fit to rows ``(n, …)`` and labels ``(n,)``; rows of one of the ``groups (n,)`` are in one fold."""
        kind = self.calibration
        if isinstance(kind, str):
            require_choice("calibration", kind, tuple(CALIBRATIONS))
            kind = CALIBRATIONS[kind]()
        self.calibration_ = kind.fit(*self._labelled(X, y, groups))
        return self

    def predict_proba(self, X: Any) -> Floats:
        """Calibrated probabilities, ``(n, K)``."""
        logits = self._read(X)
        return self.calibration_.predict_proba(logits)


class ObservationModelClassifier(_OverLogits):
    """:func:`~belief.observation_model.fit_observation_model` as a classifier of objects that are touched repeatedly.

    Args:
        estimator: the classifier of single touches. By default X holds the logits of one, a column for each class.
        candidates, num_folds: as of :func:`~belief.observation_model.fit_observation_model`.
        classes, cv: as of :class:`CalibratedClassifier`.

    Attributes:
        model_, choice_: the observation model, and the :class:`~belief.observation_model.selection.ModelChoice`.
        estimator_, classes_: as of :class:`CalibratedClassifier`.

    >>> from belief.synthetic import random_model
    >>> rng, groups = np.random.default_rng(0), np.arange(400) // 4
    >>> source = random_model(rng, num_shapes=2, num_poses=1)
    >>> X = np.array([touch.logits for i in range(100) for touch in source.sample(i % 2, [0] * 4, rng)])
    >>> fitted = ObservationModelClassifier().fit(X, np.array(["mug", "ball"])[groups % 2], groups)
    >>> fitted.predict(X[:2]).tolist(), fitted.predict_proba(X[:2]).round(2).tolist()
    (['mug', 'ball'], [[0.16, 0.84], [0.88, 0.12]])
    >>> fitted.predict_proba(X[:2], groups[:2]).round(2).tolist()
    [[0.57, 0.43], [0.57, 0.43]]
    """

    def __init__(
        self,
        estimator: Any = None,
        candidates: Mapping[str, Fit] | None = None,
        *,
        num_folds: int = NUM_FOLDS,
        classes: Sequence[Any] | None = None,
        cv: Any = None,
    ) -> None:
        self.estimator, self.candidates, self.num_folds = estimator, candidates, num_folds
        self.classes, self.cv = classes, cv

    def fit(self, X: Any, y: Any, groups: ArrayLike | None = None, poses: ArrayLike | None = None) -> Self:
        """Fit to touches ``(n, …)`` with labels ``(n,)`` of objects ``groups (n,)`` in ``poses (n,)``.

        By default each row is an object of its own, and all poses are one.
        """
        logits, labels = self._labelled(X, y, groups)
        objects = np.arange(len(labels)) if groups is None else groups
        self.choice_ = fit_observation_model(
            logits,
            labels,
            objects,
            poses,
            shape_labels=[str(name) for name in self.classes_.tolist()],
            candidates=self.candidates,
            num_folds=self.num_folds,
        )
        self.model_ = self.choice_.model
        return self

    def predict_proba(self, X: Any, groups: ArrayLike | None = None, poses: ArrayLike | None = None) -> Floats:
        """Posterior under a uniform prior, ``(n, K)``: of each row alone, or of all rows of its one of ``groups``."""
        logits = self._read(X)
        batch = TouchBatch(np.asarray(np.zeros(len(logits), int) if poses is None else poses)[None], logits[None])
        probs = np.empty_like(logits)
        for some, rows in grouped(batch, np.arange(len(logits)) if groups is None else groups):
            probs[rows] = np.exp(log_posteriors(self.model_, some))[:, None]
        return probs
