"""Worlds of a sensor: the embedding of hypotheses in them, their prior, and their posterior in a session.

>>> print(SensorHealth(("as described", "soft", "unknown"), np.log([0.8, 0.15, 0.05]), np.zeros(3), 0))
as described 0.80; soft 0.15
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from belief.frozen import FrozenArrays
from belief.observation_model.embedded_hypotheses import require_table
from belief.validation import MOST_REPEATED, Floats, require_count, require_number

AS_DESCRIBED, UNKNOWN = "as described", "unknown"
"""Labels of the first and the last component."""
SURE = 0.9
"""Posterior of the likeliest component below which all are awake."""
_TRIED = 24  # touches of a session before worlds may sleep
_NEGLIGIBLE = np.log(1e-6)  # log posterior of a world that may sleep
_IN_TURN = 4  # objects, at one of which one world is asked at random


class EmbedsWorlds(Protocol):
    """Embeds hypotheses of a body as a sensor in W other worlds reads them.

    N' may differ from the number of hypotheses of the nominal model; float16 takes half the memory, float32 half the
    time. The embedder caches its arrays, because they are asked for at every touch.
    """

    def in_pose(self, pose: int) -> NDArray[np.floating]:
        """Embedded hypotheses in one pose, ``(W, K, N', D)``."""

    def in_place(self, place: tuple[float, ...]) -> NDArray[np.floating]:
        """Embedded hypotheses in none of the poses (:class:`belief.problem.Elsewhere`), ``(W, K, N', D)``."""


@dataclass(frozen=True, eq=False)
class FixedWorlds(FrozenArrays):
    """Hypotheses in other worlds that are embedded already.

    Attributes:
        table: embedded hypotheses of every pose, ``(P, W, K, N', D)``, read-only.

    Raises:
        ValueError: it has other dimensions, or numbers that are not real, not finite or too large.

    >>> FixedWorlds(np.zeros((6, 80, 4, 512, 96), np.float16)).in_pose(5).shape
    (80, 4, 512, 96)
    """

    table: NDArray[np.floating]

    def __post_init__(self) -> None:
        if np.ndim(self.table) != 5:
            raise ValueError(f"hypotheses in other worlds must be (P, W, K, N', D), got {np.shape(self.table)}")
        require_table(self.table, np.shape(self.table))
        self.freeze()

    def in_pose(self, pose: int) -> NDArray[np.floating]:
        """See :class:`EmbedsWorlds`."""
        return self.table[pose]

    def in_place(self, place: tuple[float, ...]) -> NDArray[np.floating]:
        """See :class:`EmbedsWorlds`; raises ValueError."""
        raise ValueError(f"the hypotheses of other worlds are embedded in {len(self.table)} poses only, not at {place}")


def spread_prior(num_worlds: int, nominal: float = 0.9, unknown: float = 0.005) -> Floats:
    """Prior of the components, ``(1 + W + 1,)``, with the remaining probability spread evenly over the W worlds.

    Args:
        num_worlds: W; if it is 0, the nominal component gets the remaining probability.
        nominal: probability of the sensor as described.
        unknown: probability of the component that knows nothing.

    Raises:
        ValueError: the two are no probabilities, or have a sum above one.

    >>> spread_prior(2).round(4).tolist(), spread_prior(0).tolist()
    ([0.9, 0.0475, 0.0475, 0.005], [0.995, 0.005])
    """
    require_count("num_worlds", num_worlds, 0, MOST_REPEATED)
    require_number("nominal", nominal, 0.0, 1.0)
    require_number("unknown", unknown, 0.0, 1.0 - nominal)
    rest = max(0.0, 1.0 - nominal - unknown)
    if num_worlds == 0:
        return np.array([nominal + rest, unknown])
    return np.array([nominal, *[rest / num_worlds] * num_worlds, unknown])


@dataclass(frozen=True, eq=False)
class SensorHealth:
    """What a session knows about its sensor: the posterior over C components after all its touches. A frozen value.

    Once a session has 24 touches and one component has a posterior of 0.9, worlds with a posterior below 1e-6 *sleep*:
    they count as impossible for the next object, and forgetting brings them back when they are asked again. That is all
    of them as soon as no component has 0.9 at an object, and one of them, drawn at random, at every fourth object.

    ``log_prior (C,)`` and ``log_ratios (C,)``, the log of posterior by prior after the last object, are of the
    components; ``is_clear`` says whether one component has at least 0.9 at every object of the search.
    """

    labels: tuple[str, ...]
    log_prior: Floats
    log_ratios: Floats
    num_touches: int
    is_clear: bool = True

    @property
    def probs(self) -> Floats:
        """Posterior of the components, ``(C,)``."""
        return np.exp(self.log_prior + self.log_ratios)

    @property
    def log_bets(self) -> Floats:
        """What the next search of the session begins with, ``(C + 1,)``: log ratios, and number of touches."""
        return np.append(self.log_ratios, float(self.num_touches))

    @property
    def log_conflict(self) -> float:
        """Log Bayes factor of the component that knows nothing against the mixture of all others."""
        known = np.logaddexp.reduce((self.log_prior + self.log_ratios)[:-1])
        return float(self.log_ratios[-1] - known + np.logaddexp.reduce(self.log_prior[:-1]))

    @property
    def awake(self) -> NDArray[np.int64]:
        """Indices of the worlds that are evaluated for the next object, ``(A,)``."""
        log_probs = self.log_prior + self.log_ratios
        number = len(log_probs) - 2
        if self.num_touches < _TRIED or log_probs.max() < np.log(SURE):
            return np.arange(number)
        drawn = int(np.random.default_rng(self.num_touches).integers(max(1, _IN_TURN * number)))
        return np.union1d(np.flatnonzero(log_probs[1:-1] >= _NEGLIGIBLE), [drawn] if drawn < number else []).astype(int)

    def __str__(self) -> str:
        """The likeliest components that together have 0.95, at most four."""
        probs = self.probs
        order = np.argsort(-probs, kind="stable")[:4]
        number = 1 + int(np.searchsorted(np.cumsum(probs[order])[:-1], 0.95))
        return "; ".join(f"{self.labels[i]} {probs[i]:.2f}" for i in order[:number])
