"""Choose between observation models by how well they predict objects they have not seen, touch after touch."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from belief.bayes import update
from belief.observation_model import ObservationModel
from belief.problem import Floats, Touch


def group_by_object(touches: Sequence[Touch], object_ids: ArrayLike) -> dict[int, list[Touch]]:
    """The touches of each object, in the order they came; objects in rising order of their id."""
    ids = np.asarray(object_ids).tolist()
    groups: dict[int, list[Touch]] = {i: [] for i in sorted(set(ids))}
    for touch, i in zip(touches, ids, strict=True):
        groups[i].append(touch)
    return groups


def log_posteriors(model: ObservationModel, sequences: Sequence[Sequence[Touch]]) -> Floats:
    """Log posterior after each sequence of touches of one object, under a uniform prior, ``(n, K)``."""
    log_likelihoods = np.stack([model.log_likelihood(sequence) for sequence in sequences])
    num_shapes = log_likelihoods.shape[1]
    return update(np.full(num_shapes, -np.log(num_shapes)), log_likelihoods)[0]


def cross_validated_nll(
    fit: Callable[[Sequence[Touch], np.ndarray, np.ndarray], ObservationModel],
    touches: Sequence[Touch],
    shapes: ArrayLike,
    object_ids: ArrayLike,
    num_folds: int = 5,
) -> float:
    """Mean negative log posterior of the true shape [nats], out of fold.

    The mean is over objects and over how many of an object's touches were seen: one, two, up to all. With a good
    sensor the posterior after all touches is certain under any model, and early ones decide. Folds are made of whole
    objects: touches of one object never sit on both sides.

    Args:
        fit: builds a model from touches, shapes and object ids.
        touches: calibration touches.
        shapes: true shape of each, ``(n,)``.
        object_ids: which object each belongs to, ``(n,)``.
        num_folds: number of folds, at most the number of objects.
    """
    truth, ids = np.asarray(shapes), np.asarray(object_ids)
    unique, first = np.unique(ids, return_index=True)
    if not 2 <= num_folds <= len(unique):
        raise ValueError(f"need between 2 and {len(unique)} folds for {len(unique)} objects, got {num_folds}")
    shape_of = dict(zip(unique.tolist(), truth[first].tolist(), strict=True))
    by_shape = unique[np.argsort(truth[first], kind="stable")]  # dealt out in this order, every fold gets every shape
    fold_of = dict(zip(by_shape.tolist(), (np.arange(len(unique)) % num_folds).tolist(), strict=True))
    folds = np.array([fold_of[i] for i in ids.tolist()])
    losses: list[float] = []
    for fold in range(num_folds):
        kept, held = np.flatnonzero(folds != fold), np.flatnonzero(folds == fold)
        model = fit([touches[i] for i in kept.tolist()], truth[kept], ids[kept])
        for i, some in group_by_object([touches[j] for j in held.tolist()], ids[held]).items():
            prefixes = [some[:length] for length in range(1, len(some) + 1)]
            losses.append(-float(log_posteriors(model, prefixes)[:, shape_of[i]].mean()))
    return float(np.mean(losses))
