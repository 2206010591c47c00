"""A belief: a categorical distribution over named shapes, stored as log probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief import bayes
from belief.frozen import FrozenArrays
from belief.naming import Name, checked_names, index_of, one_line
from belief.validation import Floats, as_logs, as_real, normalise_log_probs, normalise_probs


@dataclass(frozen=True, eq=False)
class Belief(FrozenArrays):
    """Probability distribution over the shape of one object.

    Immutable: :meth:`update` returns a new belief. A shape of probability zero keeps probability zero.

    Attributes:
        labels: names of the K shapes.
        log_probs: log probabilities, ``(K,)``, normalised at construction, read-only.

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
    def from_probs(cls, labels: Sequence[str], probs: ArrayLike) -> Belief:
        """A belief from probabilities ``(K,)``; zeros are allowed."""
        given = normalise_probs(probs)
        names = _checked_labels(labels, given.shape)
        with np.errstate(divide="ignore"):
            return cls.of_normalised(names, np.log(given))

    @classmethod
    def of_normalised(cls, labels: tuple[str, ...], log_probs: Floats) -> Belief:
        """A belief from normalised log probabilities ``(K,)``, without any check.

        The array is not copied and becomes read-only.

        >>> Belief.of_normalised(("cube", "cone"), np.array([0.0, -np.inf])).probs.tolist()
        [1.0, 0.0]
        """
        belief = object.__new__(cls)
        log_probs.flags.writeable = False
        belief.__dict__.update(labels=labels, log_probs=log_probs)
        return belief

    @property
    def probs(self) -> Floats:
        """Probabilities, ``(K,)``."""
        return np.exp(self.log_probs)

    @property
    def entropy(self) -> float:
        """Entropy [nats]."""
        return float(bayes.entropy(self.probs))

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
            ValueError: NaN, +inf, a negative likelihood, a shape that does not fit, or not exactly one of the two.
            ImpossibleObservation: zero likelihood for every shape of positive probability.
        """
        logs = as_logs("log_likelihood", log_likelihood, "likelihood", likelihood)
        log_posterior, _ = bayes.update(self.log_probs, logs)
        if log_posterior.ndim != 1:
            raise ValueError(f"one belief needs a log-likelihood ({len(self.labels)},), got {logs.shape}")
        return Belief.of_normalised(self.labels, log_posterior)

    def __repr__(self) -> str:
        likely = np.argsort(-self.log_probs, kind="stable")
        shown = [f"{self.labels[k]} {np.exp(self.log_probs[k]):.3f}" for k in likely[:4]]
        return one_line(Belief, *shown, *([f"{len(likely) - 4} others"] if len(likely) > 4 else []))

    def __str__(self) -> str:
        pairs = zip(self.labels, self.probs, strict=True)
        return f"Belief({', '.join(f'{label} {prob:.3f}' for label, prob in pairs)})"


def _checked_labels(labels: Sequence[str], shape: tuple[int, ...]) -> tuple[str, ...]:
    """The names of a belief's shapes, checked against the shape of its array."""
    names = checked_names("labels", labels)
    if shape != (len(names),):
        raise ValueError(f"{len(names)} labels need as many probabilities, ({len(names)},), got {shape}")
    return names
