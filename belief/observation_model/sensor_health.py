r"""The health of the sensor as a latent variable of the session, which is inferred along with the shapes.

    p(o_1.. of all objects | k, w) = ∏_objects j  mean_i ∏_t p(o_t | k_j, R_i, s_i, pose_t, w_j)

A *world* w of the sensor is a way in which it may differ from its description: stiffer, noisier, with a stuck taxel.
The components of the mixture are the sensor as described, W worlds, and one that knows nothing, under which all shapes
are alike. They compare directly, because all ratios log p(o | c, w) / p(o) share p(o). Under the one that knows nothing
every touch has the log ratio zero; or, where touches were simulated in all worlds, the other components' evidence times
the mean e-value of the object's touches against being like one of these (:class:`belief.conflict.SimulatedTouches`).

The component stays from object to object, except that before each object it is drawn anew from the prior with a small
probability (``forgetting``): sensors change. So the posterior over components is that of a hidden Markov chain over
objects, in the order of their first touches, and the belief about each object uses what all others tell about the
sensor. In what one object tells about it, all shapes count alike.

In a long session, very improbable worlds *sleep*: they are not evaluated for every object (:class:`SensorHealth`).

The touches of three objects, two in each, whose embeddings have the wrong sign:

>>> from belief.observation_model import FixedHypotheses, FixedWorlds, spread_prior
>>> table = np.array([[[[2.0, 0.0]], [[0.0, 2.0]]]], np.float32)                        # one pose, two shapes
>>> one = np.ones((1, 1, 2))
>>> nominal = RigidBodyModel(("mug", "cup"), 1, 1.0, one, one, hypotheses=FixedHypotheses(table))
>>> model = SensorHealthModel(nominal, FixedWorlds(-table[:, None]), ("wrong sign",), spread_prior(1))
>>> evidence: list[SensorEvidence] = []
>>> cup = Touch(0, features=np.array([0.0, -3.0]))
>>> for _ in range(3):
...     evidence.append(model.start().update(cup).update(cup))
>>> log_likelihoods, health = model.over_objects(evidence, np.zeros(4))
>>> print(health)
wrong sign 1.00
>>> log_likelihoods.argmax(axis=1).tolist(), int(evidence[0].nominal.log_likelihood.argmax())
([1, 1, 1], 0)
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.conflict import SimulatedTouches
from belief.frozen import frozen
from belief.naming import checked_names
from belief.observation_model.embedded_hypotheses import require_table, scaled
from belief.observation_model.model import ArrayModel
from belief.observation_model.nominal import BesideNominal, OfNominal
from belief.observation_model.outcome_mixture import log_means
from belief.observation_model.rigid_body import RigidBodyModel, joint_model
from belief.observation_model.rigid_body_evidence import (
    RigidBodyEvidence,
    SumsByPlace,
    relative,
    with_touch,
)
from belief.observation_model.sensor_worlds import AS_DESCRIBED, SURE, UNKNOWN, EmbedsWorlds, SensorHealth
from belief.problem import Touch
from belief.validation import SUM_TOLERANCE, Floats, renormalised, require_number

if TYPE_CHECKING:
    from belief.observation_model.varied_bodies import VariedBodyModel, VariedEvidence
    from belief.touch_batch import TouchBatch

_KEPT_BYTES, _KEEPING = 2**27, threading.Lock()  # of tables in single precision
_LEAST = -1e4  # log of a posterior by its prior: an impossible world may come back


@dataclass(frozen=True, eq=False)
class SensorHealthModel(OfNominal, ArrayModel):
    """The joint model of one rigid body, with the world of the sensor as a latent that all objects of a session share.

    :class:`~belief.scene_belief.SceneBelief` couples the objects. For one object alone, the worlds have their prior.
    Samples, tables, predicted outcomes and the file are those of the nominal model.

    Attributes:
        nominal: the sensor as described, whose objects may have other proportions; its conflict test is not used.
        worlds: embeds the hypotheses in W other worlds, pose by pose, at first use.
        world_labels: names of the W worlds; W may be 0.
        prior: probabilities of the components nominal, worlds, unknown, ``(1 + W + 1,)``; see :func:`spread_prior`.
        forgetting: probability that the component is drawn anew before an object, in [0, 1].
        simulated: touches in all worlds, beside which a touch may be strange; None for a log ratio of zero.

    Raises:
        ValueError: names that are not different; a prior that is no distribution over the components, or gives all to
            the unknown one; a forgetting out of range.
    """

    nominal: RigidBodyModel | VariedBodyModel
    worlds: EmbedsWorlds
    world_labels: tuple[str, ...]
    prior: Floats
    forgetting: float = 0.02
    simulated: SimulatedTouches | None = None

    def __post_init__(self) -> None:
        self.to_floats("prior")
        labels = checked_names("labels of the sensor's worlds", (AS_DESCRIBED, *self.world_labels, UNKNOWN))
        prior = self.prior
        if prior.shape != (len(labels),) or not (prior >= 0.0).all() or abs(prior.sum() - 1.0) > SUM_TOLERANCE:
            raise ValueError(f"prior must be {len(labels)} probabilities (nominal, worlds, unknown), got {prior}")
        if not prior[:-1].any():
            raise ValueError("prior gives everything to the unknown world, in which no touch tells anything")
        require_number("forgetting", self.forgetting, 0.0, 1.0)
        object.__setattr__(self, "shape_labels", self.nominal.shape_labels)
        object.__setattr__(self, "world_labels", labels[1:-1])
        object.__setattr__(self, "prior", renormalised(prior))
        self.freeze()

    @cached_property
    def log_prior(self) -> Floats:
        """Log prior of the components, ``(C,)``."""
        with np.errstate(divide="ignore"):
            return frozen(np.log(self.prior))

    def start(self) -> SensorEvidence:
        """See :class:`ArrayModel`; every world is awake."""
        return self.start_in(np.arange(len(self.world_labels)))

    def start_in(self, awake: NDArray[np.int64]) -> SensorEvidence:
        """The evidence before the first touch of an object, with only some worlds awake."""
        nothing = np.zeros((len(awake), len(self.shape_labels), 1))
        return SensorEvidence(self, self.nominal.start().untested(), frozen(awake), frozen(nothing))

    @cached_property
    def _body(self) -> RigidBodyModel:
        """Of nominal proportions, if the sensor is as described."""
        found = joint_model(self.nominal)
        assert found is not None
        return found

    def scores_of(self, touch: Touch, embedding: Floats, awake: NDArray[np.int64]) -> NDArray[np.float32]:
        """Log ratio of a touch under the hypotheses of some worlds, ``(A, K, N')``.

        Raises:
            ValueError: the embedded hypotheses do not fit the model, or are not finite.
        """
        place: int | tuple[float, ...] = int(touch.pose) if touch.elsewhere is None else touch.elsewhere.place
        found = self.worlds.in_pose(place) if isinstance(place, int) else self.worlds.in_place(place)
        wanted = len(self.world_labels), len(self.shape_labels), self._body.references.shape[-1]
        if found.ndim != 4 or (*found.shape[:2], found.shape[3]) != wanted or not found.shape[2]:
            raise ValueError(
                f"hypotheses of other worlds must be (W, K, N', D) = {(*wanted[:2], 'N', wanted[2])}, "
                f"got {found.shape} in {place}"
            )
        if place not in self._checked:
            require_table(found, found.shape)
            self._checked.add(place)
        one = scaled(embedding, self._body.temperature)[0]
        scores = np.empty((len(awake), *found.shape[1:3]), np.float32)
        room, kept, used = np.empty_like(found[0], np.int32), self._kept, {}
        is_settled = found.dtype == np.float16 and 2 * len(awake) < len(found)  # then the same are asked for again
        for row, world in enumerate(awake.tolist()):
            table = kept.get((place, world))
            if table is None:
                table = _single(found[world], np.empty_like(room) if is_settled else room)
            scores[row] = (table.reshape(-1, len(one)) @ one).reshape(scores.shape[1:])
            if is_settled:
                used[place, world] = table
        with _KEEPING:  # of all sessions of a sensor
            for key in used:
                kept.pop(key, None)
            kept.update(used)
            while len(kept) * room.nbytes > _KEPT_BYTES:
                del kept[next(iter(kept))]
        return scores

    @cached_property
    def _checked(self) -> set[int | tuple[float, ...]]:
        return set()

    @cached_property
    def _kept(self) -> dict[tuple[int | tuple[float, ...], int], NDArray[np.float32]]:
        """Tables of single worlds in single precision, the one that was used last at the end."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process, without the copies of tables."""
        return {name: value for name, value in vars(self).items() if name != "_kept"}

    def health(self, log_bets: ArrayLike = 0.0, is_clear: bool = True) -> SensorHealth:
        """The health of the sensor after a session with this evidence (:attr:`SensorHealth.log_bets`), or with none."""
        given = np.zeros(len(self.prior) + 1) + np.asarray(log_bets, np.float64)
        log_ratios = given[:-1]
        for _ in range(2):  # the second time, large numbers are gone that hid the prior
            log_ratios = np.maximum(log_ratios - np.logaddexp.reduce(self.log_prior + log_ratios), _LEAST)
        labels = (AS_DESCRIBED, *self.world_labels, UNKNOWN)
        return SensorHealth(labels, self.log_prior, frozen(log_ratios), int(given[-1]), is_clear)

    def over_objects(
        self,
        evidence: Sequence[SensorEvidence],
        log_bets: ArrayLike,
        strange: Floats | None = None,
        log_odds: float | None = None,
    ) -> tuple[Floats, SensorHealth]:
        """Log likelihoods of the shapes of n touched objects, each given all others, and the sensor's health.

        The forward and backward recursions of a hidden Markov chain.

        Args:
            evidence: about each object, in the order of their first touches.
            log_bets: log bets of the session before these objects (:attr:`SensorHealth.log_bets`), or zeros.
            strange: log p(touches | component, some body that has none of the shapes) of each object, ``(n, C)``, on
                the scale of :attr:`SensorEvidence.log_ratios`; in the last column, of the component that knows nothing,
                the log mean e-value against touches of any body (:attr:`simulated` are of the shapes). None where all
                objects have a shape.
            log_odds: prior log odds that an object has none of the shapes, with ``strange``.

        Returns:
            ``(n, K)``, each row up to a constant, with one more column of strangers if they are given; and the health
            after the last object.
        """
        rows = [None] * len(evidence) if strange is None else strange
        earlier, told, ratios = self.health(log_bets), list[Floats](), list[Floats]()
        known, before = earlier.log_ratios, []
        for one, row in zip(evidence, rows, strict=True):
            before.append(self._forgetful(known))
            ratios.append(one.log_ratios_after(before[-1], row, log_odds))
            told.append(_log_bets(ratios[-1], None if row is None else log_odds))
            known = before[-1] + told[-1]
        after, is_clear = np.zeros(len(self.prior)), True
        found = np.empty((len(told), len(self.shape_labels) + (strange is not None)))
        for place in range(len(told))[::-1]:
            weights = self.log_prior + before[place] + after
            weights = weights - weights.max()
            found[place] = np.logaddexp.reduce(weights[:, None] + ratios[place], axis=0)
            weights = weights + told[place]
            is_clear &= bool(np.exp(weights - weights.max()).sum() * SURE <= 1.0)
            after = self._forgetful(after + told[place])
            after = after - after.max()
        total = earlier.num_touches + sum(one.num_touches for one in evidence)
        return found, self.health(np.append(known, total), is_clear)

    def _forgetful(self, log_ratios: Floats) -> Floats:
        """Log ratios after a redraw from the prior with the probability of forgetting, ``(C,)``."""
        kept, drawn = self._log_forgetting
        return np.asarray(np.logaddexp(kept + log_ratios, drawn + np.logaddexp.reduce(self.log_prior + log_ratios)))

    @cached_property
    def _log_forgetting(self) -> tuple[float, float]:
        with np.errstate(divide="ignore"):
            return float(np.log1p(-self.forgetting)), float(np.log(self.forgetting))

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        return np.stack([self.start().updated(batch.sequence(row)).log_likelihood for row in range(len(batch))])


@dataclass(frozen=True, eq=False)
class SensorEvidence(BesideNominal):
    """Evidence about one object under every component: a frozen value, of which an update makes a new one.

    ``nominal`` is the evidence if the sensor is as described. ``log_weights (A, K, N')``, less ``constant``, are log
    p(all touches | world, hypothesis) for the A worlds ``awake``; ``sums`` are as in :class:`RigidBodyEvidence`.
    ``strangeness`` is the sum of the touches' e-values against being like simulated ones.
    """

    model: SensorHealthModel
    nominal: RigidBodyEvidence | VariedEvidence
    awake: NDArray[np.int64]
    log_weights: Floats
    constant: float = 0.0
    sums: SumsByPlace = field(default_factory=dict)
    strangeness: float = 0.0

    @property
    def has_sleepers(self) -> bool:
        """Whether some worlds are asleep."""
        return len(self.awake) < len(self.model.world_labels)

    def update(self, touch: Touch) -> SensorEvidence:
        """The evidence with one more touch; costs (K N + A K N') D multiplications."""
        nominal, body = self.nominal.update(touch), self.model._body
        embedding, known = body.embedding_of(touch), self.model.simulated
        strangeness = self.strangeness + (0.0 if known is None else known.e_value(embedding[0]))
        if not len(self.awake):
            return replace(self, nominal=nominal, strangeness=strangeness)
        scores = self.model.scores_of(touch, embedding, self.awake)
        rates = body.correlation, body.drift
        sums, discounted = with_touch(self.sums, touch, scores, *rates)
        constant, total = (self.constant, self.log_weights + scores) if discounted is None else (0.0, discounted)
        log_weights, log_likelihoods, largest = relative(total)
        constant += float(largest)
        found = SensorEvidence(self.model, nominal, self.awake, log_weights, constant, sums, strangeness)
        found.__dict__["_log_means"] = log_likelihoods  # of these log weights
        return found

    @cached_property
    def _log_means(self) -> Floats:
        return log_means(self.log_weights)

    @cached_property
    def log_ratios(self) -> Floats:
        """Log p(all touches | component, shape) by p(touches), up to one constant, ``(C, K)``; -inf if asleep."""
        found = np.full((len(self.model.prior), len(self.model.shape_labels)), -np.inf)
        found[0] = self.nominal.log_likelihood
        found[1 + self.awake] = self._log_means + (self.constant - self.nominal.constant)
        found[-1] = -self.nominal.constant
        return frozen(found)

    def log_ratios_after(
        self, known: Floats | float = 0.0, strange: Floats | None = None, log_odds: float | None = None
    ) -> Floats:
        """:attr:`log_ratios` after earlier objects, with the log ratios ``known (C,)`` of posterior by prior.

        What the component that knows nothing says of strange touches follows from what the others say after these.
        ``strange`` is one more column, of objects that have none of the shapes, with these prior log odds
        (:meth:`SensorHealthModel.over_objects`).
        """
        found = self.log_ratios
        if strange is not None:
            found = np.column_stack([found, np.append(strange[:-1], found[-1, 0])])
        if self.model.simulated is None or not self.num_touches:
            return found
        weights = (self.model.log_prior + known)[:-1]
        told = _log_bets(found[:-1], None if strange is None else log_odds)
        others = np.logaddexp.reduce(weights + told) - np.logaddexp.reduce(weights)
        log_e_value = np.log(self.strangeness / self.num_touches) if strange is None else strange[-1]
        last = others + log_e_value
        return np.concatenate([found[:-1], np.full_like(found[-1:], last)])

    @cached_property
    def log_bets(self) -> Floats:
        """Log p(all touches | component), where all shapes count alike, up to one constant, ``(C,)``."""
        return frozen(_log_bets(self.log_ratios_after()))

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`: with the prior of the components."""
        if not self.num_touches:
            return self.nominal.log_likelihood
        return frozen(np.logaddexp.reduce(self.model.log_prior[:, None] + self.log_ratios_after(), axis=0))


def _log_bets(log_ratios: Floats, log_odds: float | None = None) -> Floats:
    """Log p(touches | component) of log ratios ``(C, K)`` of shapes that count alike, ``(C,)``.

    With log odds, the last column is that of objects that have none of the shapes.
    """
    listed = log_ratios if log_odds is None else log_ratios[:, :-1]
    found = np.asarray(np.logaddexp.reduce(listed, axis=1) - np.log(listed.shape[1]))
    if log_odds is None:
        return found
    return np.asarray(np.logaddexp(found, log_odds + log_ratios[:, -1]) - np.logaddexp(0.0, log_odds))


def _single(array: NDArray[np.floating], room: NDArray[np.int32]) -> NDArray[np.float32]:
    """Finite numbers in single precision; those in half precision are converted in the given room, which is faster."""
    if array.dtype != np.float16:
        return np.asarray(array, np.float32)
    np.left_shift(array.view(np.int16), 13, out=room, dtype=np.int32)
    room &= ~0x70000000  # the sign stays, its copies go
    found = room.view(np.float32)
    found *= np.float32(2.0**112)  # the exponents are less by 112
    return found
