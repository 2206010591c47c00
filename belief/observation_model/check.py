"""Check of the contract of observation models."""

from __future__ import annotations

import numpy as np

from belief.errors import BrokenContract
from belief.observation_model.model import ObservationModel


def check_observation_model(model: ObservationModel, rng: np.random.Generator, num_objects: int = 20) -> None:
    """Check that an observation model keeps the contract of :class:`ObservationModel`, on touches that it samples.

    The checks are: labels and array shapes; zeros for no touches; no NaN or +inf; equal likelihoods for equal touches;
    a valid outcome table.

    Args:
        model: to be checked; it is not changed.
        rng: draws the touches.
        num_objects: number of objects of each shape, each touched up to four times.

    Raises:
        BrokenContract: the first rule that the model violates.

    >>> from belief.synthetic import random_model
    >>> rng = np.random.default_rng(0)
    >>> check_observation_model(random_model(rng), rng)
    """
    labels = tuple(model.shape_labels)
    if not labels or len(set(labels)) < len(labels) or not all(isinstance(label, str) for label in labels):
        raise BrokenContract(f"shape_labels must be one or more different names, got {labels}")
    nothing = np.asarray(model.log_likelihood([]))
    if nothing.shape != (len(labels),) or nothing.any():
        raise BrokenContract(f"log_likelihood([]) must be {len(labels)} zeros, got {nothing}")
    table = model.outcome_table()
    num_poses = table.probs.shape[0]
    if table.probs.shape[1] != len(labels):
        raise BrokenContract(f"outcome_table() must have {len(labels)} shapes, it is {table.probs.shape}")
    for shape, label in enumerate(labels):
        for _ in range(num_objects):
            poses = rng.integers(num_poses, size=rng.integers(1, 5)).tolist()
            touches = model.sample(shape, poses, rng)
            if [touch.pose for touch in touches] != poses:
                raise BrokenContract(f"sample({label}, poses={poses}) has poses {[touch.pose for touch in touches]}")
            found = np.asarray(model.log_likelihood(touches))
            where = f"log_likelihood of touches of {label} in the poses {poses}"
            if found.shape != (len(labels),):
                raise BrokenContract(f"{where} must have shape ({len(labels)},), got {found.shape}")
            if np.isnan(found).any() or np.isposinf(found).any() or np.isneginf(found).all():
                raise BrokenContract(f"{where} must be a number or -inf for each shape, and not -inf for all: {found}")
            if np.isneginf(found[shape]):
                raise BrokenContract(f"{where} is -inf for {label} itself, the shape they were sampled from")
            if not np.array_equal(found, model.log_likelihood(touches)):
                raise BrokenContract(f"{where} differs between two calls")
