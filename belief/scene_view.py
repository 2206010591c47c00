"""Read access to the joint belief about a scene, and a read-only view of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np

from belief.arrangement import prob_shape_absent
from belief.categorical import Belief
from belief.conflict import log_conflict
from belief.frozen import frozen
from belief.naming import Name, index_of
from belief.observation_model.evidence import ObjectEvidence
from belief.observation_model.sensor_worlds import SensorHealth
from belief.problem import TouchHistory
from belief.validation import Floats, require_index

UNKNOWN = -1
"""Marks an object of unknown shape in an arrangement."""


class ReadableScene:
    """Methods of :class:`~belief.scene_belief.SceneBelief` that read the joint belief about all N objects.

    >>> from belief import SceneBelief
    >>> sorted(name for name in {*dir(SceneBelief)} - {*dir(ReadableScene)} if not name.startswith("_"))
    ['update', 'view']

    Attributes:
        labels: names of the K shapes.
    """

    labels: tuple[str, ...]
    _counts: tuple[int, ...] | None
    _log_likelihoods: Floats
    _log_marginals: Floats
    _touches: Sequence[TouchHistory]
    _evidence: Sequence[ObjectEvidence]
    _earlier_bets: Floats
    _health: SensorHealth | None

    @property
    def num_objects(self) -> int:
        """N."""
        return len(self._touches)

    def touches(self, object_index: int) -> TouchHistory:
        """All touches of one object, oldest first; immutable."""
        return self._touches[self._object(object_index)]

    def evidence(self, object_index: int) -> ObjectEvidence:
        """The evidence of all touches of one object; immutable."""
        return self._evidence[self._object(object_index)]

    def marginals(self) -> Floats:
        """Posterior over shapes of every object, ``(N, K)``."""
        return np.exp(self._log_marginals)

    def log_marginals(self) -> Floats:
        """Logarithms of :meth:`marginals`, ``(N, K)``, exact also where a probability underflows; a copy."""
        return self._log_marginals.copy()

    def log_likelihoods(self) -> Floats:
        """Log p(touches of each object | its shape), ``(N, K)``; a copy."""
        return self._log_likelihoods.copy()

    def belief(self, object_index: int) -> Belief:
        """Posterior of one object, given all touches of all objects."""
        return Belief.of_normalised(self.labels, self._log_marginals[self._object(object_index)].copy())

    def prob_present(self, target: Name) -> float:
        """Probability that an object has the target shape.

        Raises:
            UnknownName: no shape has the target's name.
            ValueError: a target out of range.
        """
        target = self._shape(target)
        if self._counts is None:
            probs = np.minimum(np.exp(self._log_marginals[:, target]), 1.0)
            with np.errstate(divide="ignore"):
                return 0.0 - float(np.expm1(np.log1p(-probs).sum()))  # never -0.0
        return 1.0 - prob_shape_absent(self._log_likelihoods, self._counts, target)

    @property
    def sensor_health(self) -> SensorHealth | None:
        """What the session knows about its sensor after all touches; None for a model with one world of the sensor."""
        return self._health

    @property
    def log_conflict(self) -> float:
        """Natural log of the e-value against "all touches so far come from the world that the model knows".

        For a model with several worlds of the sensor, the Bayes factor of none of them
        (:attr:`belief.observation_model.SensorHealth.log_conflict`).

        It counts the touches of earlier searches too, if their :attr:`log_bets` were given. In that world it ever
        exceeds log(1/α) with probability at most α, up to the dependence between touches that :mod:`belief.conflict`
        describes. It is 0.0 for models without a test.
        """
        return log_conflict([self.log_bets]) if self._health is None else self._health.log_conflict

    @property
    def log_bets(self) -> Floats:
        """Log wealth of every strategy of the conflict test after all touches, ``(J,)``; 0.0 without a test.

        Give it to the next search with the same robot and sensor, so that its test continues this one. For a model with
        several worlds of the sensor, what is known about them.
        """
        if self._health is not None:
            return self._health.log_bets
        bets = (evidence.log_bets for evidence in self._evidence if evidence.log_bets is not None)
        return np.asarray(sum(bets, start=self._earlier_bets))

    def _object(self, object_index: int) -> int:
        require_index("object_index", object_index, len(self._touches))
        return object_index

    def _shape(self, shape: Name) -> int:
        return index_of("shape", self.labels, shape)


class SceneView(ReadableScene):
    """A read-only copy of the joint belief; :meth:`belief.scene_belief.SceneBelief.view` makes one.

    Later touches do not change it. Its arrays are read-only and its attributes cannot be set.

    >>> from belief import SceneBelief, SearchProblem
    >>> from belief.synthetic import random_model
    >>> import numpy as np
    >>> model = random_model(np.random.default_rng(0))
    >>> scene = SceneBelief(SearchProblem(model.shape_labels, ("p0", "p1", "p2"), num_objects=2), model)
    >>> view = scene.view()
    >>> _ = scene.update(0, model.sample(0, [0], np.random.default_rng(0)))
    >>> len(scene.touches(0)), len(view.touches(0)), view.marginals()[0].tolist()
    (1, 0, [0.25, 0.25, 0.25, 0.25])
    """

    def __init__(self, scene: ReadableScene) -> None:
        self.__setstate__({name: getattr(scene, name) for name in ReadableScene.__annotations__})

    def __setstate__(self, state: dict[str, Any]) -> None:
        arrays = {name: frozen(value) for name, value in state.items() if isinstance(value, np.ndarray)}
        lists = {name: tuple(state[name]) for name in ("_touches", "_evidence")}
        self.__dict__.update(state | arrays | lists)

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise AttributeError(f"a view of a scene is read-only: {name} cannot be set")
