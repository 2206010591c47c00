"""A search with as few hidden states as planning needs: the current shape, and whether a target was rejected before.

The exact hidden state of a bag's objects is which shapes were rejected, thousands of sets for a dozen objects. For a
plan it matters almost only whether a target was among them, and how likely the next object is one: hypergeometric, by
how many are left in the bag. That other shapes become likelier or rarer is left out of the plan. It is not left out of
the belief, which the plan is asked about anew after every touch (decision 0026).
"""

from __future__ import annotations

import numpy as np

from belief import SceneView, SearchProblem
from belief.problem import Floats
from planners.pomdp.stages import Stage, StagedProblem


def stages_by_target(problem: SearchProblem, outcome_probs: Floats, target: int, touch_cost: float) -> StagedProblem:
    """A search in a bag of known content with 2K hidden states an object.

    States 0 to K - 1 are the current shape with no target rejected yet, K to 2K - 1 with one rejected.

    Args:
        problem: a search whose composition has counts.
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        target: index of the shape sought.
        touch_cost: λ.
    """
    counts = np.array(problem.counts, np.float64)
    num_shapes, num_targets, others = problem.num_shapes, counts[target], np.delete(counts, target)
    shapes = np.tile(np.arange(num_shapes), 2)
    missed = np.arange(2 * num_shapes) >= num_shapes
    is_target = shapes == target
    confirm = np.where(is_target, 1.0, -1.0)

    def next_shape(num_gone: int, targets_left: float) -> Floats:
        """Of the object after so many, ``(K,)``."""
        prob = min(max(targets_left / (counts.sum() - num_gone), 0.0), 1.0)
        total = others.sum()
        rest = others / total if total else np.zeros(len(others))
        found = np.insert((1.0 - prob) * rest, target, prob)
        return np.asarray(found / found.sum()) if found.sum() else np.eye(num_shapes)[target]

    stages = []
    for number in range(1, problem.num_objects):
        moves = np.zeros((2 * num_shapes, 2 * num_shapes))
        moves[~(missed | is_target), :num_shapes] = next_shape(number, num_targets)
        moves[missed | is_target, num_shapes:] = next_shape(number, max(num_targets - 1.0, 0.0))
        stages.append(Stage(shapes, confirm, np.zeros(2 * num_shapes), moves))
    stages.append(Stage(shapes, confirm, np.where(missed | is_target, -1.0, 1.0)))
    initial = np.concatenate([problem.prior_probs, np.zeros(num_shapes)])
    return StagedProblem(tuple(stages), initial, outcome_probs, touch_cost, 1.0)


def belief_by_target(problem: SearchProblem, scene: SceneView, target: int, object_index: int) -> Floats:
    """The exact marginals of a scene, as a belief about a stage of :func:`stages_by_target`, ``(2K,)``."""
    assert problem.counts is not None, "the composition has counts"
    marginals = scene.marginals()
    here, before = marginals[object_index], marginals[:object_index, target]
    if problem.counts[target] > 1:
        missed = 1.0 - float(np.prod(1.0 - before))
        return np.concatenate([(1.0 - missed) * here, missed * here])
    missed = min(float(before.sum()), 1.0 - here[target])
    rest = 1.0 - here[target]
    share = missed / rest if rest > 0.0 else 0.0  # of each other shape's probability: there is one target only
    lost = np.where(np.arange(len(here)) == target, 0.0, share * here)
    return np.concatenate([here - lost, lost])
