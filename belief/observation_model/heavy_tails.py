r"""Logits with heavy tails: each logit of an object has a scale of its own.

Logit c of a touch of object o, of shape k, in pose p is

    x_c = m_pkc + s_oc (r_oc u_oc + e_c),     u ~ N(0, B_c),  e ~ N(0, W_c).

All touches of the object share u, the scale s and the ratio r; e is independent for each touch. With ν / s² ~ χ²(ν),
the noise has Student's t-distribution, and log r ~ N(0, σ²) on a grid lets the part that touches share be as far out,
whatever their scatter. One *spread* σ says how heavy both tails are: ν = 1 / (2 σ²), at which log s varies about as
much as log r. Unlike in :mod:`belief.observation_model.plda`, one wrong logit does not spoil the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.constraints import Positive, Within, check
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.plda import pose_means, sampled_table, typical_size
from belief.touch_batch import TouchBatch
from belief.validation import Floats

_NODES = np.linspace(-3.0, 3.0, 9)  # of the grid of log r, in spreads
_LOG_WEIGHTS = -0.5 * _NODES**2 - np.logaddexp.reduce(-0.5 * _NODES**2)
_SPREADS = (0.2, 0.35, 0.5, 0.7, 1.0)
_SWEEPS = 12  # of the spread and the scales given means and variances, and of these given the scales
_MOST_UNITS = 1e4
_LEAST = 1e-9  # variance, in squared units


@dataclass(frozen=True, eq=False)
class HeavyTailsModel(ArrayModel):
    """Logits with Student's t-distribution, each with a scale for every object.

    Attributes:
        shape_labels: names of the K shapes.
        unit: size of a typical logit, the unit of the other attributes.
        means: ``(P, K, K)``, of each shape and logit in each pose.
        of_object: variance of what touches of an object share, ``(K,)``.
        of_touch: variance of single touches, ``(K,)``.
        spread: standard deviation σ of log scales.

    Example:
        >>> from belief import Touch
        >>> rng = np.random.default_rng(0)
        >>> ids = np.arange(1200) // 4                                  # four touches of each object
        >>> logits = 4.0 * np.eye(3)[ids % 3] + rng.standard_t(2, (300, 3))[ids] + rng.standard_t(2, (1200, 3))
        >>> model = HeavyTailsModel.fit([Touch(0, row) for row in logits], ids % 3, ids)
        >>> odd = [Touch(0, np.array([4.0, 0.0, 30.0]))]                # of shape 0, with one logit far out
        >>> int(model.log_likelihood(odd).argmax())
        0
    """

    name: ClassVar[str] = "heavy tails"

    shape_labels: tuple[str, ...]
    unit: Positive
    means: Floats
    of_object: Floats
    of_touch: Floats
    spread: Annotated[float, Within(0.05, 5.0)]

    def __post_init__(self) -> None:
        self.to_floats("means", "of_object", "of_touch")
        check(self)
        number = len(self.shape_labels)
        if self.means.ndim != 3 or self.means.shape[1:] != (number, number) or len(self.means) == 0:
            raise ValueError(f"means must be (P, {number}, {number}), got {self.means.shape}")
        for name in ("of_object", "of_touch"):
            if (values := getattr(self, name)).shape != (number,) or not (values > 0.0).all():
                raise ValueError(f"{name} must be {number} positive variances, got {values}")
        self.freeze()

    @classmethod
    def fit_to(cls, data: LabelledTouches) -> Self:
        """Fit by turns the scales of objects, and means, variances and the likeliest spread given these.

        Where no object was touched twice, half of the variance is taken as shared.
        """
        unit = typical_size(data.logits)
        vectors, owner = _in_units(data.logits, unit), data.objects
        number = np.bincount(owner).astype(np.float64)[:, None]
        alone = shared = np.ones((data.num_objects, data.num_shapes))  # expected s^-2 and (r s)^-2
        repeats = float((number - 1.0).sum())
        for _ in range(_SWEEPS):
            means, rest = pose_means(vectors, data, weights=shared[owner])
            away, scatter = np.zeros_like(shared), np.zeros_like(shared)
            np.add.at(away, owner, rest / number[owner])
            np.add.at(scatter, owner, (rest - away[owner]) ** 2)
            if repeats:
                noise = (alone * scatter).sum(axis=0) / repeats
                left = (shared * scatter).sum(axis=0) / repeats * (1.0 / number).mean()
                common = (shared * away**2).mean(axis=0) - left
            else:
                common = noise = (shared * away**2).mean(axis=0) / 2.0
            noise, common = np.maximum(noise, _LEAST), np.maximum(common, _LEAST)
            found = {some: _of_ratios(number, away, scatter, common, noise, some) for some in _SPREADS}
            spread = max(found, key=lambda some: float(scipy.special.logsumexp(found[some][0], axis=0).sum()))
            terms, precisions = found[spread]
            posterior = scipy.special.softmax(terms, axis=0) * precisions
            alone = posterior.sum(axis=0)
            shared = np.tensordot(np.exp(-2.0 * spread * _NODES), posterior, 1)
        return cls(data.shape_labels, unit, means, common, noise, spread)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.means)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        rest = _in_units(batch.require_logits(), self.unit)[:, :, None] - self.means[batch.poses]  # (S, n, K, K)
        away = rest.mean(axis=1)
        scatter = ((rest - away[:, None]) ** 2).sum(axis=1)
        terms, _ = _of_ratios(batch.num_touches, away, scatter, self.of_object, self.of_touch, self.spread)
        return np.asarray(scipy.special.logsumexp(terms, axis=0).sum(axis=2))

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        size, freedom = (len(poses), 1, len(self.shape_labels)), _freedom(self.spread)
        ratio = np.exp(self.spread * rng.choice(_NODES, size, p=np.exp(_LOG_WEIGHTS)))
        scale = np.sqrt(freedom / rng.chisquare(freedom, size))
        shared = ratio * np.sqrt(self.of_object) * rng.standard_normal(size)
        alone = np.sqrt(self.of_touch) * rng.standard_normal((*poses.shape, size[2]))
        vectors = self.means[poses, shape] + scale * (shared + alone)
        return TouchBatch(poses, np.clip(vectors, -_MOST_UNITS, _MOST_UNITS) * self.unit)

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; a table of single sampled touches, which does not describe repeats."""
        return sampled_table(self, num_outcomes, rng)


