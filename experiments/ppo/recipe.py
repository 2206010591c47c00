"""Recipes: named settings of PPO training."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from belief.errors import ActiveTouchError
from belief.policy_state import ENCODINGS, TOUCH_LIMIT


class ImpossiblePPO(ActiveTouchError, ValueError):
    """A setting of PPO is out of its range."""


def _is_count(least: int) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and value >= least


def _is_prior(value: Any) -> bool:
    ends = value if isinstance(value, tuple) else (value, value)
    return len(ends) == 2 and bool(0.0 < ends[0] <= ends[1] < 1.0)


_COUNT = (_is_count(1), "a whole number of at least 1")
_WEIGHT = (lambda value: 0.0 <= value < math.inf, "a finite number ≥ 0")
_DISCOUNT = (lambda value: 0.0 < value <= 1.0, "in (0, 1]")
_RULES: Mapping[str, tuple[Callable[[Any], bool], str]] = MappingProxyType(
    {
        **dict.fromkeys(("steps", "num_envs", "rollout", "epochs", "touch_limit"), _COUNT),
        **dict.fromkeys(("entropy", "beta", "touch_cost"), _WEIGHT),
        **dict.fromkeys(("discount", "gae"), _DISCOUNT),
        "state": (lambda value: value in ENCODINGS, f"one of {', '.join(ENCODINGS)}"),
        "batch_size": (_is_count(2), "a whole number of at least 2"),
        "learning_rate": (lambda value: 0.0 < value < math.inf, "a finite number > 0"),
        "hidden": (lambda value: len(value) > 0 and all(map(_is_count(1), value)), "sizes of at least 1, one or more"),
        "target_prob": (_is_prior, "in (0, 1), one number or two that rise"),
    }
)
"""By setting, a test of its value and the rule in words."""


@dataclass(frozen=True)
class PPORecipe:
    """Settings of PPO and of the task.

    Attributes:
        state: state that the policy observes, a key of :data:`belief.policy_state.ENCODINGS`.
        masked: whether probes beyond the touch limit are masked (MaskablePPO of sb3-contrib).
        steps: total number of steps of all environments.
        num_envs: number of parallel environments.
        rollout: steps of each environment between two updates.
        batch_size, epochs: batch size and epochs of an update.
        learning_rate: initial learning rate; it falls linearly to zero.
        entropy: weight of the entropy bonus.
        discount, gae: γ and λ of the advantages.
        hidden: units of the hidden layers of policy and value network.
        beta: weight of the shaping reward (decision 0031).
        touch_cost, touch_limit: λ and T_max of the task.
        target_prob: prior probability of the target in training, or a range from which every test draws it.

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
            except TypeError:  # not a number
                fits = False
            if not fits:
                raise ImpossiblePPO(f"{name} must be {rule}, got {value!r}")
        if self.batch_size > self.num_envs * self.rollout:
            most = f"{self.num_envs} × {self.rollout} steps"
            raise ImpossiblePPO(f"batch_size must be no larger than a rollout of {most}, got {self.batch_size}")

    @property
    def test_prob(self) -> float:
        """Prior probability of the target where policies are evaluated: the middle of the range."""
        ends = self.target_prob if isinstance(self.target_prob, tuple) else (self.target_prob, self.target_prob)
        return sum(ends) / 2.0


_POSTERIOR = PPORecipe(state="posterior", beta=0.0, target_prob=(0.05, 0.95))

PPO_RECIPES: Mapping[str, PPORecipe] = MappingProxyType(
    {
        "paper": PPORecipe(),
        "posterior": _POSTERIOR,
        "posterior_masked": replace(_POSTERIOR, masked=True),
        "gains": replace(_POSTERIOR, state="gains", steps=60_000),
        "goal": replace(_POSTERIOR, state="goal", steps=100_000),
    }
)
"""Recipes by name: the paper's state and shaping; the posterior at many priors (decision 0024); the same with masks;
the gains of all poses beside the posterior; the same with the target, for one policy of all targets (decision 0058)."""
