"""Identification of recorded objects, and searches among them, in one split of recorded touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from activetouch.recorded.reader import Classifier, Reading, read
from activetouch.recorded.touches import RecordedTouches, Split
from activetouch.recorded.world import RecordedBank, RecordedWorld
from belief.observation_model.action_kernel import ActionKernelModel, touch_weights
from belief.observation_model.calibration_data import LabelledTouches
from belief.problem import SearchProblem
from belief.validation import Floats
from planners.decider import Decider, ProbeSelector, SequentialDecider
from planners.episode import Episode
from planners.probing import GivenOrder, RandomOrder, ShapeInformationGain, greedy_order
from planners.registry import make_decider
from planners.search import Identification, identify, search
from planners.stopping import PosteriorThresholds

RANDOM, FIXED, GAIN = "random order", "best fixed order", "information gain"
_Selectors: TypeAlias = dict[str, ProbeSelector]


@dataclass(frozen=True, eq=False)
class Fold:
    """A split after reading: the bank of test touches, the fitted model, and the best fixed order of action names."""

    reading: Reading
    bank: RecordedBank
    model: ActionKernelModel
    order: tuple[str, ...]


@dataclass(frozen=True)
class Named:
    """One identification: the rule that chose actions, the number of the object, and the result."""

    decider: str
    object_index: int
    result: Identification


@dataclass(frozen=True, eq=False)
class Found:
    """One search: its decider, the number of its scene, whose searches are about the same objects, and its return."""

    decider: str
    scene: int
    episode: Episode
    reward: float


def prepare(
    touches: RecordedTouches, split: Split, threshold: float, kinds: Mapping[str, Classifier] | None = None
) -> Fold:
    """Read a split, and fit what its searches need; they stop at a probability, by which fixed orders are ranked."""
    reading, test = read(touches, split, kinds), split.test
    names, rows = touches.action_names, reading.calibration_rows
    columns = touches.labels[test], touches.objects[test], touches.actions[test], touches.sessions_of(test)
    bank = RecordedBank(touches.label_names, names, reading.test_ratios, *columns)
    model = reading.model(touches, repeats=bank.repeats)
    data = touches.labelled(rows, reading.calibration_ratios)
    order = best_order(data, touches.sessions_of(rows), model.kernel, threshold)
    return Fold(reading, bank, model, tuple(names[action] for action in order))


def best_order(data: LabelledTouches, sessions: NDArray[np.int64], kernel: Floats, threshold: float) -> tuple[int, ...]:
    """The better of two greedy orders of actions: by the negative log posterior, and by the share of certain objects.

    The better one needs fewer touches on the calibration data until a label has the probability ``threshold``. Only
    ``sessions (n,)`` with a touch in every action count, or all if there are none.
    """
    _, group = np.unique(np.stack([data.objects, sessions]), axis=1, return_inverse=True)
    table = np.full((int(group.max()) + 1, data.num_poses, data.num_shapes), np.nan)
    labels = np.zeros(len(table), np.int64)
    table[group.ravel(), data.poses] = data.logits
    labels[group.ravel()] = data.shapes
    whole = ~np.isnan(table).any(axis=(1, 2))
    ratios, labels = (table[whole], labels[whole]) if whole.any() else (np.nan_to_num(table), labels)
    if data.num_poses == 1:
        return tuple(range(data.num_poses))

    def fused(actions: tuple[int, ...]) -> Floats:
        """Log posteriors after one touch with each of some actions, ``(G, K)``."""
        counts = np.bincount(actions, minlength=len(kernel))
        return np.asarray(log_softmax(np.einsum("p,gpk->gk", touch_weights(counts, kernel) * counts, ratios), axis=1))

    def loss(actions: tuple[int, ...]) -> float:
        return -float(fused(actions)[np.arange(len(labels)), labels].mean())

    def uncertain(actions: tuple[int, ...]) -> float:
        return -float((fused(actions).max(axis=1) >= np.log(threshold)).mean()) + 1e-3 * loss(actions)

    def mean_touches(order: tuple[int, ...]) -> float:
        waiting, total = np.ones(len(ratios), np.bool_), 0.0
        for step in range(len(order)):
            total += waiting.mean()
            waiting &= fused(order[: step + 1]).max(axis=1) < np.log(threshold)
        return total

    size = data.num_poses
    return min((greedy_order(size, size, score)[0] for score in (loss, uncertain)), key=mean_touches)


def identify_all(fold: Fold, seed: Sequence[int], threshold: float, max_touches: int, rounds: int) -> list[Named]:
    """Identify every test object with all deciders, in several rounds, each with another order of sessions."""
    found, made = list[Named](), dict[tuple[int, ...], tuple[RecordedBank, ActionKernelModel, _Selectors]]()
    objects = np.unique(fold.bank.objects).tolist()
    is_one_session = all(len(np.unique(fold.bank.sessions[fold.bank.objects == index])) == 1 for index in objects)
    for index in objects:
        if (actions := tuple(fold.bank.actions_of([index]))) not in made:  # an object is touched with what it has
            labels = fold.bank.label_names
            bank, model = fold.bank.among(labels, actions), fold.model.among(labels, actions)
            made[actions] = bank, model, _selectors(bank, model, fold.order)
    names = list(dict.fromkeys(name for _, _, selectors in made.values() for name in selectors))
    for name in names:
        for index in objects:
            bank, model, selectors = made[tuple(fold.bank.actions_of([index]))]
            limit = min(max_touches, fold.bank.repeats * len(bank.action_names))
            for number in range(1 if is_one_session and name != RANDOM else rounds):
                words = [*seed, index, number]
                world = RecordedWorld(bank, [index], words)
                selector = selectors.get(name, selectors[RANDOM])
                result = identify(world, selector, model, bank.action_names, words, threshold, limit)
                found.append(Named(name, index, result))
    return found


def _selectors(bank: RecordedBank, model: ActionKernelModel, order: Sequence[str]) -> _Selectors:
    """The rules that choose actions; with one action only random order, because there is nothing to choose."""
    if len(bank.action_names) == 1:
        return {RANDOM: RandomOrder()}
    fixed = GivenOrder(tuple(name for name in order if name in bank.action_names))
    return {RANDOM: RandomOrder(), FIXED: fixed, GAIN: ShapeInformationGain(model.outcome_table(128))}


def find_all(
    fold: Fold, deciders: Sequence[str], seed: Sequence[int], num_objects: int, num_scenes: int, max_touches: int
) -> list[Found]:
    """Search for every object of random scenes with all deciders.

    The labels on the table are known and distinct, their places are not. The actions are those that all objects of the
    scene have; a scene without one is left out, and all are if there are fewer labels than objects. A decider is a name
    for :func:`planners.registry.make_decider`, or "best fixed order".
    """
    present, found = np.unique(fold.bank.labels), list[Found]()
    if len(present) < num_objects:
        return found
    for number in range(num_scenes):
        rng = np.random.default_rng([*seed, number])
        chosen = rng.permutation(present)[:num_objects]
        names = tuple(fold.bank.label_names[index] for index in chosen.tolist())
        of_labels = [fold.bank.objects_of(int(label)) for label in chosen]
        objects = [int(rng.choice(of_labels[place])) for place in rng.permutation(num_objects)]
        if not (actions := fold.bank.actions_of(objects)):
            continue
        bank, model = fold.bank.among(names, actions), fold.model.among(names, actions)
        limit = min(max_touches, fold.bank.repeats * len(actions))
        problem = SearchProblem(names, bank.action_names, num_objects, touch_limit=limit * num_objects)
        scene = int(seed[-1]) * num_scenes + number
        order = tuple(name for name in fold.order if name in bank.action_names)
        made = {name: _decider(name, model, order, limit) for name in deciders}
        for target in range(num_objects):
            words = [*seed, number, target]
            for name, decider in made.items():
                episode = search(RecordedWorld(bank, objects, words), decider, problem, target, model, words)
                found.append(Found(name, scene, episode, episode.reward(problem)))
    return found


def _decider(name: str, model: ActionKernelModel, order: tuple[str, ...], max_touches: int) -> Decider:
    if name == FIXED:
        return SequentialDecider(PosteriorThresholds(max_touches=max_touches), GivenOrder(order))
    return make_decider(name.replace("{max_touches}", str(max_touches)), model.outcome_table(), model)
