"""What every observation model can do."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.batch import TouchBatch
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Floats, Touch


class ObservationModel(Protocol):
    """What turns touches into evidence: all that trackers and planners ask for."""

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the K shapes."""

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """Log p(all these touches of one object | shape), ``(K,)``; zeros for no touches."""

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """Touches that one object of this shape might give in these poses."""

    def outcome_table(self) -> OutcomeTable:
        """The model with touches discretised, for planners."""


class ArrayModel(ABC):
    """An observation model that computes with arrays; the models of this package derive from it.

    Attributes:
        name: what it is called in files.
        shape_labels: names of the K shapes.
    """

    name: ClassVar[str]
    shape_labels: tuple[str, ...]

    @property
    @abstractmethod
    def num_poses(self) -> int:
        """P."""

    @abstractmethod
    def log_likelihood_batch(self, batch: TouchBatch) -> Floats:
        """Log p(touches of a sequence | shape) up to a constant of the sequence, ``(S, K)``."""

    @abstractmethod
    def sample_batch(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """What S objects of a shape might give, each touched in its row of ``poses (S, n)``."""

    @abstractmethod
    def outcome_table(self, num_outcomes: int | None = None, rng: np.random.Generator | None = None) -> OutcomeTable:
        """The model with touches discretised into at most so many outcomes, for planners.

        Args:
            num_outcomes: at most so many; the model's own number by default.
            rng: for models that have to sample their table; seed 0 by default, so that a model has one table.
        """

    @abstractmethod
    def to_fields(self) -> dict[str, Any]:
        """Everything but the shape labels that makes this object, as JSON types."""

    @classmethod
    @abstractmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> Self:
        """The object from :meth:`to_fields`."""

    def to_json(self) -> str:
        """The model as JSON text, exact to the last bit; :func:`read_observation_model` reads it."""
        fields = {"model": self.name, "shape_labels": list(self.shape_labels), **self.to_fields()}
        return json.dumps(fields, allow_nan=False)

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """Log p(all these touches of one object | shape) up to a constant, ``(K,)``; zeros for no touches.

        Raises:
            ValueError: a touch does not fit the model; the message names it.
        """
        if not touches:
            return np.zeros(len(self.shape_labels))
        batch = TouchBatch.of([touches])
        self.require_fit(batch)
        return self.log_likelihood_batch(batch)[0]

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """Touches that one object of this shape might give in these poses."""
        if not poses:
            return []
        return self.sample_batch(shape, np.asarray(poses, np.int64)[None], rng).sequence(0)

    def require_fit(self, batch: TouchBatch) -> None:
        """Refuse touches of other shapes or poses than the model knows.

        Raises:
            ValueError: the message names the first touch that does not fit.
        """
        if batch.logits.shape[2] != len(self.shape_labels):
            raise ValueError(
                f"the model knows {len(self.shape_labels)} shapes ({', '.join(self.shape_labels)}), the touches have "
                f"{batch.logits.shape[2]} logits"
            )
        beyond = np.argwhere(batch.poses >= self.num_poses)
        if beyond.size:
            sequence, touch = (int(i) for i in beyond[0])
            raise ValueError(
                f"touch {touch} has pose {batch.poses[sequence, touch]}, the model knows poses 0 to {self.num_poses}, "
                "exclusive"
            )


def calibration_arrays(
    touches: Sequence[Touch], shapes: ArrayLike, object_ids: ArrayLike | None
) -> tuple[TouchBatch, NDArray[np.int64], NDArray[np.int64]]:
    """Calibration touches as one long sequence, with shape and object (from 0, without gaps) of each, ``(n,)``.

    Raises:
        ValueError: no touches, labels out of range, lengths that do not fit, or an object of two shapes.
    """
    truth = np.asarray(shapes)
    ids = np.arange(len(touches)) if object_ids is None else np.asarray(object_ids)
    if len(touches) == 0 or truth.shape != (len(touches),) or ids.shape != truth.shape:
        raise ValueError(
            f"need at least one touch, and one shape and object for each, got {len(touches)} touches, {truth.shape} "
            f"shapes and {ids.shape} objects"
        )
    batch = TouchBatch.of([touches])
    num_shapes = batch.logits.shape[2]
    if not np.issubdtype(truth.dtype, np.integer) or truth.min() < 0 or truth.max() >= num_shapes:
        raise ValueError(
            f"shapes must be integers in [0, {num_shapes}), got {truth.dtype} from {truth.min()} to {truth.max()}"
        )
    _, first, index = np.unique(ids, return_index=True, return_inverse=True)
    if (truth[first][index] != truth).any():
        row = int(np.argmax(truth[first][index] != truth))
        raise ValueError(
            f"object {ids[row]} has two shapes, {truth[first][index][row]} and, in touch {row}, {truth[row]}"
        )
    return batch, truth.astype(np.int64), index.astype(np.int64)


def labels_or_default(shape_labels: Sequence[str] | None, num_shapes: int) -> tuple[str, ...]:
    """The names given, or ``shape_0`` and so on.

    Raises:
        ValueError: there are not as many names as shapes.
    """
    labels = tuple(shape_labels) if shape_labels is not None else tuple(f"shape_{k}" for k in range(num_shapes))
    if len(labels) != num_shapes:
        raise ValueError(f"the touches have {num_shapes} logits, shape_labels names {len(labels)}: {list(labels)}")
    return labels
