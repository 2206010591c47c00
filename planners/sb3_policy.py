"""A policy that Stable-Baselines3 saved, as a decider: ``sb3:PATH``.

The size and the range of the policy's observation tell what it sees: the paper's state or the posterior, alone or
followed by the target, one-hot. Loading such a file runs code from it, so load only files that you trust.

A policy that learned inside ``VecNormalize`` sees normalised observations. Its statistics lie in a file beside it, a
pickle, of which only numbers are read: no code runs from it.
"""

from __future__ import annotations

import json
import pickle
import re
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from belief import Confirm, Probe, Reject
from belief.errors import MissingPackage
from belief.files import require_regular_file
from belief.policy_state import ENCODINGS, TOUCH_LIMIT
from belief.problem import Floats
from belief.validation import require_count
from planners.decider import Decision, InformationState
from planners.ppo import BadPolicy, MissingPolicy, situation_of

PREFIX = "sb3:"
"""What the name of such a decider starts with."""
_LEAST = {"paper": 0.0, "posterior": -1.0}  # of an observation; the posterior of a whole search is as long as "paper"


class Normaliser(NamedTuple):
    """Statistics with which ``VecNormalize`` normalises observations of D numbers: mean and variance, ``(D,)``."""

    mean: Floats
    var: Floats
    epsilon: float
    clip: float

    def __call__(self, seen: Floats) -> Floats:
        """Normalised observations, ``(D,)``."""
        return np.asarray(np.clip((seen - self.mean) / np.sqrt(self.var + self.epsilon), -self.clip, self.clip))


class Loaded(NamedTuple):
    """A policy, what it sees, whether it also sees the target, and how its observations are normalised, if they are."""

    model: Any
    state: str
    sees_target: bool
    normaliser: Normaliser | None


@dataclass(frozen=True)
class SB3Policy:
    """Takes the best action of a saved policy, object by object.

    After ``touch_limit`` touches of one object it takes the more probable answer.

    Attributes:
        path: the file; ``{target}`` in it stands for the label of the target. For a policy ``model.zip`` that learned
            inside ``VecNormalize``, its statistics are in ``model_vecnormalize.pkl``, ``vecnormalize.pkl`` or
            ``vec_normalize.pkl`` beside it, or where SB3's ``CheckpointCallback`` writes them.
        touch_limit: T_max of the environment in which it learned. The file does not say it, nor the ``target_prob``
            with which it learned.
    """

    path: str
    touch_limit: int = TOUCH_LIMIT

    def __post_init__(self) -> None:
        require_count("touch_limit", self.touch_limit)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        problem, scores = info.problem, {"target_prob": info.target_prob}
        loaded = self._loaded(info)
        situation = situation_of(info.history, info.belief.log_probs, problem.num_poses, self.touch_limit)
        seen = ENCODINGS[loaded.state](situation, info.target)[0]
        if loaded.sees_target:
            seen = np.append(seen, np.arange(problem.num_shapes) == info.target)
        if loaded.normaliser is not None:
            seen = loaded.normaliser(seen)
        action = int(loaded.model.predict(seen.astype(np.float32), deterministic=True)[0])
        if action < problem.num_poses:
            if len(info.history) < self.touch_limit:
                return Decision(Probe(action), scores)
            action = problem.num_poses + (info.target_prob < 0.5)
        return Decision(Confirm() if action == problem.num_poses else Reject(), scores)

    def files(self, target: str) -> tuple[Path, ...]:
        """The file that searches for this target follow, and that of its normalisation if there is one.

        Raises:
            MissingPolicy: there is none.
        """
        path = Path(self.path.replace("{target}", target))
        if not path.is_file():
            raise MissingPolicy(f"{PREFIX}{self.path}: there is no file {path}")
        return (path, *_beside(path)[:1])

    def _loaded(self, info: InformationState) -> Loaded:
        path, *beside = self.files(info.problem.shape_labels[info.target])
        model = _model(path, _written(path))
        self._require_touches(model, path)
        num_shapes, num_poses = info.problem.num_shapes, info.problem.num_poses
        sizes = {"paper": num_shapes + num_poses + 3, "posterior": num_shapes + num_poses + 2}
        shape, actions = model.observation_space.shape, getattr(model.action_space, "n", None)
        least = np.min(getattr(model.observation_space, "low", np.nan))
        for state, size in sizes.items():
            for sees_target in (False, True):
                if (shape, least, actions) == ((size + sees_target * num_shapes,), _LEAST[state], num_poses + 2):
                    return Loaded(model, state, sees_target, _normaliser_of(model, path, beside))
        raise BadPolicy(
            f"{path} reads an observation of shape {shape} from {least:g} on and chooses among {actions} actions; a "
            f"search with {num_shapes} shapes and {num_poses} poses needs {num_poses + 2} actions and "
            + " or ".join(
                f"{size} numbers ({state}), {size + num_shapes} with the target, from {_LEAST[state]:g} on"
                for state, size in sizes.items()
            )
            + ", as activetouch/ObjectTest-v0 and ObjectTestGoal-v0 have them; train it there"
        )

    def _require_touches(self, model: Any, path: Path) -> None:
        """Raise BadPolicy if the last episodes of the training were longer than the touch limit allows."""
        longest = max((int(episode["l"]) for episode in getattr(model, "ep_info_buffer", None) or ()), default=0)
        if longest > self.touch_limit + 1:
            raise BadPolicy(
                f"{path} learned in tests of up to {longest} steps, and is played with a touch limit of "
                f"{self.touch_limit}, which allows {self.touch_limit + 1}; name the limit of its training, as in "
                f"planners.sb3_policy:SB3Policy(path='{path}',touch_limit={longest - 1})"
            )


