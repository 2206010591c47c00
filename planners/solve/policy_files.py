"""Files of solved policies: arrays and one line of JSON, without code.

A policy is valid only for the observation model it was solved for, so its file holds a digest of that model.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import ActiveTouchError, CorruptFile, InvalidArgument
from belief.files import atomic_path, read_npz, require_regular_file, sealed_json, unsealed_json
from belief.observation_model import OutcomeTable
from belief.problem import Floats
from planners.pomdp.alpha_vectors import AlphaVectors
from planners.pomdp.problem import SearchTouchProblem, TouchProblem
from planners.pomdp.stages import StagedProblem
from planners.solve.policy import SearchPolicy, TouchPolicy

_FORMAT = "activetouch policy 3"
_MOST_BYTES = 1 << 30  # of an unpacked file whose header does not say how large it is
_MOST_HEADER = 1 << 20  # of the header, and of the headers of all arrays


class PolicyMismatch(ActiveTouchError, ValueError):
    """A policy was solved for another observation model than the one at hand."""


class CorruptPolicy(CorruptFile):
    """A file is not a policy, or is damaged."""


def save_policy(path: Path, policy: TouchPolicy | SearchPolicy) -> None:
    """Write a policy to a file, conventionally ``.npz``, atomically.

    Raises:
        InvalidArgument: it was solved for stages and not for a :class:`SearchTouchProblem`.
        CannotWrite: the disk is full, or the folder cannot be written to.
    """
    problem = policy.problem
    if isinstance(problem, StagedProblem):
        raise InvalidArgument(
            "only the policy of a SearchTouchProblem or a TouchProblem can be saved; this one was solved for stages "
            "with fewer hidden states than the search"
        )
    header: dict[str, Any] = {
        "model_sha256": OutcomeTable(problem.outcome_probs).sha256,
        "target": int(problem.target),
        "touch_cost": float(problem.touch_cost),
        "discount": float(problem.discount),
    }
    if isinstance(problem, SearchTouchProblem):
        header |= {"num_objects": int(problem.num_objects), "composition": str(problem.composition)}
    by_object = policy.vectors if isinstance(policy, SearchPolicy) else ((policy.vectors,),)
    header["num_touches"] = len(by_object[0])
    arrays: dict[str, Any] = {"outcome_probs": problem.outcome_probs}
    assert problem.prior is not None, "filled in at construction"
    arrays["prior"] = problem.prior
    for number, by_touches in enumerate(by_object):
        for touches, vectors in enumerate(by_touches):
            arrays |= {f"alphas_{number}_{touches}": vectors.alphas, f"actions_{number}_{touches}": vectors.actions}
    write_arrays(path, _FORMAT, header, arrays, compressed=True)


def write_arrays(
    path: Path, name: str, fields: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], compressed: bool = False
) -> None:
    """Write arrays and fields, with digests of both, atomically.

    Args:
        path: of the file.
        name: of the format.
        fields: JSON types.
        arrays: by name; not ``header``.
        compressed: whether to compress them.

    Raises:
        CannotWrite: the disk is full, or the folder cannot be written to.
    """
    size = sum(array.nbytes for array in arrays.values()) + _MOST_HEADER
    header = {"format": name, **fields, "unpacked_bytes": size, "arrays_sha256": _arrays_sha256(arrays)}
    content: dict[str, Any] = {"header": np.array(sealed_json(header, indent=None)), **arrays}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        (np.savez_compressed if compressed else np.savez)(file, allow_pickle=False, **content)


def load_policy(path: Path, outcome_probs: ArrayLike | None = None) -> TouchPolicy | SearchPolicy:
    """Read a policy; ``outcome_probs (P, K, M)``, if given, is the table for which it must have been solved.

    Raises:
        CorruptPolicy: the file is not a policy, or is damaged.
        PolicyMismatch: it was solved for another observation model.
    """
    content = require_regular_file(path, CorruptPolicy).read_bytes()
    try:
        header, arrays = read_arrays(content, _FORMAT)
        policy = _policy(header, arrays)
    except Exception as error:  # numpy and zipfile raise many kinds on damaged bytes
        raise CorruptPolicy(f"{path} cannot be read as a policy: {error}; solve again and save it") from error
    solved_for = OutcomeTable(policy.problem.outcome_probs).sha256
    if solved_for != header["model_sha256"]:
        raise CorruptPolicy(f"{path} holds another observation model than its header says: the file was changed")
    expected = solved_for if outcome_probs is None else OutcomeTable(np.asarray(outcome_probs)).sha256
    if expected != solved_for:
        raise PolicyMismatch(
            f"{path} was solved for the observation model {solved_for[:12]}, not for {expected[:12]}; solve again"
        )
    return policy


def read_arrays(content: bytes, name: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Fields and arrays of a file from :func:`write_arrays`, once their digests are checked.

    Args:
        content: bytes of the file.
        name: of the format.

    Raises:
        Exception: it is something else, or damaged; numpy and zipfile raise many kinds.
    """
    header = unsealed_json(str(read_npz(content, _MOST_HEADER, ["header"])["header"]))
    if header["format"] != name:
        raise ValueError(f"its format is {header['format']!r}, this reads {name!r}")
    arrays = read_npz(content, min(header.get("unpacked_bytes", _MOST_BYTES), _MOST_BYTES))
    del arrays["header"]
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


def _policy(header: dict[str, Any], arrays: dict[str, Any]) -> TouchPolicy | SearchPolicy:
    table, prior = arrays["outcome_probs"], arrays["prior"]
    target, cost, discount = header["target"], header["touch_cost"], header["discount"]
    if "num_objects" not in header:
        single = TouchProblem(table, prior, target, cost, discount)
        return TouchPolicy(single, alpha_vectors(arrays, "0_0"))
    given: Floats | None = prior if header["composition"] == "independent" else None
    search = SearchTouchProblem(table, header["num_objects"], header["composition"], target, cost, given, discount)
    touches = range(header["num_touches"])
    by_object = [
        tuple(alpha_vectors(arrays, f"{number}_{count}") for count in touches) for number in range(search.num_objects)
    ]
    return SearchPolicy(search, tuple(by_object))


def alpha_vectors(arrays: Mapping[str, Any], name: str) -> AlphaVectors:
    """The alpha vectors ``alphas_NAME`` and ``actions_NAME``.

    Args:
        arrays: from :func:`read_arrays`.
        name: of the set.

    Raises:
        KeyError: they are missing.
        ValueError: they are no alpha vectors.
    """
    alphas, actions = arrays[f"alphas_{name}"], arrays[f"actions_{name}"]
    if alphas.dtype.kind != "f" or actions.dtype.kind != "i" or not len(alphas):
        raise ValueError(f"the alpha vectors {name} are not numbers")
    if alphas.ndim != 2 or actions.shape != alphas.shape[:1] or not np.isfinite(alphas).all():
        raise ValueError(f"the alpha vectors {name} are damaged")
    return AlphaVectors(np.asarray(alphas, np.float64), np.asarray(actions, np.int64))
