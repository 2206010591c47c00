"""Touches, actions, and the search problem with its reward.

>>> problem = SearchProblem(shape_labels=("sphere", "cube"), pose_labels=("front",), num_objects=2)
>>> problem.reward(confirmed_shape=0, target=0, num_touches=3)      # +1 for success, -0.02 per touch
0.94
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from belief.composition import AtMostOne, Composition, Counts
from belief.constraints import BELOW_ONE, require_rule
from belief.errors import InvalidArgument
from belief.frozen import FrozenArrays
from belief.naming import Name, checked_names, index_of, one_line
from belief.validation import MOST_REPEATED, Floats, are_finite, as_real, require_count, warn_of_probs

WHO_GIVES_LOGITS = (
    ", only features, which a joint observation model reads. Logits come from the reader: Touch(pose, logits, "
    "features); a sensor gives them if its with_logits is true"
)
"""The rest of a message that says that logits are missing."""


@dataclass(frozen=True, eq=False)
class Elsewhere(FrozenArrays):
    """A place of a touch that is none of the problem's poses.

    Attributes:
        place: numbers that describe it; touches with the same numbers are repeats.
        hypotheses: embedded there, as the joint observation model has them for its poses, ``(K, N, D)``.

    Raises:
        InvalidArgument: the hypotheses are not of three dimensions, or not finite.
    """

    place: tuple[float, ...]
    hypotheses: NDArray[np.floating]

    def __post_init__(self) -> None:
        array = as_real(self.hypotheses, "hypotheses of a touch")
        if array.ndim != 3 or not np.isfinite(array).all():
            raise InvalidArgument(f"hypotheses of a touch must be (K, N, D) and finite, got {array.shape}")
        self.freeze()


@dataclass(frozen=True, eq=False)
class Touch(FrozenArrays):
    """One touch as deciders and observation models see it; its arrays are read-only.

    It has logits, features, or both. A joint observation model reads the features, any other one the logits.

    Attributes:
        pose: index of the exploration pose.
        logits: the reader's logits over shapes, ``(K,)``, or None; -inf for a shape that is ruled out. Converted to
            float64.
        features: the reader's embedding of the image, ``(D,)``, or None.
        elsewhere: where it was made, if that is none of the poses; ``pose`` is then the nearest one. Only a joint
            observation model of one rigid body takes such a touch.
        image: what was felt, bytes of any shape, or None. No likelihood reads it; a sensor that doubts its own state
            reads it again in other states.

    Raises:
        InvalidArgument: a pose that is not an integer ≥ 0; logits that are not a row of real numbers, or hold NaN or
            +inf; neither logits nor features; an image that is no array of bytes.

    >>> Touch(2, features=np.ones(64, np.float32))
    Touch(pose 2, no logits, 64 features)
    """

    pose: int
    logits: Floats | None = None
    features: NDArray[np.floating] | None = None
    elsewhere: Elsewhere | None = None
    image: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.pose, int | np.integer) or isinstance(self.pose, bool) or self.pose < 0:
            raise InvalidArgument(f"the pose of a touch must be an integer ≥ 0, got {self.pose!r}")
        if self.logits is None and self.features is None:
            raise InvalidArgument("a touch needs a row of real numbers as its logits, as its features or as both")
        if self.logits is not None:
            scores = np.asarray(as_real(self.logits, "logits of a touch"), np.float64)
            object.__setattr__(self, "logits", scores)
            if scores.ndim != 1 or not scores.size or not scores.max() < np.inf:  # NaN fails too
                raise InvalidArgument(f"a touch needs a row of logits without NaN and +inf, got {scores.tolist()}")
            if scores[0] >= 0.0 and scores.min() >= 0.0 and np.count_nonzero(scores) > 1:
                warn_of_probs(scores, "logits", "take the logarithms of probabilities")
        if self.features is not None:
            object.__setattr__(self, "features", as_real(self.features, "features of a touch"))
        if self.image is not None and not (isinstance(self.image, np.ndarray) and self.image.dtype == np.uint8):
            raise InvalidArgument(f"the image of a touch must be an array of bytes, got {self.image!r:.80}")
        self.freeze()

    def require_logits(self) -> Floats:
        """The logits, ``(K,)``, for what cannot do without them.

        Raises:
            InvalidArgument: the touch has none.

        >>> Touch(2, features=np.ones(64)).require_logits()  # doctest: +ELLIPSIS
        Traceback (most recent call last):
        ...
        belief.errors.InvalidArgument: the touch in pose 2 has no logits, only features, which a joint ...
        """
        if self.logits is None:
            raise InvalidArgument(f"the touch in pose {self.pose} has no logits{WHO_GIVES_LOGITS}")
        return self.logits

    def __repr__(self) -> str:
        features = "no features" if self.features is None else f"{self.features.size} features"
        logits = "no logits"
        if self.logits is not None:
            shown = np.array2string(self.logits[:6], precision=2, separator=", ", max_line_width=1000)
            logits = f"{self.logits.size} logits {shown}"
        return one_line(Touch, f"pose {self.pose}", logits, features)


class TouchHistory(tuple[Touch, ...]):
    """The touches of one object, oldest first.

    >>> first = TouchHistory([Touch(0, np.zeros(2))])
    >>> longer = first.extended([Touch(2, np.zeros(2)), Touch(2, np.zeros(2))])
    >>> len(first), len(longer), longer.uses(num_poses=3).tolist()
    (1, 3, [1, 0, 2])
    """

    __slots__ = ()

    def extended(self, touches: Iterable[Touch]) -> TouchHistory:
        """This history followed by these touches."""
        return TouchHistory((*self, *touches))

    def uses(self, num_poses: int) -> NDArray[np.int64]:
        """Number of touches in each pose, ``(P,)``.

        Raises:
            ValueError: a touch has a pose that is out of range.
        """
        poses = np.array([touch.pose for touch in self], np.int64)
        if poses.size and poses.max() >= num_poses:
            raise ValueError(f"a touch was made in pose {poses.max()}, there are {num_poses} poses")
        return np.bincount(poses, minlength=num_poses)


@dataclass(frozen=True)
class Probe:
    """Touch the current object in this pose; in a decider's answer, ``pose`` may also be the label."""

    pose: int


