"""Solved policies in a cache folder, so that processes and later runs need not solve the same problem again.

The folder is ``activetouch/plans`` in ``$XDG_CACHE_HOME`` (by default ``~/.cache``). The environment variable
``ACTIVETOUCH_PLANS`` names another folder; ``off`` turns the cache off. Files may be deleted at any time. They hold
arrays and one line of JSON; reading one runs no code (decision 0045).
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.errors import CannotWrite
from belief.files import array_digest, require_regular_file
from belief.identity import module_code
from belief.problem import Floats
from planners.pomdp.alpha_vectors import AlphaVectors
from planners.pomdp.problem import SearchTouchProblem
from planners.pomdp.stages import StagedProblem, staged
from planners.solve import solve
from planners.solve.policy import SearchPolicy
from planners.solve.policy_files import alpha_vectors, read_arrays, write_arrays

VARIABLE = "ACTIVETOUCH_PLANS"
"""Environment variable with the folder of plans; ``off`` turns the cache off."""
MOST_BYTES = 1 << 28
"""Size of all plans together; those that were not used for the longest time are deleted beyond it."""
CODE = tuple(
    f"planners.{name}"
    for name in (
        *(f"pomdp.{part}" for part in ("alpha_vectors", "belief_sampling", "repeat_aware", "solver", "stages")),
        "solve",
    )
)
"""Modules whose code determines the solution of a staged problem."""
_FORMAT = "activetouch plan 1"


class PlanCacheWarning(UserWarning):
    """A plan could not be read from the cache folder, or not be written there; it is solved all the same."""


def plan_folder() -> Path | None:
    """The cache folder; None if the cache is turned off."""
    named = os.environ.get(VARIABLE, "")
    if named:
        return None if named == "off" else Path(named)
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not cache.is_absolute():  # as the XDG specification has it
        try:
            cache = Path.home() / ".cache"
        except RuntimeError:  # there is no home
            return None
    return cache / "activetouch" / "plans"


def solve_once(
    problem: SearchTouchProblem | StagedProblem, rounds: Sequence[int], repeat_weights: Floats
) -> SearchPolicy:
    """:func:`planners.solve.solve`, from the cache folder where the same problem was solved before.

    Args:
        problem: a search, or a search as stages.
        rounds: number of simulated searches in each round.
        repeat_weights: see :func:`planners.solve.solve`.
    """
    folder = plan_folder()
    search = problem if isinstance(problem, StagedProblem) else staged(problem)
    if folder is None:
        return solve(problem, rounds=rounds, repeat_weights=repeat_weights)
    key = _key(search, rounds, repeat_weights)
    path = folder / f"{key}.npz"
    vectors = _read(path, key, search, len(repeat_weights) + 1)
    if vectors is None:
        policy = solve(problem, rounds=rounds, repeat_weights=repeat_weights)
        _write(path, key, policy)
        return policy
    return SearchPolicy(problem, vectors)


def _key(search: StagedProblem, rounds: Sequence[int], repeat_weights: Floats) -> str:
    """Digest of everything that determines the solution: the problem, the settings and the code."""
    arrays: dict[str, NDArray[Any]] = {"initial": search.initial, "outcome_probs": search.outcome_probs}
    arrays["repeat_weights"] = repeat_weights
    for number, stage in enumerate(search.stages):
        parts: dict[str, NDArray[Any] | None] = {"shapes": stage.shapes, "confirm": stage.confirm}
        parts |= {"reject": stage.reject, "moves": stage.moves}
        arrays |= {f"{name}_{number}": part for name, part in parts.items() if part is not None}
    numbers = float(search.touch_cost), float(search.discount), [int(num) for num in rounds]
    settings = [_FORMAT, array_digest(arrays), *numbers]
    return hashlib.sha256(json.dumps([*settings, np.__version__, *_code()]).encode()).hexdigest()


@lru_cache(maxsize=1)
def _code() -> tuple[str, ...]:
    return tuple(module_code(sys.modules[name]) for name in CODE)


def _read(path: Path, key: str, search: StagedProblem, num_touches: int) -> tuple[tuple[AlphaVectors, ...], ...] | None:
    """The alpha vectors in a file; None if there is none, or if it is damaged or something else."""
    try:
        content = require_regular_file(path, FileNotFoundError).read_bytes()
    except OSError:
        return None
    try:
        header, arrays = read_arrays(content, _FORMAT)
        if header["key"] != key:
            raise ValueError("it is the plan of another search")
        found = tuple(
            tuple(alpha_vectors(arrays, f"{number}_{touches}") for touches in range(num_touches))
            for number in range(len(search.stages))
        )
        num_actions = len(search.outcome_probs) + 2
        for stage, by_touches in zip(search.stages, found, strict=True):
            for vectors in by_touches:
                if vectors.alphas.shape[1] != len(stage.shapes) or not _within(vectors.actions, num_actions):
                    raise ValueError("its alpha vectors do not fit the search")
    except Exception as error:  # numpy and zipfile raise many kinds on damaged bytes
        warnings.warn(
            f"{path} is no plan of this search ({error}); the search is solved again, and the file replaced",
            PlanCacheWarning,
            stacklevel=2,
        )
        return None
    with suppress(OSError):
        os.utime(path)  # it was used
    return found


def _within(actions: NDArray[np.int64], num_actions: int) -> bool:
    return bool(((actions >= 0) & (actions < num_actions)).all())


def _write(path: Path, key: str, policy: SearchPolicy) -> None:
    arrays: dict[str, NDArray[Any]] = {}
    for number, by_touches in enumerate(policy.vectors):
        for touches, vectors in enumerate(by_touches):
            arrays |= {f"alphas_{number}_{touches}": vectors.alphas, f"actions_{number}_{touches}": vectors.actions}
    try:
        write_arrays(path, _FORMAT, {"key": key}, arrays)
        _make_room(path.parent)
    except CannotWrite as error:
        warnings.warn(
            f"the plan is not kept: {error}; {VARIABLE}=off turns the cache off", PlanCacheWarning, stacklevel=2
        )


def _make_room(folder: Path) -> None:
    """Delete the plans that were not used for the longest time, beyond :data:`MOST_BYTES`."""
    plans = []
    for path in folder.glob("*.npz"):
        with suppress(OSError):  # another process deleted it
            status = path.stat()
            plans.append((status.st_mtime_ns, status.st_size, path))
    total = 0
    for _, size, path in sorted(plans, reverse=True):
        total += size
        if total > MOST_BYTES:
            with suppress(OSError):
                path.unlink()
