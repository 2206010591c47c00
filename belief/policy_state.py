"""State vectors of learned policies: the paper's state, and a state with the posterior.

The paper's state holds the classifier's last output, the last action and the time (paper §5.8). The posterior state
holds the posterior over shapes, the number of touches in each pose and the time.

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
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats

TOUCH_LIMIT = 12
"""T_max, default limit of touches per object; the paper gives no number."""
NO_ACTION = -1
"""Value of ``previous`` before the first action."""
_SCALE = 4.0  # log-odds of 4 (55 to 1) become tanh 1 = 0.76


@dataclass(frozen=True, eq=False)
class Situation:
    """State of B episodes.

    Attributes:
        frame_probs: the classifier's softmax of the current object's last touch, ``(B, K)``; uniform before one.
        log_probs: log posterior of the current object, ``(B, K)``.
        previous: last action, ``(B,)``: a pose, P for CONFIRM, P + 1 for REJECT, :data:`NO_ACTION` for none.
        uses: touches of the current object in each pose, ``(B, P)``.
        time: number of touches divided by the touch limit, ``(B,)``.
    """

    frame_probs: Floats
    log_probs: Floats
    previous: NDArray[np.int64]
    uses: NDArray[np.int64]
    time: Floats


def frame_probs(logits: NDArray[np.floating]) -> Floats:
    """Softmax of logits ``(..., K)`` of any size.

    >>> frame_probs(np.array([[1e308, -1e308], [0.0, 0.0]])).tolist()
    [[1.0, 0.0], [0.5, 0.5]]
    """
    scores = np.asarray(logits, np.float64)
    with np.errstate(over="ignore", under="ignore"):
        shares = np.exp(scores - scores.max(axis=-1, keepdims=True))
    return np.asarray(shares / shares.sum(axis=-1, keepdims=True))


def paper_state(situation: Situation, target: int) -> Floats:
    """The paper's ``[p_t, e(a_{t-1}), t/T_max]`` (§5.8), ``(B, K + P + 3)``, in [0, 1]; ``target`` has no effect."""
    num_actions = situation.uses.shape[1] + 2
    one_hot = (situation.previous[:, None] == np.arange(num_actions)).astype(np.float64)
    return np.concatenate([situation.frame_probs, one_hot, situation.time[:, None]], axis=1)


def posterior_state(situation: Situation, target: int) -> Floats:
    """Posterior, :func:`certainty` of the target, n/(n + 1) for the n uses of each pose, and time; in [-1, 1].

    Returns:
        ``(B, K + P + 2)``.
    """
    worn = situation.uses / (1.0 + situation.uses)
    sure = certainty(situation.log_probs, target)[:, None]
    return np.concatenate([np.exp(situation.log_probs), sure, worn, situation.time[:, None]], axis=1)


def certainty(log_probs: Floats, target: int) -> Floats:
    """tanh(ℓ/4) of the target's log-odds ℓ, ``(...)``: -1 for certainly another shape, 1 for certainly the target.

    >>> certainty(np.log([[0.5, 0.5], [0.99, 0.01]]), target=0).round(2).tolist()
    [0.0, 0.82]
    """
    others = np.delete(log_probs, target, axis=-1)
    return np.asarray(np.tanh((log_probs[..., target] - np.logaddexp.reduce(others, axis=-1)) / _SCALE))


Encoding: TypeAlias = Callable[[Situation, int], Floats]

ENCODINGS: Mapping[str, Encoding] = MappingProxyType({"paper": paper_state, "posterior": posterior_state})
"""State encodings by name."""
