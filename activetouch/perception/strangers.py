"""Is the object none of the bodies? What was felt, beside what the best body and what just some body would feel like.

Two statistics of all touches of an object speak to that. The first is the log evidence of the best body, less that of
random bodies (:mod:`activetouch.perception.contacts.random_views`). The second is a posterior predictive check: as soon
as a body is probable, it is pressed in simulation as it is supposed to lie, in the touched poses, and the scores of
what was felt are compared with those of what it gives. The distributions of both, for objects of a set and for objects
whose own body is left out of it, come from the simulated objects that the set is fitted to; their ratios multiply.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.perception.contacts.close_look import CloseContacts
from activetouch.perception.contacts.random_views import log_normalisers
from activetouch.perception.imaging import Floats32
from activetouch.perception.pressed_beliefs import Residuals, compared, oddness
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from belief.files import array_digest
from belief.frozen import FrozenArrays
from belief.observation_model.nested_bodies import NestedEvidence
from belief.validation import Floats

PROBABLE = 0.9
"""Posterior, under equal priors, from which a body is pressed in simulation."""
_FREEDOM = 6  # degrees of freedom of the t-densities
_LIKE, _SPREAD = 4, 2.0  # every standard deviation is as of so many more objects with this one
_GRID, _FAR = 256, 4.0  # points of a density, and how far it reaches below the strangers' mean, in deviations
_FEWEST_DRAWN = 3  # presses in a pose, from which images are compared
_ALWAYS = 0.3  # variance of the score of a touch that presses of one hypothesis do not show


@dataclass(frozen=True, eq=False)
class TwoDensities(FrozenArrays):
    """t-densities of a statistic after 1 to N touches: of objects of the listed bodies, and of strangers.

    ``means`` and ``deviations`` are ``(2, N)``, the listed first; after more touches, they go on as in the last four.
    """

    means: Floats
    deviations: Floats

    def __post_init__(self) -> None:
        fits = self.means.ndim == 2 and len(self.means) == 2 and self.means.shape == self.deviations.shape
        if not fits or not self.means.size or not np.isfinite(self.means).all():
            raise ValueError(f"means must be finite and (2, N), deviations of their shape, got {self.means.shape}")
        if not ((self.deviations > 0.0) & (self.deviations < np.inf)).all():
            raise ValueError("deviations must be positive and finite")
        self.freeze()

    @classmethod
    def of(cls, listed: Floats, strangers: Floats) -> TwoDensities:
        """Of the statistic of n objects after 1 to N touches, ``(n, N)`` of either kind."""
        kinds = listed, strangers
        sizes = np.array([[len(one)] for one in kinds])
        squares = np.stack([((one - one.mean(axis=0)) ** 2).sum(axis=0) for one in kinds])
        deviations = np.sqrt((squares + _LIKE * _SPREAD**2) / (sizes + _LIKE))
        return cls(np.stack([one.mean(axis=0) for one in kinds]), deviations)

    @classmethod
    def along(cls, listed: Floats, strangers: Floats, touches: int) -> TwoDensities:
        """Of pairs of a number of touches and the statistic then, ``(n, 2)`` of either kind.

        Means are linear in the root of the number of touches, and variances rise in proportion to a part of it.
        """
        every, means, variances = np.arange(1, touches + 1), [], []
        for numbers, values in (listed.T, strangers.T):
            slope, level = _line(np.sqrt(numbers), values)
            squares = (values - level - slope * np.sqrt(numbers)) ** 2
            growth = float(np.clip(_line(numbers, squares)[0], 0.0, squares.mean() / numbers.mean()))
            start = squares.mean() - growth * numbers.mean()
            means.append(level + slope * np.sqrt(every))
            variances.append((len(squares) * (start + growth * every) + _LIKE * _SPREAD**2) / (len(squares) + _LIKE))
        return cls(np.stack(means), np.sqrt(np.stack(variances)))

    def fields(self) -> list[list[list[float]]]:
        """Means and deviations as JSON types."""
        return [self.means.tolist(), self.deviations.tolist()]

    def log_ratio(self, touches: float, value: float) -> float:
        """Log density of strangers over that of the listed; it never rises with the value."""
        (mean, other), (deviation, wide) = (self._after(part, touches) for part in (self.means, self.deviations))
        other = min(other, mean)
        values = np.linspace(other - _FAR * wide, mean, _GRID)
        ratios = _log_density(values, other, wide) - _log_density(values, mean, deviation)
        falling = np.maximum.accumulate(ratios[::-1])[::-1]  # to fit well, or less badly, is no sign of a stranger
        return float(np.interp(value, values, falling))

    @staticmethod
    def _after(rows: Floats, touches: float) -> list[float]:
        number = rows.shape[1]
        found = np.array([np.interp(touches, np.arange(1, number + 1), row) for row in rows])
        if touches > number > 4:
            found += (rows[:, -1] - rows[:, -5]) / 4.0 * (touches - number)
        return np.asarray(found).tolist()


def _line(places: Floats, values: Floats) -> tuple[float, float]:
    """Slope and level of a line through points, flat where all are at one place."""
    from_mean = places - places.mean()
    slope = float(from_mean @ values / (from_mean @ from_mean + 1.0))
    return slope, float(values.mean() - slope * places.mean())


def _log_density(values: Floats, mean: float, deviation: float) -> Floats:
    return np.asarray(scipy.stats.t.logpdf((values - mean) / deviation, _FREEDOM) - np.log(deviation))


@dataclass(frozen=True, eq=False)
class Strangers:
    """Weighs whether an object is none of the bodies of a scene (:mod:`activetouch.perception.strangers`).

    Attributes:
        scene: of the simulated presses.
        reader: of their images.
        bodies: the bodies.
        random: embeddings of views of random bodies in the state of the sensor, ``(B, D)``.
        check: presses of the probable body in each touched pose; 0 for no check.
        sums: of :meth:`fit_of`; None before the fit, as ``checks``.
        checks: of :meth:`surprise_of`; None without a check.
    """

    scene: Scene
    reader: TactileReader
    bodies: CloseContacts
    random: Floats32 = field(repr=False)
    check: int
    sums: TwoDensities | None = None
    checks: TwoDensities | None = None

    def log_ratio(self, evidence: NestedEvidence) -> float:
        """See :class:`belief.observation_model.nested_bodies.StrangerTest`."""
        logs, number = evidence.belief.log_evidence - evidence.belief.correction, evidence.belief.num_new
        found = 0.0 if self.sums is None else self.sums.log_ratio(number, self.fit_of(evidence, logs))
        likely = np.exp(evidence.log_likelihood - scipy.special.logsumexp(evidence.log_likelihood))
        if self.check and self.checks is not None and likely.max() >= PROBABLE:
            found += self.checks.log_ratio(number, self.surprise_of(evidence, int(likely.argmax())))
        return found

    def fields(self) -> dict[str, Any]:
        """See :class:`belief.observation_model.nested_bodies.StrangerTest`."""
        densities = [None if one is None else one.fields() for one in (self.sums, self.checks)]
        return {"check": self.check, "random": array_digest({"views": self.random}), "densities": densities}

    def fit_of(self, evidence: NestedEvidence, log_evidence: Floats) -> float:
        """Log evidence of the best body, less that of random bodies that may be others in every touch."""
        belief = evidence.belief
        scale = belief.scale / (1.0 + belief.drift * max(belief.num_new - 1.0, 0.0))
        felt = np.stack(list(evidence.effective.values()))
        return float(log_evidence.max() - log_normalisers(self.random, felt, scale).sum())

    def surprise_of(self, evidence: NestedEvidence, body: int) -> float:
        """How much better what was felt fits a body than what its presses give, in standard deviations.

        The body is pressed as it fits the touches best, ``check`` times in each touched pose. Two deviations are added:
        that of the scores, and, where touches have images, how odd these are beside those of the presses
        (:func:`activetouch.perception.pressed_beliefs.oddness`). The generator follows from the touches: the same
        touches give the same number.
        """
        poses = list(evidence.in_pose)
        felt = np.stack([total / np.float32(number) for number, total in evidence.in_pose.values()])
        rest, size = self.bodies.fitted(body, evidence.belief.touches)
        expected = self.bodies.contacts(body, poses, rest, size)
        digest = array_digest({"poses": np.array(poses), "felt": felt, "body": np.array(body)})
        rng = np.random.default_rng(int(digest[:16], 16))
        obj = replace(self.scene.sample_object(body, rng), orientation=rest, scale=size)
        images = np.stack([self.scene.press(obj, pose, rng).image for pose in poses for _ in range(self.check)])
        given = self.reader.run(images)[0]
        scores = self._scores(given, expected.repeat(self.check, axis=0)).reshape(len(poses), self.check)
        spread = scores.var(axis=1, ddof=min(1, self.check - 1)) * (1.0 + 1.0 / self.check) + _ALWAYS
        found = float((self._scores(felt, expected) - scores.mean(axis=1)).sum() / np.sqrt(spread.sum()))
        if not evidence.images or self.check < _FEWEST_DRAWN:
            return found
        drawn = dict(zip(poses, np.split(compared(images), len(poses)), strict=True))
        shown = [compared(image[None])[0] for _, image in evidence.images]
        return found - oddness([Residuals.of(shown, [drawn[pose] for pose, _ in evidence.images])])

    def _scores(self, felt: NDArray[np.floating], expected: Floats32) -> Floats:
        """Log p(touch | its contact) / p(touch | some body), ``(n,)``."""
        return np.einsum("nd,nd->n", felt, expected) - log_normalisers(self.random, felt, 1.0)
