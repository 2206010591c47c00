"""A PPO policy that sees the maps of the belief about a tray and says where to press next; the belief ends the search.

python tray_policy.py --seeds 0 1      (writes runs/zoo-drawer-v1/ppo-0.zip; the extra train)
activetouch benchmark --task drawer-v1 --agent "tray_policy:Learned(seed=0)" --out ppo-0.jsonl.gz

It learns in trays with other seeds than those of the task. A press of one of some 900 squares of 10 mm is an action;
a small convolutional network says how good each is from what is near it, and from how far the pad is.
"""

import argparse
import os
import time
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # threads wait for each other in matrices so small

import gymnasium
import numpy as np
import stable_baselines3
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from activetouch.envs.tray import TraySearchEnv
from belief.tray import TrayBelief
from experiments.search.benchmark.cards import Card
from planners.tray import Press, TrayDecision, maps_of, standing_of

TASK, FOLDER = "drawer-v1", Path("runs", "zoo-drawer-v1")
CELLS = 2
"""Cells of the belief along an edge of a square."""


def squares(maps: NDArray[np.float32]) -> NDArray[np.float32]:
    """The highest value of each map in each square, ``(5, X, Y)``; for the way, the shortest."""
    _, x, y = maps.shape
    padded = np.pad(maps, ((0, 0), (0, -x % CELLS), (0, -y % CELLS)), "edge")
    blocks = padded.reshape(len(maps), padded.shape[1] // CELLS, CELLS, padded.shape[2] // CELLS, CELLS)
    found = blocks.max(axis=(2, 4))
    found[4] = blocks[4].min(axis=(1, 3))
    return found


def cell_of(square: int, cells: tuple[int, int]) -> tuple[int, int]:
    """The cell in the middle of a square, by the number of cells along the tray."""
    x, y = divmod(square, -(-cells[1] // CELLS))
    return min(CELLS * x + CELLS // 2, cells[0] - 1), min(CELLS * y + CELLS // 2, cells[1] - 1)


class Squares(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Presses of squares, and maps over them."""

    def __init__(self, env: TraySearchEnv) -> None:
        super().__init__(env)
        self.sensor = env.sensor
        shape = squares(np.zeros(env.observation_space.shape, np.float32)).shape
        self.observation_space = gymnasium.spaces.Box(0.0, 1.0, shape, np.float32)
        self.action_space = gymnasium.spaces.Discrete(shape[1] * shape[2])

    def reset(self, **given: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """See :class:`gymnasium.Env`."""
        maps, info = self.env.reset(**given)
        return squares(maps), info

    def step(self, action: int) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """See :class:`gymnasium.Env`."""
        place = self.sensor.grid.centre(cell_of(int(action), self.sensor.grid.cells))
        maps, *rest = self.env.step(np.float32(np.divide(place, self.sensor.tray.size)))
        return squares(maps), *rest


class Near(BaseFeaturesExtractor):
    """A score of each square from what is near it, and 32 numbers for the value, one after the other."""

    def __init__(self, space: gymnasium.spaces.Box) -> None:
        maps, x, y = space.shape
        super().__init__(space, x * y + 32)
        layers: list[Any] = []
        for inputs, dilation in ((maps, 1), (16, 1), (16, 2)):
            layers += [torch.nn.Conv2d(inputs, 16, 3, padding=dilation, dilation=dilation), torch.nn.ReLU()]
        self.near, self.score = torch.nn.Sequential(*layers), torch.nn.Conv2d(16, 1, 1)
        self.all = torch.nn.Sequential(torch.nn.Linear(2 * 16 + 2 * maps, 32), torch.nn.ReLU())

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """``(B, X Y + 32)``."""
        near = self.near(maps)
        parts = [part for of in (near, maps) for part in (of.mean(dim=(2, 3)), of.amax(dim=(2, 3)))]
        return torch.cat([self.score(near).flatten(1), self.all(torch.cat(parts, dim=1))], dim=1)


class Part(torch.nn.Module):
    """The first numbers of the features, which are the scores of the squares."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """``(B, number)``."""
        return features[:, : self.number]


class Value(torch.nn.Linear):
    """The value of the last 32 features, ``(B, 1)``."""

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """See :class:`torch.nn.Linear`."""
        return super().forward(features[:, -self.in_features :])


class MapPolicy(ActorCriticPolicy):
    """A policy whose network is :class:`Near`, and nothing behind it."""

    def __init__(self, *spaces: Any, **given: Any) -> None:
        super().__init__(*spaces, **{**given, "net_arch": [], "features_extractor_class": Near})

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net, self.value_net = Part(int(self.action_space.n)), Value(32, 1)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1.0), **self.optimizer_kwargs)


@dataclass(frozen=True, eq=False)
class Learned:
    """A decider of trays that presses where a trained policy says.

    Attributes:
        seed: of the training.
        folder: of its file, runs/zoo-drawer-v1 by default.
    """

    seed: int
    folder: str = str(FOLDER)

    @cached_property
    def policy(self) -> Any:
        """The policy; its file is read once."""
        torch.set_num_threads(1)
        return stable_baselines3.PPO.load(Path(self.folder, f"ppo-{self.seed}.zip"), device="cpu")

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        """A press of the square that the policy finds best among those that were not pressed."""
        seen = torch.from_numpy(squares(maps_of(belief, standing_of(belief), at))[None])
        with torch.inference_mode():
            scores = self.policy.policy.get_distribution(seen).distribution.logits[0].numpy()
        order = np.argsort(-scores, kind="stable")
        cells = (cell_of(int(square), belief.cells) for square in order)
        return TrayDecision(Press(next(cell for cell in cells if cell not in belief.pressed)))


def train(card: Card, seed: int, steps: int, num_envs: int = 8) -> Any:
    """A trained model."""
    assert card.tray is not None
    make = partial(TraySearchEnv, card.tray.made, touch_cost=card.tray.touch_cost)
    model = stable_baselines3.PPO(
        MapPolicy,
        VecMonitor(DummyVecEnv([lambda: Squares(make()) for _ in range(num_envs)])),
        learning_rate=lambda left: 2e-3 * max(left, 0.0),
        n_steps=128,
        batch_size=256,
        n_epochs=6,
        gamma=0.98,
        ent_coef=0.003,
        seed=seed,
        device="cpu",
    )
    return model.learn(steps)


def main() -> None:
    """Train policies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--steps", type=int, default=40_000, help="presses of all trays together")
    parser.add_argument("--out", type=Path, default=FOLDER)
    given = parser.parse_args()
    torch.set_num_threads(1)
    card = Card.named(TASK)
    if card.seed in given.seeds:
        parser.error(f"--seeds: {card.seed} is the seed of {card.name}")
    given.out.mkdir(parents=True, exist_ok=True)
    for seed in given.seeds:
        started = time.process_time()
        model = train(card, seed, given.steps)
        ends = [episode["r"] for episode in model.ep_info_buffer]
        model.save(given.out / f"ppo-{seed}.zip")
        minutes = (time.process_time() - started) / 60.0
        told = f"return {np.mean(ends):.3f} in the last {len(ends)} searches of its training, whose presses are drawn"
        print(f"{given.out / f'ppo-{seed}.zip'}: {told}; {minutes:.1f} minutes of processor time", flush=True)


if __name__ == "__main__":
    main()
