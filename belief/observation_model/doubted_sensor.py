"""A sensor whose description is doubted when there is a reason, and which then asks what is the matter.

As long as nothing is odd, the evidence is that of the joint model of one rigid body, to the last bit. Before an answer
may be given, a :class:`Doubts` is asked about all touches. In doubt, their images are read again under many states of
the sensor (:class:`~belief.observation_model.sensor_health.SensorHealthModel`), and a component that explains nothing
takes part with the evidence that no state explains what was felt: under it every shape is equally probable. A sensor
whose description leaves its state open is in doubt from the start: its nominal model weighs the states.

A sensor that doubts from the start and finds that its embeddings have the wrong sign:

>>> from belief.observation_model import FixedHypotheses, FixedWorlds, RigidBodyModel, spread_prior
>>> table = np.array([[[[2.0, 0.0]], [[0.0, 2.0]]]], np.float32)                        # one pose, two shapes
>>> one = np.ones((1, 1, 2))
>>> nominal = RigidBodyModel(("mug", "cup"), 1, 1.0, one, one, hypotheses=FixedHypotheses(table))
>>> states = SensorHealthModel(nominal, FixedWorlds(-table[:, None]), ("wrong sign",), spread_prior(1))
>>> class Always:
...     labels = ("wrong sign",)
...     def are_odd(self, objects, log_conflict): return True
...     def states(self): return states
...     def read_again(self, touch): return touch
...     def explained(self, objects, log_likelihoods, health): return Explanation(log_likelihoods, str(health), -2.0)
>>> model = DoubtedSensorModel(nominal, Always())
>>> cup = Touch(0, features=np.array([0.0, -3.0]), image=np.zeros((1, 1), np.uint8))
>>> evidence = [model.start().update(cup).update(cup) for _ in range(3)]
>>> log_likelihoods, health = model.over_objects(evidence, 0.0)
>>> print(health)
nearest of the listed states: wrong sign 1.00
>>> log_likelihoods.argmax(axis=1).tolist(), evidence[0].log_likelihood.argmax()
([1, 1, 1], np.int64(0))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.conflict import log_conflict
from belief.frozen import frozen
from belief.observation_model.model import ArrayModel
from belief.observation_model.nominal import BesideNominal, OfNominal
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence
from belief.observation_model.sensor_health import SensorEvidence, SensorHealthModel
from belief.observation_model.sensor_worlds import AS_DESCRIBED, SensorHealth
from belief.observation_model.varied_bodies import VariedBodyModel, VariedEvidence
from belief.problem import Touch
from belief.validation import Floats

UNEXPLAINED = 0.005
"""Prior probability, in doubt, that no listed or composed state of the sensor explains the touches."""
_MOST_KEPT = 4.0  # log Bayes factor of the unexplained that one search may leave to the next


class Explanation(NamedTuple):
    """What states of a sensor say about touches of n objects.

    Attributes:
        log_likelihoods: of the shapes of each object, up to a constant of each, ``(n, K)``.
        words: the likeliest states, for people.
        log_unexplained: log Bayes factor of "none of these states" against them.
    """

    log_likelihoods: Floats
    words: str
    log_unexplained: float


class Doubts(Protocol):
    """Says when the description of a sensor is doubted, and reads its images in other states."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the W states that :meth:`states` weighs beside the described one."""

    def are_odd(self, objects: Sequence[DoubtedEvidence], log_conflict: float) -> bool:
        """Whether the touches of some objects are odd for the sensor as described; asked after every touch."""

    def states(self) -> SensorHealthModel:
        """The model with other states of the sensor, which may take a minute to prepare."""

    def read_again(self, touch: Touch) -> Touch:
        """A touch from the image of another, as the model of states reads it."""

    def explained(
        self, objects: Sequence[DoubtedEvidence], log_likelihoods: Floats, health: SensorHealth
    ) -> Explanation:
        """What the listed states, or composed ones, say; given what the listed ones say, ``(n, K)``."""

    def log_stranger(self, one: DoubtedEvidence) -> float:
        """Log ratio of some body that has none of the shapes to these, for a sensor as described."""

    def log_strangers(self, one: DoubtedEvidence) -> Floats:
        """What states say of some body, ``(C,)``; see :meth:`SensorHealthModel.over_objects`."""


