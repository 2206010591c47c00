"""From touches to likelihoods: p(touch | shape, pose), estimated on touches of objects the classifier never saw.

A classifier's softmax is a *posterior* under its training set, and over-confident; multiplying such outputs counts
the prior once per touch. An observation model turns a touch into a likelihood instead. The likelihood takes all
touches of one object at once, so that a model may discount touches that repeat each other.

:class:`ConfusionModel` is the auditable one: it discretises a touch into (predicted shape × confidence bin) and
counts how often each outcome came from each shape.

To add a model, write a class with the members of :class:`ObservationModel`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration import TemperatureScaling
from belief.problem import Floats, Touch


class ObservationModel(Protocol):
    """What turns touches into evidence."""

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the K shapes."""

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """Log p(all these touches of one object | shape), ``(K,)``; zeros for no touches."""

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """Touches that one object of this shape might give in these poses."""

    def outcome_table(self) -> OutcomeTable:
        """The model with touches discretised, for planners."""


@dataclass(frozen=True, eq=False)
class OutcomeTable:
    """A discrete observation model.

    Attributes:
        probs: p(outcome | pose, shape), ``(P, K, M)``; the last axis sums to one.

    Raises:
        ValueError: not three axes, a negative or NaN entry, or a row that does not sum to one.
    """

    probs: Floats

    def __post_init__(self) -> None:
        probs = np.array(self.probs, np.float64)
        if probs.ndim != 3 or probs.size == 0:
            raise ValueError(f"probs must be (P, K, M) with no axis empty, got shape {probs.shape}")
        bad = ~((probs >= 0.0).all(axis=2) & (np.abs(probs.sum(axis=2) - 1.0) <= 2e-3))
        if bad.any():
            pose, shape = (int(i) for i in np.argwhere(bad)[0])
            raise ValueError(
                f"probs[pose {pose}, shape {shape}] is no distribution over outcomes: {probs[pose, shape].tolist()}"
            )
        totals = probs.sum(axis=2, keepdims=True)
        if np.abs(totals - 1.0).max() > 1e-12:  # what is already normalised keeps its last bit, as on reload
            probs /= totals
        probs.flags.writeable = False
        object.__setattr__(self, "probs", probs)

    @property
    def num_poses(self) -> int:
        """P."""
        return self.probs.shape[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.probs.shape[1]

    @property
    def num_outcomes(self) -> int:
        """M."""
        return self.probs.shape[2]


@dataclass(frozen=True, eq=False)
class ConfusionModel:
    """Per-pose confusion matrices over (predicted shape × confidence bin).

    Attributes:
        shape_labels: names of the K shapes.
        probs: p(outcome | pose, shape), ``(P, K, M)`` with M = K · number of bins; never zero when fitted.
        calibration: turns logits into the confidences that are binned.
        confidence_edges: rising inner edges of the confidence bins; empty for the plain confusion matrix.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> logits = rng.normal(size=(400, 2)) + 3.0 * np.eye(2)[np.arange(400) % 2]
        >>> touches = [Touch(pose=0, logits=row) for row in logits]
        >>> model = ConfusionModel.fit(touches, np.arange(400) % 2, shape_labels=("cube", "cone"))
        >>> model.outcome_table().probs.round(2).tolist()         # outcomes: "cube", "cone"
        [[[0.98, 0.02], [0.02, 0.98]]]
    """

    shape_labels: tuple[str, ...]
    probs: Floats
    calibration: TemperatureScaling
    confidence_edges: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        probs = OutcomeTable(self.probs).probs
        expected = len(self.shape_labels) * (len(self.confidence_edges) + 1)
        if probs.shape[1:] != (len(self.shape_labels), expected):
            raise ValueError(
                f"{len(self.shape_labels)} shapes and {len(self.confidence_edges)} confidence edges need probs of "
                f"shape (P, {len(self.shape_labels)}, {expected}), got {probs.shape}"
            )
        edges = np.array([1.0 / len(self.shape_labels), *self.confidence_edges, 1.0])
        if not (np.diff(edges) > 0.0).all():
            raise ValueError(f"confidence_edges must rise strictly within (1/K, 1), got {self.confidence_edges}")
        object.__setattr__(self, "probs", probs)

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        confidence_edges: Sequence[float] = (),
        smoothing: float = 0.5,
        pooling: float = 100.0,
    ) -> ConfusionModel:
        """Count outcomes on a calibration set.

        Each pose's counts are shrunk towards the matrix pooled over all poses (Dirichlet prior of ``pooling``
        pseudo-counts), and the pooled matrix towards a uniform one (``smoothing`` pseudo-counts an outcome), so no
        outcome ever has probability zero.

        Args:
            touches: calibration touches, of objects the classifier was not trained on.
            shapes: true shape index of each, ``(n,)``.
            object_ids: ignored: this model treats touches as independent given the shape.
            shape_labels: names; by default ``shape_0`` and so on.
            num_poses: P; by default one more than the largest pose seen.
            confidence_edges: inner edges of the confidence bins.
            smoothing: pseudo-counts per outcome of the pooled matrix, > 0.
            pooling: weight of the pooled matrix in each pose, in touches.

        Raises:
            ValueError: no touches, labels out of range, or a length that does not fit.
        """
        del object_ids
        truth = np.asarray(shapes)
        if len(touches) == 0 or truth.shape != (len(touches),):
            raise ValueError(f"need at least one touch and one shape for each, got {len(touches)} and {truth.shape}")
        num_shapes = len(touches[0].logits)
        logits, poses = _stack(touches, num_shapes, num_poses)
        if not np.issubdtype(truth.dtype, np.integer) or truth.min() < 0 or truth.max() >= num_shapes:
            raise ValueError(f"shapes must be integers in [0, {num_shapes}), got {truth.dtype} {truth}")
        if not smoothing > 0.0 or pooling < 0.0:
            raise ValueError(f"smoothing must be > 0 and pooling ≥ 0, got {smoothing} and {pooling}")
        labels = tuple(shape_labels) if shape_labels else tuple(f"shape_{k}" for k in range(num_shapes))
        size = (int(poses.max()) + 1 if num_poses is None else num_poses, num_shapes)
        calibration = TemperatureScaling().fit(logits, truth)
        outcomes = _outcomes(calibration, logits, confidence_edges)
        counts = np.zeros((*size, num_shapes * (len(confidence_edges) + 1)))
        np.add.at(counts, (poses, truth, outcomes), 1.0)
        pooled = counts.sum(axis=0) + smoothing
        pooled /= pooled.sum(axis=1, keepdims=True)
        probs = counts + pooling * pooled + np.finfo(float).tiny
        probs /= probs.sum(axis=2, keepdims=True)
        return cls(labels, probs, calibration, tuple(float(edge) for edge in confidence_edges))

    def outcomes(self, touches: Sequence[Touch]) -> NDArray[np.int64]:
        """Outcome index of each touch, ``(n,)``: bin · K + predicted shape."""
        logits, _ = _stack(touches, len(self.shape_labels), len(self.probs))
        return _outcomes(self.calibration, logits, self.confidence_edges)

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """See :class:`ObservationModel`; the sum over touches, which are independent given the shape here."""
        if not touches:
            return np.zeros(len(self.shape_labels))
        logits, poses = _stack(touches, len(self.shape_labels), len(self.probs))
        outcomes = _outcomes(self.calibration, logits, self.confidence_edges)
        with np.errstate(divide="ignore"):
            log_probs = np.log(self.probs[poses, :, outcomes])  # (n, K)
        return np.asarray(log_probs.sum(axis=0))

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """See :class:`ObservationModel`; the logits claim what the sampled outcome is worth, within its bin."""
        touches = []
        for pose in poses:
            outcome = int(rng.choice(self.probs.shape[2], p=self.probs[pose, shape]))
            touches.append(Touch(pose, self._typical_logits[pose, outcome]))
        return touches

    @cached_property
    def _typical_logits(self) -> Floats:
        """Logits that stand for each outcome, ``(P, M, K)``: calibrated, they give the precision of the outcome."""
        num_shapes = len(self.shape_labels)
        predicted = np.arange(self.probs.shape[2]) % num_shapes  # (M,)
        bins = np.arange(self.probs.shape[2]) // num_shapes
        edges = np.concatenate([[1.0 / num_shapes], self.confidence_edges, [1.0]])
        right = self.probs[:, predicted, np.arange(self.probs.shape[2])]  # (P, M)
        margin = 1e-9  # bins are open below, and a claim of certainty has no finite logits
        low, high = edges[bins] + margin, np.minimum(edges[bins + 1], 1.0 - margin)
        confidence = np.clip(right / self.probs.sum(axis=1), low, high)
        floor = self.calibration.floor  # which the calibration will add again
        confidence = np.minimum((confidence - floor / num_shapes) / (1.0 - floor), 1.0 - margin)
        rest = (1.0 - confidence) / max(num_shapes - 1, 1)
        probs = np.where(predicted[:, None] == np.arange(num_shapes), confidence[..., None], rest[..., None])
        return np.log(probs) * self.calibration.temperature

    def outcome_table(self) -> OutcomeTable:
        """See :class:`ObservationModel`."""
        return OutcomeTable(self.probs)

    def to_json(self) -> str:
        """The model as JSON text, exact to the last bit."""
        return json.dumps(
            {
                "model": "confusion",
                "shape_labels": self.shape_labels,
                "confidence_edges": self.confidence_edges,
                "temperature": self.calibration.temperature,
                "status": self.calibration.status,
                "floor": self.calibration.floor,
                "probs": self.probs.tolist(),
            },
            indent=1,
        )

    @classmethod
    def from_json(cls, text: str) -> ConfusionModel:
        """The model from :meth:`to_json`.

        Raises:
            ValueError: the text is no confusion model.
        """
        try:
            fields = json.loads(text)
            if fields["model"] != "confusion":
                raise ValueError(f"expected a confusion model, found {fields['model']!r}")
            calibration = TemperatureScaling(fields["temperature"], fields["status"], fields["floor"])
            return cls(
                tuple(fields["shape_labels"]),
                np.array(fields["probs"], np.float64),
                calibration,
                tuple(fields["confidence_edges"]),
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f"not an observation model: {error!r}") from error


def _outcomes(calibration: TemperatureScaling, logits: Floats, confidence_edges: Sequence[float]) -> NDArray[np.int64]:
    probs = calibration.predict_proba(logits)
    bins = np.searchsorted(np.asarray(confidence_edges, np.float64), probs.max(axis=1))
    return np.asarray(bins * probs.shape[1] + logits.argmax(axis=1), np.int64)


def _stack(touches: Sequence[Touch], num_shapes: int, num_poses: int | None) -> tuple[Floats, NDArray[np.int64]]:
    """Logits ``(n, K)`` and poses ``(n,)`` of touches that fit the model; ValueError names the one that does not."""
    for index, touch in enumerate(touches):
        if np.shape(touch.logits) != (num_shapes,) or not np.isfinite(touch.logits).all():
            raise ValueError(f"touch {index} needs {num_shapes} finite logits, got {np.asarray(touch.logits)}")
        if touch.pose < 0 or (num_poses is not None and touch.pose >= num_poses):
            raise ValueError(f"touch {index} has pose {touch.pose}, the model knows poses 0 to {num_poses}, exclusive")
    logits = np.stack([np.asarray(touch.logits, np.float64) for touch in touches])
    return logits, np.array([touch.pose for touch in touches], np.int64)
