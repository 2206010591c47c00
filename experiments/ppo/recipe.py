"""How policies are trained: named settings of PPO."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from belief.errors import ActiveTouchError
from belief.policy_state import ENCODINGS, TOUCH_LIMIT


class ImpossiblePPO(ActiveTouchError, ValueError):
    """A setting of PPO is out of its range.

    Args:
        name: of the setting.
        rule: what it must be.
        value: what it is.
    """

    def __init__(self, name: str, rule: str, value: object) -> None:
        self._arguments = (name, rule, value)
        super().__init__(f"{name} must be {rule}, got {value!r}")

    def __reduce__(self) -> tuple[type[ImpossiblePPO], tuple[str, str, object]]:
        return ImpossiblePPO, self._arguments  # so that it survives the way back from a worker


def _is_count(least: int) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and value >= least


def _is_in(low: float, high: float) -> Callable[[Any], bool]:
    """Within (low, high]."""
    return lambda value: bool(low < value <= high)


def _is_not_negative(value: Any) -> bool:
    return bool(0.0 <= value < math.inf)


def _is_chance(value: Any) -> bool:
    ends = value if isinstance(value, tuple) else (value, value)
    return len(ends) == 2 and bool(0.0 < ends[0] <= ends[1] < 1.0)


_AT_LEAST_ONE = (_is_count(1), "a whole number of at least 1")
_WEIGHT = (_is_not_negative, "a finite number ≥ 0")
_RULES: Mapping[str, tuple[Callable[[Any], bool], str]] = MappingProxyType(
    {
        "state": (lambda value: value in ENCODINGS, f"one of {', '.join(ENCODINGS)}"),
        "steps": _AT_LEAST_ONE,
        "num_envs": _AT_LEAST_ONE,
        "rollout": _AT_LEAST_ONE,
        "batch_size": (_is_count(2), "a whole number of at least 2"),
        "epochs": _AT_LEAST_ONE,
        "learning_rate": (lambda value: bool(0.0 < value < math.inf), "a finite number > 0"),
        "entropy": _WEIGHT,
        "discount": (_is_in(0.0, 1.0), "in (0, 1]"),
        "gae": (_is_in(0.0, 1.0), "in (0, 1]"),
        "hidden": (lambda value: len(value) > 0 and all(map(_is_count(1), value)), "sizes of at least 1, one or more"),
        "beta": _WEIGHT,
        "touch_cost": _WEIGHT,
        "touch_limit": _AT_LEAST_ONE,
        "target_prob": (_is_chance, "in (0, 1), one number or two that rise"),
    }
)
"""What each setting must be, and in words."""


@dataclass(frozen=True)
class PPORecipe:
    """Settings of PPO and of the task.

    Attributes:
        state: what the policy sees, a key of :data:`belief.policy_state.ENCODINGS`.
        masked: whether probes beyond the touch limit are masked (MaskablePPO of sb3-contrib).
        steps: of all environments together.
        num_envs: that play at once.
        rollout: steps of each between two updates.
        batch_size, epochs: of an update.
        learning_rate: at the start; falls linearly to nothing.
        entropy: weight of the entropy bonus.
        discount, gae: γ and λ of the advantages.
        hidden: units of the hidden layers, of policy and of value network.
        beta: weight of the shaping reward (decision 0031).
        touch_cost, touch_limit: of the task.
        target_prob: how often an object is the target, or a range from which every test of the training draws this.

    Raises:
        ImpossiblePPO: a setting is out of its range; the message names it.
    """

    state: str = "paper"
    masked: bool = False
    steps: int = 320_000
    num_envs: int = 256
    rollout: int = 16
    batch_size: int = 1024
    epochs: int = 10
    learning_rate: float = 3e-3
    entropy: float = 0.003
    discount: float = 1.0
    gae: float = 0.95
    hidden: tuple[int, ...] = (64, 64)
    beta: float = 0.1
    touch_cost: float = 0.02
    touch_limit: int = TOUCH_LIMIT
    target_prob: float | tuple[float, float] = 0.5

    def __post_init__(self) -> None:
        for name, (is_right, rule) in _RULES.items():
            value = getattr(self, name)
            try:
                fits = is_right(value)
            except TypeError:  # no number at all
                fits = False
            if not fits:
                raise ImpossiblePPO(name, rule, value)
        if self.batch_size > self.num_envs * self.rollout:
            rule = f"no larger than a rollout of {self.num_envs} × {self.rollout} steps"
            raise ImpossiblePPO("batch_size", rule, self.batch_size)

    @property
    def test_prob(self) -> float:
        """How often an object is the target where policies are measured: the middle of the range."""
        return sum(self._target_probs) / 2.0

    @property
    def _target_probs(self) -> tuple[float, float]:
        return self.target_prob if isinstance(self.target_prob, tuple) else (self.target_prob, self.target_prob)


_POSTERIOR = PPORecipe(state="posterior", beta=0.0, target_prob=(0.05, 0.95))

PPO_RECIPES: Mapping[str, PPORecipe] = MappingProxyType(
    {
        "paper": PPORecipe(),
        "posterior": _POSTERIOR,
        "posterior_masked": replace(_POSTERIOR, masked=True),
    }
)
"""By name: the paper's state and shaping; the posterior in its place, begun at many priors (0024); and with masks."""
