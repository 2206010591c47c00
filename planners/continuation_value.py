r"""Continuation value of REJECT: the value of a search from the next object on.

The exact value depends on the whole joint belief. Two simplifications reduce it to two numbers per object, quick to
compute at run time (decision 0019):

- After a REJECT it is revealed whether the rejected object was the target, but not which other shape it had. The value
  from object i on is then w(i, m), where m says whether a target was rejected before. It is the value of a test of one
  object that pays w(i+1, 1) for rejecting the target and w(i+1, m) for rejecting any other shape.
- That test probes the poses in turn and stops at the best of some dozen pairs of thresholds on the posterior of the
  target. The value of a pair is its mean over sampled sequences of touches, the same for all pairs and objects.

At run time, the probability of m comes from the joint belief of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import SearchProblem
from belief.validation import Floats
from planners.decider import InformationState, touch_share
from planners.probing import LEAST_USED, RepeatDiscount
from planners.stopping import share_of_threshold

_SEQUENCES = 2_000  # of touches, in all
_MOST_TOUCHES = 16  # in a sequence
_MANY = 64  # shapes, above which all but the target are taken as one
_REJECT = np.array([0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.003, 0.001])
_CONFIRM = 1.0 - _REJECT


@dataclass(frozen=True, eq=False)
class ContinuationValue:
    """``values`` w(i, m) before any touch of object i, ``(N + 1, 2)``; the last row is for all objects rejected."""

    values: Floats

    @classmethod
    def of(
        cls, problem: SearchProblem, target: int, table: OutcomeTable, repeats: RepeatDiscount = LEAST_USED
    ) -> ContinuationValue:
        """Compute the values from the last object to the first.

        With a perfect pose and four objects the number of touches is 1, 2, 3 or 3, because the last object needs none.

        >>> problem = SearchProblem(tuple("abcd"), ("p",), num_objects=4, touch_cost=0.04)
        >>> ContinuationValue.of(problem, 0, OutcomeTable(np.eye(4)[None])).values[:, 0].round(3).tolist()
        [0.91, 0.933, 0.96, 1.0, 1.0]
        """
        ahead = shapes_ahead(problem, target)
        if table.num_shapes > _MANY:
            ahead, table, target = _target_or_other(ahead, table, target)
        length = min(touch_share(problem), _MOST_TOUCHES)
        evidence = _sequences(table, length, repeats)
        values = np.empty((problem.num_objects + 1, 2))
        values[-1] = 1.0, -1.0
        for index in reversed(range(problem.num_objects)):
            for missed, prior in enumerate(ahead[index]):
                of_target, of_other = values[index + 1, [1, missed]]  # values of rejecting them
                if prior[target] in (0.0, 1.0):  # no touch is needed
                    values[index, missed] = 1.0 if prior[target] else of_other
                    continue
                values[index, missed] = _test_value(evidence, prior, target, of_target, of_other, problem.touch_cost)
        return cls(values)

    def reject_payoffs(self, info: InformationState) -> Floats:
        """Value of rejecting the current object for each shape that it may have, ``(K,)``."""
        missed = prob_missed(info)
        if_right, if_missed = self.values[info.object_index + 1].tolist()
        payoffs = np.full(info.problem.num_shapes, (1.0 - missed) * if_right + missed * if_missed)
        payoffs[info.target] = if_missed
        return payoffs


def shapes_ahead(problem: SearchProblem, target: int) -> Floats:
    """p(shape of object i) before it is touched, if no earlier object was a target, and if one was, ``(N, 2, K)``.

    That the other shapes differ from each other is ignored, and an unlisted shape counts as one of them.
    """
    others = np.where(np.arange(problem.num_shapes) == target, 0.0, problem.prior_probs)
    if not others.any():  # every object is a target
        chances = np.ones((problem.num_objects, 2))
    elif (bag := problem.bag_of(target)) is None:
        chances = np.full((problem.num_objects, 2), problem.prior_probs[target])
    else:
        count, total = bag
        left = total - np.arange(problem.num_objects)[:, None]  # in the bag before each draw
        chances = np.minimum([[count, max(count - 1, 0)]], left) / left * (1.0 - problem.unlisted)
    others /= others.sum() if others.any() else 1.0
    probs = (1.0 - chances)[..., None] * others
    probs[..., target] = chances
    return np.asarray(probs)


def prob_missed(info: InformationState) -> float:
    """Probability that a rejected object was a target, given that the current one is not; 0 without ``info.scene``."""
    if info.scene is None or info.object_index == 0:
        return 0.0
    log_probs = [info.scene.belief(index).log_probs[info.target] for index in range(info.object_index)]
    missed = np.minimum(np.exp(log_probs), 1.0)
    if not _is_only_one(info):  # an approximation for several targets with known counts
        return float(1.0 - np.prod(1.0 - missed))
    other = 1.0 - info.target_prob
    return min(float(missed.sum()) / other, 1.0) if other > 0.0 else 0.0


def belief_with_missed(info: InformationState) -> Floats:
    """p(shape of the current object, whether a target was rejected), ``(2, K)``; not rejected comes first."""
    here = info.probs
    missed = prob_missed(info) * here
    if _is_only_one(info):
        missed[info.target] = 0.0
    return np.stack([here - missed, missed])


def _is_only_one(info: InformationState) -> bool:
    """Whether there is at most one target, as counts of shapes say."""
    bag = info.problem.bag_of(info.target)
    return bag is not None and bag[0] <= 1


def _target_or_other(ahead: Floats, table: OutcomeTable, target: int) -> tuple[Floats, OutcomeTable, int]:
    """The same for two shapes: the target and any other one, whose outcomes are those of all others in the mean."""
    others = np.delete(table.probs, target, axis=1).mean(axis=1)
    two = OutcomeTable(np.stack([table.probs[:, target], others], axis=1))
    return np.stack([ahead[..., target], 1.0 - ahead[..., target]], axis=-1), two, 0


def _sequences(table: OutcomeTable, length: int, repeats: RepeatDiscount) -> Floats:
    """Cumulative log-likelihoods of sampled touches, from none to all: ``(shape, sequence, 0 … length, K)``."""
    rng = np.random.default_rng(0)  # fixed, so that a problem has one value
    number = -(-_SEQUENCES // table.num_shapes)
    evidence = np.zeros((table.num_shapes, number, length + 1, table.num_shapes))
    with np.errstate(divide="ignore"):
        log_probs = np.log(table.probs)
    order = np.arange(length) % table.num_poses
    uses = np.zeros(table.num_poses, np.int64)
    for step, pose in enumerate(order.tolist()):
        cumulative = table.probs[pose].cumsum(axis=1)  # (K, M)
        drawn = rng.random((table.num_shapes, number, 1)) * cumulative[:, None, -1:]
        outcome = (drawn >= cumulative[:, None]).sum(axis=2)
        tells = rng.random((table.num_shapes, number, 1)) < repeats.weights(uses)[pose]
        evidence[:, :, step + 1] = evidence[:, :, step] + np.where(tells, log_probs[pose].T[outcome], 0.0)
        uses[pose] += 1
    return evidence


def _test_value(
    evidence: Floats, prior: Floats, target: int, reject_target: float, reject_other: float, touch_cost: float
) -> float:
    """Value of the best pair of thresholds for an object with this prior."""
    kept = np.flatnonzero(prior)
    scores = evidence[kept][..., kept] + np.log(prior[kept])  # (k, S, n + 1, k)
    scores -= scores.max(axis=-1, keepdims=True)
    probs = np.exp(scores)
    target_prob = probs[..., np.searchsorted(kept, target)] / probs.sum(axis=-1)
    stop = np.maximum(2.0 * target_prob - 1.0, target_prob * reject_target + (1.0 - target_prob) * reject_other)
    stop -= touch_cost * np.arange(stop.shape[2])
    best = -np.inf
    for reject in _REJECT * share_of_threshold(float(prior[target])):
        for confirm in _CONFIRM:
            beyond = (target_prob <= reject) | (target_prob >= confirm)
            beyond[..., -1] = True
            first = beyond.argmax(axis=2)[..., None]
            best = max(best, float(prior[kept] @ np.take_along_axis(stop, first, axis=2).mean(axis=(1, 2))))
    return best