@dataclass(frozen=True, eq=False)
class DoubtedSensorModel(OfNominal, ArrayModel):
    """The joint model of one rigid body, whose sensor may be in another state than described.

    :class:`~belief.scene_belief.SceneBelief` couples the objects. Elsewhere, and for touches without an image, this is
    the nominal model. Samples, tables, predicted outcomes and the file are those of the nominal model.

    Attributes:
        nominal: the sensor as described; or in any of the states that its description allows, which are then weighed
            from the first touch in place of those of the doubts.
        doubts: says when that is doubted, and what may be the matter.
    """

    nominal: RigidBodyModel | VariedBodyModel | SensorHealthModel
    doubts: Doubts

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape_labels", self.nominal.shape_labels)
        self.freeze()

    def start(self) -> DoubtedEvidence:
        """See :class:`ArrayModel`."""
        return DoubtedEvidence(self, self.nominal.start())

    def start_in(self, awake: NDArray[np.int64]) -> DoubtedEvidence:
        """See :class:`~belief.observation_model.model.CouplesObjects`; all states are asked in doubt."""
        return self.start()

    def health(self, log_bets: ArrayLike = 0.0, is_clear: bool = True) -> DoubtedHealth:
        """What is known after a session with these bets (:attr:`DoubtedHealth.log_bets`), or before any."""
        bets, in_doubt, unexplained, told = self._apart(log_bets)
        words = "as before" if in_doubt else AS_DESCRIBED
        return DoubtedHealth(bets, in_doubt, unexplained, told, words)

    def over_objects(
        self, evidence: Sequence[DoubtedEvidence], log_bets: ArrayLike, log_odds: float | None = None
    ) -> tuple[Floats, DoubtedHealth]:
        """Log likelihoods of the shapes of n touched objects, ``(n, K)``, each given all others, and the health.

        Args:
            evidence: about each object, in the order of their first touches.
            log_bets: of the session before these objects (:attr:`DoubtedHealth.log_bets`), or zeros.
            log_odds: prior log odds that an object has none of the shapes; None if that is impossible. If not, the
                health says how likely that makes the touches (:attr:`DoubtedHealth.log_unlisted`).
        """
        bets, was_doubted, before, told = self._apart(log_bets)
        likely = np.stack([one.nominal.log_likelihood for one in evidence])
        known = DoubtedHealth(bets, was_doubted, before, told, AS_DESCRIBED, tuple(evidence))
        have_images = all(one.has_images for one in evidence)
        is_doubted = self._is_open or (
            have_images and (was_doubted or self.doubts.are_odd(evidence, known.log_conflict))
        )
        if not is_doubted:
            return likely, known if log_odds is None else replace(known, log_unlisted=self._log_unlisted(evidence))
        inferred, strange = [one.inferred for one in evidence], None
        if log_odds is not None and have_images:
            strange = np.stack([self.doubts.log_strangers(one) for one in evidence])
        found, health = self.states.over_objects(inferred, told, strange, log_odds)
        if not have_images:
            words, log_unlisted = str(health), None if log_odds is None else self._log_unlisted(evidence)
            tells = bets, True, before, health.log_bets, words, tuple(evidence), health.log_conflict
            return found, DoubtedHealth(*tells, log_unlisted)
        number, log_strange = likely.shape[1], health.log_conflict
        listed = found[:, :number]
        explained, words, unexplained = self.doubts.explained(evidence, listed, health)
        unexplained += before
        odds = unexplained + np.log(UNEXPLAINED) - np.log1p(-UNEXPLAINED)
        means, best = (np.logaddexp.reduce(one, axis=1, keepdims=True) - np.log(number) for one in (listed, explained))
        mixed = np.logaddexp(explained - best, odds) - np.logaddexp(0.0, odds)
        known = DoubtedHealth(bets, True, unexplained, health.log_bets, words, tuple(evidence), log_strange)
        if strange is None:
            return mixed, known
        others = found[:, number] - np.maximum(means, best)[:, 0]
        return mixed, replace(known, log_unlisted=np.logaddexp(others, odds) - np.logaddexp(0.0, odds))

    def _log_unlisted(self, evidence: Sequence[DoubtedEvidence]) -> Floats:
        """Log p(touches | none of the shapes) for a sensor as described, on the nominal scale, ``(n,)``.

        Two likelihood ratios are averaged: the bets of the nominal model, and what the doubts say of random bodies.
        """
        found = []
        for one in evidence:
            listed = float(np.logaddexp.reduce(one.log_likelihood)) - np.log(len(one.log_likelihood))
            bets, bodies = one.log_unlisted, self.doubts.log_stranger(one) if one.has_images else -np.inf
            found.append(np.logaddexp(bets, listed + bodies) - np.log(2.0))
        return np.array(found)

    @property
    def _is_open(self) -> bool:
        """Whether the description leaves the state of the sensor open."""
        return isinstance(self.nominal, SensorHealthModel)

    @property
    def states(self) -> SensorHealthModel:
        """The model with other states of the sensor, which may take a minute to prepare."""
        return self.nominal if isinstance(self.nominal, SensorHealthModel) else self.doubts.states()

    def _apart(self, log_bets: ArrayLike) -> tuple[Floats, bool, float, Floats]:
        """Bets of the conflict test, whether there was doubt, log Bayes factor of the unexplained, bets of states."""
        nominal = self.nominal.start().log_bets
        number = 1 if nominal is None else len(nominal)
        given = np.zeros(number + 2 + len(self.doubts.labels) + 3) + np.asarray(log_bets, np.float64)
        return given[:number], bool(given[number] > 0.5), float(given[number + 1]), given[number + 2 :]


