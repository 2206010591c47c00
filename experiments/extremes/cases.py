"""What a stress case is, and how what happens is judged.

A case hands something extreme to a public function. Two things may happen: the right answer, compared with what is
known beforehand, or an error of a stated type whose message says what was wrong. All else is a failure: a wrong answer,
NaN, a warning, an error of another type, or none where there should be one.
"""

from __future__ import annotations

import re
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


class Verdict(StrEnum):
    """How a case ended."""

    RIGHT = "right answer"
    REFUSED = "clear error"
    FAILED = "failed"


@dataclass(frozen=True)
class Expectation:
    """What should come out: a test of the answer, or a kind of error and a pattern that its message must match.

    Attributes:
        words: for the report.
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
    """Something extreme for a public function.

    Attributes:
        entry: the function, by its public name.
        given: in words.
        run: gives it.
        expected: what should come out.
        is_slow: takes more than about a second.
    """

    entry: str
    given: str
    run: Callable[[], Any]
    expected: Expectation
    is_slow: bool = False

    def __str__(self) -> str:
        return f"{self.entry}, {self.given}"


@dataclass(frozen=True)
class Finding:
    """What came of a case."""

    case: Case
    verdict: Verdict
    happened: str
    seconds: float


def answers(entry: str, given: str, run: Callable[[], Any], expected: Expectation, *, slow: bool = False) -> Case:
    """A case that has an answer."""
    return Case(entry, given, run, expected, slow)


def refuses(
    entry: str, given: str, run: Callable[[], Any], error: type[Exception], pattern: str, *, slow: bool = False
) -> Case:
    """A case that has none: the message of the error must match a pattern that names the cause."""
    return Case(entry, given, run, Expectation(f"{error.__name__} about “{pattern}”", None, error, pattern), slow)


def equal_to(value: ArrayLike, tolerance: float = 1e-9) -> Expectation:
    """The answer is this, within a tolerance relative to 1 or to itself, whichever is larger; infinities are equal."""
    shown = np.array2string(np.asarray(value), precision=4, threshold=6).replace("\n", "")

    def holds(answer: Any) -> bool:
        return bool(np.shape(answer) == np.shape(value) and np.allclose(answer, value, rtol=tolerance, atol=tolerance))

    return Expectation(shown, holds)


def such_that(words: str, holds: Callable[[Any], bool]) -> Expectation:
    """The answer has a property."""
    return Expectation(words, holds)


def in_folder(run: Callable[[Path], Any]) -> Callable[[], Any]:
    """Run something in an empty folder, which is gone afterwards."""

    def wrapped() -> Any:
        with tempfile.TemporaryDirectory() as name:
            return run(Path(name))

    return wrapped


def judge(case: Case) -> Finding:
    """Run a case with warnings as errors, and say what came of it."""
    started = time.perf_counter()
    expected = case.expected
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            answer = case.run()
            right = expected.holds is not None and expected.holds(answer)
        verdict, happened = (Verdict.RIGHT if right else Verdict.FAILED), f"answer: {_short(answer)}"
    except Exception as error:  # whatever it is, that is the finding
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
