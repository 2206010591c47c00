"""The protocol of observation models, its check, and the base class of the models of this package."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, Self, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.codec import from_fields, to_fields
from belief.errors import BrokenContract, InvalidArgument
from belief.files import sealed_json
from belief.frozen import FrozenArrays
from belief.naming import checked_names
from belief.observation_model.evidence import ObjectEvidence, RecomputedEvidence, SummarisedEvidence, Summarises
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Touch
from belief.validation import Floats, require_count, require_index

if TYPE_CHECKING:
    from belief.touch_batch import TouchBatch

Reads: TypeAlias = Literal["logits", "embeddings", "log ratios"]
"""What a model reads of a touch: its logits, its embedding, or logits that are calibrated log likelihood ratios."""
_BLOCK = 1 << 16  # logits per block, unless one sequence has more


class Embeds(Protocol):
    """Embeds hypotheses about an object: what a reader and a scene give to a model that is fitted to them."""

    def __call__(self, num_hypotheses: int) -> NDArray[np.float32]:
        """Embedded hypotheses ``(P, K, N, D)``, N of each shape."""


class ObservationModel(Protocol):
    """A likelihood of touches: all methods that trackers and planners call.

    Two members are optional. ``start()`` returns the :class:`~belief.observation_model.evidence.ObjectEvidence` before
    the first touch; without it, the likelihood of all touches of an object is computed anew after each touch.
    ``repeat_correlation`` is the correlation ρ in [0, 1] of two touches of one object in one pose, by which deciders
    discount repeats; without it, or if it is None, deciders repeat no pose before all others were used.
    """

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the K shapes."""

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """Log p(all these touches of one object | shape) up to a constant, ``(K,)``; zeros for no touches.

        All shapes share the constant, which may depend on the touches and on the model.
        """

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """Sampled touches of one object of this shape in these poses."""

    def outcome_table(self, num_outcomes: int | None = None) -> OutcomeTable:
        """The model for discretised touches, with at most ``num_outcomes`` outcomes if given; for planners."""


@runtime_checkable
class CouplesObjects(Protocol):
    """An observation model in which touches of one object tell about the sensor that touches all.

    See :class:`~belief.observation_model.sensor_health.SensorHealthModel`, whose methods these are. Where its evidence
    also weighs strangers, ``over_objects`` takes their log odds as well
    (:meth:`~belief.observation_model.doubted_sensor.DoubtedSensorModel.over_objects`).
    """

    def health(self, log_bets: ArrayLike = 0.0, is_clear: bool = True) -> Any:
        """What is known about the sensor after earlier searches."""

    def start(self) -> Any:
        """The evidence about an object before its first touch."""

    def start_in(self, awake: NDArray[np.int64]) -> Any:
        """The same, in which only some worlds of the sensor are evaluated."""

    def over_objects(self, evidence: Sequence[Any], log_bets: ArrayLike) -> tuple[Floats, Any]:
        """Log likelihoods of the shapes of all touched objects, each given all others, and what is then known."""


@runtime_checkable
class GivesLogits(Protocol):
    """An observation model of embeddings that says what one touch alone tells about the shapes."""

    def logits(self, pose: int, embedding: NDArray[np.floating]) -> Floats:
        """Log p(touch | shape) of an embedding ``(D,)``, up to a constant, ``(K,)``."""


