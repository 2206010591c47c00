"""Choose between calibrations by how well they predict objects they have not seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief.calibration.base import Calibration
from belief.calibration.inputs import labelled_logits
from belief.calibration.table import CALIBRATIONS
from belief.cross_validation import object_folds
from belief.validation import require_count


@dataclass(frozen=True, eq=False)
class Choice:
    """What :func:`choose_calibration` found.

    >>> logits, labels = [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.0, 2.0]], [0, 1, 0, 1]
    >>> choice = choose_calibration(logits, labels, object_ids=[1, 2, 3, 4], num_folds=2)
    >>> choice.losses[choice.name] == min(choice.losses.values())
    True

    Attributes:
        calibration: the best, fitted to all the data.
        name: its name among the candidates.
        losses: mean NLL of touches out of fold [nats] by candidate; also the others', so that a narrow win shows.
    """

    calibration: Calibration
    name: str
    losses: Mapping[str, float]


def choose_calibration(
    logits: ArrayLike,
    labels: ArrayLike,
    object_ids: ArrayLike,
    candidates: Mapping[str, Calibration] | None = None,
    num_folds: int = 5,
) -> Choice:
    """The candidate with the least cross-validated NLL; of equals, the first.

    Folds are made of whole objects (touches of one object err alike) and follow from the ids alone: no chance is in it.

    Args:
        logits: ``(n, K)``.
        labels: true shape indices, ``(n,)``.
        object_ids: which object each touch is of, ``(n,)``.
        candidates: unfitted calibrations by any names; by default one of each kind in :data:`CALIBRATIONS`. To choose
            a strength, enter one kind several times.
        num_folds: number of folds, at most the number of objects.

    Raises:
        ValueError: bad logits or labels, no candidates, more folds than objects, or an object of two shapes.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> labels = np.arange(2000) % 2
        >>> logits = 2.0 * np.eye(2)[labels] + rng.normal(size=(2000, 2)) - [0.0, 1.5]        # shy of the second
        >>> choice = choose_calibration(logits, labels, object_ids=np.arange(2000))
        >>> {name: round(loss, 3) for name, loss in choice.losses.items()}
        {'temperature': 0.366, 'vector': 0.193, 'structured_matrix': 0.193, 'dirichlet': 0.197}
        >>> choice.name
        'structured_matrix'
    """
    z, y = labelled_logits(logits, labels)
    if candidates is None:
        candidates = {name: kind() for name, kind in CALIBRATIONS.items()}
    if not candidates:
        raise ValueError(f"no candidates to choose from; try {', '.join(CALIBRATIONS)}")
    require_count("num_folds", num_folds, least=2)
    folds = object_folds(y, object_ids, num_folds)
    losses = {}
    for name, candidate in candidates.items():
        at_label = np.empty(len(y))
        for fold in range(num_folds):
            held = folds == fold
            fitted = candidate.fit(z[~held], y[~held])
            at_label[held] = fitted.predict_log_proba(z[held])[np.arange(held.sum()), y[held]]
        with np.errstate(over="ignore"):  # the mean of -1e308's
            losses[name] = -float(at_label.mean())
    best = min(losses, key=losses.__getitem__)
    return Choice(candidates[best].fit(z, y), best, losses)
