"""The joint belief about all objects on a table, coupled by what is known of the composition."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belief.arrangement import blank_objects, log_arrangement_marginals, num_states, prob_shape_absent
from belief.bayes import update
from belief.categorical import Belief
from belief.errors import ImpossibleObservation
from belief.history import TouchHistory
from belief.impossible_evidence import RAISE, ImpossiblePolicy, warn_of_zero_prior
from belief.observation_model import ObservationModel
from belief.observation_model.evidence import start
from belief.problem import Floats, SearchProblem, Touch
from belief.scene_view import SceneView

_UNKNOWN = -1


@dataclass(frozen=True)
class ExactState:
    """What an exact posterior of a scene has to remember, at the least.

    Attributes:
        name: of the representation.
        num_states: numbers in it.
        reason: why it is enough, in a sentence.
    """

    name: str
    num_states: int
    reason: str


class SceneBelief:
    """The joint belief about all objects of a search: exact, whatever was touched in whatever order.

    It keeps an ``(N, K)`` table of log-likelihoods. For ``independent`` objects each row gives a posterior by itself;
    where the objects came from a bag of known content, the marginals come from :mod:`belief.arrangement`. Rejecting an
    object is a decision, not evidence: it changes nothing here. Being told an object's shape is evidence: see
    :meth:`known` and :meth:`remove`. Object indices never change their meaning, whatever is removed.

    Args:
        problem: the search.
        model: likelihood of touches.
        prior: belief about one object of an ``independent`` scene; uniform by default.
        target: index of the shape sought, if any; only to warn where it has no chance.
        on_impossible: what to do when no arrangement explains the touches.

    Raises:
        ValueError: problem, model and prior are about different shapes; a prior where the composition fixes one; more
            multisets of shapes than can be summed over (more than 20 distinct shapes and objects); a target that is no
            shape.

    >>> from belief import Counts
    >>> from belief.synthetic import random_model
    >>> model, rng = random_model(np.random.default_rng(0), num_shapes=3), np.random.default_rng(1)
    >>> bag = Counts({"shape_0": 1, "shape_1": 2})
    >>> scene = SceneBelief(SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 3, bag), model)
    >>> print(scene.update(0, model.sample(0, poses=[0, 1, 2, 2], rng=rng)))
    Belief(shape_0 0.906, shape_1 0.094, shape_2 0.000)
    >>> print(scene.belief(2))                                # which leaves the other shape for the others
    Belief(shape_0 0.047, shape_1 0.953, shape_2 0.000)
    >>> scene.state.num_states
    5
    >>> scene.remove(0, shape=0)                              # found: it was the one
    >>> scene.prob_present(0)
    0.0
    """

    def __init__(
        self,
        problem: SearchProblem,
        model: ObservationModel,
        prior: Belief | None = None,
        *,
        target: int | None = None,
        on_impossible: ImpossiblePolicy = RAISE,
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
            num_states(self._counts, problem.num_objects)  # better refused now than in the middle of a search
        self._prior = prior if prior is not None else Belief.uniform(self.labels)
        self._on_impossible = on_impossible
        self._log_likelihoods = np.zeros((problem.num_objects, problem.num_shapes))
        self._touches = [TouchHistory() for _ in range(problem.num_objects)]
        self._evidence = [start(model)] * problem.num_objects
        self._known = np.full(problem.num_objects, _UNKNOWN)
        self._on_table = np.ones(problem.num_objects, np.bool_)
        self._log_marginals = self._compute(self._log_likelihoods, self._known)
        if target is not None and np.isneginf(self._log_marginals[:, self._shape(target)]).all():
            warn_of_zero_prior(self.labels[target], "the prior" if self._counts is None else "the bag")

    def view(self) -> SceneView:
        """The belief as it is now, for reading only: what comes later does not show in it."""
        now = copy.copy(self)
        now._touches, now._evidence = self._touches.copy(), self._evidence.copy()  # what is changed in place
        now._on_table = self._on_table.copy()
        return SceneView(now)

    @property
    def num_objects(self) -> int:
        """N, those that are known or removed included."""
        return len(self._touches)

    def touches(self, object_index: int) -> TouchHistory:
        """All touches of one object that count, oldest first; it stays as it is when more are made."""
        return self._touches[self._object(object_index)]

    def marginals(self) -> Floats:
        """Posterior over shapes of every object, ``(N, K)``, those that are known or removed included."""
        return np.exp(self._log_marginals)

    def log_marginals(self) -> Floats:
        """Logarithms of :meth:`marginals`, ``(N, K)``, right where those are too small for a float; a copy."""
        return self._log_marginals.copy()

    def log_likelihoods(self) -> Floats:
        """Log p(touches of each object | its shape), ``(N, K)``; a copy."""
        return self._log_likelihoods.copy()

    def belief(self, object_index: int) -> Belief:
        """Posterior of one object, given all touches of all objects."""
        return Belief.of_normalised(self.labels, self._log_marginals[self._object(object_index)].copy())

    def update(self, object_index: int, touches: Sequence[Touch]) -> Belief:
        """Take in new touches of one object and return its posterior.

        Raises:
            ValueError: the object is none of the N, or no longer on the table.
            ImpossibleObservation: no arrangement explains the touches, and the policy is to raise; the scene's belief
                is unchanged.
        """
        if not self._on_table[self._object(object_index)]:
            raise ValueError(f"object {object_index} is no longer on the table and cannot be touched")
        all_touches, evidence = self._touches[object_index].extended(touches), self._evidence[object_index]
        for touch in touches:
            evidence = evidence.update(touch)
        log_likelihoods = self._log_likelihoods.copy()
        log_likelihoods[object_index] = self._on_impossible.temper(evidence.log_likelihood)
        try:
            log_marginals = self._compute(log_likelihoods, self._known)
        except ImpossibleObservation as error:
            poses = [touch.pose for touch in touches]
            explained = ImpossibleObservation(
                f"touching object {object_index} in poses {poses}, {self.belief(object_index)}: {error}"
            )
            explained.__cause__ = error
            self._on_impossible.resolve(explained)
            return self.belief(object_index)
        self._log_likelihoods, self._log_marginals = log_likelihoods, log_marginals
        self._evidence[object_index] = evidence
        self._touches[object_index] = all_touches
        return self.belief(object_index)

    def known(self, object_index: int, shape: int) -> None:
        """Take in that an object certainly has a shape, because somebody looked.

        The others' beliefs are conditioned on it, so a bag then holds one object of the shape less for them. The object
        stays on the table.

        Raises:
            ValueError: the object is none of the N, or the shape none of the K.
            ImpossibleObservation: the object is known to have another shape, or the touches, the prior or the bag rule
                this one out; nothing has changed then, whatever the policy.
        """
        before = self._known[self._object(object_index)]
        if before not in (_UNKNOWN, self._shape(shape)):
            raise ImpossibleObservation(
                f"object {object_index} cannot be a {self.labels[shape]}: it is known to be a {self.labels[before]}"
            )
        known = self._known.copy()
        known[object_index] = shape
        try:
            self._log_marginals = self._compute(self._log_likelihoods, known)
        except ImpossibleObservation as error:
            raise ImpossibleObservation(
                f"object {object_index} cannot be a {self.labels[shape]}, {self.belief(object_index)}: {error}"
            ) from error
        self._known = known

    def remove(self, object_index: int, shape: int | None = None) -> None:
        """Take an object off the table, with its shape if that is known now, as of one that was found.

        It can no longer be touched and no longer counts as present, but what was learned about it still tells about the
        others. Their indices stay as they are.

        Raises:
            ValueError, ImpossibleObservation: as :meth:`known`; the object then stays on the table.
        """
        if shape is not None:
            self.known(object_index, shape)
        self._on_table[self._object(object_index)] = False

    def prob_present(self, target: int) -> float:
        """Probability that an object still on the table has the target shape, given all that was felt and told.

        Raises:
            ValueError: the target is none of the K shapes.
        """
        target = self._shape(target)
        if (self._known[self._on_table] == target).any():
            return 1.0
        unknown = self._known == _UNKNOWN
        if self._counts is None:
            probs = np.minimum(np.exp(self._log_marginals[unknown & self._on_table, target]), 1.0)
            with np.errstate(divide="ignore"):
                return 1.0 - float(np.exp(np.log1p(-probs).sum()))
        if not (unknown & self._on_table).any():
            return 0.0
        bag = self._bag(self._known)
        return 1.0 - prob_shape_absent(self._log_likelihoods[unknown], bag, target, self._on_table[unknown])

    @property
    def state(self) -> ExactState:
        """The smallest exact state of this scene as it is now: it grows with touches, and what is known drops out."""
        unknown = self._known == _UNKNOWN
        if self._counts is None:
            return ExactState(
                "one distribution per object",
                int(unknown.sum()) * len(self.labels),
                "shapes are independent, so an object's own touches are all that tells about it",
            )
        bag = self._bag(self._known)
        blank = blank_objects(self._log_likelihoods[unknown], bag)
        num_rows = int((~blank).sum()) + bool(blank.any())
        distinct = max(self._counts) == 1
        return ExactState(
            "sets of used shapes" if distinct else "multisets of used shapes",
            num_states(bag, num_rows),
            f"objects are coupled only by what others use up of the bag, so sums over arrangements remember which "
            f"{'shapes' if distinct else 'shapes, how often,'} are used and not by whom; {int(blank.sum())} of "
            f"{int(unknown.sum())} unknown objects told nothing yet, are alike and count as one",
        )

    def _compute(self, log_likelihoods: Floats, known: np.ndarray) -> Floats:
        """Log marginals of every object, ``(N, K)``."""
        unknown, told = known == _UNKNOWN, np.flatnonzero(known != _UNKNOWN)
        contradicted = np.isneginf(log_likelihoods[told, known[told]])
        if contradicted.any():
            index = int(told[np.argmax(contradicted)])
            raise ImpossibleObservation(f"the touches of object {index} rule out {self.labels[known[index]]}")
        log_marginals = np.full(log_likelihoods.shape, -np.inf)
        log_marginals[told, known[told]] = 0.0
        if self._counts is None:
            if np.isneginf(self._prior.log_probs[known[told]]).any():
                raise ImpossibleObservation(f"the prior rules it out: {self._prior}")
            if unknown.any():
                log_marginals[unknown] = update(self._prior.log_probs, log_likelihoods[unknown])[0]
        else:
            bag = self._bag(known)
            if min(bag) < 0:
                raise ImpossibleObservation(f"the bag does not hold that many, counts {list(self._counts)}")
            if unknown.any():
                log_marginals[unknown] = log_arrangement_marginals(log_likelihoods[unknown], bag)
        return log_marginals

    def _bag(self, known: np.ndarray) -> tuple[int, ...]:
        """What the bag has for the objects of unknown shape, ``(K,)``."""
        assert self._counts is not None, "independent objects come from no bag"
        used = np.bincount(known[known != _UNKNOWN], minlength=len(self.labels))
        return tuple(int(count) for count in np.array(self._counts) - used)

    def _object(self, object_index: int) -> int:
        if not 0 <= object_index < len(self._touches):
            raise ValueError(f"object_index must be in [0, {len(self._touches)}), got {object_index}")
        return object_index

    def _shape(self, shape: int) -> int:
        if not 0 <= shape < len(self.labels):
            raise ValueError(f"shape must be in [0, {len(self.labels)}), got {shape}")
        return shape
