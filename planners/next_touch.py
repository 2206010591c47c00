"""What the next touch of the current object can tell: its outcome table, and the weight of each pose."""

from __future__ import annotations

import numpy as np

from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import Floats
from planners.decider import InformationState
from planners.repeats import RepeatDiscount

OUTCOMES = 128
HYPOTHESES = 64


def next_touch(
    info: InformationState,
    table: OutcomeTable,
    repeats: RepeatDiscount,
    outcomes: int = OUTCOMES,
    hypotheses: int = HYPOTHESES,
) -> tuple[OutcomeTable, Floats]:
    """The outcome table of the next touch, and the value of a touch in each pose as a fraction of that in the table.

    A mixture knows what a repeat tells; its weights are one.

    Args:
        info: the information state.
        table: p(outcome | pose, shape) of single touches, for models that take touches as independent given the shape.
        repeats: discounts the value of repeated poses, for the same models.
        outcomes: of a mixture, at most.
        hypotheses: about the object that a mixture works with, of each shape, at most.

    Returns:
        The table, and weights in [0, 1], ``(P,)``; a pose with weight zero is not used.

    >>> from belief import Belief, SearchProblem
    >>> from planners.repeats import LeastUsedFirst
    >>> problem, table = SearchProblem(("cube", "cone"), ("p",), num_objects=1), OutcomeTable([[[0.5, 0.5]] * 2])
    >>> next_touch(InformationState(problem, 0, Belief.uniform(("cube", "cone"))), table, LeastUsedFirst())[1].tolist()
    [1.0]
    """
    evidence = info.evidence
    mixture = None if evidence is None else evidence.outcome_mixture(outcomes, hypotheses)
    if mixture is None:
        return table, repeats.weights(info.uses)
    return mixture.table, np.ones(mixture.table.num_poses)