@dataclass(frozen=True, eq=False)
class DoubtedEvidence(BesideNominal):
    """Evidence about one object: the nominal one, and, once asked for, the evidence in other states of the sensor.

    ``again`` are its touches as the model of states reads them, and ``inferred`` their evidence; both are made at first
    use, and continued from then on.
    """

    model: DoubtedSensorModel
    nominal: RigidBodyEvidence | VariedEvidence | SensorEvidence
    touches: tuple[Touch, ...] = ()

    def update(self, touch: Touch) -> DoubtedEvidence:
        """The evidence with one more touch."""
        found = DoubtedEvidence(self.model, self.nominal.update(touch), (*self.touches, touch))
        if touch.image is not None:
            if "again" in vars(self):
                found.__dict__["again"] = (*self.again, self.model.doubts.read_again(touch))
            if "inferred" in vars(self) and not isinstance(self.nominal, SensorEvidence):
                found.__dict__["inferred"] = self.inferred.update(found.again[-1])
        if "sums" in vars(self):
            found.__dict__["sums"] = dict(self.sums)
        return found

    @cached_property
    def has_images(self) -> bool:
        """Whether all touches can be read again: they have an image, and were made in poses of the problem."""
        return all(touch.image is not None and touch.elsewhere is None for touch in self.touches)

    @cached_property
    def again(self) -> tuple[Touch, ...]:
        """The touches as the model of states reads them."""
        return tuple(self.model.doubts.read_again(touch) for touch in self.touches)

    @cached_property
    def inferred(self) -> SensorEvidence:
        """The evidence of these touches in all states of the sensor."""
        if isinstance(self.nominal, SensorEvidence):
            return self.nominal
        return self.model.states.start().updated(self.again)

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """What a :class:`Doubts` has computed about these touches."""
        return {}

    @cached_property
    def sums(self) -> dict[Any, tuple[int, Floats]]:
        """What a :class:`Doubts` sums over the touches, and over how many; the next evidence goes on from them."""
        return {}

    @property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`: as the nominal model reads the touches."""
        return self.nominal.log_likelihood

    @property
    def log_unlisted(self) -> float:
        """As the nominal model weighs it; :meth:`DoubtedSensorModel.over_objects` asks the doubts as well."""
        return getattr(self.nominal, "log_unlisted", -np.inf)

    @property
    def has_sleepers(self) -> bool:
        """See :class:`~belief.observation_model.sensor_health.SensorEvidence`; no state ever sleeps."""
        return False

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process, without what can be computed anew."""
        return {name: vars(self)[name] for name in ("model", "nominal", "touches")}


@dataclass(frozen=True, eq=False)
class DoubtedHealth:
    """What a session knows about its sensor. A frozen value.

    Attributes:
        earlier_bets: log wealth of the conflict test before these objects, ``(J,)``.
        in_doubt: whether the description of the sensor is doubted.
        log_unexplained: log Bayes factor of "no state explains the touches"; 0 before any doubt.
        told: log bets of the states (:attr:`SensorHealth.log_bets`), zeros before any doubt.
        words: the likeliest states.
        evidence: about the objects of the search.
        log_strange: log Bayes factor of the states' component that knows nothing (:attr:`SensorHealth.log_conflict`).
        log_unlisted: log p(touches | none of the shapes) of each of them, on the scale of the log likelihoods of the
            shapes, ``(n,)``; None where that was not asked.
    """

    earlier_bets: Floats
    in_doubt: bool
    log_unexplained: float
    told: Floats
    words: str
    evidence: tuple[DoubtedEvidence, ...] = ()
    log_strange: float = 0.0
    log_unlisted: Floats | None = None
    is_clear: ClassVar[bool] = True

    @property
    def awake(self) -> NDArray[np.int64]:
        """See :class:`SensorHealth`; nothing is kept asleep."""
        return np.zeros(0, np.int64)

    @property
    def probs(self) -> Floats:
        """Probability of all states together, and that none explains the touches, ``(2,)``; without doubt, 1 and 0."""
        odds = self.log_conflict + np.log(UNEXPLAINED) - np.log1p(-UNEXPLAINED)
        return np.exp(-np.logaddexp(0.0, [odds, -odds])) if self.in_doubt else np.array([1.0, 0.0])

    @cached_property
    def log_bets(self) -> Floats:
        """What the next search of the session begins with."""
        kept = min(self.log_unexplained, _MOST_KEPT)
        return frozen(np.concatenate([self._bets, [float(self.in_doubt), kept], self.told]))

    @cached_property
    def _bets(self) -> Floats:
        bets = (one.nominal.log_bets for one in self.evidence)
        return np.asarray(sum((some for some in bets if some is not None), start=self.earlier_bets))

    @cached_property
    def log_conflict(self) -> float:
        """Without doubt, that of the conflict test; in doubt, the log Bayes factor that no state explains the touches.

        The latter is the larger one of presses of what is believed, and of how strange the touches are in all states. A
        conflict with the sensor as described is the reason of a doubt, and explained by another state.
        """
        return max(self.log_unexplained, self.log_strange) if self.in_doubt else log_conflict([self._bets])

    def __str__(self) -> str:
        """The likeliest states of the sensor."""
        if not self.in_doubt or self.words == AS_DESCRIBED:
            return self.words
        odds = self.log_conflict + np.log(UNEXPLAINED)
        return f"{'none explains the touches; ' if odds > 0.0 else ''}nearest of the listed states: {self.words}"
