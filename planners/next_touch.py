"""What the next touch of the current object can tell: its outcomes, and the weight of each pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import Floats
from planners.decider import InformationState
from planners.repeats import RepeatDiscount

OUTCOMES = 128
HYPOTHESES = 32


def next_touch(
    info: InformationState,
    shares: Floats,
    table: OutcomeTable,
    repeats: RepeatDiscount,
    outcomes: int = OUTCOMES,
    hypotheses: int = HYPOTHESES,
) -> tuple[NDArray[np.floating], Floats]:
    """Joint probabilities of the next touch, and the value of a touch in each pose as a fraction of one with these.

    Args:
        info: the information state.
        shares: of the belief in what the touch is to distinguish: one row for each answer, ``(J, K)``.
        table: p(outcome | pose, shape) of single touches, for models that take touches as independent given the shape.
        repeats: discounts the value of repeated poses, for the same models.
        outcomes: of a mixture, at most.
        hypotheses: about the object that a mixture works with, of each shape, at most.

    Returns:
        p(answer, outcome | pose), ``(P, J, M)``, and weights in [0, 1], ``(P,)``; a pose with weight zero is not used.
    """
    evidence = info.evidence
    mixture = None if evidence is None else evidence.outcome_mixture(outcomes, hypotheses)
    if mixture is None:
        return shares @ table.probs, repeats.weights(info.uses)
    joint = mixture.one_touch(shares)
    return joint, np.ones(len(joint)) if mixture.new is None else mixture.new
