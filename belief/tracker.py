"""Follow what is known while touches come in: of one object, or of a whole table of objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from belief.arrangement import arrangement_marginals
from belief.bayes import update
from belief.categorical import Belief
from belief.errors import ImpossibleObservation
from belief.observation_model import ObservationModel
from belief.problem import Composition, Floats, SearchProblem, Touch


class BeliefTracker:
    """Bayes' filter for the shape of one object.

    Args:
        prior: belief before the first touch.
        model: likelihood of touches.

    Attributes:
        belief: the current posterior.
        touches: all touches so far.
    """

    def __init__(self, prior: Belief, model: ObservationModel) -> None:
        if prior.labels != tuple(model.shape_labels):
            raise ValueError(f"the prior is about {prior.labels}, the model about {tuple(model.shape_labels)}")
        self._prior = prior
        self._model = model
        self.belief = prior
        self.touches: tuple[Touch, ...] = ()

    def update(self, touch: Touch) -> Belief:
        """Take in a touch and return the posterior.

        Raises:
            ImpossibleObservation: the touch contradicts everything still believed in; the tracker is unchanged.
        """
        touches = (*self.touches, touch)
        try:
            belief = self._prior.update(self._model.log_likelihood(touches))
        except ImpossibleObservation as error:
            raise ImpossibleObservation(f"touch in pose {touch.pose}, {self.belief}: {error}") from error
        self.belief, self.touches = belief, touches
        return belief


class SceneBelief:
    """The joint belief about all objects of a search, coupled by what is known of the composition.

    The state is the smallest exact one: an ``(N, K)`` table of log-likelihoods, whatever was touched when. For
    ``independent`` objects each row is a posterior by itself; for ``distinct`` ones the marginals come from
    :func:`belief.arrangement.arrangement_marginals`. Rejecting an object is a decision, not evidence: it changes
    nothing here.

    Args:
        problem: the search.
        model: likelihood of touches.
        prior: belief about one object of an ``independent`` scene; uniform by default.
    """

    def __init__(self, problem: SearchProblem, model: ObservationModel, prior: Belief | None = None) -> None:
        self.labels = tuple(problem.shape_labels)
        if self.labels != tuple(model.shape_labels):
            raise ValueError(f"the problem is about {self.labels}, the model about {tuple(model.shape_labels)}")
        if prior is not None and problem.composition is Composition.DISTINCT:
            raise ValueError("a distinct composition fixes the prior; leave it out or use 'independent'")
        self._composition = problem.composition
        self._model = model
        self._prior = prior if prior is not None else Belief.uniform(self.labels)
        self._log_likelihoods = np.zeros((problem.num_objects, problem.num_shapes))
        self._touches: list[tuple[Touch, ...]] = [()] * problem.num_objects
        self._marginals = self._compute(self._log_likelihoods)

    def touches(self, object_index: int) -> tuple[Touch, ...]:
        """All touches of one object so far."""
        return self._touches[object_index]

    def marginals(self) -> Floats:
        """Posterior over shapes of every object, ``(N, K)``; do not write to it."""
        return self._marginals

    def belief(self, object_index: int) -> Belief:
        """Posterior of one object, given all touches of all objects."""
        return Belief.from_probs(self.labels, self._marginals[object_index])

    def update(self, object_index: int, touches: Sequence[Touch]) -> Belief:
        """Take in new touches of one object and return its posterior.

        Raises:
            ImpossibleObservation: no arrangement explains the touches; the scene's belief is unchanged.
        """
        all_touches = (*self._touches[object_index], *touches)
        log_likelihoods = self._log_likelihoods.copy()
        log_likelihoods[object_index] = self._model.log_likelihood(all_touches)
        try:
            marginals = self._compute(log_likelihoods)
        except ImpossibleObservation as error:
            poses = [touch.pose for touch in touches]
            raise ImpossibleObservation(
                f"touching object {object_index} in poses {poses}, {self.belief(object_index)}: {error}"
            ) from error
        self._log_likelihoods, self._marginals = log_likelihoods, marginals
        self._touches[object_index] = all_touches
        return self.belief(object_index)

    def _compute(self, log_likelihoods: Floats) -> Floats:
        if self._composition is Composition.DISTINCT:
            return arrangement_marginals(log_likelihoods)
        log_posterior, _ = update(self._prior.log_probs, log_likelihoods)
        return np.exp(log_posterior)
