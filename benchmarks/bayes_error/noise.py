"""Likelihood of a reading given simulated ideal images, in closed form.

Where the sensor's faults are known, the probability of a reading x given an ideal image m has a closed form. With gain
g, Gaussian noise σ, saturation and 8 bits, every taxel is a censored Gaussian:

    p(x | m, g) = Φ((½ - 255 g m) / 255σ)                 where x = 0
                  1 - Φ((254½ - 255 g m) / 255σ)          where x = 255
                  φ((x - 255 g m) / 255σ') / 255σ'        else, σ' with Sheppard's correction for the width of a level
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from activetouch.rendering import DeadTaxels, Fault, Gain, Noise
from belief.errors import ActiveTouchError
from benchmarks.held_out import split_at_noise

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_READINGS_AT_ONCE, _IMAGES_AT_ONCE = 256, 2000  # blocks that fit into the processor's cache


class UnknownLikelihood(ActiveTouchError, TypeError):
    """A scene has no likelihood that this estimator can compute."""


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
        gain, std, after = _gain_and_noise(faults)
        return cls(gain, std, _live_taxels(after, edge))

    def sample_means(self, ideals: Floats, rng: np.random.Generator) -> Floats:
        """Amplified live taxels ``(B, T)`` of ideal images ``(B, n, n)``, a gain drawn for each."""
        return rng.uniform(1.0 - self.gain, 1.0 + self.gain, (len(ideals), 1)) * ideals[:, self.live]

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


def _gain_and_noise(faults: Sequence[Fault]) -> tuple[float, float, Sequence[Fault]]:
    """The statistics of a sensor with at most one gain, followed by noise.

    Returns:
        Half range of the gain, 0 without one; standard deviation of the noise; and the faults after the noise.

    Raises:
        UnknownLikelihood: there is no noise, or something other than one gain before it.
    """
    before, after = split_at_noise(faults)
    match before, after[:1]:
        case [], [Noise(std=std)] if std > 0.0:
            return 0.0, std, after[1:]
        case [Gain(half_range=gain)], [Noise(std=std)] if std > 0.0:
            return gain, std, after[1:]
    raise UnknownLikelihood(f"the likelihood of a reading needs at most one Gain, then Noise; got {faults}")


def _live_taxels(faults: Sequence[Fault], edge: int) -> NDArray[np.bool_]:
    """The taxels of an image of ``edge`` × ``edge`` taxels that work, ``(edge, edge)``.

    Raises:
        UnknownLikelihood: there are faults other than :class:`DeadTaxels`.
    """
    live = np.ones((edge, edge), bool)
    for fault in faults:
        if not isinstance(fault, DeadTaxels):
            raise UnknownLikelihood(f"the likelihood of a reading needs DeadTaxels only after the noise; got {fault}")
        live &= fault(np.ones((edge, edge)), np.random.default_rng(0)) > 0.0
    return live
