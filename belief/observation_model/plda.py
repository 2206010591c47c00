r"""Probabilistic linear discriminant analysis (PLDA) with poses: touches of one object share random effects.

A touch of object o, of shape k, in pose p is (Ioffe 2006; Brümmer & de Villiers 2010; Sizov, Lee & Kinnunen 2014)

    x = m_pk + u_o + v_op + e,     u ~ N(0, B),  v ~ N(0, V),  e ~ N(0, W).

All touches of the object share u, its touches in one pose share v, and e is independent for each touch. All shapes
share the covariances, so the likelihood ratios have a closed form in the number of touches in each pose and their mean.
A :class:`GaussianModel` has B = V = 0: its touches are independent given the shape.

Objects may differ in how far their touches lie from the mean of their shape. Each object then has a *scale* s, with
log s ~ N(0, σ²), which multiplies u, v and e, and the likelihood is a mean over a grid of scales. So touches far from
all shapes are evidence of a large scale, and not of the nearest shape; this also covers tails longer than normal ones.
With the *spread* σ = 0 all objects have the scale 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.codec import OPTIONAL, Merged
from belief.constraints import Positive, Within, check
from belief.frozen import FrozenArrays
from belief.observation_model.calibration_data import LabelledTouches, object_folds
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable, smoothed, tabulate
from belief.touch_batch import TouchBatch, grouped
from belief.validation import Floats, as_real

_LARGEST = 1e300  # sums and differences of a few thousand such numbers are finite
_MOST_UNITS = 3.0


@dataclass(frozen=True, eq=False)
class LogitEmbedding(FrozenArrays):
    """Centred logits in an orthonormal basis of K - 1 vectors, because a softmax does not depend on their mean.

    Logits are clipped to the range of the calibration touches, ``lowest (K,)`` to ``highest (K,)``, and to three units,
    so that a single extreme touch cannot dominate. A unit is the 90th percentile of the sizes of these touches.
    """

    lowest: Floats
    highest: Floats
    unit: Positive = 1.0

    def __post_init__(self) -> None:
        self.to_floats("lowest", "highest", finite=False)
        if self.lowest.ndim != 1 or self.lowest.shape != self.highest.shape or not (self.lowest <= self.highest).all():
            raise ValueError(f"need lowest ≤ highest for every component, got {self.lowest} and {self.highest}")
        check(self)
        if len(self.lowest) < 2:
            raise ValueError("an embedding of logits needs at least two shapes, got one")
        self.freeze()

    @classmethod
    def fit(cls, batch: TouchBatch) -> LogitEmbedding:
        """The embedding with the range of these touches."""
        away = _centred(batch.require_logits()).reshape(-1, batch.num_shapes)
        unit = typical_size(away)
        most = min(_MOST_UNITS * unit, _LARGEST)
        return cls(np.maximum(away.min(axis=0), -most), np.minimum(away.max(axis=0), most), unit)

    def __call__(self, batch: TouchBatch) -> Floats:
        """Vectors of touches, ``(S, n, D)``."""
        clipped = np.minimum(np.maximum(_centred(batch.require_logits()), self.lowest), self.highest)
        return np.asarray(clipped @ _basis(len(self.lowest)).T / self.unit)

    def to_touches(self, poses: NDArray[np.int64], vectors: Floats) -> TouchBatch:
        """Touches in ``poses (S, n)`` with vectors ``(S, n, D)``; the logits have mean zero."""
        return TouchBatch(poses, vectors @ _basis(len(self.lowest)) * self.unit)


@lru_cache
def _basis(num_shapes: int) -> Floats:
    """Orthonormal rows ``(K - 1, K)`` that are orthogonal to a constant."""
    return scipy.linalg.helmert(num_shapes)


def _centred(logits: Floats) -> Floats:
    z = np.minimum(np.maximum(logits, -_LARGEST), _LARGEST)
    return np.asarray(z - z.mean(axis=-1, keepdims=True))


def typical_size(away: Floats) -> float:
    """90th percentile of the largest entry of each row ``(n, K)``; 1 if all are zero."""
    sizes = np.sort(np.abs(away).max(axis=1))
    typical = sizes[int(0.9 * (len(sizes) - 1))]
    typical = typical if typical > 0.0 else sizes[np.searchsorted(sizes, 0.0, "right") % len(sizes)]
    return max(float(typical), np.finfo(float).tiny) if typical > 0.0 else 1.0


_MEAN_POOLING = 30.0  # weight of a shape's mean over all poses in its mean in each pose, in touches
_NODES = np.linspace(-3.0, 3.0, 25)  # of the grid of log scales, in spreads
_LOG_WEIGHTS = -0.5 * _NODES**2 - np.logaddexp.reduce(-0.5 * _NODES**2)
_SWEEPS = 6  # of means and covariances given the scales, and of scales given these
_LONGEST = 12  # touches of a held-out object
_BLOCK = 256  # objects whose scales are estimated together


class Components(NamedTuple):
    """Covariances ``(D, D)`` of all shapes: B of objects, V of objects in a pose, W of touches (positive definite)."""

    of_object: Floats
    of_pose: Floats
    of_touch: Floats


@dataclass(frozen=True, eq=False)
class PLDAModel(ArrayModel):
    """A Gaussian model with one random effect per object, one per object and pose, and a scale of each object.

    Attributes:
        shape_labels: names of the K shapes.
        embedding: from touches to vectors.
        means: ``(P, K, D)``.
        components: the covariances B, V and W of an object of scale 1.
        spread: standard deviation σ of the log scale of objects; 0 if all objects have the scale 1.

    Example:
        Five equal touches of one object in one pose are little more evidence than one:

        >>> from belief import Touch
        >>> rng = np.random.default_rng(0)
        >>> ids = np.arange(1200) // 4                                  # four touches of each object, in one pose
        >>> shapes = ids % 2
        >>> shared = rng.normal(size=(300, 2))[ids]                     # equal in all four
        >>> logits = 1.5 * np.eye(2)[shapes] + shared + 0.1 * rng.normal(size=(1200, 2))
        >>> touches = [Touch(0, row) for row in logits]
        >>> model = PLDAModel.fit(touches, shapes, ids)
        >>> touch = Touch(0, np.array([1.5, 0.0]))
        >>> once, five = (np.ptp(model.log_likelihood([touch] * n)) for n in (1, 5))
        >>> bool(once <= five < 1.1 * once)
        True
    """

    name: ClassVar[str] = "plda"
    spreads: ClassVar[tuple[float, ...]] = (0.25, 0.5, 0.75, 1.0)  # beside 0, from which a fit chooses

    shape_labels: tuple[str, ...]
    embedding: LogitEmbedding
    means: Floats
    components: Annotated[Components, Merged()]
    spread: Annotated[float, Within(0.0, 10.0), OPTIONAL] = 0.0

    def __post_init__(self) -> None:
        self.to_floats("means")
        check(self)
        expected = (len(self.shape_labels), len(self.embedding.lowest) - 1)
        if self.means.ndim != 3 or self.means.shape[1:] != expected or len(self.means) == 0:
            raise ValueError(f"means must be (P, {expected[0]}, {expected[1]}), got {self.means.shape}")
        parts = []
        for name, values in self.components._asdict().items():
            part = np.asarray(as_real(values, name), np.float64)
            if part.shape != (expected[1], expected[1]) or not np.isfinite(part).all():
                raise ValueError(f"{name} must be finite and of shape {(expected[1], expected[1])}, got {part}")
            scale, least = np.abs(part).max(), float(np.linalg.eigvalsh(part)[0])
            is_positive = least > 0.0 if name == "of_touch" else least >= -1e-9 * scale
            if np.abs(part - part.T).max() > 1e-9 * scale or not is_positive:
                raise ValueError(
                    f"{name} must be symmetric and positive {'' if name == 'of_touch' else 'semi'}definite, "
                    f"its least eigenvalue is {least}"
                )
            parts.append(part)
        object.__setattr__(self, "components", Components(*parts))
        self.freeze()

    @classmethod
    def fit_to(cls, data: LabelledTouches, *, spread: float | None = None) -> Self:
        """Fit means, shrunk towards those of all poses, and covariances, by their moments.

        Where no object was touched twice in a pose, V = W is assumed; with one touch of each object, B = V = W. The
        ``spread`` is by default the one that predicts held-out objects best, or 0 if none does so clearly.
        """
        spread = cls._fitted_spread(data) if spread is None else spread
        embedding = LogitEmbedding.fit(data.batch)
        vectors, precisions = embedding(data.batch)[0], np.ones(len(data.poses))
        for sweep in range(1 + _SWEEPS * bool(spread)):
            means, rest = pose_means(vectors, data, weights=precisions[:, None])
            components = cls.components_of(rest * np.sqrt(precisions)[:, None], data)
            model = cls(data.shape_labels, embedding, means, components, spread)
            if sweep < _SWEEPS and spread:
                precisions = model._precisions(data)
        return model

    @classmethod
    def _fitted_spread(cls, data: LabelledTouches) -> float:
        """The spread of least loss on held-out objects; 0 unless the gain is two standard errors above zero."""
        if not cls.spreads or data.num_objects < 4:
            return 0.0
        folds = object_folds(data.shapes, data.objects, 2)
        without = least = cls._held_out_losses(data, folds, 0.0)
        chosen = 0.0
        for spread in cls.spreads:
            losses = cls._held_out_losses(data, folds, spread)
            if losses.mean() >= least.mean():
                break
            chosen, least = spread, losses
        gain = without - least
        return chosen if gain.mean() > 2.0 * gain.std() / np.sqrt(len(gain)) else 0.0

    @classmethod
    def _held_out_losses(cls, data: LabelledTouches, folds: NDArray[np.intp], spread: float) -> Floats:
        """Mean negative log posterior of the shape of each object, ``(N,)``, by models of the other fold [nats]."""
        losses = np.empty(data.num_objects)
        for fold in (0, 1):
            model, held = cls.fit_to(data.of_rows(folds != fold), spread=spread), data.of_rows(folds == fold)
            for batch, rows in grouped(held.batch, held.objects):
                truth = np.arange(len(rows)), held.shapes[rows[:, 0]]
                steps = range(1, min(batch.num_touches, _LONGEST) + 1)
                found = [scipy.special.log_softmax(model.log_likelihood_batch(batch.first(n)), axis=1) for n in steps]
                losses[data.objects[folds == fold][rows[:, 0]]] = -np.mean([each[truth] for each in found], axis=0)
        return losses

    def _precisions(self, data: LabelledTouches) -> Floats:
        """Expected s^-2 of the object of each touch, ``(n,)``, given all its touches and its shape."""
        found = np.empty(len(data.poses))
        for batch, rows in grouped(data.batch, data.objects):
            for first in range(0, len(rows), _BLOCK):
                some = rows[first : first + _BLOCK]
                by_scale = self._log_likelihoods_by_scale(batch.sequences(slice(first, first + _BLOCK)))
                weights = scipy.special.softmax(by_scale[np.arange(len(some)), data.shapes[some[:, 0]]], axis=1)
                found[some] = (weights @ np.exp(-2.0 * self.spread * _NODES))[:, None]
        return found

    @classmethod
    def components_of(cls, rest: Floats, data: LabelledTouches) -> Components:
        """The covariances, from touches less the mean of their shape and pose, ``(n, D)``."""
        if data.num_objects == len(data.poses):
            return Components(*[covariance(rest) / 3] * 3)
        return estimate_components(rest, data)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.means)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`; without scales a function of the touches' number and mean in each pose."""
        if not self.spread:
            return self._of_scale_one(*self._in_poses(batch)[1:])
        return np.asarray(scipy.special.logsumexp(self._log_likelihoods_by_scale(batch), axis=2))

    def _log_likelihoods_by_scale(self, batch: TouchBatch) -> Floats:
        """Log p(touches, scale | shape) up to a constant, for each node of the grid of scales, ``(S, K, G)``."""
        membership, counts, means = self._in_poses(batch)
        away = (self.embedding(batch) - membership @ means) @ self._basis[0].T  # from the mean of the pose
        distance = (away**2).sum(axis=(1, 2))[:, None] - 2.0 * self._of_scale_one(counts, means)  # squared, (S, K)
        log_scales = self.spread * _NODES
        volume = _LOG_WEIGHTS - away[0].size * log_scales
        return np.asarray(volume - 0.5 * distance[..., None] * np.exp(-2.0 * log_scales))

    def _in_poses(self, batch: TouchBatch) -> tuple[Floats, Floats, Floats]:
        """Pose of each touch ``(S, n, P)``, number of touches in each ``(S, P)``, and their mean ``(S, P, D)``."""
        membership = (batch.poses[..., None] == np.arange(self.num_poses)).astype(np.float64)  # (S, n, P)
        counts = membership.sum(axis=1)
        means = np.swapaxes(membership, 1, 2) @ self.embedding(batch) / np.maximum(counts, 1.0)[..., None]
        return membership, counts, means

    def _of_scale_one(self, counts: Floats, means: Floats) -> Floats:
        """Log-likelihoods ``(S, K)`` of objects of scale 1, less the part that all shapes share."""
        whiten, of_pose, of_object = self._basis
        # In this basis W is the identity, V is diagonal, and the mean in a pose has variance V + 1 / count given u.
        y = (means @ whiten.T)[:, :, None] - self.means @ whiten.T  # (S, P, K, D)
        number = counts[..., None]
        weight = np.where(number > 0.0, 1.0 / (of_pose + 1.0 / np.maximum(number, 1.0)), 0.0)[:, :, None]
        pull = (weight * y).sum(axis=1)  # (S, K, D)
        inner = np.eye(len(whiten)) + of_object * weight.sum(axis=1)  # I + B M for each sequence, M diagonal
        gain = np.linalg.solve(inner, np.broadcast_to(of_object, inner.shape))
        explained = ((pull @ np.swapaxes(gain, 1, 2)) * pull).sum(axis=2)
        return np.asarray(0.5 * (explained - (weight * y**2).sum(axis=(1, 3))))

    @cached_property
    def _basis(self) -> tuple[Floats, Floats, Floats]:
        """A with A W Aᵀ = I and A V Aᵀ diagonal, this diagonal, and A B Aᵀ."""
        values, vectors = scipy.linalg.eigh(self.components.of_pose, self.components.of_touch)
        return vectors.T, np.maximum(values, 0.0), vectors.T @ self.components.of_object @ vectors

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        num_sequences, n = poses.shape
        size = self.means.shape[2]
        used, index = np.unique(poses, return_inverse=True)
        of_object, of_pose, of_touch = (_root(part) for part in self.components)
        shared = rng.standard_normal((num_sequences, 1, size)) @ of_object
        in_pose = rng.standard_normal((num_sequences, len(used), size)) @ of_pose
        alone = rng.standard_normal((num_sequences, n, size)) @ of_touch
        rows = np.arange(num_sequences)[:, None]
        away = shared + in_pose[rows, index.reshape(poses.shape)] + alone
        if self.spread:
            away *= np.exp(self.spread * rng.standard_normal((num_sequences, 1, 1)))
        return self.embedding.to_touches(poses, self.means[poses, shape] + away)

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; a table of single sampled touches, which does not describe repeats."""
        return sampled_table(self, num_outcomes, rng)


@dataclass(frozen=True, eq=False)
class GaussianModel(PLDAModel):
    """Linear discriminant analysis as a likelihood: a mean for each shape and pose, one covariance, nothing shared.

    Example:
        >>> from belief import Touch
        >>> rng = np.random.default_rng(0)
        >>> shapes = np.arange(600) % 3
        >>> touches = [Touch(0, row) for row in rng.normal(size=(600, 3)) + 2.0 * np.eye(3)[shapes]]
        >>> int(GaussianModel.fit(touches, shapes).log_likelihood([Touch(0, np.array([0.0, 3.0, 0.0]))]).argmax())
        1
    """

    name: ClassVar[str] = "gaussian"
    spreads: ClassVar[tuple[float, ...]] = ()

    @classmethod
    def components_of(cls, rest: Floats, data: LabelledTouches) -> Components:
        """The covariance of single touches, by maximum likelihood."""
        own = covariance(rest)
        return Components(0.0 * own, 0.0 * own, own)


def estimate_components(rest: Floats, data: LabelledTouches) -> Components:
    """Components by their moments; in a balanced design these are the estimates of restricted maximum likelihood.

    A *cell* is an object in a pose. Touches of a cell differ by W; means of the cells of an object by V, and by W over
    their numbers of touches; means of objects by B and by what is left of V and W. Without a cell of two touches, V and
    W are taken as equal; without an object of two cells, B and V are. ``rest (n, D)`` are touches minus the mean of
    their shape and pose; some object must have two.
    """
    keys, cell, counts = np.unique(data.objects * data.num_poses + data.poses, return_inverse=True, return_counts=True)
    owner = keys // data.num_poses
    cells, noise = np.bincount(owner), np.bincount(owner, 1.0 / counts)  # of each object; noise in units of W
    means, centres = np.zeros((len(keys), rest.shape[1])), np.zeros((len(cells), rest.shape[1]))
    np.add.at(means, cell, rest / counts[cell, None])
    np.add.at(centres, owner, means / cells[owner, None])
    about, away = rest - means[cell], means - centres[owner]
    repeats, others = (counts - 1).sum(), (cells - 1).sum()
    of_touch = about.T @ about / repeats if repeats else away.T @ away / (2 * others)
    left = centres.T @ centres / len(cells) - (noise / cells**2).mean() * of_touch
    if others:
        of_pose = (away.T @ away - ((1.0 - 1.0 / cells) * noise).sum() * of_touch) / others if repeats else of_touch
        of_object = left - (1.0 / cells).mean() * of_pose
    else:
        of_object = of_pose = left / 2.0
    # Without a floor, W would vanish for equal touches, and the likelihood would be unbounded.
    floor = 1e-6 * np.trace(covariance(rest)) / rest.shape[1] * np.eye(rest.shape[1])
    return Components(_positive(of_object), _positive(of_pose), _positive(of_touch) + floor)


def covariance(rest: Floats) -> Floats:
    """Covariance ``(D, D)`` of vectors of mean zero, ``(n, D)``, with eigenvalues at least 1e-6 of the largest."""
    values, basis = np.linalg.eigh(rest.T @ rest / len(rest))
    values = np.maximum(values, max(1e-6 * values[-1], 1e-12))
    return np.asarray((basis * values) @ basis.T)


def pose_means(
    vectors: Floats, data: LabelledTouches, pooling: float = _MEAN_POOLING, weights: Floats | float = 1.0
) -> tuple[Floats, Floats]:
    """Mean vector of each shape in each pose, ``(P, K, D)``, and the residuals of the touches, ``(n, D)``.

    Each mean is shrunk towards the shape's mean over all poses. A shape without touches gets the mean of all touches.
    ``weights`` are of the touches, ``(n, 1)`` or ``(n, D)``.
    """
    sums = np.zeros((data.num_poses, data.num_shapes, vectors.shape[1]))
    counts = np.zeros_like(sums)
    np.add.at(sums, (data.poses, data.shapes), weights * vectors)
    np.add.at(counts, (data.poses, data.shapes), weights)
    seen = counts.sum(axis=0)
    overall = np.where(seen > 0.0, sums.sum(axis=0) / np.where(seen > 0.0, seen, 1.0), vectors.mean(axis=0))
    means = (sums + pooling * overall) / (counts + pooling)
    return means, vectors - means[data.poses, data.shapes]


def _positive(found: Floats) -> Floats:
    """The nearest covariance without negative eigenvalues."""
    values, basis = np.linalg.eigh((found + found.T) / 2)
    return np.asarray((basis * np.maximum(values, 0.0)) @ basis.T)


def _root(covariance: Floats) -> Floats:
    """A symmetric square root, also of a singular covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


