"""Identification of recorded objects, and what a belief knows after a number of touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import softmax

from activetouch.recorded.world import RecordedWorld
from belief.observation_model.action_kernel import Law
from belief.observation_model.kernel_fit import sequence_losses, sequences
from belief.problem import Floats
from experiments.recorded.fold import Fold
from experiments.recorded.order import by_session, fused
from planners.decider import ProbeSelector
from planners.identification import Identification, identify
from planners.probing import GivenOrder, RandomOrder, ShapeInformationGain

RANDOM, FIXED, GAIN = "random order", "best fixed order", "information gain"
NUMBERS = (1, 2, 3, 6, 10)
"""Numbers of touches after which the belief is judged."""
_MOST_ACTIONS = 10  # of which all subsets are tried
_ROUNDS = 5


@dataclass(frozen=True)
class Named:
    """One identification.

    Attributes:
        decider: who chose the actions.
        law: of the observation model.
        thing: the object.
        result: how it was named.
    """

    decider: str
    law: Law
    thing: int
    result: Identification


def identify_all(
    fold: Fold, seed: Sequence[int], threshold: float, max_touches: int, rounds: int, laws: Sequence[Law]
) -> list[Named]:
    """Identify every test object with all deciders: the best fixed order by the last law only.

    Args:
        fold: the split.
        seed: of all identifications.
        threshold: probability at which to stop.
        max_touches: of an object.
        rounds: identifications of each object, each with another order of sessions.
        laws: of the observation models.
    """
    found, limit = [], min(max_touches, fold.bank.repeats * len(fold.bank.action_names))
    is_one_session = all(
        len(np.unique(fold.bank.sessions[fold.bank.objects == thing])) == 1 for thing in np.unique(fold.bank.objects)
    )
    for law in laws:
        model = fold.models[law]
        selectors: dict[str, ProbeSelector] = {
            RANDOM: RandomOrder(),
            GAIN: ShapeInformationGain(model.outcome_table(128)),
        }
        if law == laws[-1]:
            selectors[FIXED] = GivenOrder(fold.order)
        for name, selector in selectors.items():
            for thing in np.unique(fold.bank.objects).tolist():
                for number in range(1 if is_one_session and name != RANDOM else rounds):
                    words = [*seed, thing, number]
                    world = RecordedWorld(fold.bank, [thing], words)
                    result = identify(world, selector, model, fold.bank.action_names, words, threshold, limit)
                    found.append(Named(name, law, thing, result))
    return found


@dataclass(frozen=True, eq=False)
class AfterTouches:
    """Beliefs after n touches with actions in random order.

    Attributes:
        law: of the observation model.
        number: n.
        probs: ``(S, K)``.
        labels, things: ``(S,)``.
    """

    law: Law
    number: int
    probs: Floats
    labels: np.ndarray
    things: np.ndarray


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


def fewest_touches(fold: Fold, threshold: float, max_touches: int) -> Floats:
    """For every test object: the fewest touches after which any choice of actions could stop, mean over its sessions.

    It is a lower bound on the touches of every decider with this belief, as it knows all outcomes in advance. Objects
    that no set of actions makes certain count with all actions, and no more than ``max_touches``, after which deciders
    give up. Empty where actions can be repeated or are too many, or where a session lacks an action.
    """
    size, data = len(fold.bank.action_names), fold.test_data
    sessions = fold.touches.sessions_of(fold.split.test)
    things = np.unique(np.stack([data.objects, sessions]), axis=1)[0]
    ratios, _ = by_session(data, sessions)
    if fold.bank.repeats > 1 or size > _MOST_ACTIONS or len(ratios) < len(things):
        return np.empty(0)
    kernel, fewest = fold.models["kernel"].kernel, np.full(len(ratios), float(size))
    for number in range(size - 1, 0, -1):
        for actions in combinations(range(size), number):
            certain = fused(ratios, kernel, actions).max(axis=1) >= np.log(threshold)
            fewest[certain] = number
    return np.asarray(np.bincount(things, np.minimum(fewest, max_touches)) / np.bincount(things))


def _weights(poses: np.ndarray, kernel: Floats) -> Floats:
    correlation = kernel[poses[:, :, None], poses[:, None, :]].copy()
    steps = np.arange(poses.shape[1])
    correlation[:, steps, steps] = 1.0
    return np.asarray(1.0 / correlation.sum(axis=2))
