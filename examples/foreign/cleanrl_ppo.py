r"""PPO in one file, as CleanRL writes it: torch, and many tests at once from gymnasium.make_vec.

Run: python cleanrl_ppo.py [STEPS]      (writes cleanrl.pt; 300 000 steps by default, about a minute)
     activetouch compare --scene paper --sensor paper-independent --targets cone \
         --deciders "policy:cleanrl_ppo:act(state='posterior')" threshold
"""

import sys
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

ENVS, ROLLOUT, EPOCHS, BATCH, CLIP, ENTROPY, LAMBDA = 256, 16, 8, 1024, 0.2, 0.003, 0.95


class Agent(nn.Module):
    """Scores of the actions, and the value of an observation."""

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()
        self.body = nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh())
        self.policy, self.value = nn.Linear(64, actions), nn.Linear(64, 1)

    def forward(self, seen: torch.Tensor) -> tuple[Categorical, torch.Tensor]:
        hidden = self.body(seen)
        return Categorical(logits=self.policy(hidden)), self.value(hidden).squeeze(-1)


def learn(steps: int) -> Agent:
    """PPO without discount. With SAME_STEP, an environment that ends has already begun the next test."""
    torch.manual_seed(0)
    envs = gymnasium.make_vec(
        "activetouch:activetouch/ObjectTestBank-v0",
        num_envs=ENVS,
        target="cone",
        state="posterior",
        autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP,
    )
    agent = Agent(envs.single_observation_space.shape[0], int(envs.single_action_space.n))
    optimizer = torch.optim.Adam(agent.parameters(), lr=3e-3)
    updates = max(steps // (ENVS * ROLLOUT), 1)
    seen, _ = envs.reset(seed=0)
    for update in range(updates):
        optimizer.param_groups[0]["lr"] = 3e-3 * (1.0 - update / updates)
        rows = []
        with torch.no_grad():
            for _ in range(ROLLOUT):
                now = torch.as_tensor(seen)
                choice, value = agent(now)
                action = choice.sample()
                seen, reward, terminated, truncated, _ = envs.step(action.numpy())
                reward, ended = torch.as_tensor(reward, dtype=torch.float32), torch.as_tensor(terminated | truncated)
                rows.append((now, action, choice.log_prob(action), value, reward, ended.float()))
            following, advantage, advantages = agent(torch.as_tensor(seen))[1], torch.zeros(ENVS), []
            for *_, value, reward, ended in reversed(rows):
                advantage = reward + (1 - ended) * following - value + LAMBDA * (1 - ended) * advantage
                following = value
                advantages.insert(0, advantage)
        states, actions, old, values = (torch.cat([row[part] for row in rows]) for part in range(4))
        gains = torch.cat(advantages)
        returns = gains + values
        gains = (gains - gains.mean()) / (gains.std() + 1e-8)
        for _ in range(EPOCHS):
            for part in torch.randperm(len(states)).split(BATCH):
                choice, value = agent(states[part])
                ratio = (choice.log_prob(actions[part]) - old[part]).exp()
                kept = torch.min(ratio * gains[part], ratio.clamp(1 - CLIP, 1 + CLIP) * gains[part]).mean()
                loss = 0.5 * (value - returns[part]).square().mean() - kept - ENTROPY * choice.entropy().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        if update % 10 == 0:
            print(f"{(update + 1) * ENVS * ROLLOUT} steps, mean return of a test {returns.mean():.3f}", flush=True)
    return agent


@cache
def _learned() -> Agent:
    weights = torch.load(Path(__file__).with_name("cleanrl.pt"), weights_only=True)
    agent = Agent(weights["body.0.weight"].shape[1], weights["policy.bias"].shape[0])
    agent.load_state_dict(weights)
    return agent


def act(observation: np.ndarray) -> int:
    """The best action, for comparisons."""
    with torch.no_grad():
        return int(_learned()(torch.as_tensor(observation))[0].logits.argmax())


if __name__ == "__main__":
    torch.set_num_threads(1)
    learned = learn(int(sys.argv[1]) if len(sys.argv) > 1 else 300_000)
    torch.save(learned.state_dict(), "cleanrl.pt")
    print("wrote cleanrl.pt")
