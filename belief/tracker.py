"""A Bayes filter for the shape of one object."""

from __future__ import annotations

from belief.bayes import update
from belief.categorical import Belief
from belief.errors import ImpossibleObservation
from belief.observation_model.evidence import start
from belief.observation_model.model import ObservationModel
from belief.problem import Touch, TouchHistory


class BeliefTracker:
    """Bayes filter for the shape of one object.

    Args:
        prior: belief before the first touch.
        model: likelihood of touches.

    Attributes:
        belief: the current posterior.
        log_evidence: log p(all touches) under the prior and the model, up to the constant of the model's
            log-likelihood [nats]. Compare it between priors of one model and the same touches only.

    Raises:
        ValueError: the prior and the model have different shapes.

    >>> import numpy as np
    >>> from belief.synthetic import random_model
    >>> rng = np.random.default_rng(0)
    >>> model = random_model(rng)
    >>> tracker = BeliefTracker(Belief.uniform(model.shape_labels), model)
    >>> for touch in model.sample(2, poses=[0, 1, 2, 0], rng=rng):
    ...     belief = tracker.update(touch)
    >>> print(belief)
    Belief(shape_0 0.082, shape_1 0.001, shape_2 0.917, shape_3 0.000)
    """

    def __init__(self, prior: Belief, model: ObservationModel) -> None:
        if prior.labels != tuple(model.shape_labels):
            raise ValueError(f"the prior is about {prior.labels}, the model about {tuple(model.shape_labels)}")
        self._prior = prior
        self._evidence = start(model)
        self.belief = prior
        self._touches = TouchHistory()
        self.log_evidence = 0.0

    @property
    def touches(self) -> TouchHistory:
        """All touches, oldest first; immutable."""
        return self._touches

    def update(self, touch: Touch) -> Belief:
        """Update the belief with a touch and return the posterior.

        Raises:
            ImpossibleObservation: the touch has likelihood zero for every possible shape; the tracker is unchanged.
        """
        evidence = self._evidence.update(touch)
        try:
            log_posterior, log_evidence = update(self._prior.log_probs, evidence.log_likelihood)
        except ImpossibleObservation as error:
            raise ImpossibleObservation(f"touch in pose {touch.pose}, {self.belief}: {error}") from error
        self.belief = Belief.of_normalised(self._prior.labels, log_posterior)
        self._evidence, self.log_evidence = evidence, float(log_evidence)
        self._touches = self._touches.extended([touch])
        return self.belief
