"""State from which a PPO training continues: weights, optimiser, unfinished episodes, and all random states.

A training that continues from this state ends with the same policy and learning curve, byte for byte, as an
uninterrupted one. The state is taken between two updates, when the rollout buffer is empty. It contains the global
generators of numpy and torch, because Stable-Baselines3 draws from them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch

from activetouch.perception.sealed_tensors import read_tensors, write_tensors
from belief.errors import CorruptFile

if TYPE_CHECKING:
    from stable_baselines3 import PPO

    from activetouch.envs.sb3 import BankVecEnv


def write_state(path: Path, learner: PPO, fields: Mapping[str, Any]) -> None:
    """Write the state of a learner before a rollout.

    Args:
        path: file to write.
        learner: the learner, on a :class:`~activetouch.envs.sb3.BankVecEnv`.
        fields: further JSON fields of the file.
    """
    envs = cast("BankVecEnv", learner.get_env())
    kind, words, *position = np.random.get_state()  # noqa: NPY002
    assert isinstance(words, np.ndarray), "the old generator's state is a tuple by default"
    tensors = {f"policy.{name}": value.numpy() for name, value in learner.policy.state_dict().items()}
    for index, moments in learner.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"optimiser.{index}.{name}": value.numpy() for name, value in moments.items()}
    tensors |= {f"episodes.{name}": array for name, array in envs.arrays.items()}
    assert isinstance(learner._last_obs, np.ndarray)
    assert learner._last_episode_starts is not None
    tensors |= {"last.observations": learner._last_obs, "last.starts": learner._last_episode_starts}
    tensors |= {"chance.torch": torch.get_rng_state().numpy(), "chance.numpy": words}
    chance = {"numpy": [kind, *position], "episodes": envs.chance}
    progress = {"steps": learner.num_timesteps, "updates": learner._n_updates, "chance": chance}
    write_tensors(path, tensors, {**fields, "progress": progress})


def restore_state(path: Path, learner: PPO) -> None:
    """Set a new learner with the same settings to the state in a file.

    Raises:
        CorruptFile: the file is damaged, or has other settings.
    """
    tensors, fields = read_tensors(path)
    envs = cast("BankVecEnv", learner.get_env())
    try:
        progress = fields["progress"]
        learner.policy.load_state_dict({name: torch.tensor(v) for name, v in _within(tensors, "policy.").items()})
        optimiser: dict[int, dict[str, torch.Tensor]] = {}
        for name, value in _within(tensors, "optimiser.").items():
            index, moment = name.split(".")
            optimiser.setdefault(int(index), {})[moment] = torch.tensor(value)
        groups = learner.policy.optimizer.state_dict()["param_groups"]
        learner.policy.optimizer.load_state_dict({"state": optimiser, "param_groups": groups})
        saved = _within(tensors, "episodes.")
        for name, array in envs.arrays.items():
            array[...] = saved[name]
        envs.chance = progress["chance"]["episodes"]
        learner._last_obs, learner._last_episode_starts = tensors["last.observations"], tensors["last.starts"]
        learner.num_timesteps, learner._n_updates = progress["steps"], progress["updates"]
        kind, *position = progress["chance"]["numpy"]
        np.random.set_state((kind, tensors["chance.numpy"], *position))  # noqa: NPY002
        torch.set_rng_state(torch.tensor(tensors["chance.torch"]))
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise CorruptFile(f"{path} is no state of this training: {error!r}") from error


@contextmanager
def global_chance_kept() -> Iterator[None]:
    """Restore the global generators, which Stable-Baselines3 seeds and draws from, afterwards."""
    before = np.random.get_state()  # noqa: NPY002
    try:
        with torch.random.fork_rng(devices=[]):
            yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def _within(tensors: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
