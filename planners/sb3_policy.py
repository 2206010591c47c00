"""A policy that Stable-Baselines3 saved, as a decider: ``sb3:PATH``, or ``sb3:PATH(normalize='vecnormalize.pkl')``.

The size and the range of the policy's observation tell what it sees: the paper's state or the posterior, alone or
followed by the target, one-hot. Loading such a file runs code from it, so load only files that you trust.
"""

from __future__ import annotations

import json
import pickle
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from belief.errors import MissingPackage, install_command
from belief.files import require_regular_file
from belief.policy_state import TOUCH_LIMIT, state_size
from belief.validation import require_count
from planners.decider import Decision, InformationState
from planners.function_policy import decision, observation
from planners.ppo import BadPolicy, MissingPolicy, written

_LEAST = {"paper": 0.0, "posterior": -1.0}  # of an observation; the posterior of a whole search is as long as "paper"
_MOST_SETTINGS = 1 << 26  # of the settings in a file [bytes]


@dataclass(frozen=True)
class SB3Policy:
    """Takes the best action of a saved policy, object by object.

    After ``touch_limit`` touches of one object it takes the more probable answer.

    Attributes:
        path: the file; ``{target}`` in it stands for the label of the target.
        touch_limit: T_max of the environment in which it learned. The file does not say it, nor the ``target_prob``
            with which it learned.
        normalize: file that ``VecNormalize.save`` wrote, of a policy that learned inside of it; ``{target}`` in it
            stands for the label of the target. Empty for none.
    """

    path: str
    touch_limit: int = TOUCH_LIMIT
    normalize: str = ""

    def __post_init__(self) -> None:
        require_count("touch_limit", self.touch_limit)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        model, state, sees_target, change = self._loaded(info)
        seen = observation(info, state, sees_target, self.touch_limit)
        if change is not None:
            if np.shape(change.obs_rms.mean) != seen.shape:
                raise BadPolicy(
                    f"{self.normalize} normalises observations of shape {np.shape(change.obs_rms.mean)}; {self.path} "
                    f"reads {seen.shape}"
                )
            seen = change.normalize_obs(seen)
        return decision(info, int(model.predict(seen, deterministic=True)[0]), self.touch_limit)

    def files(self, target: str) -> tuple[Path, ...]:
        """The files that searches for this target follow: the policy's, and its normalisation's.

        Raises:
            MissingPolicy: one is missing.
        """
        paths = [Path(name.replace("{target}", target)) for name in (self.path, self.normalize) if name]
        for path in paths:
            if not path.is_file():
                raise MissingPolicy(f"sb3:{self.path}: there is no file {path}")
        return tuple(paths)

    def _loaded(self, info: InformationState) -> tuple[Any, str, bool, Any]:
        """The policy, what it sees, whether it also sees the target, and how this is normalised; None if it is not."""
        path, *more = self.files(info.problem.shape_labels[info.target])
        model = _model(path, written(path))
        change = _normalization(more[0], written(more[0])) if more else None
        self._require_training(model, path)
        num_shapes, num_poses = info.problem.num_shapes, info.problem.num_poses
        sizes = {state: state_size(state, num_shapes, num_poses) for state in _LEAST}
        shape, actions = model.observation_space.shape, getattr(model.action_space, "n", None)
        least = np.min(getattr(model.observation_space, "low", np.nan))
        for state, size in sizes.items():
            for sees_target in (False, True):
                if (shape, least, actions) == ((size + sees_target * num_shapes,), _LEAST[state], num_poses + 2):
                    return model, state, sees_target, change
        raise BadPolicy(
            f"{path} reads an observation of shape {shape} from {least:g} on and chooses among {actions} actions; a "
            f"search with {num_shapes} shapes and {num_poses} poses needs {num_poses + 2} actions and "
            + " or ".join(
                f"{size} numbers ({state}), {size + num_shapes} with the target, from {_LEAST[state]:g} on"
                for state, size in sizes.items()
            )
            + ", as activetouch/ObjectTest-v0 and ObjectTestGoal-v0 have them; train it there"
        )

    def _require_training(self, model: Any, path: Path) -> None:
        """Raise BadPolicy if the last tests of the training were longer, or their observations normalised."""
        space, seen = model.observation_space, getattr(model, "_last_obs", None)
        if not self.normalize and seen is not None and ((seen < space.low).any() or (seen > space.high).any()):
            raise BadPolicy(
                f"{path} learned from observations that VecNormalize changed; name the file that its save() wrote, as "
                f"in sb3:{path}(normalize='vecnormalize.pkl')"
            )
        longest = max((int(episode["l"]) for episode in getattr(model, "ep_info_buffer", None) or ()), default=0)
        if longest > self.touch_limit + 1:
            raise BadPolicy(
                f"{path} learned in tests of up to {longest} steps, and is played with a touch limit of "
                f"{self.touch_limit}, which allows {self.touch_limit + 1}; name the limit of its training, as in "
                f"sb3:{path}(touch_limit={longest - 1})"
            )


@lru_cache(maxsize=32)
def _model(path: Path, written: tuple[int, int] | None) -> Any:
    """The model, read once in each process, and again when its file was written anew."""
    try:
        with zipfile.ZipFile(require_regular_file(path, BadPolicy)) as file, file.open("data") as settings:
            data = json.loads(settings.read(_MOST_SETTINGS))
        module, name = _algorithm(data)
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, AttributeError) as error:
        raise BadPolicy(f"{path} is no file that Stable-Baselines3 saved: {error}") from error
    try:
        algorithm = getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        extra = "contrib" if module == "sb3_contrib" else "rl"
        raise MissingPackage(f"{path} needs {module}: {install_command(extra)}") from error
    try:
        return algorithm.load(path, device="cpu")
    except Exception as error:  # unpickling and torch raise a dozen kinds on other policies and damaged bytes
        raise BadPolicy(
            f"{path} cannot be loaded as {name}: {error}. It must be an undamaged PPO, A2C, DQN or MaskablePPO"
        ) from error


@lru_cache(maxsize=32)
def _normalization(path: Path, written: tuple[int, int] | None) -> Any:
    """The ``VecNormalize`` in a file, or None if it normalises no observations."""
    try:
        found = pickle.loads(require_regular_file(path, BadPolicy).read_bytes())
        return found if found.norm_obs and found.obs_rms.mean.shape else None
    except Exception as error:  # unpickling damaged bytes, or something else, raises a dozen kinds
        raise BadPolicy(f"{path} holds no VecNormalize of arrays that Stable-Baselines3 saved: {error!r}") from error


def _algorithm(data: dict[str, Any]) -> tuple[str, str]:
    """Module and name of the algorithm that wrote a file, by the settings it keeps."""
    if "sb3_contrib" in str(data.get("policy_class")):
        return "sb3_contrib", "MaskablePPO"
    if "exploration_fraction" in data:
        return "stable_baselines3", "DQN"
    return "stable_baselines3", "PPO" if "clip_range" in data else "A2C"
