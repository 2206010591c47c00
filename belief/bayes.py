"""Bayes' rule, entropy and information gain as pure functions of arrays; and a belief about one object by them.

Leading axes of arrays are batch axes.

    log p(y | o) = log p(y) + log p(o | y) - log p(o),    log p(o) = logsumexp over y of the first two terms.

:func:`update` works on logarithms and is exact for likelihoods of any size.

    >>> import numpy as np
    >>> log_prior = np.log([0.5, 0.5])
    >>> log_posterior, log_evidence = update(log_prior, np.log([0.8, 0.2]))
    >>> np.exp(log_posterior).round(3), np.exp(log_evidence).round(3)
    (array([0.8, 0.2]), np.float64(0.5))

The rule is computed plainly, in blocks of rows that fit in the cache, and a single row of few shapes with plain floats.
Input is checked through sums that are computed anyway: NaN, infinity, underflow or a wrong total shows in them, and
only such rows take the careful rule.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, inf, log
from typing import Any, NoReturn

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief import bayes
from belief.errors import ImpossibleObservation, InvalidArgument
from belief.frozen import FrozenArrays
from belief.naming import NONE_OF_THESE, Name, checked_names, index_of, one_line
from belief.validation import (
    SUM_TOLERANCE,
    Floats,
    as_logs,
    as_real,
    at,
    normalise_log_probs,
    normalise_probs,
    require,
    require_index,
    require_number,
)

_FEW_SHAPES = 16  # up to here plain floats are faster than arrays
_LEAST_TOTAL = 1e-30  # a smaller sum may have lost terms to underflow: such rows take the careful rule
_LARGEST = np.finfo(np.float64).max
_SHOWN = 12  # shapes in a notebook
_BLOCK = 16_384  # numbers in a block; three such arrays fit in the second-level cache


def update(
    log_prior: ArrayLike, log_likelihood: ArrayLike | None = None, *, likelihood: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Log posterior over shapes, and log evidence.

    Args:
        log_prior: log p(y), ``(..., K)``; every row's probabilities sum to one (float16 rows are renormalised).
        log_likelihood: log p(o | y), ``(..., K)``; any finite value or -inf.
        likelihood: p(o | y) instead, ``(..., K)``; finite and not negative.

    Returns:
        log p(y | o), ``(..., K)``, and log p(o), ``(...,)``, limited to the range of floats: only a shape that the
        prior or the likelihood rules out gets -inf.

    >>> log_posterior, log_evidence = update(np.log([[0.5, 0.5], [0.9, 0.1]]), [[0.0, -1e4], [0.0, 0.0]])
    >>> log_posterior.round(3).tolist(), log_evidence.round(3).tolist()
    ([[0.0, -10000.0], [-0.105, -2.303]], [-0.693, 0.0])
    """
    if log_likelihood is None or likelihood is not None:
        log_likelihood = as_logs("log_likelihood", log_likelihood, "likelihood", likelihood)
    prior, likelihood = as_real(log_prior, "log_prior"), as_real(log_likelihood, "log_likelihood")
    if prior.ndim == likelihood.ndim == 1 and 0 < prior.size == likelihood.size <= _FEW_SHAPES:
        result = _update_few(prior.tolist(), likelihood.tolist())
        if result is not None:
            return result
    shape = _common_shape(prior, likelihood)
    priors, scores = (np.broadcast_to(x, shape).reshape(-1, shape[-1]) for x in (prior, likelihood))
    posterior, evidence, is_sound = np.empty(scores.shape), np.empty(len(scores)), np.empty(len(scores), np.bool_)
    size = max(1, _BLOCK // shape[-1])
    for first in range(0, len(scores), size):
        rows = slice(first, first + size)
        posterior[rows], evidence[rows], is_sound[rows] = _update_block(priors[rows], scores[rows])
    if not is_sound.all():
        odd = np.flatnonzero(~is_sound)
        priors, scores = priors[odd].astype(np.float64), scores[odd].astype(np.float64)
        with np.errstate(all="ignore"):
            posterior[odd], evidence[odd], is_answered = _careful_logs(priors, scores)
        if not is_answered.all():
            first = int(np.argmin(is_answered))
            _complain(priors[first], scores[first], tuple(int(i) for i in np.unravel_index(odd[first], shape[:-1])))
    return posterior.reshape(shape), evidence.reshape(shape[:-1])[()]


def entropy(probs: ArrayLike, axis: int = -1) -> Floats:
    """Entropy of distributions along an axis [nats], in ``[0, log K]``.

    >>> entropy([[0.5, 0.5], [1.0, 0.0]]).round(3).tolist()
    [0.693, 0.0]
    """
    return _entropy(normalise_probs(probs, axis=axis), axis)


def expected_information_gain(belief: ArrayLike, outcome_probs: ArrayLike) -> Floats:
    """Mutual information of the shape and the outcome in each pose [nats].

    I(y; o | pose) = H(o | pose) - sum_k b_k H(o | pose, y = k)          # Cover & Thomas, section 2.4

    Args:
        belief: b, ``(..., K)``, sums to one.
        outcome_probs: p(o | pose, y), ``(P, K, M)``, sums to one over the last axis.

    Returns:
        ``(..., P)``, each in ``[0, H(belief)]``; zero for a pose whose outcome does not depend on the shape.

    >>> perfect, useless = [[1.0, 0.0], [0.0, 1.0]], [[0.5, 0.5], [0.5, 0.5]]
    >>> expected_information_gain([0.5, 0.5], [perfect, useless]).round(3).tolist()
    [0.693, 0.0]
    """
    b, table = _belief_and_table(belief, outcome_probs)
    predictive = np.einsum("...k,pkm->...pm", b, table)  # (..., P, M)
    gain = _entropy(predictive) - np.einsum("...k,pk->...p", b, _entropy(table))
    return np.maximum(gain, 0.0)  # rounding can leave -1e-17


def target_information_gain(belief: ArrayLike, outcome_probs: ArrayLike, target: int) -> Floats:
    """Mutual information of the event "this is the target" and the outcome in each pose [nats].

    The result ``(..., P)`` is in ``[0, log 2]`` and at most :func:`expected_information_gain`, whose arguments and
    errors it shares; ``target`` is the index of the target shape, and one out of range is a ``ValueError``.

    >>> tells_the_target, tells_the_others = np.eye(3)[[0, 1, 1]], np.eye(3)[[0, 0, 1]]
    >>> target_information_gain([0.5, 0.25, 0.25], [tells_the_target, tells_the_others], target=0).round(3).tolist()
    [0.693, 0.216]
    """
    b, table = _belief_and_table(belief, outcome_probs)
    require_index("target", target, b.shape[-1])
    joint = b[..., None, :, None] * table  # (..., P, K, M)
    hit = joint[..., target, :]  # (..., P, M)
    miss = np.maximum(joint.sum(axis=-2) - hit, 0.0)
    here = b[..., target]
    bit = np.stack([here, 1.0 - here], axis=-1)  # (..., 2)
    # I = H(bit) + H(o) - H(bit, o)
    gain = _entropy(bit)[..., None] + _entropy(hit + miss) - _entropy(hit) - _entropy(miss)
    return np.maximum(gain, 0.0)


def _entropy(probs: Floats, axis: int = -1) -> Floats:
    return np.asarray(scipy.special.entr(probs).sum(axis=axis))


def _belief_and_table(belief: ArrayLike, outcome_probs: ArrayLike) -> tuple[Floats, Floats]:
    b, table = normalise_probs(belief, "belief"), normalise_probs(outcome_probs, "outcome_probs")
    if table.ndim != 3 or table.shape[1] != b.shape[-1]:
        raise ValueError(f"outcome_probs must be (P, {b.shape[-1]}, M) for a belief {b.shape}, got {table.shape}")
    return b, table


def _update_few(prior: list[float], likelihood: list[float]) -> tuple[Floats, Floats] | None:
    """:func:`update` of one row on plain floats; None if the row needs the careful path."""
    try:
        best = max(likelihood)
        joint = [p + (score - best) for p, score in zip(prior, likelihood)]  # noqa: B905, of equal length
        total, prior_total = sum(map(exp, joint)), sum(map(exp, prior))
    except OverflowError:
        return None
    if not (total >= _LEAST_TOTAL and -SUM_TOLERANCE <= prior_total - 1.0 <= SUM_TOLERANCE):  # NaN fails both
        return None
    if -inf in joint and any(j == -inf < min(p, score) for j, p, score in zip(joint, prior, likelihood, strict=True)):
        return None  # overflowed
    log_total = log(total)
    log_evidence: Any = np.float64(log_total - log(prior_total) + best)
    return np.array([score - log_total for score in joint]), log_evidence


def _update_block(prior: NDArray[np.floating], likelihood: NDArray[np.floating]) -> tuple[Floats, Floats, Any]:
    """:func:`update` of rows ``(n, K)``, and which of them are sound; the others need the careful rule."""
    p, scores = (np.array(values.T, np.float64, order="C") for values in (prior, likelihood))  # fast sums over shapes
    with np.errstate(all="ignore"):  # NaN and infinity are handled by the careful rule
        best = scores.max(axis=0)
        joint = scores - best
        joint += p
        total, prior_total = np.exp(joint).sum(axis=0), np.exp(p).sum(axis=0)
        log_total = np.log(total)
        log_evidence = log_total - np.log(prior_total) + best
        joint -= log_total
        is_sound = (total >= _LEAST_TOTAL) & (np.abs(prior_total - 1.0) <= SUM_TOLERANCE)
    if joint.min() == -inf:  # ruled out, or beyond the largest float
        is_sound &= ~((joint == -inf) & (p > -inf) & (scores > -inf)).any(axis=0)
    return joint.T, log_evidence, is_sound


def _careful_logs(prior: Floats, likelihood: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Exact for numbers of any size: computes relative to the shape with the largest posterior."""
    log_prior_total = np.logaddexp.reduce(prior, axis=1, keepdims=True)
    possible = (prior > -np.inf) & (likelihood > -np.inf)
    prior = prior - log_prior_total
    halves = np.where(possible, prior / 2 + likelihood / 2, -np.inf)  # a sum that never overflows
    joint = halves
    for _ in range(2):  # halves that rounding makes equal are told apart relative to one of them
        winner = np.argmax(joint, axis=1)[:, None]
        top_prior, top_likelihood = (np.take_along_axis(scores, winner, axis=1) for scores in (prior, likelihood))
        joint = (prior - top_prior) + (likelihood - top_likelihood)
        beyond = possible & ~np.isfinite(joint)  # a term overflows, and often the sum does not
        joint[beyond] = np.maximum(2.0 * (halves - np.take_along_axis(halves, winner, axis=1))[beyond], -_LARGEST)
        joint = np.where(possible, joint, -np.inf)
    log_total = np.log(np.exp(joint).sum(axis=1, keepdims=True))
    log_evidence = np.maximum((top_prior + top_likelihood + log_total)[:, 0], -_LARGEST)
    sums_to_one = np.abs(np.expm1(log_prior_total[:, 0])) <= SUM_TOLERANCE
    sound = sums_to_one & (likelihood < np.inf).all(axis=1) & possible.any(axis=1)
    return np.where(possible, np.maximum(joint - log_total, -_LARGEST), -np.inf), log_evidence, sound


def _complain(prior: Floats, likelihood: Floats, row: tuple[int, ...]) -> NoReturn:
    require(~np.isnan(likelihood) & (likelihood != np.inf), likelihood, "log_likelihood", "NaN or +inf", row)
    believed = np.exp(normalise_log_probs(prior, "log_prior", row))
    raise ImpossibleObservation(
        f"the observation{at(row)} has zero likelihood under every shape of positive probability: prior "
        f"{believed.round(6).tolist()}, log-likelihood {likelihood.tolist()}. A smoothed observation model never "
        "assigns zero."
    )


def _common_shape(prior: NDArray[np.floating], likelihood: NDArray[np.floating]) -> tuple[int, ...]:
    if prior.ndim == 0 or likelihood.ndim == 0 or prior.shape[-1] != likelihood.shape[-1] or prior.size == 0:
        raise ValueError(
            f"log_prior and log_likelihood need the same, non-empty last axis of shapes, got {prior.shape} and "
            f"{likelihood.shape}"
        )
    try:
        shape = np.broadcast_shapes(prior.shape, likelihood.shape)
    except ValueError as error:
        raise ValueError(
            f"the rows of log_prior {prior.shape} and log_likelihood {likelihood.shape} do not fit"
        ) from error
    if 0 in shape:
        raise ValueError(f"nothing to update: log_prior is {prior.shape}, log_likelihood {likelihood.shape}")
    return shape


@dataclass(frozen=True, eq=False)
class Belief(FrozenArrays):
    """Probability distribution over the shape of one object, which may be none of the listed ones.

    Immutable: :meth:`update` returns a new belief. A shape of probability zero keeps probability zero.

    Attributes:
        labels: names of the K shapes.
        log_probs: log probabilities, ``(K,)``, normalised at construction, read-only. Those of a search in which an
            object may have an unlisted shape (:attr:`belief.SearchProblem.unlisted`) sum to 1 - ``unlisted``.
        unlisted: probability that the object has none of the shapes, in [0, 1].

    Raises:
        ValueError: labels that are no sequence of different names; probabilities that hold NaN, do not sum to one, or
            do not fit the labels.

    Example:
        >>> belief = Belief.uniform(["sphere", "cube", "cone"])
        >>> belief = belief.update(likelihood=[0.9, 0.05, 0.05])
        >>> print(belief)
        Belief(sphere 0.900, cube 0.050, cone 0.050)
    """

    labels: tuple[str, ...]
    log_probs: Floats
    unlisted: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        log_probs = as_real(self.log_probs, "log_probs")
        object.__setattr__(self, "labels", _checked_labels(self.labels, log_probs.shape))
        object.__setattr__(self, "log_probs", normalise_log_probs(log_probs))
        self.freeze()

    @classmethod
    def uniform(cls, labels: Sequence[str]) -> Belief:
        """Every shape equally likely."""
        names = checked_names("labels", labels)
        return cls(names, np.full(len(names), -np.log(len(names))))

    @classmethod
    def from_probs(cls, labels: Sequence[str], probs: ArrayLike, unlisted: float = 0.0) -> Belief:
        """A belief from probabilities ``(K,)`` that sum to 1 - ``unlisted``; zeros are allowed.

        >>> print(Belief.from_probs(["cube", "cone"], [0.6, 0.1], unlisted=0.3))
        Belief(cube 0.600, cone 0.100, none of these 0.300)
        """
        rest = 0.0
        if unlisted:
            require_number("unlisted", unlisted, 0.0, 1.0)
            given = normalise_probs(np.append(as_real(probs, "probs"), unlisted))
            given, rest = given[:-1], float(given[-1])
        else:
            given = normalise_probs(probs)
        names = _checked_labels(labels, given.shape)
        with np.errstate(divide="ignore"):
            return cls.of_normalised(names, np.log(given), rest)

    @classmethod
    def of_normalised(cls, labels: tuple[str, ...], log_probs: Floats, unlisted: float = 0.0) -> Belief:
        """A belief from log probabilities ``(K,)`` that sum to 1 - ``unlisted``, without any check.

        The array is not copied and becomes read-only.

        >>> Belief.of_normalised(("cube", "cone"), np.array([0.0, -np.inf])).probs.tolist()
        [1.0, 0.0]
        """
        belief = object.__new__(cls)
        log_probs.flags.writeable = False
        belief.__dict__.update(labels=labels, log_probs=log_probs, unlisted=unlisted)
        return belief

    @property
    def probs(self) -> Floats:
        """Probabilities, ``(K,)``."""
        return np.exp(self.log_probs)

    @property
    def entropy(self) -> float:
        """Entropy [nats], in which an unlisted shape is one more answer."""
        return float(_entropy(np.append(self.probs, self.unlisted)))

    def prob(self, label: Name) -> float:
        """Probability of one shape, in [0, 1], by its label or index.

        Raises:
            UnknownName: there is no shape of this name.
            InvalidArgument: an index out of range.
        """
        return float(np.exp(self.log_probs[index_of("shape", self.labels, label)]))

    def update(self, log_likelihood: ArrayLike | None = None, *, likelihood: ArrayLike | None = None) -> Belief:
        """The posterior belief after an observation.

        A log-likelihood that looks like probabilities, non-negative numbers that sum to one, causes a UserWarning.

        Args:
            log_likelihood: log p(observation | shape) up to a constant, ``(K,)``.
            likelihood: p(observation | shape) instead, up to a factor, ``(K,)``.

        Raises:
            ValueError: NaN, +inf, a negative likelihood, a shape that does not fit, or not exactly one of the two; a
                belief in which an unlisted shape is possible.
            ImpossibleObservation: zero likelihood for every shape of positive probability.
        """
        if self.unlisted:
            raise InvalidArgument("of an object that may have an unlisted shape, a SceneBelief updates the belief")
        logs = as_logs("log_likelihood", log_likelihood, "likelihood", likelihood)
        log_posterior, _ = bayes.update(self.log_probs, logs)
        if log_posterior.ndim != 1:
            raise ValueError(f"one belief needs a log-likelihood ({len(self.labels)},), got {logs.shape}")
        return Belief.of_normalised(self.labels, log_posterior)

    def __repr__(self) -> str:
        likely = np.argsort(-self.log_probs, kind="stable")
        shown = [f"{self.labels[k]} {np.exp(self.log_probs[k]):.3f}" for k in likely[:4]]
        others = [f"{len(likely) - 4} others"] if len(likely) > 4 else []
        return one_line(Belief, *shown, *others, *self._none_of_these)

    def __str__(self) -> str:
        pairs = zip(self.labels, self.probs, strict=True)
        return f"Belief({', '.join([*(f'{label} {prob:.3f}' for label, prob in pairs), *self._none_of_these])})"

    def _repr_html_(self) -> str:
        """The shapes, the most probable first, for a notebook."""
        from belief.table import Table

        likely = np.argsort(-self.log_probs, kind="stable")[:_SHOWN].tolist()
        rows: list[tuple[str, float] | tuple[str]] = [(self.labels[row], float(self.probs[row])) for row in likely]
        rows += [(NONE_OF_THESE, self.unlisted)] if self.unlisted else []
        rows += [(f"and {num} less probable shapes",)] if (num := len(self.labels) - len(likely)) else []
        return Table("", ["shape", ("probability", ".3f")], rows).html()

    @property
    def _none_of_these(self) -> list[str]:
        return [f"{NONE_OF_THESE} {self.unlisted:.3f}"] if self.unlisted else []


def _checked_labels(labels: Sequence[str], shape: tuple[int, ...]) -> tuple[str, ...]:
    """The names of a belief's shapes, checked against the shape of its array."""
    names = checked_names("labels", labels)
    if shape != (len(names),):
        raise ValueError(f"{len(names)} labels need as many probabilities, ({len(names)},), got {shape}")
    return names
