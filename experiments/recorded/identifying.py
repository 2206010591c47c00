"""Identification of recorded objects, and what a belief knows after a number of touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from activetouch.recorded.world import RecordedWorld
from belief.observation_model.action_kernel import Law
from belief.observation_model.kernel_fit import sequence_losses, sequences
from belief.validation import Floats
from experiments.recorded.fold import LAWS, Fold
from planners.decider import ProbeSelector
from planners.identification import Identification, identify
from planners.probing import GivenOrder, RandomOrder, ShapeInformationGain

RANDOM, FIXED, GAIN = "random order", "best fixed order", "information gain"
NUMBERS = (1, 2, 3, 6, 10)
"""Numbers of touches after which the belief is judged."""
_ROUNDS = 5


@dataclass(frozen=True)
class Named:
    """One identification.

    Attributes:
        decider: who chose the actions.
        law: of the observation model.
        object_index: the object.
        result: how it was named.
    """

    decider: str
    law: Law
    object_index: int
    result: Identification


def identify_all(fold: Fold, seed: Sequence[int], threshold: float, max_touches: int, rounds: int) -> list[Named]:
    """Identify every test object with all deciders: the best fixed order by the last law only.

    Args:
        fold: the split.
        seed: of all identifications.
        threshold: probability at which to stop.
        max_touches: of an object.
        rounds: identifications of each object, each with another order of sessions.
    """
    found, limit = [], min(max_touches, fold.bank.repeats * len(fold.bank.action_names))
    is_one_session = all(
        len(np.unique(fold.bank.sessions[fold.bank.objects == index])) == 1 for index in np.unique(fold.bank.objects)
    )
    for law, model in fold.models.items():
        selectors: dict[str, ProbeSelector] = {
            RANDOM: RandomOrder(),
            GAIN: ShapeInformationGain(model.outcome_table(128)),
        }
        if law == LAWS[-1]:
            selectors[FIXED] = GivenOrder(fold.order)
        for name, selector in selectors.items():
            for index in np.unique(fold.bank.objects).tolist():
                for number in range(1 if is_one_session and name != RANDOM else rounds):
                    words = [*seed, index, number]
                    world = RecordedWorld(fold.bank, [index], words)
                    result = identify(world, selector, model, fold.bank.action_names, words, threshold, limit)
                    found.append(Named(name, law, index, result))
    return found


@dataclass(frozen=True, eq=False)
class AfterTouches:
    """Beliefs after n touches with actions in random order.

    Attributes:
        law: of the observation model.
        number: n.
        probs: ``(S, K)``.
        labels, objects: ``(S,)``.
    """

    law: Law
    number: int
    probs: Floats
    labels: np.ndarray
    objects: np.ndarray


def after_touches(fold: Fold, seed: int) -> tuple[list[AfterTouches], dict[Law, tuple[Floats, np.ndarray]]]:
    """Beliefs after some numbers of touches, and by law the mean loss of each test sequence with its object.

    The losses are negative log posteriors of the true label after two and more touches.
    """
    data = fold.test_data
    names = np.unique(fold.touches.objects[fold.split.test])
    sessions = fold.touches.sessions_of(fold.split.test)
    found: list[AfterTouches] = []
    losses: dict[Law, tuple[Floats, np.ndarray]] = {}
    for law in fold.models:
        parts, owners = [], []
        batches: dict[int, list[tuple[Floats, np.ndarray, np.ndarray]]] = {}
        for round_ in range(_ROUNDS):
            drawn = sequences(data, sessions, np.random.default_rng([seed, round_]))
            lengths = (drawn >= 0).sum(axis=1)
            each = sequence_losses(data.logits, data.poses, data.shapes, drawn, fold.models[law].kernel)
            if each.shape[1] > 1:
                kept = lengths > 1
                parts.append(np.nanmean(each[kept, 1:], axis=1))
                owners.append(names[data.objects[drawn[kept, 0]]])
            for number in NUMBERS:
                rows = drawn[lengths >= number, :number]
                if len(rows):
                    weights = _weights(data.poses[rows], fold.models[law].kernel)
                    probs = softmax(np.einsum("sn,snk->sk", weights, data.logits[rows]), axis=1)
                    batches.setdefault(number, []).append((probs, data.shapes[rows[:, 0]], data.objects[rows[:, 0]]))
        for number, batch in batches.items():
            probs, labels, objects = (np.concatenate(columns) for columns in zip(*batch, strict=True))
            found.append(AfterTouches(law, number, probs, labels, names[objects]))
        losses[law] = (np.concatenate(parts), np.concatenate(owners)) if parts else (np.empty(0), np.empty(0, np.int64))
    return found, losses


def _weights(poses: np.ndarray, kernel: Floats) -> Floats:
    correlation = kernel[poses[:, :, None], poses[:, None, :]].copy()
    steps = np.arange(poses.shape[1])
    correlation[:, steps, steps] = 1.0
    return np.asarray(1.0 / correlation.sum(axis=2))
