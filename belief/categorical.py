"""A belief: a categorical distribution over named shapes, stored as log probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief import bayes
from belief.errors import UnknownName
from belief.frozen import FrozenArrays
from belief.naming import one_line
from belief.problem import Floats
from belief.validation import as_real, normalise_log_probs, normalise_probs


@dataclass(frozen=True, eq=False)
class Belief(FrozenArrays):
    """Probability distribution over the shape of one object.

    Immutable: :meth:`update` returns a new belief. A shape of probability zero keeps probability zero.

    Attributes:
        labels: names of the K shapes.
        log_probs: log probabilities, ``(K,)``, normalised at construction, read-only.

    Raises:
        ValueError: the probabilities hold NaN, do not sum to one, or do not fit the labels.

    Example:
        >>> belief = Belief.uniform(["sphere", "cube", "cone"])
        >>> belief = belief.update(np.log([0.9, 0.05, 0.05]))
        >>> print(belief)
        Belief(sphere 0.900, cube 0.050, cone 0.050)
    """

    labels: tuple[str, ...]
    log_probs: Floats

    def __post_init__(self) -> None:
        labels, log_probs = tuple(self.labels), as_real(self.log_probs, "log_probs")
        _require_labels(labels, log_probs.shape)
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "log_probs", normalise_log_probs(log_probs))
        self.freeze()

    @classmethod
    def uniform(cls, labels: Sequence[str]) -> Belief:
        """Every shape equally likely."""
        if not labels:
            raise ValueError("labels is empty: a belief needs at least one shape")
        return cls(tuple(labels), np.full(len(labels), -np.log(len(labels))))

    @classmethod
    def from_probs(cls, labels: Sequence[str], probs: ArrayLike) -> Belief:
        """A belief from probabilities ``(K,)``; zeros are allowed."""
        names, given = tuple(labels), normalise_probs(probs)
        _require_labels(names, given.shape)
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

    def prob(self, label: str) -> float:
        """Probability of one shape by name."""
        if label not in self.labels:
            raise UnknownName("shape", label, list(self.labels))
        return float(np.exp(self.log_probs[self.labels.index(label)]))

    def update(self, log_likelihood: ArrayLike) -> Belief:
        """The posterior belief after an observation with this log-likelihood ``(K,)``.

        Raises:
            ValueError: NaN, +inf, or a shape that does not fit.
            ImpossibleObservation: zero likelihood for every shape of positive probability.
        """
        log_posterior, _ = bayes.update(self.log_probs, log_likelihood)
        if log_posterior.ndim != 1:
            raise ValueError(f"one belief needs a log-likelihood ({len(self.labels)},), got {np.shape(log_likelihood)}")
        return Belief.of_normalised(self.labels, log_posterior)

    def __repr__(self) -> str:
        likely = np.argsort(-self.log_probs, kind="stable")
        shown = [f"{self.labels[k]} {np.exp(self.log_probs[k]):.3f}" for k in likely[:4]]
        return one_line(Belief, *shown, *([f"{len(likely) - 4} others"] if len(likely) > 4 else []))

    def __str__(self) -> str:
        pairs = zip(self.labels, self.probs, strict=True)
        return f"Belief({', '.join(f'{label} {prob:.3f}' for label, prob in pairs)})"


def _require_labels(labels: tuple[str, ...], shape: tuple[int, ...]) -> None:
    """Check the names of a belief's shapes against the shape of its array."""
    if len(set(labels)) != len(labels):
        raise ValueError(f"labels must differ from each other, got {list(labels)}")
    if shape != (len(labels),) or not labels:
        raise ValueError(
            f"{len(labels)} labels need log_probs of shape ({len(labels)},) with at least one entry, got {shape}"
        )