def _normaliser_of(model: Any, path: Path, beside: list[Path]) -> Normaliser | None:
    """How the observations of a policy are normalised; None if it learned from plain ones."""
    plain, seen = getattr(model, "_last_original_obs", None), getattr(model, "_last_obs", None)
    if plain is None or seen is None:  # SB3 keeps the plain observation of an environment inside VecNormalize only
        return None
    if not beside:
        low, high = model.observation_space.low, model.observation_space.high
        if np.array_equal(plain, seen) or (low.min() >= 0.0 and (seen >= low).all() and (seen <= high).all()):
            return None  # only rewards were normalised: normalised observations have negative numbers
        raise BadPolicy(
            f"{path} learned inside VecNormalize, and its statistics do not lie beside it; save them with "
            f"env.save('{path.with_name(path.stem + '_vecnormalize.pkl')}')"
        )
    found = _statistics(beside[0], _written(beside[0]))
    if found is not None and found.mean.shape != model.observation_space.shape:
        raise BadPolicy(
            f"{beside[0]} has the statistics of observations {found.mean.shape}, and {path} reads "
            f"{model.observation_space.shape}; put its own file there"
        )
    return found


def _beside(path: Path) -> list[Path]:
    """Files in which the statistics of a policy's normalisation may lie, those that exist."""
    names = [f"{path.stem}_vecnormalize", re.sub(r"_(\d+_steps)$", r"_vecnormalize_\1", path.stem)]
    files = [path.with_name(f"{name}.pkl") for name in (*names, "vecnormalize", "vec_normalize")]
    return [file for file in files if file.stem != path.stem and file.is_file()]


def _written(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


class _Inert:
    """Stands for an object of a pickle: keeps its attributes, and does nothing."""

    def __init__(self, *arguments: object, **settings: object) -> None:
        self.state: dict[str, Any] = {}

    def __setstate__(self, state: object) -> None:
        self.state = state if isinstance(state, dict) else {}

    def __setitem__(self, key: object, value: object) -> None:
        """Nothing: contents of spaces are not needed."""


class _OnlyNumbers(pickle.Unpickler):
    """Reads arrays and numbers; objects that SB3 writes beside them become inert, and anything else is refused."""

    def find_class(self, module: str, name: str) -> Any:
        """What a name in the pickle stands for."""
        if (module, name) in (("numpy", "ndarray"), ("numpy", "dtype")):
            return getattr(np, name)
        if module in ("numpy.core.multiarray", "numpy._core.multiarray") and name in ("_reconstruct", "scalar"):
            return getattr(import_module("numpy._core.multiarray"), name)
        if re.match(r"(stable_baselines3\.common\.|gymnasium\.spaces\.|numpy\.random\.)", module):
            return _Inert
        raise pickle.UnpicklingError(f"it names {module}.{name}, which is no part of VecNormalize")


@lru_cache(maxsize=32)
def _statistics(path: Path, written: tuple[int, int]) -> Normaliser | None:
    """The statistics in a file that ``VecNormalize.save`` wrote; None if it does not normalise observations.

    Raises:
        BadPolicy: the file is damaged, or holds anything else.
    """
    try:
        with path.open("rb") as file:
            state = _OnlyNumbers(file).load().state
        if not state["norm_obs"]:
            return None
        mean, var = (np.asarray(state["obs_rms"].state[name], np.float64) for name in ("mean", "var"))
        found = Normaliser(mean, var, float(state["epsilon"]), float(state["clip_obs"]))
        is_usable = np.isfinite(mean).all() and (var + found.epsilon > 0.0).all() and found.clip > 0.0
        if mean.shape != var.shape or not is_usable:
            raise ValueError("its mean and variance are not usable")
    except Exception as error:  # unpickling raises a dozen kinds on damaged bytes
        raise BadPolicy(
            f"{path} cannot be read as the statistics of VecNormalize: {error}. Write it with VecNormalize.save"
        ) from error
    return found


_MOST_SETTINGS = 1 << 26  # of the settings in a file [bytes]


@lru_cache(maxsize=32)
def _model(path: Path, written: tuple[int, int]) -> Any:
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
        raise MissingPackage(f"{path} needs {module}: pip install 'activetouch[{extra}]'") from error
    try:
        return algorithm.load(path, device="cpu")
    except Exception as error:  # unpickling and torch raise a dozen kinds on other policies and damaged bytes
        raise BadPolicy(
            f"{path} cannot be loaded as {name}: {error}. It must be an undamaged PPO, A2C, DQN or MaskablePPO"
        ) from error


def _algorithm(data: dict[str, Any]) -> tuple[str, str]:
    """Module and name of the algorithm that wrote a file, by the settings it keeps.

    >>> _algorithm({"clip_range": 0.2, "policy_class": {"__module__": "stable_baselines3.common.policies"}})
    ('stable_baselines3', 'PPO')
    """
    if "sb3_contrib" in str(data.get("policy_class")):
        return "sb3_contrib", "MaskablePPO"
    if "exploration_fraction" in data:
        return "stable_baselines3", "DQN"
    return "stable_baselines3", "PPO" if "clip_range" in data else "A2C"
