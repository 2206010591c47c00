"""Every extreme is answered rightly or refused with a reason; and the judge is not to be fooled."""

import math
import re
import warnings
from pathlib import Path

import pytest

import belief
import belief.calibration
import belief.metrics
import belief.observation_model
import belief.statistics
from tests.extremes import commands, files, foreign, touch
from tests.extremes.cases import Verdict, answers, equal_to, judge, refuses, such_that

CASES = [(part.__name__.rpartition(".")[2], case) for part in (touch, files, commands, foreign) for case in part.CASES]
# Words, bases and results that have no extremes of their own, and what is met through a table.
WORDS = {
    "ActiveTouchError",
    "ZeroPriorTarget",
    "Probe",
    "Confirm",
    "Reject",
    "ObjectEvidence",
    "ObservationModel",
    "ArrayModel",
}
WORDS |= {"McNemar", "CalibrationError", "ReliabilityCurve", "ShapeScore", "StopScore", "Status"}
WORDS |= {"CalibrationAtStop", "CalibrationReport", "Choice", "Calibration", "CALIBRATIONS"}


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.parametrize(
    ("area", "case"), CASES, ids=[f"{area}: {case.entry}, {case.given}"[:90] for area, case in CASES]
)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(area, case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"


def test_there_are_more_than_a_hundred_cases_and_none_twice():
    names = [(case.entry, case.given) for _, case in CASES]
    assert len(names) >= 100
    assert len(set(names)) == len(names)


def test_every_public_name_of_belief_is_put_to_the_test():
    text = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    packages = (belief, belief.calibration, belief.metrics, belief.observation_model, belief.statistics)
    names = {name for package in packages for name in package.__all__} - WORDS
    assert not {name for name in names if not re.search(rf"\b{name}\b", text)}


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        (lambda: 2.0, equal_to(1.0)),
        (lambda: math.nan, equal_to(1.0)),
        (lambda: math.nan, such_that("finite", math.isfinite)),
        (lambda: warnings.warn("hm", stacklevel=1), such_that("anything", lambda _: True)),
        (lambda: 1 / 0, equal_to(math.inf)),
    ],
    ids=["wrong", "NaN", "NaN again", "a warning", "a crash"],
)
def test_what_is_not_the_right_answer_fails(run, expected):
    assert judge(answers("it", "something", run, expected)).verdict is Verdict.FAILED


@pytest.mark.parametrize(
    ("error", "pattern"),
    [(KeyError, "five"), (ValueError, "six"), (TypeError, "")],
    ids=["another type", "another message", "a type that is no base of it"],
)
def test_an_error_of_another_type_or_message_fails(error, pattern):
    assert judge(refuses("int", "a word", lambda: int("five"), error, pattern)).verdict is Verdict.FAILED
    assert judge(refuses("int", "a word", lambda: int("five"), ValueError, "five")).verdict is Verdict.REFUSED


def test_no_error_where_there_should_be_one_fails():
    assert judge(refuses("abs", "-1", lambda: abs(-1), ValueError, "")).verdict is Verdict.FAILED
