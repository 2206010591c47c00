"""Beliefs that touches update: about one object, and about all objects on a table, coupled by their composition."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, cast

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike

from belief.arrangement import (
    log_arrangement_marginals,
    log_at_most_one_marginals,
    num_states,
    prob_at_most_one_present,
    prob_shape_absent,
)
from belief.bayes import Belief, update
from belief.composition import AtMostOne, Composition
from belief.conflict import continued_bets, log_conflict
from belief.errors import ImpossibleObservation, InvalidArgument, ZeroPriorTarget
from belief.frozen import frozen
from belief.naming import Name, index_of
from belief.observation_model.evidence import ObjectEvidence, WeighsStrangers, start
from belief.observation_model.model import CouplesObjects, ObservationModel
from belief.problem import SearchProblem, Touch, TouchHistory
from belief.validation import Floats, require_index

if TYPE_CHECKING:
    from belief.observation_model.sensor_health import SensorEvidence
    from belief.observation_model.sensor_worlds import SensorHealth

_LARGEST = 1e300  # log ratio
_SHOWN = 3  # shapes of an object in a notebook


class Places(NamedTuple):
    """What is known of the places of a composition, which objects take and strangers may take instead.

    ``log_weights (N, K)`` are log p(touches of each object | its place), ``log_marginals (N, K)`` the log posterior of
    the places. None where there are no strangers: ``log_strangers (N, K)``, log p(stranger | place, touches),
    ``log_fit (N,)``, log p(touches | listed shape or stranger) less that of a listed shape, and ``unlisted (N,)``, the
    probability of each object that it is a stranger.
    """

    log_weights: Floats
    log_marginals: Floats
    log_strangers: Floats | None = None
    log_fit: Floats | None = None
    unlisted: Floats | None = None


class ReadableScene:
    """Methods of :class:`SceneBelief` that read the joint belief about all N objects.

    >>> sorted(name for name in {*dir(SceneBelief)} - {*dir(ReadableScene)} if not name.startswith("_"))
    ['update', 'view']

    Attributes:
        labels: names of the K shapes.
    """

    labels: tuple[str, ...]
    _counts: tuple[int, ...] | None
    _sought: int | None
    _log_likelihoods: Floats
    _log_marginals: Floats
    _places: Places
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
        """Posterior over shapes of every object, ``(N, K)``; a row sums to 1 less the part of :meth:`unlisted`."""
        return np.exp(self._log_marginals)

    def unlisted(self) -> Floats:
        """Probability of every object that it has none of the shapes, ``(N,)``."""
        return np.zeros(self.num_objects) if self._places.unlisted is None else self._places.unlisted.copy()

    def log_marginals(self) -> Floats:
        """Logarithms of :meth:`marginals`, ``(N, K)``, exact also where a probability underflows; a copy."""
        return self._log_marginals.copy()

    def log_likelihoods(self) -> Floats:
        """Log p(touches of each object | its shape), ``(N, K)``; a copy."""
        return self._log_likelihoods.copy()

    def belief(self, object_index: int) -> Belief:
        """Posterior of one object, given all touches of all objects."""
        row = self._log_marginals[self._object(object_index)].copy()
        unlisted = self._places.unlisted
        return Belief.of_normalised(self.labels, row, 0.0 if unlisted is None else float(unlisted[object_index]))

    def _repr_html_(self) -> str:
        """The most probable shapes of each object, for a notebook."""
        from belief.table import Table

        rows = []
        for number, (probs, touches) in enumerate(zip(self.marginals(), self._touches, strict=True)):
            likely = np.argsort(-probs, kind="stable")[:_SHOWN]
            words = ", ".join(f"{self.labels[shape]} {probs[shape]:.3f}" for shape in likely)
            rows.append((number, len(touches), words))
        return Table("", [("object", "d"), ("touches", "d"), "most probable shapes"], rows).html()

    def prob_moved(self, object_index: int) -> float:
        """Probability that an object moved just before its last touch; 0.0 for models of objects that stay."""
        moved = getattr(self._evidence[self._object(object_index)], "moved", None)
        if moved is None:
            return 0.0
        weights = np.exp(self._log_marginals[object_index])
        return float(weights @ moved / weights.sum())

    def prob_present(self, target: Name) -> float:
        """Probability that an object has the target shape."""
        target = self._shape(target)
        if self._sought is not None:
            marginals = np.exp(self._log_marginals)
            if target != self._sought:
                marginals[:, self._sought] = np.exp(self._places.log_marginals[:, self._sought])
            return prob_at_most_one_present(marginals, self._sought, target)
        if self._counts is None:
            probs = np.minimum(np.exp(self._log_marginals[:, target]), 1.0)
            with np.errstate(divide="ignore"):
                return 0.0 - float(np.expm1(np.log1p(-probs).sum()))  # never -0.0
        strangers = self._places.log_strangers
        replaced = None if strangers is None else strangers[:, target]
        return 1.0 - prob_shape_absent(self._places.log_weights, self._counts, target, replaced)

    @property
    def sensor_health(self) -> SensorHealth | None:
        """What the session knows about its sensor after all touches; None for a model with one world of the sensor."""
        return self._health

    @property
    def log_conflict(self) -> float:
        """Natural log of the e-value against "all touches so far come from the world that the model knows".

        It counts the touches of earlier searches too, if their :attr:`log_bets` were given. In that world it ever
        exceeds log(1/α) with probability at most α, up to the dependence between touches that :mod:`belief.conflict`
        describes. It is 0.0 for models without a test. For a model with several worlds of the sensor it is
        :attr:`belief.observation_model.SensorHealth.log_conflict`.
        """
        return log_conflict([self.log_bets]) if self._health is None else self._health.log_conflict

    @property
    def log_bets(self) -> Floats:
        """Log wealth of every strategy of the conflict test after all touches, ``(J,)``; 0.0 without a test.

        Where objects may have an unlisted shape, they bet against touches of listed shapes and of strangers alike.

        Give it to the next search with the same robot and sensor, so that its test continues this one. For a model with
        several worlds of the sensor it holds what is known about them.
        """
        if self._health is not None:
            return self._health.log_bets
        bets = [np.zeros(1) if one.log_bets is None else one.log_bets for one in self._evidence]
        for index, fit in enumerate([] if self._places.log_fit is None else self._places.log_fit):
            bets[index] = bets[index] - fit
        return np.asarray(sum(bets, start=self._earlier_bets))

    def _object(self, object_index: int) -> int:
        require_index("object_index", object_index, len(self._touches))
        return object_index

    def _shape(self, shape: Name) -> int:
        return index_of("shape", self.labels, shape)


class SceneView(ReadableScene):
    """A read-only copy of the joint belief; :meth:`SceneBelief.view` makes one.

    Later touches do not change it. Its arrays are read-only and its attributes cannot be set.

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


