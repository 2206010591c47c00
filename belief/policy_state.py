"""State vectors of learned policies: the paper's state, and states with the posterior.

The paper's state holds the classifier's last output, the last action and the time (paper §5.8). The posterior state
holds the posterior over shapes, the number of touches in each pose and the time. Two states need a belief about one
rigid body: the gains state adds the expected gain of each pose, and the goal state adds the target to that.

>>> here = Situation(
...     frame_probs=np.array([[0.7, 0.3]]),
...     log_probs=np.log([[0.9, 0.1]]),
...     previous=np.array([1]),
...     uses=np.array([[0, 2]]),
...     time=np.array([0.5]),
... )
>>> paper_state(here, target=0).tolist()        # frame, previous action (2 poses, CONFIRM, REJECT), time
[[0.7, 0.3, 0.0, 1.0, 0.0, 0.0, 0.5]]
>>> posterior_state(here, target=0).round(2).tolist()             # posterior, certainty, uses, time
[[0.9, 0.1, 0.5, 0.0, 0.67, 0.5]]
>>> from dataclasses import replace
>>> known = replace(here, gains=np.log([[2.0, 1.0]]))
>>> gains_state(known, target=0)[:, 6:].tolist(), goal_state(known, target=0)[:, 6:].tolist()  # gains, target
([[1.0, 0.0]], [[1.0, 0.0, 1.0, 0.0]])
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import ActiveTouchError
from belief.observation_model.evidence import ObjectEvidence
from belief.observation_model.outcome_mixture import information, target_shares
from belief.problem import Touch
from belief.validation import Floats

TOUCH_LIMIT = 12
"""T_max, default limit of touches per object; the paper gives no number."""
NO_ACTION = -1
"""Value of ``previous`` before the first action."""
GAIN_OUTCOMES, GAIN_HYPOTHESES = 128, 64
"""Outcomes and hypotheses of each shape, at most, by which :func:`expected_gains` are computed."""
GOAL, WITH_GAINS = "goal", ("gains", "goal")
"""The state that has the target; the states that have gains."""
_SCALE = 4.0  # log-odds of 4 (55 to 1) become tanh 1 = 0.76


class NoGains(ActiveTouchError, ValueError):
    """A state needs the expected gain of each pose, and the evidence has none."""


@dataclass(frozen=True, eq=False)
class Situation:
    """State of B episodes.

    Attributes:
        frame_probs: the classifier's softmax of the current object's last touch, ``(B, K)``; uniform before one.
        log_probs: log posterior of the current object, ``(B, K)``.
        previous: last action, ``(B,)``: a pose, P for CONFIRM, P + 1 for REJECT, :data:`NO_ACTION` for none.
        uses: touches of the current object in each pose, ``(B, P)``.
        time: number of touches divided by the touch limit, ``(B,)``.
        gains: expected information of the next touch in each pose about the target [nats], ``(B, P)``; None if no state
            needs it.
    """

    frame_probs: Floats
    log_probs: Floats
    previous: NDArray[np.int64]
    uses: NDArray[np.int64]
    time: Floats
    gains: Floats | None = None


def situation_of(history: Sequence[Touch], log_probs: Floats, num_poses: int, touch_limit: int) -> Situation:
    """The situation after the touches of the current object, as a batch of one row.

    >>> here = situation_of([Touch(1, np.array([2.0, 0.0]))], np.log([0.9, 0.1]), num_poses=2, touch_limit=10)
    >>> here.previous.tolist(), here.uses.tolist(), here.time.tolist(), here.frame_probs.round(2).tolist()
    ([1], [[0, 1]], [0.1], [[0.88, 0.12]])
    """
    frame = history[-1].require_logits() if history else np.zeros(len(log_probs))
    poses = np.array([touch.pose for touch in history], np.int64)
    return Situation(
        frame_probs(frame)[None],
        log_probs[None],
        np.array([poses[-1] if history else NO_ACTION]),
        np.bincount(poses, minlength=num_poses)[None],
        np.array([min(len(history) / touch_limit, 1.0)]),
    )


def frame_probs(logits: NDArray[np.floating]) -> Floats:
    """Softmax of logits ``(..., K)`` of any size.

    >>> frame_probs(np.array([[1e308, -1e308], [0.0, 0.0]])).tolist()
    [[1.0, 0.0], [0.5, 0.5]]
    """
    scores = np.asarray(logits, np.float64)
    with np.errstate(over="ignore", under="ignore"):
        shares = np.exp(scores - scores.max(axis=-1, keepdims=True))
    return np.asarray(shares / shares.sum(axis=-1, keepdims=True))


def paper_state(situation: Situation, target: ArrayLike) -> Floats:
    """The paper's ``[p_t, e(a_{t-1}), t/T_max]`` (§5.8), ``(B, K + P + 3)``, in [0, 1]; ``target`` has no effect."""
    num_actions = situation.uses.shape[1] + 2
    one_hot = (situation.previous[:, None] == np.arange(num_actions)).astype(np.float64)
    return np.concatenate([situation.frame_probs, one_hot, situation.time[:, None]], axis=1)


