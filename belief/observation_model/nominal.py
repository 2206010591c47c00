"""What models and evidence have in common that hold a nominal one beside what may differ from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.model import Reads
from belief.observation_model.outcome_mixture import OutcomeMixture, SharedMixture
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.rigid_body import FittedRigidBody
from belief.observation_model.rigid_body_evidence import Diagnostics
from belief.problem import Touch
from belief.validation import Floats

if TYPE_CHECKING:
    from belief.touch_batch import TouchBatch


class OfNominal:
    """Methods of joint models of a sensor whose state may differ from the nominal one, that of its description.

    Samples, tables and the file are those of the nominal model: the reader brings the other states.
    """

    name: ClassVar[str] = FittedRigidBody.name
    reads: ClassVar[Reads] = "embeddings"
    nominal: Any

    @property
    def num_poses(self) -> int:
        """See :class:`ArrayModel`."""
        return self.nominal.num_poses

    @property
    def repeat_correlation(self) -> float | None:
        """See :class:`ArrayModel`."""
        return self.nominal.repeat_correlation

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        return self.nominal._log_likelihoods(batch)

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        return self.nominal._sample(shape, poses, rng)

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        return self.nominal._tabulate(num_outcomes, rng)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        return self.nominal.to_fields()

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> FittedRigidBody:
        """See :class:`ArrayModel`: the nominal model."""
        return FittedRigidBody.from_fields(fields)


class BesideNominal(ABC):
    """Methods of evidence about one object that holds the evidence if the sensor is as described, ``nominal``.

    Predicted outcomes and diagnostics are those of the nominal hypotheses.
    """

    nominal: Any

    @property
    def num_touches(self) -> int:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return self.nominal.num_touches

    @property
    def log_bets(self) -> Floats | None:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return self.nominal.log_bets

    @abstractmethod
    def update(self, touch: Touch) -> Self:
        """The evidence with one more touch."""

    def updated(self, touches: Iterable[Touch]) -> Self:
        """The evidence with more touches, one after the other."""
        found = self
        for touch in touches:
            found = found.update(touch)
        return found

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> OutcomeMixture | SharedMixture:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return self.nominal.outcome_mixture(num_outcomes, num_hypotheses)

    @property
    def diagnostics(self) -> Diagnostics:
        """See :class:`Diagnostics`."""
        return self.nominal.diagnostics