class SceneBelief(ReadableScene):
    """The exact joint belief about all objects of a search, for touches in any order.

    It stores an ``(N, K)`` table of log-likelihoods. For ``independent`` objects each row gives its own posterior; for
    objects from a bag the marginals come from :mod:`belief.arrangement`. Rejecting an object is not evidence and
    changes no belief.

    Args:
        problem: the search.
        model: likelihood of touches.
        prior: belief about one object of an ``independent`` scene; uniform by default.
        target: label or index of the target shape, for the composition "at_most_one", and for the warning
            :class:`ZeroPriorTarget`.
        log_bets: log bets of the scene of an earlier search with the same set-up, whose conflict test this one
            continues.

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
        problem = problem if target is None else problem.seeking(target)
        sought = problem.composition
        if sought is Composition.AT_MOST_ONE:
            raise InvalidArgument("at most one object has the target's shape: say which, SceneBelief(…, target=…)")
        self._sought = self.labels.index(sought.label) if isinstance(sought, AtMostOne) else None
        self._counts = problem.counts
        if prior is not None and (self._counts is not None or self._sought is not None):
            raise ValueError(
                f"the composition {problem.composition!r} fixes the prior; leave it out or use 'independent'"
            )
        if prior is not None and prior.labels != self.labels:
            raise ValueError(f"the problem is about {self.labels}, the prior about {prior.labels}")
        if self._counts is not None:
            num_states(self._counts, problem.num_objects)  # raises now, not in the middle of a search
        self._prior = prior if prior is not None else Belief.uniform(self.labels)
        self._log_likelihoods = np.zeros((problem.num_objects, problem.num_shapes))
        self._log_opinion: Floats | None = None  # odds against equal probabilities
        if problem.opinion is not None:
            from belief.opinion import tempered

            self._log_opinion = np.log(problem.num_shapes * tempered(problem.opinion))
        self._touches = [TouchHistory() for _ in range(problem.num_objects)]
        self._evidence = [start(model)] * problem.num_objects
        self._sensor = model if isinstance(model, CouplesObjects) else None
        like = self._evidence[0].log_bets if self._sensor is None else self._sensor.health().log_bets
        self._earlier_bets = continued_bets(log_bets, like)
        self._health = None if self._sensor is None else self._sensor.health(self._earlier_bets)
        self._touched: dict[int, SensorEvidence] = {}  # of the objects, in the order of their first touches
        self._log_prior = np.log([1.0 - problem.unlisted, problem.unlisted]) if problem.unlisted else None
        if self._log_prior is not None and not isinstance(self._evidence[0], WeighsStrangers):
            raise InvalidArgument(
                f"the observation model {type(model).__name__} cannot weigh whether an object has none of the shapes; "
                "leave out unlisted, or use a belief about nested cells (a reader of any object)"
            )
        self._strange = np.zeros(problem.num_objects)  # log likelihoods of none of the shapes
        self._places, self._log_marginals = self._compute(self._log_likelihoods, self._strange)
        if target is not None and np.isneginf(self._log_marginals[:, self._shape(target)]).all():
            label = self.labels[self._shape(target)]
            source = "the prior" if self._counts is None else "the bag"
            warnings.warn(
                ZeroPriorTarget(f"the target {label} has probability zero in {source}; no touch can find it"),
                stacklevel=2,
            )

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state | {name: list(state[name]) for name in ("_touches", "_evidence")})

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
        log_likelihoods, strange = self._log_likelihoods.copy(), self._strange.copy()
        if self._sensor is None:
            for touch in new:
                evidence = evidence.update(touch)
            log_likelihoods[object_index] = evidence.log_likelihood
            if self._log_prior is not None:
                strange[object_index] = cast("WeighsStrangers", evidence).log_unlisted  # checked at the start
        elif new:
            log_likelihoods, touched, health = self._coupled(self._sensor, object_index, new)
            evidence = touched[object_index]
            if self._log_prior is not None:
                strange[list(touched)] = cast("Any", health).log_unlisted
        changed = [touched.get(index, one) for index, one in enumerate(self._evidence)]
        changed[object_index] = evidence
        try:
            places, log_marginals = self._compute(log_likelihoods, strange)
        except ImpossibleObservation as error:
            poses = [touch.pose for touch in new]
            raise ImpossibleObservation(
                f"touching object {object_index} in poses {poses}, {self.belief(object_index)}: {error}"
            ) from error
        self._log_likelihoods, self._log_marginals, self._places = log_likelihoods, log_marginals, places
        self._evidence, self._health, self._touched, self._strange = changed, health, touched, strange
        self._touches[object_index] = self._touches[object_index].extended(new)
        return self.belief(object_index)

    def _coupled(
        self, sensor: CouplesObjects, object_index: int, touches: tuple[Touch, ...]
    ) -> tuple[Floats, dict[int, SensorEvidence], SensorHealth]:
        """Log-likelihoods of all objects after new touches of one, which also tell about the sensor of all."""
        assert self._health is not None, "set with the sensor"
        found, new = dict(self._touched), {object_index: touches}
        evidence = found[object_index] if object_index in found else sensor.start_in(self._health.awake)
        found[object_index] = evidence.updated(touches)
        odds = () if self._log_prior is None else (float(np.subtract(*self._log_prior[::-1])),)
        likely, health = sensor.over_objects(list(found.values()), self._earlier_bets, *odds)
        asleep = [] if health.is_clear else [index for index, one in found.items() if one.has_sleepers]
        for index in asleep:
            found[index] = sensor.start().updated((*self._touches[index], *new.get(index, ())))
        if asleep:
            likely, health = sensor.over_objects(list(found.values()), self._earlier_bets, *odds)
        log_likelihoods = self._log_likelihoods.copy()
        log_likelihoods[list(found)] = likely
        return log_likelihoods, found, health

    def _compute(self, log_likelihoods: Floats, strange: Floats) -> tuple[Places, Floats]:
        """The places of the composition, and the log marginals of every object, ``(N, K)``.

        Each object of the composition is replaced by a stranger with the prior probability of unlisted shapes, so that
        the likelihood of a place is that of its shape or of a stranger.
        """
        if self._log_opinion is not None:
            log_likelihoods = log_likelihoods + self._log_opinion
        if self._log_prior is None:
            found = self._marginals_of(log_likelihoods)
            return Places(log_likelihoods, found), found
        both = np.stack([log_likelihoods, np.broadcast_to(strange[:, None], log_likelihoods.shape)])
        both += self._log_prior[:, None, None]
        weights = np.logaddexp(*both)
        found, possible = self._marginals_of(weights), weights > -np.inf
        log_listed, log_strangers = np.subtract(both, weights, np.full(both.shape, -np.inf), where=possible)
        mean = scipy.special.logsumexp(log_likelihoods, axis=1) - np.log(log_likelihoods.shape[1])
        ratios = np.minimum(np.subtract(strange, mean, np.full(len(mean), _LARGEST), where=mean > -np.inf), _LARGEST)
        log_fit = np.logaddexp(self._log_prior[0], self._log_prior[1] + ratios)
        unlisted = np.exp(scipy.special.logsumexp(found + log_strangers, axis=1))
        return Places(weights, found, log_strangers, log_fit, unlisted), found + log_listed

    def _marginals_of(self, log_weights: Floats) -> Floats:
        """Log marginals of every object, ``(N, K)``."""
        if self._sought is not None:
            return log_at_most_one_marginals(log_weights, self._sought)
        if self._counts is None:
            return update(self._prior.log_probs, log_weights)[0]
        return log_arrangement_marginals(log_weights, self._counts)


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
