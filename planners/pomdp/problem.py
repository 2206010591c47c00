"""Touch problems with tabular observation models, for solvers.

Both are partially observable Markov decision processes whose hidden state does not change while an object is touched.
A policy decides which observations to buy, and when to stop.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import comb
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike

from belief.composition import Composition
from belief.errors import InvalidArgument
from belief.frozen import FrozenArrays
from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import Floats, as_real, normalise_probs, require_count, require_index


class _Tabular:
    outcome_probs: Floats

    @property
    def num_poses(self) -> int:
        """P."""
        return self.outcome_probs.shape[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.outcome_probs.shape[1]


@dataclass(frozen=True, eq=False)
class TouchProblem(_Tabular, FrozenArrays):
    """Decide whether one object is the target (paper §5.8).

    CONFIRM and REJECT end the problem with +1 if right and -1 if wrong; every probe costs ``touch_cost``.

    Attributes:
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        prior: of the shape, ``(K,)``.
        target: index of the target shape.
        touch_cost: λ, price of a probe, ≥ 0.
        discount: γ, per probe, in (0, 1].

    Raises:
        InvalidArgument: an argument is out of its range; the message names it.

    Example:
        >>> problem = TouchProblem(np.array([[[0.9, 0.1], [0.1, 0.9]]]), prior=[0.5, 0.5], target=0, touch_cost=0.05)
        >>> problem.num_poses, problem.num_shapes
        (1, 2)
    """

    outcome_probs: Floats
    prior: Floats
    target: int
    touch_cost: float
    discount: float = 1.0

    def __post_init__(self) -> None:
        table = checked_table(self.outcome_probs, self.target, self.touch_cost, self.discount)
        object.__setattr__(self, "outcome_probs", table)
        object.__setattr__(self, "prior", distribution(self.prior, table.shape[1], "prior"))
        self.freeze()


@dataclass(frozen=True, eq=False)
class SearchTouchProblem(_Tabular, FrozenArrays):
    """Search for the target among several objects, one after the other, each visited once.

    CONFIRM ends the search with +1 on the target and -1 on any other shape. REJECT gives 0 and brings the next object.
    Rejecting all objects gives +1 if none was the target and -1 otherwise. Every probe costs ``touch_cost``.

    Attributes:
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        num_objects: N.
        composition: ``distinct``, each shape at most once and all arrangements equally likely, or ``independent``.
        target: index of the shape sought.
        touch_cost: λ, price of a probe, ≥ 0.
        prior: of the shape of an ``independent`` object, ``(K,)``; uniform by default.
        discount: γ, per probe or REJECT, in (0, 1].

    Raises:
        InvalidArgument: an argument is out of its range; the message names it.
    """

    outcome_probs: Floats
    num_objects: int
    composition: Composition
    target: int
    touch_cost: float
    prior: Floats | None = None
    discount: float = 1.0

    def __post_init__(self) -> None:
        table = checked_table(self.outcome_probs, self.target, self.touch_cost, self.discount)
        num_shapes = table.shape[1]
        object.__setattr__(self, "outcome_probs", table)
        try:
            object.__setattr__(self, "composition", Composition(self.composition))
        except ValueError:
            raise InvalidArgument(
                f"composition must be 'distinct' or 'independent', got {self.composition!r}; the decider "
                "planners.point_based.PointBased also plans for bags of known content"
            ) from None
        require_count("num_objects", self.num_objects)
        if self.composition is Composition.DISTINCT:
            if self.prior is not None:
                raise InvalidArgument("a distinct composition fixes the prior; leave it out or use 'independent'")
            if self.num_objects > num_shapes:
                raise InvalidArgument(
                    f"{self.num_objects} objects cannot all differ in shape, of which there are {num_shapes}"
                )
        prior = np.full(num_shapes, 1.0 / num_shapes) if self.prior is None else self.prior
        object.__setattr__(self, "prior", distribution(prior, num_shapes, "prior"))
        self.freeze()

    @property
    def num_states(self) -> int:
        """Hidden states of all stages together, in the smallest exact form; see :mod:`planners.pomdp.stages`.

        >>> SearchTouchProblem(np.full((1, 4, 1), 1.0), 4, "distinct", target=0, touch_cost=0.1).num_states
        32
        """
        if self.composition is Composition.INDEPENDENT:
            return 2 * self.num_shapes
        return sum(comb(self.num_shapes, i) * (self.num_shapes - i) for i in range(self.num_objects))


def checked_table(outcome_probs: ArrayLike, target: int, touch_cost: float, discount: float) -> Floats:
    """The outcome table ``(P, K, M)`` as float64.

    Raises:
        ValueError: an argument is out of its range, see :class:`TouchProblem`; the message names it.
    """
    table = OutcomeTable(np.asarray(as_real(outcome_probs, "outcome_probs"), np.float64)).probs
    require_index("target", target, table.shape[1])
    if not (isinstance(touch_cost, Real) and np.isfinite(float(touch_cost)) and touch_cost >= 0.0):
        raise InvalidArgument(f"touch_cost must be finite and ≥ 0, got {touch_cost!r}")
    if not (isinstance(discount, Real) and 0.0 < discount <= 1.0):
        raise InvalidArgument(f"discount must be in (0, 1], got {discount!r}")
    return table


def require_rounds(rounds: object) -> tuple[int, ...]:
    """Numbers of simulated searches as a tuple; raises InvalidArgument unless there are some, each at least 1.

    >>> require_rounds(number for number in (200, 400))
    (200, 400)
    >>> require_rounds(2)
    Traceback (most recent call last):
    ...
    belief.errors.InvalidArgument: rounds must be one or more integers, each at least 1, such as (200, 400); got 2
    """
    numbers = list(rounds) if isinstance(rounds, Iterable) else []
    if not numbers or not all(isinstance(n, Integral) and not isinstance(n, bool) and int(n) >= 1 for n in numbers):
        raise InvalidArgument(
            f"rounds must be one or more integers, each at least 1, such as (200, 400); got {rounds!r}"
        )
    return tuple(int(n) for n in numbers)


def distribution(probs: ArrayLike, size: int, name: str) -> Floats:
    """A normalised probability vector ``(size,)``.

    Raises:
        InvalidArgument: another size, or as :func:`~belief.validation.normalise_probs`.
    """
    try:
        values = normalise_probs(probs, name)
    except ValueError as error:
        raise InvalidArgument(f"{name} must be {size} probabilities that sum to one: {error}") from error
    if values.shape != (size,):
        raise InvalidArgument(f"{name} must be {size} probabilities that sum to one, got {values.tolist()}")
    return values
