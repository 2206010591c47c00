"""Every extreme is answered rightly or refused with a reason; and the judge is not to be fooled."""

import csv
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
from experiments.command_line.arguments import BadArgument
from experiments.extremes.cases import Verdict, answers, equal_to, judge, refuses, such_that
from experiments.extremes.stress import AREAS, NotRobust, Stress, cases_of

_EXTREMES = Path(__file__).parents[2] / "extremes"
# The arguments are gone through, more strictly, in test_arguments.
CHEAP = [(area, case) for area in AREAS if area != "arguments" for case in cases_of(area)]
# Words, bases and results that have no extremes of their own, and what is met through a table.
WORDS = {"ActiveTouchError", "Probe", "Confirm", "Reject", "ObjectEvidence", "ObservationModel", "ArrayModel"}
WORDS |= {"McNemar", "BrierDecomposition", "CalibrationError", "ReliabilityCurve", "ShapeScore", "StopScore", "Status"}
WORDS |= {"CalibrationAtStop", "CalibrationReport", "Choice", "Calibration", "PerPose", "CALIBRATIONS"}
WORDS |= {"calibration_from_json", "GaussianModel", "PLDAModel", "RatioModel", "SignatureModel"}
WORDS |= {"FeatureEmbedding", "LogitEmbedding", "SceneView", "TouchHistory", "read_origin", "check_observation_model"}


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.parametrize(
    ("area", "case"), CHEAP, ids=[f"{area}: {case.entry}, {case.given}"[:90] for area, case in CHEAP]
)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(area, case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"


def test_there_are_more_than_a_hundred_cases_and_none_twice():
    names = [(case.entry, case.given) for area in AREAS for case in cases_of(area)]
    assert len(names) >= 100
    assert len(set(names)) == len(names)


def test_every_public_name_of_belief_is_put_to_the_test():
    text = "".join(path.read_text() for path in _EXTREMES.glob("test_*.py"))
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


def test_the_report_has_every_case_and_its_verdict_and_progress_is_shown(tmp_path, capsys):
    Stress(areas=("foreign",), out=tmp_path).run()
    said = capsys.readouterr().err
    with (tmp_path / "findings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["given"].lstrip("'") for row in rows] == [case.given for case in cases_of("foreign")]
    assert {row["verdict"] for row in rows} == {"clear error"}
    assert re.search(rf"stressing .*{len(rows)}/{len(rows)}", said)
    html = (tmp_path / "report.html").read_text()
    assert html.count("clear error") >= len(rows)
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)|<script[^>]*src""", html)


def test_no_area_is_refused(tmp_path):
    with pytest.raises(BadArgument, match="--areas"):
        Stress(areas=(), out=tmp_path).run()


def test_a_failure_is_reported_and_raised(tmp_path, monkeypatch):
    bad = answers("it", "something", lambda: 2.0, equal_to(1.0))
    monkeypatch.setattr("experiments.extremes.stress.cases_of", lambda area: [bad])
    with pytest.raises(NotRobust, match="1 of 1 cases failed"):
        Stress(areas=("files",), out=tmp_path).run()
    assert "failed" in (tmp_path / "findings.csv").read_text()
