"""Recipes: named settings of PPO training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Literal, TypeAlias

from belief.constraints import FRACTION, NotEmpty, NotNegative, Positive, Share, Within, check
from belief.policy_state import ENCODINGS, TOUCH_LIMIT
from experiments.command_line.arguments import BadArgument, Count

State: TypeAlias = Literal[tuple(ENCODINGS)]  # type: ignore[valid-type]


@dataclass(frozen=True)
class PPORecipe:
    """Settings of PPO and of the task.

    Attributes:
        state: a key of :data:`belief.policy_state.ENCODINGS`.
        steps: total number of steps of all environments.
        rollout: steps of each environment between two updates.
        learning_rate: initial learning rate; it falls linearly to zero.
        discount, gae: γ and λ of the advantages.
        beta: weight of the shaping reward (decision 0031).
        target_prob: prior probability of the target in training, or a range from which every test draws it.
    """

    state: State = "paper"
    steps: Count = 320_000
    num_envs: Count = 256
    rollout: Count = 16
    batch_size: Annotated[int, Within(2, 10**8)] = 1024
    epochs: Count = 10
    learning_rate: Positive = 3e-3
    entropy: NotNegative = 0.003
    discount: Share = 1.0
    gae: Share = 0.95
    hidden: Annotated[tuple[int, ...], NotEmpty(), Within(1, 10**6)] = (64, 64)
    beta: NotNegative = 0.1
    touch_cost: NotNegative = 0.02
    touch_limit: Count = TOUCH_LIMIT
    target_prob: Annotated[float | tuple[float, float], FRACTION] = 0.5

    def __post_init__(self) -> None:
        check(self, BadArgument)
        if isinstance(self.target_prob, tuple) and not self.target_prob[0] <= self.target_prob[1]:
            raise BadArgument(f"target_prob must not end before it begins, got {self.target_prob}")
        if self.batch_size > self.num_envs * self.rollout:
            most = f"{self.num_envs} × {self.rollout} steps"
            raise BadArgument(f"batch_size must be no larger than a rollout of {most}, got {self.batch_size}")

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
        "gains": replace(_POSTERIOR, state="gains", steps=60_000),
        "goal": replace(_POSTERIOR, state="goal", steps=100_000),
    }
)
"""Recipes by name of the state: the paper's state and shaping; the posterior at many priors (decision 0031); the gains
of all poses and the posterior; the same with the target, for one policy of all targets (decision 0031)."""