class ArrayModel(FrozenArrays, ABC):
    """Base class of observation models that compute with arrays.

    A subclass is a dataclass, whose fields are its file (:mod:`belief.codec`), and defines :attr:`num_poses`,
    :meth:`fit_to`, and

    - ``_log_likelihoods(batch)``: the result of :meth:`log_likelihood_batch` for a valid batch with touches;
    - ``_sample(shape, poses, rng)``: the result of :meth:`sample_batch` for valid arguments;
    - ``_tabulate(num_outcomes, rng)``: the result of :meth:`outcome_table` for a number ≥ 1.

    Attributes:
        name: name in files.
        reads: what it reads of a touch; with ``embeddings`` its ``fit`` takes the argument ``embed``.
        shape_labels: names of the K shapes.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng = np.random.default_rng(0)
        >>> model = random_model(rng, num_shapes=3)
        >>> batch = model.sample_batch(shape=2, poses=np.zeros((500, 4), int), rng=rng)   # 500 objects, four touches
        >>> float(np.mean(model.log_likelihood_batch(batch).argmax(axis=1) == 2).round(1))
        0.6
        >>> bool((model.log_likelihood(batch.sequence(7)) == model.log_likelihood_batch(batch)[7]).all())
        True
    """

    name: ClassVar[str]
    reads: ClassVar[Reads] = "logits"
    shape_labels: tuple[str, ...]

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        **options: Any,
    ) -> Self:
        """A model fitted to touches of known objects that the reader was not trained on.

        Arguments and errors are those of :meth:`LabelledTouches.of`. ``options`` are those of the model's
        :meth:`fit_to`. Most models learn from objects that were touched several times in one pose.
        """
        from belief.observation_model.calibration_data import LabelledTouches

        return cls.fit_to(LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses), **options)

    @classmethod
    def fit_to(cls, *data: Any, **options: Any) -> Any:
        """A model fitted to :class:`LabelledTouches`; raises InvalidArgument if the class is not fitted to touches."""
        raise InvalidArgument(f"{cls.__name__} is not fitted to touches; it has no function fit")

    @property
    @abstractmethod
    def num_poses(self) -> int:
        """P."""

    @abstractmethod
    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        """See :meth:`log_likelihood_batch`."""

    @abstractmethod
    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :meth:`sample_batch`."""

    @abstractmethod
    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :meth:`outcome_table`."""

    def to_fields(self) -> dict[str, Any]:
        """All parameters of the model, as JSON types."""
        return to_fields(self)

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> ArrayModel:
        """The model of fields from :meth:`to_fields`; :meth:`with_hypotheses` completes it."""
        return from_fields(cls, fields, is_whole=False)

    def to_json(self, origin: Mapping[str, Any] | None = None) -> str:
        """The model as JSON text, exact to the last bit, with a SHA-256; :func:`read_observation_model` reads it.

        Args:
            origin: source of the calibration touches, as JSON types; :func:`read_origin` reads it.
        """
        fields = {"model": self.name, **self.to_fields()}
        return sealed_json(fields if origin is None else {**fields, "origin": dict(origin)}, indent=None)

    def freeze(self) -> None:
        """Check that the labels are different names, and make all arrays read-only.

        Raises:
            InvalidArgument: labels that are no sequence of different names.
        """
        labels = checked_names("shape_labels", self.shape_labels)
        if "shape_labels" in vars(self):
            object.__setattr__(self, "shape_labels", labels)
        super().freeze()

    def start(self) -> ObjectEvidence:
        """The evidence before the first touch.

        A model with the methods of :class:`~belief.observation_model.evidence.Summarises` stores statistics of fixed
        size; any other model is asked about all touches after each new one.
        """
        return SummarisedEvidence(self) if isinstance(self, Summarises) else RecomputedEvidence(self)

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """See :class:`ObservationModel`; raises ValueError for a touch that does not fit the model."""
        if len(touches) == 0:
            return np.zeros(len(self.shape_labels))
        from belief.touch_batch import TouchBatch

        return self.log_likelihood_batch(TouchBatch.of([touches]))[0]

    def log_likelihood_batch(self, batch: TouchBatch) -> Floats:
        """:meth:`log_likelihood` of each sequence, ``(S, K)``."""
        self.require_fit(batch)
        if batch.poses.size == 0:
            return np.zeros((len(batch), len(self.shape_labels)))
        size = max(1, _BLOCK // (batch.num_touches * len(self.shape_labels)))
        if len(batch) <= size:
            return self._log_likelihoods(batch)
        blocks = (batch.sequences(slice(first, first + size)) for first in range(0, len(batch), size))
        return np.concatenate([self._log_likelihoods(block) for block in blocks])

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """See :class:`ObservationModel`; raises ValueError for a shape or pose out of range."""
        if len(poses) == 0:
            return []
        return self.sample_batch(shape, np.asarray(poses)[None], rng).sequence(0)

    def sample_batch(self, shape: int, poses: NDArray[np.integer], rng: np.random.Generator) -> TouchBatch:
        """:meth:`sample` of S objects of a shape, one for each row of ``poses (S, n)``."""
        require_index("shape", shape, len(self.shape_labels))
        rows = np.asarray(poses)
        if rows.ndim != 2 or not np.issubdtype(rows.dtype, np.integer):
            raise ValueError(f"poses must be integers (S, n), got {rows.dtype} {rows.shape}")
        if rows.size and not (rows.min() >= 0 and rows.max() < self.num_poses):
            raise ValueError(f"poses must be in [0, {self.num_poses}), got {rows.min()} to {rows.max()}")
        return self._sample(shape, rows.astype(np.int64), rng)

    def outcome_table(self, num_outcomes: int | None = None, rng: np.random.Generator | None = None) -> OutcomeTable:
        """See :class:`ObservationModel`.

        Args:
            num_outcomes: largest number of outcomes, ≥ 1; :attr:`default_outcomes` by default.
            rng: for models that sample their table. By default seed 0, and the table is cached.
        """
        wanted = self.default_outcomes if num_outcomes is None else num_outcomes
        require_count("num_outcomes", wanted)
        if rng is not None:
            return self._tabulate(wanted, rng)
        if wanted not in self._tables:
            self._tables[wanted] = self._tabulate(wanted, np.random.default_rng(0))
        return self._tables[wanted]

    def with_hypotheses(self, embed: Embeds) -> ArrayModel:
        """The model, completed with the hypotheses that a reader embeds, where it works with any."""
        return self

    def weights_of_sums(self, num_touches: NDArray[np.int64]) -> Floats | None:
        """Weight of the summed log-likelihoods of n touches in one pose, ``(...)`` for ``num_touches (...)``.

        The log-likelihood of an object is the weighted sum over poses; None if it depends on more than these sums.
        """
        return None

    @property
    def repeat_correlation(self) -> float | None:
        """The correlation ρ in [0, 1] of two touches of one object in one pose; None if the model has none."""
        return None

    def alone(self, touch: Touch) -> TouchBatch:
        """A touch as a batch of one; raises ValueError if it does not fit the model."""
        from belief.touch_batch import TouchBatch

        batch = TouchBatch.of([[touch]])
        self.require_fit(batch)
        return batch

    @property
    def default_outcomes(self) -> int:
        """Default number of outcomes of a table: 3 K for shape and confidence, at least 12."""
        return max(12, 3 * len(self.shape_labels))

    @cached_property
    def _tables(self) -> dict[int, OutcomeTable]:
        return {}

    def require_fit(self, batch: TouchBatch) -> None:
        """Raise ValueError for the first touch that does not fit the shapes and poses of the model."""
        if batch.logits is not None and batch.num_shapes != len(self.shape_labels):
            raise ValueError(
                f"the model knows {len(self.shape_labels)} shapes ({', '.join(self.shape_labels)}), touch 0 and all "
                f"others have {batch.num_shapes} logits"
            )
        if batch.poses.size and batch.poses.max() >= self.num_poses:
            sequence, touch = (int(i) for i in np.argwhere(batch.poses >= self.num_poses)[0])
            raise ValueError(
                f"touch {touch} of sequence {sequence} has pose {batch.poses[sequence, touch]}, the model knows poses "
                f"0 to {self.num_poses}, exclusive"
            )


def check_observation_model(model: ObservationModel, rng: np.random.Generator, num_objects: int = 20) -> None:
    """Check that an observation model keeps the contract of :class:`ObservationModel`, on touches that it samples.

    The checks are: labels and array shapes; zeros for no touches; no NaN or +inf; equal likelihoods for equal touches;
    a valid outcome table.

    Args:
        model: the model to check, which is not changed.
        rng: draws the touches.
        num_objects: number of objects of each shape, each touched up to four times.

    Raises:
        BrokenContract: the first rule that the model violates.

    >>> from belief.synthetic import random_model
    >>> rng = np.random.default_rng(0)
    >>> check_observation_model(random_model(rng), rng)
    """
    labels = tuple(model.shape_labels)
    if not labels or len(set(labels)) < len(labels) or not all(isinstance(label, str) for label in labels):
        raise BrokenContract(f"shape_labels must be one or more different names, got {labels}")
    nothing = np.asarray(model.log_likelihood([]))
    if nothing.shape != (len(labels),) or nothing.any():
        raise BrokenContract(f"log_likelihood([]) must be {len(labels)} zeros, got {nothing}")
    table = model.outcome_table()
    num_poses = table.probs.shape[0]
    if table.probs.shape[1] != len(labels):
        raise BrokenContract(f"outcome_table() must have {len(labels)} shapes, it is {table.probs.shape}")
    for shape, label in enumerate(labels):
        for _ in range(num_objects):
            poses = rng.integers(num_poses, size=rng.integers(1, 5)).tolist()
            touches = model.sample(shape, poses, rng)
            if [touch.pose for touch in touches] != poses:
                raise BrokenContract(f"sample({label}, poses={poses}) has poses {[touch.pose for touch in touches]}")
            found = np.asarray(model.log_likelihood(touches))
            where = f"log_likelihood of touches of {label} in the poses {poses}"
            if found.shape != (len(labels),):
                raise BrokenContract(f"{where} must have shape ({len(labels)},), got {found.shape}")
            if np.isnan(found).any() or np.isposinf(found).any() or np.isneginf(found).all():
                raise BrokenContract(f"{where} must be a number or -inf for each shape, and not -inf for all: {found}")
            if np.isneginf(found[shape]):
                raise BrokenContract(f"{where} is -inf for {label} itself, the shape they were sampled from")
            if not np.array_equal(found, model.log_likelihood(touches)):
                raise BrokenContract(f"{where} differs between two calls")
