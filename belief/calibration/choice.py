"""Choice of a calibration by cross-validation on whole objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief.calibration.base import Calibration, checked_weights, no_probs
from belief.calibration.table import CALIBRATIONS
from belief.cross_validation import losses_table, object_folds
from belief.table import Table, Tabular
from belief.validation import labelled_logits, require_count


@dataclass(frozen=True, eq=False)
class Choice(Tabular):
    """Result of :func:`choose_calibration`; prints as a table.

    >>> logits, labels = [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.0, 2.0]], [0, 1, 0, 1]
    >>> choice = choose_calibration(logits, labels, object_ids=[1, 2, 3, 4], num_folds=2)
    >>> choice.losses[choice.name] == min(choice.losses.values())
    True

    Attributes:
        calibration: the best candidate, fitted to all data.
        name: its name among the candidates.
        losses: mean cross-validated NLL of a touch [nats], by candidate.
    """

    calibration: Calibration
    name: str
    losses: Mapping[str, float]

    def table(self) -> Table:
        """The losses of the candidates, the least first."""
        return losses_table("calibration", self.losses, self.name)


def choose_calibration(
    logits: ArrayLike,
    labels: ArrayLike,
    object_ids: ArrayLike,
    candidates: Mapping[str, Calibration] | None = None,
    num_folds: int = 5,
    weights: ArrayLike | None = None,
) -> Choice:
    """The candidate with the least cross-validated NLL; the first of equal ones.

    Folds consist of whole objects, because touches of one object have correlated errors, and depend only on the ids.

    Args:
        logits: ``(n, K)``.
        labels: true shape indices, ``(n,)``.
        object_ids: object of each touch, ``(n,)``.
        candidates: unfitted calibrations by name; by default one of each class in :data:`CALIBRATIONS`.
        num_folds: from 2 to the number of objects.
        weights: as of :meth:`Calibration.fit`; also of the loss.

    Raises:
        ValueError: invalid logits or labels, no candidates, more folds than objects, or an object with two shapes.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> labels = np.arange(2000) % 2
        >>> logits = 2.0 * np.eye(2)[labels] + rng.normal(size=(2000, 2)) - [0.0, 1.5]  # biased against the second
        >>> choice = choose_calibration(logits, labels, object_ids=np.arange(2000))
        >>> print(choice)
        calibration        NLL [nats]  chosen
        ─────────────────────────────────────
        vector                 0.1929  yes
        structured_matrix      0.1930
        dirichlet              0.1972
        temperature            0.3661
    """
    z, y = labelled_logits(no_probs(logits), labels)
    if candidates is None:
        candidates = {name: kind() for name, kind in CALIBRATIONS.items()}
    if not candidates:
        raise ValueError(f"no candidates to choose from; try {', '.join(CALIBRATIONS)}")
    require_count("num_folds", num_folds, least=2)
    folds = object_folds(y, object_ids, num_folds)
    w = np.ones(len(y)) if weights is None else checked_weights(weights, len(y))
    losses = {}
    for name, candidate in candidates.items():
        at_label = np.empty(len(y))
        for fold in range(num_folds):
            held = folds == fold
            kept = ~held & (w > 0.0)
            fitted = candidate.fit_logits(z[kept], y[kept], None if weights is None else w[kept])
            at_label[held] = fitted.log_proba_of(z[held])[np.arange(held.sum()), y[held]]
        with np.errstate(over="ignore"):  # the mean of values near -1e308
            losses[name] = -float(np.average(at_label, weights=w))
    best = min(losses, key=losses.__getitem__)
    every = w > 0.0
    return Choice(candidates[best].fit_logits(z[every], y[every], None if weights is None else w[every]), best, losses)