def _freedom(spread: float) -> float:
    """Degrees of freedom ν of the t-distribution of a spread."""
    return 0.5 / spread**2


def _in_units(logits: Floats, unit: float) -> Floats:
    with np.errstate(over="ignore"):
        return np.clip(logits / unit, -_MOST_UNITS, _MOST_UNITS)


def _of_ratios(
    number: Floats | int, away: Floats, scatter: Floats, of_object: Floats, of_touch: Floats, spread: float
) -> tuple[Floats, Floats]:
    """Log p(touches, r) of each logit and E[s^-2 | touches, r], ``(R, ...)``, for each node of the grid of r.

    ``number`` of touches, mean ``away`` and sum of squares about it, ``scatter``, of each logit, ``(..., K)``.
    """
    freedom, log_ratios = _freedom(spread), (spread * _NODES).reshape(-1, *[1] * np.ndim(away))
    of_mean = np.exp(2.0 * log_ratios) * of_object + of_touch / number
    distance = scatter / of_touch + away**2 / of_mean
    weight = scipy.special.gammaln((freedom + number) / 2.0) - scipy.special.gammaln(freedom / 2.0)
    weight = weight - 0.5 * number * np.log(freedom) - 0.5 * (number - 1.0) * np.log(of_touch) - 0.5 * np.log(of_mean)
    terms = _LOG_WEIGHTS.reshape(log_ratios.shape) + weight - 0.5 * (freedom + number) * np.log1p(distance / freedom)
    return terms, (freedom + number) / (freedom + distance)
