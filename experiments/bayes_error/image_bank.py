"""Likelihood of a reading under each shape, by averaging over a bank of simulated ideal images.

Where the sensor's faults are known, the probability of a reading x given an ideal image m has a closed form. With gain
g, Gaussian noise σ, saturation and 8 bits, every taxel is a censored Gaussian:

    p(x | m, g) = Φ((½ - 255 g m) / 255σ)                 where x = 0
                  1 - Φ((254½ - 255 g m) / 255σ)          where x = 255
                  φ((x - 255 g m) / 255σ') / 255σ'        else, σ' with Sheppard's correction for the width of a level

The probability of the reading given a *shape* is the mean over a large bank of ideal images of the shape, with sizes,
 orientations, offsets, forces and gains as the scene draws them. Where rotated and mirrored images are equally likely,
 all of them are used. Up to the finite size of the bank, the shape of largest probability is the optimal guess.
A finite bank gives an accuracy that is too low and a posterior that is overconfident, so its *expected* accuracy is too
high. The limit lies between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from activetouch.rendering import Fault
from activetouch.rendering.faults import gain_and_noise, live_taxels
from activetouch.scene import Scene, Symmetry
from belief.seeding import keyed_rng
from experiments.bayes_error.held_out import Stream

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

IMAGES_PER_SLICE = 1000
_READINGS_AT_ONCE, _IMAGES_AT_ONCE = 256, 2000  # blocks that fit into the processor's cache


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """Parameters of the likelihood of a grey reading given an ideal image.

    Attributes:
        gain: half range of the relative error of the amplification, which is uniform.
        std: standard deviation of the noise, relative to full scale.
        live: which taxels work, ``(n, n)``.
    """

    gain: float
    std: float
    live: NDArray[np.bool_]

    @classmethod
    def of(cls, faults: Sequence[Fault], edge: int) -> SensorNoise:
        """The parameters of a sensor with these faults and ``edge`` taxels along an edge.

        Raises:
            UnknownLikelihood: they are not a gain, then noise, then dead taxels; only the noise is required.
        """
        gain, std, after = gain_and_noise(faults)
        return cls(gain, std, live_taxels(after, edge))

    def sample_means(self, ideals: Floats, rng: np.random.Generator) -> Floats:
        """Amplified live taxels ``(B, T)`` of ideal images ``(B, n, n)``, a gain drawn for each."""
        return rng.uniform(1.0 - self.gain, 1.0 + self.gain, (len(ideals), 1)) * ideals[:, self.live]

    def log_sum_likelihood(self, readings: Bytes, means: Floats) -> Floats:
        """Log ∑ p(reading | mean) over the means, for each reading, ``(N,)``.

        Args:
            readings: uint8 images ``(N, n, n)``.
            means: from :meth:`sample_means`, ``(B, T)``.
        """
        total = np.full(len(readings), -np.inf)
        read, offset = self._reading_terms(readings[:, self.live])
        for first in range(0, len(means), _IMAGES_AT_ONCE):
            terms = self._mean_terms(means[first : first + _IMAGES_AT_ONCE]).T
            for row in range(0, len(readings), _READINGS_AT_ONCE):
                rows = slice(row, row + _READINGS_AT_ONCE)
                log_likelihood = read[rows] @ terms
                highest = log_likelihood.max(axis=1)
                log_likelihood -= highest[:, None]
                total[rows] = np.logaddexp(
                    total[rows], highest + np.log(np.exp(log_likelihood, out=log_likelihood).sum(axis=1))
                )
        return total + offset

    def log_mean_likelihoods(self, readings: Bytes, means: Floats) -> Floats:
        """Log of the mean of p(reading | mean) over each group of means, ``(N, G)``.

        Args:
            readings: uint8 images ``(N, n, n)``.
            means: amplified live taxels of G groups of images, ``(G, B, T)``.
        """
        num_groups, size, _ = means.shape
        found = np.empty((len(readings), num_groups))
        read, offset = self._reading_terms(readings[:, self.live])
        at_once = max(1, _IMAGES_AT_ONCE // size)
        for first in range(0, num_groups, at_once):
            groups = slice(first, first + at_once)
            terms = self._mean_terms(means[groups].reshape(-1, means.shape[2])).T
            for row in range(0, len(readings), _READINGS_AT_ONCE):
                rows = slice(row, row + _READINGS_AT_ONCE)
                log_likelihood = (read[rows] @ terms).reshape(len(read[rows]), -1, size)
                highest = log_likelihood.max(axis=2)
                log_likelihood -= highest[:, :, None]
                found[rows, groups] = highest + np.log(np.exp(log_likelihood, out=log_likelihood).mean(axis=2))
        return found + offset[:, None]

    # A log likelihood is a sum over taxels of products of a term of the reading and a term of the mean. So all readings
    # and all means take one matrix product, in single precision: errors stay below 1e-3 nats.

    def _reading_terms(self, levels: Bytes) -> tuple[NDArray[np.float32], Floats]:
        """Factors ``(N, 4 T)`` and a constant ``(N,)``."""
        low, high, x = levels == 0, levels == 255, levels / 255.0
        between = ~(low | high)
        variance = self._variance_of_level
        constant = -0.5 * x**2 / variance - 0.5 * np.log(2 * np.pi * variance) - np.log(255.0)
        factors = np.concatenate([low, high, between * x, between], axis=1).astype(np.float32)
        return factors, np.where(between, constant, 0.0).sum(axis=1)

    def _mean_terms(self, means: Floats) -> NDArray[np.float32]:
        """Factors ``(B, 4 T)``."""
        below = log_ndtr((0.5 / 255.0 - means) / self.std)
        above = log_ndtr((means - 254.5 / 255.0) / self.std)
        slope = means / self._variance_of_level
        return np.concatenate([below, above, slope, -0.5 * means * slope], axis=1).astype(np.float32)

    @property
    def _variance_of_level(self) -> float:
        return self.std**2 + (1.0 / 255.0) ** 2 / 12.0  # Sheppard: a level is as wide as a uniform error of one step


def ideal_symmetry(scene: Scene) -> Symmetry:
    """Rotations and reflections under which ideal images of a scene are equally likely; faults do not count."""
    return replace(scene, faults=()).symmetry


def symmetric_views(images: NDArray[Any], symmetry: Symmetry) -> NDArray[Any]:
    """All equally likely views ``(B, V, n, n)`` of images ``(B, n, n)``; V is 1, 4 or 8, the given view comes first."""
    quarters = 1 if symmetry is Symmetry.NONE else 4
    views = [np.rot90(images, turns, axes=(1, 2)) for turns in range(quarters)]
    if symmetry is Symmetry.ROTATIONS_AND_MIRROR:
        views += [view[:, :, ::-1] for view in views]
    return np.stack(views, axis=1)


def ideal_images(scene: Scene, shape: int, count: int, rng: np.random.Generator) -> Floats:
    """Ideal images of new objects of a shape, each touched once, ``(count, n, n)``."""
    ideal = replace(scene, faults=())
    return np.stack(
        [ideal.press(ideal.sample_object(shape, rng), n % len(ideal.poses), rng).ideal for n in range(count)]
    )


def log_evidence_of_slice(
    scene: Scene, noise: SensorNoise, readings: Bytes, shape: int, number: int, seed: int
) -> tuple[int, int, Floats]:
    """Log of the mean likelihood of readings over one slice of the bank of a shape.

    Args:
        scene: the world.
        noise: parameters of the likelihood.
        readings: uint8 images ``(N, n, n)``.
        shape: index of the shape.
        number: of the slice, which keys its generator; a smaller bank is the beginning of a larger one.
        seed: of the bank.

    Returns:
        Shape, number, and the log likelihoods ``(N,)``.
    """
    rng = keyed_rng([seed, Stream.BANK, shape, number], is_fixed_length=True)
    views = symmetric_views(ideal_images(scene, shape, IMAGES_PER_SLICE, rng), ideal_symmetry(scene))
    means = noise.sample_means(views.reshape(-1, *views.shape[2:]), rng)
    return shape, number, noise.log_sum_likelihood(readings, means) - np.log(len(means))


def pool(log_evidence: Floats) -> Floats:
    """Log likelihoods ``(N, K)`` over all slices, from those of slices of equal size, ``(S, N, K)``."""
    return np.logaddexp.reduce(log_evidence, axis=0) - np.log(len(log_evidence))


def log_posterior(log_likelihood: Floats) -> Floats:
    """Log posteriors ``(..., K)`` under a uniform prior over shapes."""
    return log_likelihood - np.logaddexp.reduce(log_likelihood, axis=-1, keepdims=True)
