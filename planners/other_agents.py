"""Agents of others as deciders: any function from an observation to an action, and policies of Stable-Baselines3.

``policy:module:attribute`` is a function. It gets what ``activetouch/ObjectTest-v0`` shows, one array, and returns an
action of it: the index of a pose, P for CONFIRM or P + 1 for REJECT. Nothing of this package needs to be in it. It must
depend on the observation alone. An agent with a memory is a class, ``policy:module:Agent(remembers=True)``: for every
decision a new one sees all observations of the object in their order, so that the same touches lead to the same action.

``sb3:PATH``, or ``sb3:PATH(normalize='vecnormalize.pkl')``, is a policy that Stable-Baselines3 saved. The size and the
range of its observation tell what it sees: the paper's state, the posterior, or this with the gain of each pose, alone
or followed by the target, one-hot. A recurrent policy sees the paper's state, and all observations of the object in
their order, too. Loading such a file runs code from it, so load only files that you trust.
"""

from __future__ import annotations

import inspect
import json
import pickle
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from belief.constraints import Checked, Choice, Count
from belief.errors import BrokenContract, MissingPackage, install_command
from belief.files import opened_zip, require_regular_file
from belief.policy_state import TOUCH_LIMIT, state_size
from belief.problem import Confirm, Probe, Reject
from belief.references import Reference
from belief.validation import require_choice, require_count
from planners.decider import Decision, InformationState
from planners.ppo import BadPolicy, MissingPolicy, UnknownNormalization, shown, written

_LEAST = {"paper": 0.0, "posterior": -1.0, "gains": -1.0}  # of what is observed; a whole search has "paper"'s size, too
STATES = tuple(_LEAST)
"""What a function may observe."""
_MOST_SETTINGS = 1 << 26  # of the settings in a file [bytes]


def observation(info: InformationState, state: str, sees_target: bool, touch_limit: int) -> NDArray[np.float32]:
    """What an environment with this state would show: of the current object, and the target, one-hot, if it is seen.

    Args:
        info: the information state.
        state: one of :data:`STATES`.
        sees_target: whether the target follows, as in ``ObjectTestGoal-v0``.
        touch_limit: T_max of the environment, in touches of one object.

    Returns:
        The observation, ``(S,)`` or, with the target, ``(S + K,)``.
    """
    target = np.arange(info.problem.num_shapes) == info.target
    return np.append(shown(info, state, touch_limit)[0], target if sees_target else ()).astype(np.float32)


def _observations(
    info: InformationState, state: str, sees_target: bool, touch_limit: int, remembers: bool
) -> Iterator[NDArray[np.float32]]:
    """The :func:`observation` now, after all earlier ones of the object if the agent remembers."""
    for number in range(0 if remembers else len(info.history), len(info.history) + 1):
        yield observation(replace(info, history=info.history[:number]), state, sees_target, touch_limit)


def decision(info: InformationState, action: int, touch_limit: int) -> Decision:
    """The decision that an action of the environment stands for; at the touch limit the more probable answer."""
    num_poses, scores = info.problem.num_poses, {"target_prob": info.target_prob}
    if action < num_poses:
        if len(info.history) < touch_limit:
            return Decision(Probe(action), scores)
        action = num_poses + (info.target_prob < 0.5)
    return Decision(Confirm() if action == num_poses else Reject(), scores)


