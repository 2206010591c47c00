"""Extreme inputs, and the judgement of their outcomes.

A case passes an extreme input to a public function. It must give the right answer, which is known in advance, or an
error of a stated type whose message names the cause. Anything else is a failure: a wrong answer, NaN, a warning,
another error, or no error where one is expected.
"""

from __future__ import annotations

import re
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


class Verdict(StrEnum):
    """Outcome of a case."""

    RIGHT = "right answer"
    REFUSED = "clear error"
    FAILED = "failed"


@dataclass(frozen=True)
class Expectation:
    """Expected outcome: a test of the answer, or a type of error and a pattern that its message must match.

    Attributes:
        words: description for the report.
        holds: whether an answer is right; None where an error is expected.
        error: type of the error.
        pattern: regular expression for its message.
    """

    words: str
    holds: Callable[[Any], bool] | None = None
    error: type[Exception] | None = None
    pattern: str = ""


@dataclass(frozen=True)
class Case:
    """An extreme input to a public function.

    Attributes:
        entry: public name of the function.
        given: description of the input.
        run: calls the function.
        expected: the expected outcome.
    """

    entry: str
    given: str
    run: Callable[[], Any]
    expected: Expectation

    def __str__(self) -> str:
        return f"{self.entry}, {self.given}"


@dataclass(frozen=True)
class Finding:
    """Outcome of one case."""

    case: Case
    verdict: Verdict
    happened: str
    seconds: float


def answers(entry: str, given: str, run: Callable[[], Any], expected: Expectation) -> Case:
    """A case with an answer."""
    return Case(entry, given, run, expected)


def refuses(entry: str, given: str, run: Callable[[], Any], error: type[Exception], pattern: str) -> Case:
    """A case with an error, whose message must match a pattern that names the cause."""
    return Case(entry, given, run, Expectation(f"{error.__name__} about “{pattern}”", None, error, pattern))


def refusals(
    entry: str, error: type[Exception], cases: Mapping[str, tuple[Callable[[], Any], str]]
) -> tuple[Case, ...]:
    """Cases of one function with the same type of error: call and pattern by description."""
    return tuple(refuses(entry, given, run, error, pattern) for given, (run, pattern) in cases.items())


def equal_to(value: ArrayLike, tolerance: float = 1e-9) -> Expectation:
    """The answer equals a value, up to a relative and absolute tolerance; infinities are equal."""
    shown = np.array2string(np.asarray(value), precision=4, threshold=6).replace("\n", "")

    def holds(answer: Any) -> bool:
        return bool(np.shape(answer) == np.shape(value) and np.allclose(answer, value, rtol=tolerance, atol=tolerance))

    return Expectation(shown, holds)


def such_that(words: str, holds: Callable[[Any], bool]) -> Expectation:
    """The answer has a property."""
    return Expectation(words, holds)


def in_folder(run: Callable[[Path], Any]) -> Callable[[], Any]:
    """Run a function in an empty folder that is deleted afterwards."""

    def wrapped() -> Any:
        with tempfile.TemporaryDirectory() as name:
            return run(Path(name))

    return wrapped


def judge(case: Case) -> Finding:
    """Run a case with warnings as errors and judge the outcome."""
    started = time.perf_counter()
    expected = case.expected
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            answer = case.run()
            right = expected.holds is not None and expected.holds(answer)
        verdict, happened = (Verdict.RIGHT if right else Verdict.FAILED), f"answer: {_short(answer)}"
    except Exception as error:  # any error is a finding
        typed = expected.error is not None and isinstance(error, expected.error)
        clear = typed and re.search(expected.pattern, str(error)) is not None
        verdict = Verdict.REFUSED if clear else Verdict.FAILED
        happened = f"{type(error).__name__}: {error}"
        if not clear:
            last = traceback.extract_tb(error.__traceback__)[-1]
            happened += f" ({Path(last.filename).name}:{last.lineno})"
    return Finding(case, verdict, happened, time.perf_counter() - started)


def _short(answer: Any, length: int = 160) -> str:
    text = " ".join(repr(answer).split())
    return text if len(text) <= length else text[: length - 1] + "…"
