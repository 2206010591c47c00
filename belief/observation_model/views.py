"""What the poses of a scene have in common, and outcome tables of many poses that use it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.frozen import FrozenArrays
from belief.observation_model.log_weights import some_hypotheses
from belief.observation_model.outcome_mixture import OutcomeMixture, with_nothing_new
from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import Floats

_NEGLIGIBLE = 1e-7  # of a factor, relative to the largest: the rounding of single precision


@dataclass(frozen=True, eq=False)
class Views(FrozenArrays):
    """Which hypotheses look alike in different poses.

    An object that lies in any orientation shows in one pose what another object shows in another pose. Poses of one
    group share this: their touches have the same distribution when nothing is known about the object.

    Attributes:
        groups: of each pose, numbered from 0 in the order of their first poses, ``(P,)``.
        same: hypothesis that looks in the first pose of the group as hypothesis i looks in pose p, nearly, ``(P, N)``.
    """

    groups: NDArray[np.int64]
    same: NDArray[np.int64]

    def __post_init__(self) -> None:
        found, first = np.unique(self.groups, return_index=True)
        if not len(found) or found.tolist() != list(range(len(found))) or (np.diff(first) <= 0).any():
            raise ValueError(f"groups must be numbered from 0 in the order of their poses, got {self.groups.tolist()}")
        if self.same.ndim != 2 or len(self.same) != len(self.groups) or not self.same.size:
            raise ValueError(f"same must be ({len(self.groups)}, N), got {self.same.shape}")
        if self.same.min() < 0 or self.same.max() >= self.same.shape[1]:
            raise ValueError(f"same must be indices of {self.same.shape[1]} hypotheses, got {self.same.max()}")
        self.freeze()

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """The first pose of each group, ``(G,)``."""
        return np.unique(self.groups, return_index=True)[1]

    def of_all_poses(self, outcomes: NDArray[np.float32], chosen: NDArray[np.int64]) -> NDArray[np.float32]:
        """p(outcome | pose, hypothesis) of some hypotheses, ``(P, K, H, M)``."""
        shapes = np.arange(len(chosen))[None, :, None]
        return outcomes[self.groups[:, None, None], shapes, self.same[:, chosen]]


@dataclass(frozen=True, eq=False)
class SharedMixture(FrozenArrays):
    """An :class:`OutcomeMixture` of many poses, from one table of outcomes for all poses of a group.

    Attributes:
        log_weights: log p(hypothesis | shape, touches so far) up to a constant of each shape, ``(K, N)``.
        num_hypotheses: H, at most, of each shape; see :func:`~belief.observation_model.log_weights.some_hypotheses`.
        outcomes: p(outcome | shape, hypothesis) in the first pose of each group, ``(G, K, N, M)``.
        views: of the poses.
        new: how much the next touch in each pose tells, as a fraction of a first touch in it, ``(P,)``; None for all.
            The last outcome is then that it tells nothing new.
    """

    log_weights: Floats
    num_hypotheses: int
    outcomes: NDArray[np.float32]
    views: Views
    new: Floats | None = None

    def __post_init__(self) -> None:
        num_shapes, number = self.outcomes.shape[1:3]
        if self.log_weights.shape != (num_shapes, number) or not np.isfinite(self.log_weights.max(axis=1)).all():
            raise ValueError(f"log weights must be ({num_shapes}, {number}), one in each row finite and none above it")
        if self.views.same.shape[1] != number or len(self.views.first) != len(self.outcomes):
            raise ValueError(f"the views are of {self.views.same.shape[1]} hypotheses, the outcomes of {number}")
        self.freeze()

    @cached_property
    def table(self) -> OutcomeTable:
        """p(outcome | pose, shape), averaged over the hypotheses."""
        found = self.one_touch(np.eye(len(self.log_weights)))
        return OutcomeTable(found if self.new is None else with_nothing_new(found, self.new))

    def one_touch(self, factors: Floats) -> NDArray[Any]:
        """See :meth:`OutcomeMixture.one_touch`: one sparse product for all poses, without shapes of negligible factor.

        For K shapes of a belief, that changes an information by less than K times 2e-6 nats.
        """
        num_groups, num_shapes, number, num_outcomes = self.outcomes.shape
        num_poses, num_rows = len(self.views.groups), len(factors)
        rows, shapes = np.nonzero(factors > _NEGLIGIBLE * factors.max())
        chosen, shares = some_hypotheses(self.log_weights[shapes], self.num_hypotheses)
        places = chosen + number * np.arange(len(shapes))[:, None]
        once = np.flatnonzero(np.diff(places.ravel(), prepend=-1))  # some are chosen several times, in a row
        weights = np.add.reduceat((factors[rows, shapes, None] * shares).ravel(), once)
        entry, which = np.divmod(places.ravel()[once], number)
        columns = self.views.same[:, which] + number * shapes[entry]
        columns += (num_shapes * number * self.views.groups)[:, None]
        ends = np.tile(np.bincount(rows[entry], minlength=num_rows), num_poses).cumsum()
        means = scipy.sparse.csr_array(
            (np.tile(weights.astype(np.float32), num_poses), columns.ravel(), np.concatenate([[0], ends])),
            shape=(num_poses * num_rows, num_groups * num_shapes * number),
        )
        return np.asarray((means @ self.outcomes.reshape(-1, num_outcomes)).reshape(num_poses, num_rows, -1))

    def two_touches(self, pose: int, factors: Floats) -> NDArray[np.float32]:
        """See :meth:`OutcomeMixture.two_touches`."""
        return self._whole.two_touches(pose, factors)

    @cached_property
    def _whole(self) -> OutcomeMixture:
        """The same with the outcomes of every pose."""
        chosen, weights = some_hypotheses(self.log_weights, self.num_hypotheses)
        return OutcomeMixture(weights, self.views.of_all_poses(self.outcomes, chosen), self.new)
