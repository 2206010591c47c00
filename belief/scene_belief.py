"""The joint belief about all objects on a table, coupled by the composition of the scene."""

from __future__ import annotations

import warnings
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from belief.arrangement import log_arrangement_marginals, num_states
from belief.bayes import update
from belief.categorical import Belief
from belief.conflict import continued_bets
from belief.errors import ImpossibleObservation, ZeroPriorTarget
from belief.naming import Name
from belief.observation_model.evidence import ObjectEvidence, start
from belief.observation_model.model import ObservationModel
from belief.observation_model.sensor_health import SensorEvidence, SensorHealthModel
from belief.observation_model.sensor_worlds import SensorHealth
from belief.problem import SearchProblem, Touch, TouchHistory
from belief.scene_view import ReadableScene, SceneView
from belief.validation import Floats


class SceneBelief(ReadableScene):
    """The exact joint belief about all objects of a search, for touches in any order.

    It stores an ``(N, K)`` table of log-likelihoods. For ``independent`` objects each row gives its own posterior; for
    objects from a bag the marginals come from :mod:`belief.arrangement`. Rejecting an object is not evidence and
    changes no belief.

    Args:
        problem: the search.
        model: likelihood of touches.
        prior: belief about one object of an ``independent`` scene; uniform by default.
        target: label or index of the target shape; used only for the warning :class:`ZeroPriorTarget`.
        log_bets: of the scene of an earlier search with the same set-up, whose conflict test this one continues.

    Raises:
        ValueError: problem, model and prior have different shapes; a prior where the composition fixes one; more
            multisets of shapes than :data:`belief.arrangement.MAX_STATES`; a target out of range.
        UnknownName: no shape has the target's name.

    >>> from belief import Counts
    >>> from belief.synthetic import random_model
    >>> model, rng = random_model(np.random.default_rng(0), num_shapes=3), np.random.default_rng(1)
    >>> bag = Counts({"shape_0": 1, "shape_1": 2})
    >>> scene = SceneBelief(SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 3, bag), model)
    >>> print(scene.update(0, model.sample(0, poses=[0, 1, 2, 2], rng=rng)))
    Belief(shape_0 0.906, shape_1 0.094, shape_2 0.000)
    >>> print(scene.belief(2))                                # the bag holds one shape_0
    Belief(shape_0 0.047, shape_1 0.953, shape_2 0.000)
    """

    _touches: list[TouchHistory]
    _evidence: list[ObjectEvidence]

    def __init__(
        self,
        problem: SearchProblem,
        model: ObservationModel,
        prior: Belief | None = None,
        *,
        target: Name | None = None,
        log_bets: ArrayLike = 0.0,
    ) -> None:
        self.labels = tuple(problem.shape_labels)
        if self.labels != tuple(model.shape_labels):
            raise ValueError(f"the problem is about {self.labels}, the model about {tuple(model.shape_labels)}")
        self._counts = problem.counts
        if prior is not None and self._counts is not None:
            raise ValueError(
                f"the composition {problem.composition!r} fixes the prior; leave it out or use 'independent'"
            )
        if prior is not None and prior.labels != self.labels:
            raise ValueError(f"the problem is about {self.labels}, the prior about {prior.labels}")
        if self._counts is not None:
            num_states(self._counts, problem.num_objects)  # raises now, not in the middle of a search
        self._prior = prior if prior is not None else Belief.uniform(self.labels)
        self._log_likelihoods = np.zeros((problem.num_objects, problem.num_shapes))
        self._touches = [TouchHistory() for _ in range(problem.num_objects)]
        self._evidence = [start(model)] * problem.num_objects
        self._sensor = model if isinstance(model, SensorHealthModel) else None
        like = self._evidence[0].log_bets if self._sensor is None else self._sensor.health().log_bets
        self._earlier_bets = continued_bets(log_bets, like)
        self._health = None if self._sensor is None else self._sensor.health(self._earlier_bets)
        self._touched: dict[int, SensorEvidence] = {}  # of the objects, in the order of their first touches
        self._log_marginals = self._compute(self._log_likelihoods)
        if target is not None and np.isneginf(self._log_marginals[:, self._shape(target)]).all():
            label = self.labels[self._shape(target)]
            source = "the prior" if self._counts is None else "the bag"
            warnings.warn(
                ZeroPriorTarget(f"the target {label} has probability zero in {source}; no touch can find it"),
                stacklevel=2,
            )

    def view(self) -> SceneView:
        """A read-only view of the current belief, which later touches do not change."""
        return SceneView(self)

    def update(self, object_index: int, touches: Iterable[Touch]) -> Belief:
        """Update the belief with new touches of one object and return its posterior.

        Raises:
            ValueError: an object index out of range, or a touch does not fit the model.
            ImpossibleObservation: every arrangement has likelihood zero; the belief is unchanged.
        """
        self._object(object_index)
        new, evidence, health, touched = tuple(touches), self._evidence[object_index], self._health, self._touched
        log_likelihoods = self._log_likelihoods.copy()
        if self._sensor is None:
            for touch in new:
                evidence = evidence.update(touch)
            log_likelihoods[object_index] = evidence.log_likelihood
        elif new:
            log_likelihoods, touched, health = self._coupled(self._sensor, object_index, new)
            evidence = touched[object_index]
        try:
            log_marginals = self._compute(log_likelihoods)
        except ImpossibleObservation as error:
            poses = [touch.pose for touch in new]
            raise ImpossibleObservation(
                f"touching object {object_index} in poses {poses}, {self.belief(object_index)}: {error}"
            ) from error
        self._log_likelihoods, self._log_marginals = log_likelihoods, log_marginals
        self._evidence[object_index], self._health, self._touched = evidence, health, touched
        for index, one in touched.items():
            self._evidence[index] = one
        self._touches[object_index] = self._touches[object_index].extended(new)
        return self.belief(object_index)

    def _coupled(
        self, sensor: SensorHealthModel, object_index: int, touches: tuple[Touch, ...]
    ) -> tuple[Floats, dict[int, SensorEvidence], SensorHealth]:
        """Log-likelihoods of all objects after new touches of one, which also tell about the sensor of all."""
        assert self._health is not None, "set with the sensor"
        found, new = dict(self._touched), {object_index: touches}
        evidence = found[object_index] if object_index in found else sensor.start_in(self._health.awake)
        found[object_index] = evidence.updated(touches)
        likely, health = sensor.over_objects(list(found.values()), self._earlier_bets)
        asleep = [] if health.is_clear else [index for index, one in found.items() if one.has_sleepers]
        for index in asleep:
            found[index] = sensor.start().updated((*self._touches[index], *new.get(index, ())))
        if asleep:
            likely, health = sensor.over_objects(list(found.values()), self._earlier_bets)
        log_likelihoods = self._log_likelihoods.copy()
        log_likelihoods[list(found)] = likely
        return log_likelihoods, found, health

    def _compute(self, log_likelihoods: Floats) -> Floats:
        """Log marginals of every object, ``(N, K)``."""
        if self._counts is None:
            return update(self._prior.log_probs, log_likelihoods)[0]
        return log_arrangement_marginals(log_likelihoods, self._counts)
