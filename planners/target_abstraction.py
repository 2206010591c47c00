"""Abstraction of a search with few hidden states: the current shape, and whether a target was rejected before.

The exact hidden state is the set of rejected shapes: thousands of sets for a dozen objects. The optimal action depends
mostly on whether a target was among them, and on the probability that the next object is one, which is hypergeometric.
The abstraction leaves out how rejections change the probabilities of the other shapes. The belief includes it, and the
policy is evaluated at the new belief after every touch (decision 0026).
"""

from __future__ import annotations

import numpy as np

from belief.problem import SearchProblem
from belief.scene_view import SceneView
from belief.validation import Floats
from planners.pomdp.stages import StagedProblem, stages_by_missed


def stages_by_target(problem: SearchProblem, outcome_probs: Floats, target: int, touch_cost: float) -> StagedProblem:
    """A search with known counts of shapes as stages of 2K hidden states.

    States 0 to K - 1 are the current shape with no target rejected yet, states K to 2K - 1 with one rejected.

    Args:
        problem: a search whose composition has counts.
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        target: index of the shape sought.
        touch_cost: λ.
    """
    counts = np.array(problem.counts, np.float64)
    num_shapes, num_targets, others = problem.num_shapes, counts[target], np.delete(counts, target)

    def next_shape(num_gone: int, targets_left: float) -> Floats:
        """Distribution over the shape of the object after ``num_gone`` others, ``(K,)``."""
        prob = min(max(targets_left / (counts.sum() - num_gone), 0.0), 1.0)
        total = others.sum()
        other_probs = others / total if total else np.zeros(len(others))
        found = np.insert((1.0 - prob) * other_probs, target, prob)
        return np.asarray(found / found.sum()) if found.sum() else np.eye(num_shapes)[target]

    later = [
        (next_shape(number, num_targets), next_shape(number, max(num_targets - 1.0, 0.0)))
        for number in range(1, problem.num_objects)
    ]
    stages = stages_by_missed(num_shapes, target, later)
    initial = np.concatenate([problem.prior_probs, np.zeros(num_shapes)])
    return StagedProblem(tuple(stages), initial, outcome_probs, touch_cost, 1.0)


def belief_by_target(problem: SearchProblem, scene: SceneView, target: int, object_index: int) -> Floats:
    """Belief about a stage of :func:`stages_by_target` with the exact marginals of a scene, ``(2K,)``.

    Args:
        problem: a search whose composition has counts.
        scene: the joint belief about all objects.
        target: index of the shape sought.
        object_index: of the current object.
    """
    assert problem.counts is not None, "the composition has counts"
    marginals = scene.marginals()
    here, before = marginals[object_index], marginals[:object_index, target]
    if problem.counts[target] > 1:
        missed = 1.0 - float(np.prod(1.0 - before))
        return np.concatenate([(1.0 - missed) * here, missed * here])
    missed = min(float(before.sum()), 1.0 - here[target])
    other = 1.0 - here[target]
    share = missed / other if other > 0.0 else 0.0  # of each other shape's probability, as there is only one target
    lost = np.where(np.arange(len(here)) == target, 0.0, share * here)
    return np.concatenate([here - lost, lost])
