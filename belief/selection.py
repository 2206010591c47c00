"""Choose between observation models by how well they predict whole sequences on objects they have not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from belief.bayes import update
from belief.observation_model import ObservationModel
from belief.problem import Floats, Touch


def fused_log_probs(
    model: ObservationModel, touches: Sequence[Touch], object_ids: ArrayLike
) -> tuple[np.ndarray, Floats]:
    """Posterior of every object from all its touches, under a uniform prior.

    Returns:
        The object ids, sorted ``(n,)``, and log posteriors ``(n, K)``.
    """
    ids = np.asarray(object_ids)
    unique, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    groups: list[list[Touch]] = [[] for _ in first]
    for touch, group in zip(touches, inverse, strict=True):
        groups[int(group)].append(touch)
    log_likelihoods = np.stack([model.log_likelihood(group) for group in groups])
    num_shapes = log_likelihoods.shape[1]
    log_posterior, _ = update(np.full(num_shapes, -np.log(num_shapes)), log_likelihoods)
    return unique, log_posterior


def cross_validated_nll(
    fit: Callable[[Sequence[Touch], np.ndarray, np.ndarray], ObservationModel],
    touches: Sequence[Touch],
    shapes: ArrayLike,
    object_ids: ArrayLike,
    num_folds: int = 5,
) -> float:
    """Mean negative log posterior of the true shape after all touches of an object [nats], out of fold.

    Folds are made of whole objects: touches of one object never sit on both sides.

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
        held_ids, log_posterior = fused_log_probs(model, [touches[i] for i in held.tolist()], ids[held])
        losses += [-float(row[shape_of[i]]) for i, row in zip(held_ids.tolist(), log_posterior, strict=True)]
    return float(np.mean(losses))