def posterior_state(situation: Situation, target: ArrayLike) -> Floats:
    """Posterior, :func:`certainty` of the target, n/(n + 1) for the n uses of each pose, time: ``(B, K + P + 2)``."""
    worn = situation.uses / (1.0 + situation.uses)
    sure = certainty(situation.log_probs, target)[:, None]
    return np.concatenate([np.exp(situation.log_probs), sure, worn, situation.time[:, None]], axis=1)


def gains_state(situation: Situation, target: ArrayLike) -> Floats:
    """:func:`posterior_state`, and the gain of each pose as a fraction of one bit, ``(B, K + 2 P + 2)``, in [-1, 1].

    Raises:
        NoGains: the situation has no gains.
    """
    if situation.gains is None:
        raise NoGains("this state needs the expected gain of each pose: give the situation its gains")
    return np.concatenate([posterior_state(situation, target), situation.gains / np.log(2.0)], axis=1)


def goal_state(situation: Situation, target: ArrayLike) -> Floats:
    """:func:`gains_state`, and the target, one-hot: the state of one policy for all targets, ``(B, 2 K + 2 P + 2)``."""
    is_target = np.asarray(target)[..., None] == np.arange(situation.log_probs.shape[1])
    goals = np.broadcast_to(is_target, situation.log_probs.shape).astype(np.float64)
    return np.concatenate([gains_state(situation, target), goals], axis=1)


def certainty(log_probs: Floats, target: ArrayLike) -> Floats:
    """tanh(ℓ/4) of the target's log-odds ℓ, ``(...)``: -1 for certainly another shape, 1 for certainly the target.

    Args:
        log_probs: ``(..., K)``.
        target: index of one target for all rows, or of each, ``(...)``.

    >>> certainty(np.log([[0.5, 0.5], [0.99, 0.01]]), target=0).round(2).tolist()
    [0.0, 0.82]
    """
    is_target = np.asarray(target)[..., None] == np.arange(log_probs.shape[-1])
    own = np.where(is_target, log_probs, 0.0).sum(axis=-1)
    others = np.logaddexp.reduce(np.where(is_target, -np.inf, log_probs), axis=-1)
    return np.asarray(np.tanh((own - others) / _SCALE))


def expected_gains(evidence: ObjectEvidence | None, log_probs: Floats, target: int) -> Floats:
    """Expected information of the next touch in each pose about "this is the target" [nats], ``(P,)``.

    It is what the decider ``information_gain`` chooses by, from twice as many hypotheses.

    Args:
        evidence: about the current object.
        log_probs: log posterior of the object, ``(K,)``.
        target: index.

    Raises:
        NoGains: the evidence has no outcomes of the next touch.

    >>> expected_gains(None, np.log([0.5, 0.5]), 0)                          # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    belief.policy_state.NoGains: the gain of each pose needs a sensor whose belief is about one rigid body...
    """
    mixture = None if evidence is None else evidence.outcome_mixture(GAIN_OUTCOMES, GAIN_HYPOTHESES)
    if mixture is None:
        raise NoGains(
            "the gain of each pose needs a sensor whose belief is about one rigid body, such as the shipped sensor of "
            "a scene; sensors of independent touches have the states 'paper' and 'posterior'"
        )
    gains = information(mixture.one_touch(target_shares(np.exp(log_probs), target)))
    return gains if mixture.new is None else gains * mixture.new


Encoding: TypeAlias = Callable[[Situation, ArrayLike], Floats]

ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {"paper": paper_state, "posterior": posterior_state, "gains": gains_state, "goal": goal_state}
)
"""State encodings by name."""


def state_size(state: str, num_shapes: int, num_poses: int) -> int:
    """S, the length of a state vector; ``state`` is a key of :data:`ENCODINGS`.

    >>> [state_size(state, num_shapes=4, num_poses=6) for state in ENCODINGS]
    [13, 12, 18, 22]
    """
    last = {"paper": num_poses + 3, "posterior": num_poses + 2, "gains": 2 * num_poses + 2}
    return 2 * num_shapes + last["gains"] if state == GOAL else num_shapes + last[state]