@dataclass(frozen=True)
class Confirm:
    """Declare the current object to be the target; ends the search."""


@dataclass(frozen=True)
class Reject:
    """Put the current object aside for the rest of the search and go on to the next."""


@dataclass(frozen=True)
class Unsure:
    """Answer "I do not know": ends the search without naming an object; only where the search has ``unsure_reward``."""


Action: TypeAlias = Probe | Confirm | Reject | Unsure


@dataclass(frozen=True)
class SearchProblem:
    """A search for one target among several objects, which are visited in a fixed order.

    Attributes:
        shape_labels: names of the K shapes.
        pose_labels: names of the P poses.
        num_objects: N, number of objects on the table.
        composition: how their shapes depend on each other: "distinct", "independent", "at_most_one"
            (:class:`AtMostOne`), or the :class:`Counts` of the bag from which they are drawn.
        touch_cost: λ ≥ 0, cost of one touch in units of a success.
        touch_limit: number of touches after which the search is truncated; by default, or with None, 4 for each object,
            and at least 48.
        unsure_reward: reward of the answer "I do not know" (:class:`Unsure`), at least that of a wrong answer (-1) and
            below that of a success (+1). At 0, a searcher that wants the largest return gives an answer if it is more
            probably right than wrong; at c, if it is right with probability above (1 + c) / 2. None: the search does
            not have this answer.
        unlisted: probability that an object has none of the shapes: each of the objects of the composition is replaced
            by such a stranger with this probability, independently. Above 0, the observation model must weigh strangers
            (:class:`belief.observation_model.evidence.WeighsStrangers`).
        opinion: probabilities of the shapes of each object from another source, such as a camera, ``(N, K)``, or
            ``(K,)`` for all objects; kept as tuples. It may be wrong, so beliefs temper it (:mod:`belief.opinion`).

    Raises:
        ValueError: labels that are empty, equal or not strings; a number of objects or touches that is not an integer
            ≥ 1; more objects than the composition allows; a touch cost that is negative or not finite; a reward of
            "I do not know" outside [-1, 1); a probability of unlisted shapes outside [0, 1).
        UnknownName: the bag holds a shape without a label.

    >>> problem = SearchProblem(("sphere", "cube"), ("front",), 2, Counts({"sphere": 1, "cube": 3}))
    >>> problem.prior_probs.tolist(), problem.prior_absent_probs.tolist()
    ([0.25, 0.75], [0.5, 0.0])
    """

    shape_labels: Sequence[str]
    pose_labels: Sequence[str]
    num_objects: int
    composition: Composition | Counts | AtMostOne = Composition.DISTINCT
    touch_cost: float = 0.02
    touch_limit: int = cast("int", None)
    unsure_reward: float | None = None
    unlisted: float = 0.0
    opinion: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.composition, Counts | AtMostOne):
            object.__setattr__(self, "composition", Composition(self.composition))  # may be a plain string
        for name in ("shape_labels", "pose_labels"):
            object.__setattr__(self, name, checked_names(name, getattr(self, name)))
        if isinstance(self.composition, AtMostOne):
            index_of("target", self.shape_labels, self.composition.label)
        if self._seeks and self.num_shapes < 2:
            raise InvalidArgument("where at most one object has the target's shape, there must be another shape")
        require_count("num_objects", self.num_objects, most=MOST_REPEATED)
        if self.touch_limit is None:
            object.__setattr__(self, "touch_limit", max(48, 4 * int(self.num_objects)))
        require_count("touch_limit", self.touch_limit)
        if isinstance(self.composition, Counts) and sum(self.composition.of(self.shape_labels)) < self.num_objects:
            raise InvalidArgument(f"{self.num_objects} objects cannot come from a bag of {self.composition.total}")
        if self.composition is Composition.DISTINCT and self.num_objects > self.num_shapes:
            raise InvalidArgument(
                f"{self.num_objects} objects cannot all differ in shape when there are only {self.num_shapes} "
                f"shapes ({', '.join(self.shape_labels)}); use at most that many or composition 'independent'"
            )
        if not (isinstance(self.touch_cost, Real) and are_finite(self.touch_cost) and self.touch_cost >= 0.0):
            raise ValueError(f"touch_cost must be finite and ≥ 0, got {self.touch_cost}")
        if not isinstance(self.touch_cost, int):  # a float16 would round every return
            object.__setattr__(self, "touch_cost", float(self.touch_cost))
        if self.unsure_reward is not None and not -1.0 <= self.unsure_reward < 1.0:  # NaN fails too
            raise ValueError(
                "unsure_reward must be None, or at least -1 (a wrong answer) and below 1 (a success), "
                f"got {self.unsure_reward!r}"
            )
        require_rule("unlisted", self.unlisted, BELOW_ONE)
        if self.opinion is not None:
            from belief.opinion import as_opinion

            rows = as_opinion(self.opinion, self.num_objects, self.num_shapes)
            object.__setattr__(self, "opinion", tuple(map(tuple, rows.tolist())))

    def __repr__(self) -> str:
        """As of any dataclass, without what a search does not have: runs and certificates hold this text."""
        rare = [name for name in ("unlisted", "opinion") if not getattr(self, name)]
        names = [field.name for field in fields(self) if field.name not in rare]
        return f"SearchProblem({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    def with_unsure(self) -> SearchProblem:
        """The search with the answer "I do not know", of reward 0 unless it has one."""
        return self if self.unsure_reward is not None else replace(self, unsure_reward=0.0)

    def seeking(self, target: Name) -> SearchProblem:
        """The search for a target, which is the label of :class:`AtMostOne` where the composition is "at most one"."""
        if not self._seeks:
            return self
        label = self.shape_labels[index_of("target", self.shape_labels, target)]
        return self if self.composition == AtMostOne(label) else replace(self, composition=AtMostOne(label))

    def bag_of(self, target: int) -> tuple[int, int] | None:
        """Objects of the target's shape, and all objects, in the bag from which those of the search are drawn.

        None for independent objects. Where there is at most one target, N objects are drawn from a bag of N + 1.
        """
        if self._seeks:
            return 1, self.num_objects + 1
        return None if self.counts is None else (self.counts[target], sum(self.counts))

    @property
    def _seeks(self) -> bool:
        return self.composition is Composition.AT_MOST_ONE or isinstance(self.composition, AtMostOne)

    @property
    def _prior_absent(self) -> float:
        """Probability that at most one target is none, or at each place."""
        return 1.0 / (self.num_objects + 1)

    @property
    def _may_be_sought(self) -> NDArray[np.bool_]:
        """Whether each shape can be the one target, ``(K,)``; all, if no target is known."""
        if not isinstance(self.composition, AtMostOne):
            return np.ones(self.num_shapes, np.bool_)
        return np.arange(self.num_shapes) == list(self.shape_labels).index(self.composition.label)

    @property
    def num_shapes(self) -> int:
        """K."""
        return len(self.shape_labels)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.pose_labels)

    @property
    def counts(self) -> tuple[int, ...] | None:
        """Objects of each shape in the bag, ``(K,)``; None for independent objects and for at most one target."""
        if isinstance(self.composition, Counts):
            return self.composition.of(self.shape_labels)
        return (1,) * self.num_shapes if self.composition is Composition.DISTINCT else None

    @property
    def prior_probs(self) -> Floats:
        """Probability of each shape for an untouched object, ``(K,)``; equal for independent objects.

        They sum to 1 - ``unlisted``. With "at_most_one" and no target yet, it is that of each shape if it is the
        target.
        """
        if self._seeks:
            of_target, of_others = self._prior_absent, (1.0 - self._prior_absent) / (self.num_shapes - 1)
            return np.where(self._may_be_sought, of_target, of_others) * (1.0 - self.unlisted)
        counts = np.array(self.counts or (1,) * self.num_shapes, np.float64)
        return counts / counts.sum() * (1.0 - self.unlisted)

    @property
    def prior_absent_probs(self) -> Floats:
        """Probability before any touch that no object has the shape, ``(K,)``; exactly zero where one must have it."""
        if self._seeks:
            number, misses = self.num_objects, 1.0 - (1.0 - self.unlisted) / (self.num_shapes - 1)  # by another object
            absent = misses ** (number - 1) * (misses + number) / (number + 1)
            of_target = self._prior_absent + self.unlisted * (1.0 - self._prior_absent)
            return np.where(self._may_be_sought, of_target, absent)
        if self.counts is None:
            return (1.0 - self.prior_probs) ** self.num_objects
        counts = np.array(self.counts, np.float64)
        number, total = self.num_objects, counts.sum()
        left = total - np.arange(number)  # in the bag before each draw
        others = left - counts[:, None]  # of another shape, given that all earlier draws were
        absent = np.prod(np.maximum(others, 0.0) / left, axis=1)
        if self.unlisted:
            among, others = _log_choices(counts, number), _log_choices(total - counts, number)[::-1]
            taken = self.unlisted ** np.arange(number + 1)[:, None]  # places of the shape by strangers
            absent = (np.exp(among + others - _log_choices(np.array([total]), number)[-1]) * taken).sum(axis=0)
        return np.asarray(absent)

    def reward(
        self,
        confirmed_shape: int | None,
        target: Name,
        num_touches: int,
        target_present: bool = True,
        is_unsure: bool = False,
    ) -> float:
        """Return of a finished search (decision 0004), which is not the sum of the paper's single-object rewards.

        Args:
            confirmed_shape: index of the true shape of the confirmed object, which may be none of the K; None if none
                was confirmed.
            target: label or index of the shape sought.
            num_touches: number of touches in the whole search.
            target_present: whether any object had the target shape.
            is_unsure: whether the search ended with :class:`Unsure`.

        Returns:
            +1 for a correct confirmation or a correct "no target", ``unsure_reward`` for "I do not know", -1 otherwise;
            minus ``touch_cost`` per touch.

        Raises:
            UnknownName: no shape has the target's name.
            InvalidArgument: a target out of range; ``is_unsure`` in a search without this answer, or together with a
                confirmed shape.

        >>> search = SearchProblem(("sphere", "cube"), ("front",), 2, unsure_reward=0.0)
        >>> search.reward(None, 0, num_touches=3, is_unsure=True)
        -0.06
        """
        target = index_of("target", self.shape_labels, target)
        if is_unsure:
            if self.unsure_reward is None or confirmed_shape is not None:
                given = "unsure_reward=None" if self.unsure_reward is None else f"a confirmed shape {confirmed_shape}"
                raise InvalidArgument(
                    f"a search with {given} cannot have ended with Unsure(); it needs SearchProblem(unsure_reward=0.0) "
                    "and confirms nothing"
                )
            return self.unsure_reward - self.touch_cost * num_touches
        right = confirmed_shape == target if confirmed_shape is not None else not target_present
        return (1.0 if right else -1.0) - self.touch_cost * num_touches


def _log_choices(of: Floats, most: int) -> Floats:
    """Log of the number of ways to choose 0 to ``most`` of so many ``(K,)``, ``(most + 1, K)``; -inf for none."""
    chosen = np.arange(most)[:, None]
    with np.errstate(divide="ignore"):
        more = np.log(np.maximum(of - chosen, 0.0) / (chosen + 1.0))
    return np.concatenate([np.zeros((1, len(of))), more.cumsum(axis=0)])