@dataclass(frozen=True)
class FunctionPolicy:
    """Takes the action of a function, object by object.

    Attributes:
        act: the function, or its ``module:attribute``; a class is called without arguments.
        state: what it observes, one of :data:`STATES`.
        sees_target: whether the target follows, one-hot.
        touch_limit: T_max; after so many touches of one object the more probable answer is taken.
        remembers: whether ``act`` is a class without arguments whose instances are called with the observations of one
            object, of the state "paper", from the first to the last; what they return for the last one counts.

    Raises:
        InvalidArgument: the state is unknown, or is another than "paper" of what remembers, or the limit is below 1.
        BadReference: there is no such module, or its attribute cannot be called.
    """

    act: Callable[[NDArray[np.float32]], Any] | str
    state: str = "paper"
    sees_target: bool = False
    touch_limit: int = TOUCH_LIMIT
    remembers: bool = False

    def __post_init__(self) -> None:
        require_choice("state", self.state, STATES[:1] if self.remembers else STATES)
        require_count("touch_limit", self.touch_limit)
        found = Reference.parse(self.act).load() if isinstance(self.act, str) else self.act
        object.__setattr__(self, "act", found() if isinstance(found, type) and not self.remembers else found)
        if not callable(self.act):
            raise BrokenContract(f"a policy is a function from an observation to an action; {self.act!r:.80} is none")

    def prepare(self, info: InformationState) -> None:
        """Call the function once, so that it loads what it needs; raises as :meth:`decide`."""
        if callable(self.act) and not self.remembers:
            try:
                inspect.signature(self.act).bind(None)
            except TypeError as error:
                raise BrokenContract(f"a policy is called with one observation; {self.act!r:.80}: {error}") from error
            except ValueError:
                pass  # compiled functions tell no signature
        self.decide(info, np.random.default_rng(0))

    def knows_target(self, info: InformationState) -> bool:
        """Whether its observations depend on the target; those of "posterior" and "gains" hold its log-odds."""
        return self.sees_target or self.state != STATES[0]

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`.

        Raises:
            BrokenContract: the function returns no action of the environment.
        """
        assert not isinstance(self.act, str), "loaded at construction"
        act: Callable[..., Any] = self.act
        if self.remembers:
            act = act()
        for seen in _observations(info, self.state, self.sees_target, self.touch_limit, self.remembers):
            given = act(seen)
        found = np.asarray(given)
        most = info.problem.num_poses + 1
        if found.size != 1 or found.dtype.kind not in "iu" or not 0 <= int(found.reshape(())) <= most:
            name = getattr(self.act, "__name__", repr(self.act))
            raise BrokenContract(
                f"{name:.80} must return an action, an integer from 0 to {most}, got {given!r:.80}: poses are 0 to "
                f"{most - 2}, CONFIRM is {most - 1}, REJECT is {most}"
            )
        return decision(info, int(found.reshape(())), self.touch_limit)


@dataclass(frozen=True)
class SB3Policy(Checked):
    """Takes the best action of a saved policy, object by object.

    After ``touch_limit`` touches of one object it takes the more probable answer.

    Attributes:
        path: the file; ``{target}`` in it stands for the label of the target.
        touch_limit: T_max of the environment in which it learned. The file does not say it, nor the ``target_prob``
            with which it learned.
        normalize: file that ``VecNormalize.save`` wrote, of a policy that learned inside of it; ``{target}`` in it
            stands for the label of the target. Empty for none.
        state: what it sees; empty to tell it by its observation, which is the same for two where there are as many
            shapes as poses: "posterior" followed by the target, and "gains".
    """

    path: str
    touch_limit: Count = TOUCH_LIMIT
    normalize: str = ""
    state: Annotated[str, Choice(("", *_LEAST))] = ""

    def prepare(self, info: InformationState) -> None:
        """Load the policy and let it decide once; raises BadPolicy if it does not fit the search."""
        self.decide(info, np.random.default_rng(0))

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        model, state, sees_target, change = self._loaded(info)
        memory, begins = None, np.ones(1, np.bool_)
        for seen in _observations(info, state, sees_target, self.touch_limit, _remembers(model)):
            if change is not None:
                if np.shape(change.obs_rms.mean) != seen.shape:
                    raise BadPolicy(
                        f"{self.normalize} normalises observations of shape {np.shape(change.obs_rms.mean)}; "
                        f"{self.path} reads {seen.shape}"
                    )
                seen = change.normalize_obs(seen)
            action, memory = model.predict(seen, memory, begins, deterministic=True)
            begins = np.zeros(1, np.bool_)
        return decision(info, int(action), self.touch_limit)

    def knows_target(self, info: InformationState) -> bool:
        """Whether its observations, or the name of its file, depend on the target."""
        _, state, sees_target, _ = self._loaded(info)
        return sees_target or state != STATES[0] or "{target}" in self.path

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
        num_shapes, num_poses = info.problem.num_shapes, info.problem.num_poses
        # Earlier beliefs are not known, and a recurrent policy would see them.
        states = [state for state in (STATES[:1] if _remembers(model) else STATES) if self.state in ("", state)]
        sizes = {state: state_size(state, num_shapes, num_poses) for state in states}
        shape, actions = model.observation_space.shape, getattr(model.action_space, "n", None)
        least = np.min(getattr(model.observation_space, "low", np.nan))
        for state, size in sizes.items():
            for sees_target in (False, True):
                if (shape, least, actions) == ((size + sees_target * num_shapes,), _LEAST[state], num_poses + 2):
                    self._require_training(model, path, num_shapes)
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

    def _require_training(self, model: Any, path: Path, num_shapes: int) -> None:
        """Raise BadPolicy if the last tests of the training were longer, or their observations changed."""
        space, seen = model.observation_space, getattr(model, "_last_obs", None)
        remedy = f"name the file that its save() wrote, as in sb3:{path}(normalize='vecnormalize.pkl')"
        if not self.normalize and seen is not None:
            shares = np.asarray(seen)[..., :num_shapes].sum(axis=-1)  # every state begins with probabilities
            if (seen < space.low).any() or (seen > space.high).any() or (abs(shares - 1.0) > 1e-4).any():
                raise BadPolicy(f"{path} learned from observations that VecNormalize changed; {remedy}")
        elif not self.normalize and model.num_timesteps:
            warnings.warn(
                f"{path} keeps no observation of its training, so nothing tells whether VecNormalize changed them. "
                f"If it did, the decisions are wrong: {remedy}",
                UnknownNormalization,
                stacklevel=2,
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
        with opened_zip(require_regular_file(path, BadPolicy)) as file, file.open("data") as settings:
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
            f"{path} cannot be loaded as {name}: {error}. It must be an undamaged PPO, A2C, DQN, MaskablePPO or "
            "RecurrentPPO"
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
    policy = str(data.get("policy_class"))
    if "sb3_contrib" in policy:
        return "sb3_contrib", "RecurrentPPO" if "sb3_contrib.common.recurrent" in policy else "MaskablePPO"
    if "exploration_fraction" in data:
        return "stable_baselines3", "DQN"
    return "stable_baselines3", "PPO" if "clip_range" in data else "A2C"


def _remembers(model: Any) -> bool:
    """Whether a model of Stable-Baselines3 is recurrent."""
    return hasattr(model.policy, "lstm_actor")
