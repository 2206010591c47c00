"""Choice of an observation model by cross-validated loss on sequences of touches of held-out objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import update
from belief.observation_model.calibration_data import object_folds
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import Fit, fits
from belief.problem import Touch
from belief.table import Table, Tabular
from belief.touch_batch import TouchBatch
from belief.validation import Floats, require_count

NUM_FOLDS = 5
"""Default number of folds of whole objects."""
_LONGEST = 12  # touches of a sequence


@dataclass(frozen=True, eq=False)
class ModelChoice(Tabular):
    """The chosen observation model, and the losses of all candidates; prints as a table.

    Attributes:
        name: of the chosen candidate, a key of ``losses``.
        model: fitted to all touches.
        losses: cross-validated sequence NLL of every candidate [nats]; the chosen one has the least.

    >>> from belief.synthetic import random_model
    >>> choice = ModelChoice("ratio", random_model(np.random.default_rng(0)), {"plda": 0.358, "ratio": 0.357})
    >>> print(choice)
    observation model  NLL [nats]  chosen
    ─────────────────────────────────────
    ratio                  0.3570  yes
    plda                   0.3580
    """

    name: str
    model: ArrayModel
    losses: Mapping[str, float]

    def table(self) -> Table:
        """The losses of the candidates, the least first."""
        ordered: list[tuple[str, float | None]] = [*sorted(self.losses.items(), key=lambda pair: pair[1])]
        rows = [(name, loss, "yes" if name == self.name else "") for name, loss in ordered or [(self.name, None)]]
        return Table("", ["observation model", ("NLL [nats]", ".4f", "nll"), ("chosen", "")], rows)


def log_posteriors(model: ArrayModel, batch: TouchBatch) -> Floats:
    """Log posterior after each sequence of touches of one object, under a uniform prior, ``(S, K)``.

    >>> from belief.synthetic import random_model
    >>> model = random_model(np.random.default_rng(0), num_shapes=2)
    >>> once, twice = (TouchBatch.of([[Touch(0, np.array([1.0, 0.0]))] * n]) for n in (1, 2))
    >>> np.exp(log_posteriors(model, once)).round(2).tolist(), np.exp(log_posteriors(model, twice)).round(2).tolist()
    ([[0.83, 0.17]], [[0.96, 0.04]])
    """
    log_likelihoods = model.log_likelihood_batch(batch)
    num_shapes = log_likelihoods.shape[1]
    return update(np.full(num_shapes, -np.log(num_shapes)), log_likelihoods)[0]


def log_posteriors_by_touch(model: ArrayModel, batch: TouchBatch) -> Floats:
    """Log posteriors after 1 to n touches of each sequence, under a uniform prior, ``(S, n, K)``.

    >>> from belief.synthetic import random_model
    >>> model = random_model(np.random.default_rng(0), num_shapes=2)
    >>> log_posteriors_by_touch(model, TouchBatch(np.zeros((3, 4), int), np.zeros((3, 4, 2)))).shape
    (3, 4, 2)
    """
    return np.stack([log_posteriors(model, batch.first(n)) for n in range(1, batch.num_touches + 1)], axis=1)


def grouped(batch: TouchBatch, groups: ArrayLike) -> Iterator[tuple[TouchBatch, NDArray[np.int64]]]:
    """Touches grouped into sequences, each in its original order.

    Args:
        batch: all touches as one sequence, n of them.
        groups: sequence of each touch, ``(n,)``; any labels.

    Yields:
        For each length, the sequences of that length and the rows of their touches, ``(S, length)``.

    >>> batch = TouchBatch(np.zeros((1, 5), int), np.zeros((1, 5, 2)))
    >>> [rows.tolist() for _, rows in grouped(batch, ["mug", "ball", "mug", "cup", "mug"])]
    [[[1], [3]], [[0, 2, 4]]]
    """
    _, index, sizes = np.unique(np.asarray(groups), return_inverse=True, return_counts=True)
    order, first = np.argsort(index, kind="stable"), np.concatenate([[0], sizes.cumsum()[:-1]])
    for size in np.unique(sizes).tolist():
        rows = order[first[sizes == size][:, None] + np.arange(size)]
        yield batch.take((0, rows)), rows


def _sequence_nll(
    model: ArrayModel, batch: TouchBatch, truth: NDArray[np.int64], objects: NDArray[np.generic]
) -> float:
    """Mean negative log posterior of the true shape after 1, 2, … touches of an object under a uniform prior [nats]."""
    _, owner = np.unique(objects, return_inverse=True)
    means = []
    for kind in (owner, owner * (int(batch.poses.max()) + 1) + batch.poses[0]):
        losses = []
        for some, rows in grouped(batch, kind):
            for n in range(1, min(some.num_touches, _LONGEST) + 1):
                found = log_posteriors(model, some.first(n))
                losses.append(-found[np.arange(len(found)), truth[rows[:, 0]]])
        means.append(np.concatenate(losses).mean())
    return float(np.mean(means))


def choose_observation_model(
    touches: Sequence[Touch],
    shapes: ArrayLike,
    object_ids: ArrayLike,
    *,
    shape_labels: Sequence[str],
    num_poses: int,
    candidates: Mapping[str, Fit] = MappingProxyType(fits()),
    num_folds: int = NUM_FOLDS,
) -> ModelChoice:
    """The candidate with the least loss on sequences of touches of held-out objects, fitted to all touches.

    The loss is the mean negative log posterior of the true shape after one touch, two, and so on, half of it over
    touches of an object in their order, half over touches in one pose; it is averaged over folds of whole objects.

    Args:
        touches: calibration touches.
        shapes: true shape of each, ``(n,)``.
        object_ids: object of each, ``(n,)``.
        shape_labels: names of the K shapes.
        num_poses: P.
        candidates: functions that fit a model, by name.
        num_folds: from 2 to the number of objects.

    Raises:
        ValueError: no candidates, ``num_folds`` is out of range, or as the candidates.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng = np.random.default_rng(0)
        >>> source, ids = random_model(rng, num_shapes=2, num_poses=2), np.arange(400) // 4
        >>> touches = [touch for i in range(100) for touch in source.sample(i % 2, [0, 1, 0, 1], rng)]
        >>> some = {name: fits()[name] for name in ("confusion", "ratio")}
        >>> choice = choose_observation_model(
        ...     touches, ids % 2, ids, shape_labels=("cube", "cone"), num_poses=2, candidates=some
        ... )
        >>> choice.name == min(choice.losses, key=choice.losses.get)
        True
    """
    if not candidates:
        raise ValueError("there are no candidates to choose from")
    require_count("num_folds", num_folds, least=2)
    truth, ids, batch = np.asarray(shapes), np.asarray(object_ids), TouchBatch.of([touches])
    folds = object_folds(truth, ids, num_folds)
    options: dict[str, Any] = {"shape_labels": tuple(shape_labels), "num_poses": num_poses}
    losses = {}
    for name, fit in candidates.items():
        each = []
        for fold in range(num_folds):
            kept, held = np.flatnonzero(folds != fold), np.flatnonzero(folds == fold)
            model = fit([touches[i] for i in kept.tolist()], truth[kept], ids[kept], **options)
            each.append(_sequence_nll(model, batch.touches(held), truth[held], ids[held]))
        losses[name] = float(np.mean(each))
    best = min(losses, key=losses.__getitem__)
    return ModelChoice(best, candidates[best](touches, shapes, object_ids, **options), losses)
