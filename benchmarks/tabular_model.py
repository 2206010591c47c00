"""An observation model that is an outcome table, for exact tests and comparisons of planners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belief.naming import checked_names
from belief.observation_model.evidence import SummarisedEvidence
from belief.observation_model.outcome_table import OutcomeTable, merged
from belief.problem import Touch
from belief.validation import Floats


@dataclass(frozen=True, eq=False)
class TabularModel:
    """An observation model whose touches are outcomes of a table, independent given the shape.

    The logits of a touch are the log-likelihoods of its outcome.

    >>> model = TabularModel(("cube", "cone"), OutcomeTable(np.array([[[0.9, 0.1], [0.2, 0.8]]])))
    >>> touches = model.sample(0, poses=[0, 0], rng=np.random.default_rng(0))
    >>> np.exp(model.log_likelihood(touches)).round(3).tolist()
    [0.81, 0.04]
    """

    shape_labels: tuple[str, ...]
    table: OutcomeTable

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape_labels", checked_names("shape_labels", self.shape_labels))
        if len(self.shape_labels) != self.table.num_shapes:
            raise ValueError(f"the table has {self.table.num_shapes} shapes, labels are {list(self.shape_labels)}")

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """See :class:`ObservationModel`."""
        total = np.zeros(len(self.shape_labels))
        for touch in touches:
            total += touch.require_logits()
        return total

    def start(self) -> SummarisedEvidence:
        """See :mod:`belief.observation_model.evidence`."""
        return SummarisedEvidence(self)

    def statistics_with(self, statistics: Floats | None, touch: Touch) -> Floats:
        """The sum of logits."""
        logits = touch.require_logits()
        return logits if statistics is None else statistics + logits

    def log_likelihood_of(self, statistics: Floats) -> Floats:
        """The sum itself."""
        return statistics

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """See :class:`ObservationModel`."""
        touches = []
        for pose in poses:
            cumulative = self.table.probs[pose, shape].cumsum()
            outcome = int(np.searchsorted(cumulative, rng.random() * cumulative[-1], "right"))
            with np.errstate(divide="ignore"):
                touches.append(Touch(int(pose), np.log(self.table.probs[pose, :, outcome])))
        return touches

    def outcome_table(self, num_outcomes: int | None = None) -> OutcomeTable:
        """The table itself, or the table merged into fewer outcomes."""
        return self.table if num_outcomes is None else merged(self.table, num_outcomes, np.random.default_rng(0))
