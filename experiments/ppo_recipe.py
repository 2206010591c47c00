"""How policies are trained: named settings of PPO."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from belief.encoding import TOUCH_LIMIT
from belief.errors import ActiveTouchError


class ImpossiblePPO(ActiveTouchError, ValueError):
    """A setting of PPO is out of its range."""


@dataclass(frozen=True)
class PPORecipe:
    """Settings of PPO and of the task.

    Attributes:
        state: what the policy sees, a key of :data:`belief.encoding.ENCODINGS`.
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
        counts = (self.steps, self.num_envs, self.rollout, self.batch_size, self.epochs, *self.hidden)
        if min(counts) < 1 or not self.hidden or self.batch_size > self.num_envs * self.rollout:
            raise ImpossiblePPO(f"counts must be at least 1, and a batch no larger than a rollout, got {self}")
        shares = (self.discount, self.gae)
        if not (self.learning_rate > 0.0 and min(shares) > 0.0 and max(shares) <= 1.0 and self.beta >= 0.0):
            raise ImpossiblePPO(f"need learning_rate > 0, discount and gae in (0, 1], beta ≥ 0, got {self}")
        low, high = self._target_probs
        if not 0.0 < low <= high < 1.0:
            raise ImpossiblePPO(f"target_prob must be in (0, 1), a number or two that rise, got {self.target_prob}")

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
