"""Searching by trained policies (paper §5.8): one network a target or one for all, run by numpy alone.

A policy is a small multilayer perceptron in one safetensors file: float32 weights, and in the header a card and a
SHA-256 of it all. Loading runs no code from the file.

>>> card = PolicyCard("paper", "cube", ("sphere", "cube"), ("front",), touch_limit=12)
>>> policy = Policy(card, (np.zeros((3, 6), np.float32),), (np.array([0.0, 1.0, 0.5], np.float32),))
>>> policy.scores(np.zeros((1, 6))).tolist()             # probe, CONFIRM, REJECT
[[0.0, 1.0, 0.5]]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from belief.codec import from_fields, to_fields
from belief.errors import ActiveTouchError, CorruptFile
from belief.files import in_file_name
from belief.policy_state import ENCODINGS, GOAL, WITH_GAINS, expected_gains, frame_probs, situation_of, state_size
from belief.problem import Confirm, Probe, Reject
from belief.sealed_tensors import read_tensors, write_tensors
from belief.validation import Floats
from planners.decider import Decision, InformationState

_FORMAT, _PARTS = "activetouch-policy-2", ("weight", "bias")


class MissingPolicy(ActiveTouchError, FileNotFoundError):
    """There is no trained policy for a target."""


class BadPolicy(CorruptFile):
    """A policy file is damaged, or was trained for other shapes or poses."""


class UnknownNormalization(UserWarning):
    """A policy's file does not say whether its observations were normalised."""


@dataclass(frozen=True)
class PolicyCard:
    """What a policy is and what it was trained for: the header of its file.

    ``state`` is a key of :data:`belief.policy_state.ENCODINGS`; ``target`` is empty for a policy that observes the
    target; ``touch_limit`` is T_max of one object; ``training`` is text for people.
    """

    state: str
    target: str
    shape_labels: tuple[str, ...]
    pose_labels: tuple[str, ...]
    touch_limit: int
    training: str = ""


