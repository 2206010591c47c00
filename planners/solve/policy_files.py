"""Solved policies on disk: arrays and a line of JSON, and never code.

A policy holds only for the observation model it was solved for, so its file says which that was, by content.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import ActiveTouchError, CorruptFile
from belief.files import atomic_path, sealed_json, unsealed_json
from belief.problem import Floats
from planners.pomdp.alpha_vectors import Plans
from planners.pomdp.problem import SearchTouchProblem, TouchProblem
from planners.solve.policy import SearchPolicy, TouchPolicy

_FORMAT = "activetouch policy 2"
_MOST_BYTES = 1 << 30  # that a file may unpack to


class PolicyMismatch(ActiveTouchError, ValueError):
    """A policy was solved for another observation model than the one at hand."""


class CorruptPolicy(CorruptFile):
    """A file is no policy, or a damaged one."""


def save_policy(path: Path, policy: TouchPolicy | SearchPolicy) -> None:
    """Write a policy, whole or not at all.

    Args:
        path: the file; conventionally ends in ``.npz``.
        policy: what to write.

    Raises:
        CannotWrite: the disk is full, or the folder cannot be written to.
    """
    problem = policy.problem
    header: dict[str, Any] = {
        "format": _FORMAT,
        "model_sha256": table_sha256(problem.outcome_probs),
        "target": int(problem.target),
        "touch_cost": float(problem.touch_cost),
        "discount": float(problem.discount),
    }
    if isinstance(problem, SearchTouchProblem):
        header |= {"num_objects": problem.num_objects, "composition": str(problem.composition)}
    stages = policy.stages if isinstance(policy, SearchPolicy) else (policy.plans,)
    arrays: dict[str, Any] = {"outcome_probs": problem.outcome_probs}
    assert problem.prior is not None, "filled in at construction"
    arrays["prior"] = problem.prior
    for number, plans in enumerate(stages):
        arrays |= {f"alphas_{number}": plans.alphas, f"actions_{number}": plans.actions}
    header["arrays_sha256"] = _arrays_sha256(arrays)
    content = {"header": np.array(sealed_json(header, indent=None)), **arrays}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **content)


def load_policy(path: Path, outcome_probs: ArrayLike | None = None) -> TouchPolicy | SearchPolicy:
    """Read a policy.

    Args:
        path: the file.
        outcome_probs: the observation model at hand, ``(P, K, M)``, to be sure that the policy is for it.

    Raises:
        CorruptPolicy: the file is no policy, or damaged.
        PolicyMismatch: it was solved for another observation model.
    """
    content = path.read_bytes()
    try:
        header, arrays = _unpacked(content)
        policy = _policy(header, arrays)
    except Exception as error:  # what numpy and zipfile raise on damaged bytes is no closed list
        raise CorruptPolicy(f"{path} is no policy that can be read: {error}; solve again and save it") from error
    solved_for = table_sha256(policy.problem.outcome_probs)
    if solved_for != header["model_sha256"]:
        raise CorruptPolicy(f"{path} holds another observation model than its header says: the file was changed")
    if outcome_probs is not None and table_sha256(outcome_probs) != solved_for:
        raise PolicyMismatch(
            f"{path} was solved for the observation model {solved_for[:12]}, the one at hand is "
            f"{table_sha256(outcome_probs)[:12]}; solve again for this one"
        )
    return policy


def _unpacked(content: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays, once their digests are checked."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > _MOST_BYTES:
        raise ValueError(f"it would unpack to {size} bytes, more than {_MOST_BYTES}")
    with np.load(io.BytesIO(content), allow_pickle=False) as found:
        arrays = {name: found[name] for name in found.files}
    header = unsealed_json(str(arrays.pop("header")))
    if header["format"] != _FORMAT:
        raise ValueError(f"its format is {header['format']!r}, this reads {_FORMAT!r}")
    if header["arrays_sha256"] != _arrays_sha256(arrays):
        raise ValueError("it was changed after it was written: its arrays do not match their SHA-256")
    return header, arrays


def _arrays_sha256(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Of all arrays with their names, types and shapes."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    return digest.hexdigest()


def table_sha256(outcome_probs: ArrayLike) -> str:
    """Fingerprint of an observation model's outcome table, to the last bit.

    >>> table_sha256([[[0.5, 0.5]]])[:12]
    '38ffe0147c9c'
    """
    table = np.ascontiguousarray(outcome_probs, np.float64)
    return hashlib.sha256(repr(table.shape).encode() + table.astype("<f8").tobytes()).hexdigest()


def _policy(header: dict[str, Any], arrays: dict[str, Any]) -> TouchPolicy | SearchPolicy:
    table, prior = arrays["outcome_probs"], arrays["prior"]
    target, cost, discount = header["target"], header["touch_cost"], header["discount"]
    if "num_objects" not in header:
        single = TouchProblem(table, prior, target, cost, discount)
        return TouchPolicy(single, _plans(arrays, 0))
    given: Floats | None = prior if header["composition"] == "independent" else None
    search = SearchTouchProblem(table, header["num_objects"], header["composition"], target, cost, given, discount)
    return SearchPolicy(search, tuple(_plans(arrays, number) for number in range(search.num_objects)))


def _plans(arrays: dict[str, Any], number: int) -> Plans:
    alphas, actions = arrays[f"alphas_{number}"], arrays[f"actions_{number}"]
    if alphas.dtype.kind != "f" or actions.dtype.kind != "i" or not len(alphas):
        raise ValueError(f"plans of object {number} are no numbers")
    if alphas.ndim != 2 or actions.shape != alphas.shape[:1] or not np.isfinite(alphas).all():
        raise ValueError(f"plans of object {number} are damaged")
    return Plans(np.asarray(alphas, np.float64), np.asarray(actions, np.int64))