_SAMPLES = 2000  # touches per shape and pose


def sampled_table(
    model: ArrayModel, num_outcomes: int, rng: np.random.Generator, num_samples: int = _SAMPLES
) -> OutcomeTable:
    """The outcome table of touches that the model samples, ``num_samples`` per shape and pose."""
    log_posteriors = sampled_posteriors(model, rng, num_samples)  # (P, K, n, K)
    log_posteriors = log_posteriors.reshape(model.num_poses, -1, log_posteriors.shape[-1])
    shares = np.exp(log_posteriors)
    shares /= shares.sum(axis=1, keepdims=True)
    table = tabulate(log_posteriors, shares, num_outcomes, rng)
    return OutcomeTable(smoothed(table, num_samples))


def sampled_posteriors(model: ArrayModel, rng: np.random.Generator, num_samples: int) -> Floats:
    """Log posteriors under a uniform prior of sampled touches for each pose and shape, ``(P, K, n, K)``."""
    num_shapes = len(model.shape_labels)
    found = np.empty((model.num_poses, num_shapes, num_samples, num_shapes))
    for pose in range(model.num_poses):
        poses = np.full((num_samples, 1), pose)
        for shape in range(num_shapes):
            batch: TouchBatch = model.sample_batch(shape, poses, rng)
            found[pose, shape] = scipy.special.log_softmax(model.log_likelihood_batch(batch), axis=1)
    return found