@dataclass(frozen=True, eq=False)
class Policy:
    """A multilayer perceptron with tanh between its layers; weights ``(out, in)`` and biases ``(out,)``, float32."""

    card: PolicyCard
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]

    def __post_init__(self) -> None:
        card, num_shapes, num_poses = self.card, len(self.card.shape_labels), len(self.card.pose_labels)
        knows_target = card.target == "" if card.state == GOAL else card.target in card.shape_labels
        if card.state not in ENCODINGS or not knows_target or card.touch_limit < 1:
            raise BadPolicy(f"a policy needs a known state, a target among its shapes and a touch limit, got {card}")
        sizes = [state_size(card.state, num_shapes, num_poses)]
        for weight, bias in zip(self.weights, self.biases, strict=True):
            if weight.shape != (len(bias), sizes[-1]) or not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise BadPolicy(
                    f"layer {len(sizes) - 1} must be finite and read {sizes[-1]} numbers, got {weight.shape}"
                )
            sizes.append(len(bias))
        if sizes[-1] != num_poses + 2:
            raise BadPolicy(f"{num_poses} poses, CONFIRM and REJECT need {num_poses + 2} scores, got {sizes[-1]}")

    def scores(self, states: NDArray[np.floating]) -> Floats:
        """Logits of the poses, CONFIRM and REJECT, ``(B, P + 2)``, of states ``(B, S)``."""
        hidden = np.asarray(states, np.float64)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            hidden = np.tanh(hidden @ weight.T + bias)
        return np.asarray(hidden @ self.weights[-1].T + self.biases[-1])

    def save(self, path: Path) -> None:
        """Write the policy; raises CannotWrite."""
        layers = enumerate(zip(self.weights, self.biases, strict=True))
        tensors = {f"{name}_{i}": array for i, pair in layers for name, array in zip(_PARTS, pair, strict=True)}
        write_tensors(path, tensors, to_fields(self.card), _FORMAT)

    @classmethod
    def load(cls, path: Path) -> Policy:
        """The policy in a file."""
        try:
            tensors, fields = read_tensors(path, _FORMAT)
            weights, biases = (tuple(tensors[f"{name}_{i}"] for i in range(len(tensors) // 2)) for name in _PARTS)
            return cls(from_fields(PolicyCard, fields), weights, biases)
        except (KeyError, TypeError, ValueError) as error:  # of CorruptFile, too
            raise BadPolicy(f"{path} is no policy file: {error}") from error


def policy_file(state: str, target: str) -> str:
    """Name of a policy's file in its folder."""
    return f"{state}.safetensors" if state == GOAL else f"{state}-{in_file_name(target, '-')}.safetensors"


def load_ppo_policy(folder: Path | None, state: str, target: str) -> Policy:
    """The policy for a target in a folder."""
    path = None if folder is None else folder / policy_file(state, target)
    if path is None or not path.is_file():
        where = "given: a folder of policies is needed" if folder is None else f"in {folder}"
        raise MissingPolicy(f"no policy for the target {target!r} and the state {state!r} {where}")
    policy = Policy.load(path)
    if (policy.card.state, policy.card.target) != (state, "" if state == GOAL else target):
        raise BadPolicy(f"{path} is for the target {policy.card.target!r} and the state {policy.card.state!r}")
    return policy


@dataclass(frozen=True)
class PPODecider:
    """Follows the policy that was trained for the target, from a folder, object by object.

    It is a decider, and by :meth:`choose` a probe selector, which takes the best pose even if stopping is better. A
    policy was trained on one object at a time and knows of others only by the belief. After as many touches of one
    object as in its training, it has to decide.
    """

    policies: Path | None
    state: str = "paper"

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        policy = self._policy(info)
        scores = self.scores(info, policy)
        probs = frame_probs(scores)
        may_probe = len(info.history) < policy.card.touch_limit
        num_poses = info.problem.num_poses
        best = int(scores.argmax()) if may_probe else num_poses + int(scores[num_poses:].argmax())
        why = {"target_prob": info.target_prob, "confirm": float(probs[-2]), "reject": float(probs[-1])}
        if best < num_poses:
            return Decision(Probe(best), why)
        return Decision(Confirm() if best == num_poses else Reject(), why)

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        poses = self.scores(info, self._policy(info))[: info.problem.num_poses]
        return Decision(Probe(int(poses.argmax())), {"target_prob": info.target_prob})

    def files(self, target: str) -> tuple[Path, ...]:
        """Files that searches for this target read, each checked to hold a policy."""
        load_ppo_policy(self.policies, self.state, target)
        return () if self.policies is None else (self.policies / policy_file(self.state, target),)

    def _policy(self, info: InformationState) -> Policy:
        problem, folder = info.problem, self.policies
        target = problem.shape_labels[info.target]
        last = None if folder is None else written(folder / policy_file(self.state, target))
        policy = _cached_policy(folder, self.state, target, last)
        card = policy.card
        if (card.shape_labels, card.pose_labels) != (tuple(problem.shape_labels), tuple(problem.pose_labels)):
            raise BadPolicy(
                f"the policies in {self.policies} know the shapes {list(card.shape_labels)} and the poses "
                f"{list(card.pose_labels)}, the search has {list(problem.shape_labels)} and "
                f"{list(problem.pose_labels)}; this scene needs policies of its own"
            )
        return policy

    def scores(self, info: InformationState, policy: Policy) -> Floats:
        """Scores of the poses, CONFIRM and REJECT by a policy, ``(P + 2,)``."""
        return np.asarray(policy.scores(shown(info, self.state, policy.card.touch_limit))[0])


def shown(info: InformationState, state: str, touch_limit: int) -> Floats:
    """The state vector that an environment with this state and limit shows of the current object, as a batch of one."""
    log_probs = info.log_probs
    situation = situation_of(info.history, log_probs, info.problem.num_poses, touch_limit)
    if state in WITH_GAINS:
        situation = replace(situation, gains=expected_gains(info.evidence, log_probs, info.target)[None])
    return ENCODINGS[state](situation, info.target)


def written(path: Path) -> tuple[int, int] | None:
    """Time and size of a file, which change when it is rewritten; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


@lru_cache(maxsize=64)
def _cached_policy(folder: Path | None, state: str, target: str, written: tuple[int, int] | None) -> Policy:
    """The policy, read once in a process, and again when its file was rewritten."""
    return load_ppo_policy(folder, state, target)
