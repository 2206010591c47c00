"""Conditions change what they name and nothing else; what a sensor then tells is measured pair by pair."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.distributions import Constant
from activetouch.rendering import Blur, DeadTaxels, Noise, Shift
from activetouch.rendering.faults import faults_of
from belief import Belief, Confirm, Probe, Reject, Touch, Unsure
from belief.errors import UnknownName
from belief.statistics import clopper_pearson_interval
from experiments.robustness.conditions import AS_TRAINED, CONDITIONS, DoesNotApply, _together, applicable_conditions
from experiments.robustness.robustness import Robustness, RobustnessReport, robustness
from experiments.robustness.searches import _abstention, search_scores
from planners import Decision, Episode, Outcome, Step

COARSE = replace(SCENES["coarse"].scene, press_model=Quasistatic())
REPORT = {"scene": "coarse", "left_out": {"4 bits": "no taxels"}}


@pytest.fixture(scope="module")
def sensor():
    return TactileSensor.shipped("coarse", COARSE, anyway=True)


def test_conditions_change_what_they_say_by_as_much_as_they_say():
    for name in ("coarse", "gel", "hard"):
        scene = SCENES[name].scene
        [noise] = faults_of(Noise, scene.faults)
        for factor in (1.5, 2, 3, 4, 6):
            found, louder = CONDITIONS[f"noise × {factor:g}"](scene), Noise(factor * noise.std)
            assert found == replace(scene, faults=tuple(louder if fault is noise else fault for fault in scene.faults))
        old = sum(fault.share for fault in faults_of(DeadTaxels, scene.faults))
        for words, share in (("5 % more dead", 0.05), ("19 % more dead", 3 / 16), ("all taxels dead", 1.0)):
            faults = CONDITIONS[words](scene).faults
            [dead] = faults_of(DeadTaxels, faults)
            assert dead.share == pytest.approx(min(old + share, 1.0))
            rest = [fault for fault in scene.faults if not isinstance(fault, DeadTaxels)]
            assert [fault for fault in faults if fault is not dead] == rest
        together, force = CONDITIONS["all of these"](scene), scene.variation.force.support
        assert together.variation.force.support == pytest.approx((0.7 * force[0], 1.3 * force[1]))
        assert together.variation.size.support == (0.75, 1.25)
        assert faults_of(Noise, together.faults)[0].std == pytest.approx(1.5 * noise.std)
    with pytest.raises(DoesNotApply, match="no range"):
        CONDITIONS["larger by ≤ 15 %"](replace(COARSE, variation=replace(COARSE.variation, size=Constant(1.0))))
    nothing = _together(CONDITIONS["noise × 2"], CONDITIONS["4 bits"])
    with pytest.raises(DoesNotApply, match="no noise"):
        nothing(SCENES["paper"].scene)


@pytest.mark.parametrize("name", SCENES)
def test_every_condition_changes_a_scene_or_is_left_out_with_a_reason(name):
    scene = SCENES[name].scene
    scenes, left_out = applicable_conditions(scene)
    assert scenes.keys() | left_out.keys() == {AS_TRAINED, *CONDITIONS}
    assert not scenes.keys() & left_out.keys()
    assert scenes[AS_TRAINED] is scene
    assert [label for label, changed in scenes.items() if changed == scene] == [AS_TRAINED]
    assert all(left_out.values())


@pytest.mark.parametrize(
    ("scene", "condition", "reason"),
    [
        (SCENES["paper"].scene, "noise × 2", "no noise"),
        (SCENES["paper"].scene, "4 bits", "not readings of taxels"),
        (SCENES["hard"].scene, "size ± 25 %", "was trained"),
        (SCENES["coarse"].scene, "1 % more dead", "1 % of its 16 taxels"),
        (SCENES["coarse"].scene, "shifted by 3 % of the edge", "less than one taxel"),
        (SCENES["keyed"].scene, "cylinder twice as long", "no cylinder"),
        (COARSE, "friction 0.3 to 1", "nothing slides"),
    ],
)
def test_what_means_nothing_in_a_scene_is_left_out(scene, condition, reason):
    scenes, left_out = applicable_conditions(scene)
    assert condition not in scenes
    assert reason in left_out[condition]


def test_the_pad_is_blurred_and_displaced_before_it_is_read_and_stuck_taxels_say_nothing_else():
    for name, kind in (("blurred by 1 taxel", Blur), ("shifted by 1 taxel", Shift)):
        assert isinstance(CONDITIONS[name](COARSE).faults[0], kind)
    assert CONDITIONS["shifted by 1 taxel"](COARSE).faults[0] == Shift(columns=1)
    assert CONDITIONS["shifted by 3 % of the edge"](SCENES["hard"].scene).faults[0] == Shift(columns=4)
    stuck = CONDITIONS["6 % stuck at full scale"](COARSE).faults[-1]
    read = stuck(np.zeros((4, 4)), np.random.default_rng(0))
    assert (read == 1.0).sum() == 1
    [dead] = faults_of(DeadTaxels, COARSE.faults)
    assert dead(read, np.random.default_rng(0)).max() == 1.0  # it is none of those that are dead


@pytest.mark.torch
def test_searches_state_what_they_achieve_and_a_shy_decider_makes_the_same_searches(sensor):
    scenes = {AS_TRAINED: COARSE, "noise × 4": CONDITIONS["noise × 4"](COARSE)}
    searched = search_scores(sensor, scenes, SCENES["coarse"], episodes=1, seed=0, jobs=1)
    assert list(searched) == list(scenes)
    for found in searched.values():
        assert found["number"] == 4
        assert found["touches"] > 0
    table, left = RobustnessReport(REPORT | {"conditions": searched}).tables()
    assert [row[0] for row in table.rows] == list(scenes)
    assert [row[-3:] for row in table.rows] == [
        [row[name] for name in ("touches", "stated", "achieved")] for row in searched.values()
    ]
    assert "Largest gap: " in table.note
    assert left.rows == [("4 bits", "no taxels")]
    shy = search_scores(sensor, scenes, SCENES["coarse"], 1, 0, 1, abstain=0.02)
    wide = RobustnessReport(REPORT | {"conditions": shy}).tables()[0]
    assert {len(row) for row in wide.rows} == {len(wide.columns)} == {len(table.columns) + 4}
    for name, row in shy.items():
        unsure = row.pop("abstaining")
        assert row == searched[name]
        assert all(low < high for _, low, high in (unsure["wrong"], unsure["unsure"]))  # of few searches, too
        assert unsure["unsure"][1] <= unsure["unsure"][0] <= unsure["unsure"][2]


def test_a_condition_without_an_answer_has_no_gap_and_is_not_drawn(tmp_path):
    none = {"number": 4, "success": 0.0, "interval": [0.0, 0.6], "wrong": [0.0, 0.0, 0.6], "touches": 9.0}
    report = RobustnessReport(REPORT | {"conditions": {AS_TRAINED: none | {"stated": None, "achieved": None}}})
    report.save(tmp_path)
    assert "gap" not in str(report)
    assert AS_TRAINED in (tmp_path / "report.html").read_text()


def test_an_unknown_condition_is_refused_with_the_nearest(tmp_path):
    with pytest.raises(UnknownName, match="noise × 2"):
        Robustness("coarse", conditions=("noise x 2",), out=tmp_path).run()


def episode(outcome, success=False, reason=None, stated=0.9, touched=2):
    target = 0 if success or outcome is not Outcome.CONFIRMED else 1
    action = {Outcome.CONFIRMED: Confirm(), Outcome.UNSURE: Unsure(), Outcome.EXHAUSTED: Reject()}[outcome]
    belief = Belief.from_probs(("a", "b"), (0.9, 0.1))
    steps = [Step(0, belief, Decision(Probe(0)), Touch(0, np.zeros(2)))] * touched
    last = Step(0, belief, Decision(action, {"answer_prob": stated} | ({} if reason is None else {reason: 1.0})), None)
    return Episode((0, target, 0), target, (0,), (*steps, last), outcome)


def test_what_robots_that_may_be_unsure_did_is_counted():
    right, wrong = episode(Outcome.CONFIRMED, True, stated=0.97), episode(Outcome.CONFIRMED, stated=0.95, touched=4)
    doubt, alarm = (episode(Outcome.UNSURE, reason=reason) for reason in ("is_doubtful", "is_conflict"))
    found = _abstention([[right, doubt, alarm, alarm], [right, wrong, right, right], [alarm, right, right, right]])
    assert (found["alarms"], found["searches_to_alarm"]) == (2, 2.0)  # in the third search, and in the first
    assert found["touches_to_alarm"] == 4.0  # of six, and of two
    assert (found["wrong"][0], found["unsure"][0]) == (pytest.approx(1 / 12), pytest.approx(4 / 12))
    assert found["right"] == [7 / 8, *clopper_pearson_interval(7, 8)]
    for share, low, high in (found["wrong"], found["unsure"]):
        least, most = clopper_pearson_interval(round(12 * share), 12)
        assert low <= least
        assert high >= most
    for events, name in (([[doubt] * 3] * 2, "unsure"), ([[wrong] * 3] * 2, "wrong")):  # always: no point
        assert _abstention(events)[name] == [1.0, *clopper_pearson_interval(6, 6)]
    assert _abstention([[doubt]])["right"] is None
    assert _abstention([[doubt]])["searches_to_alarm"] is _abstention([[doubt]])["touches_to_alarm"] is None


@pytest.mark.torch
@pytest.mark.mujoco
@pytest.mark.slow
def test_the_command_writes_a_page_and_the_same_numbers_as_the_function(tmp_path):
    Robustness("coarse", conditions=("noise × 2",), searches=1, seed=3, out=tmp_path, jobs=1).run()
    numbers = json.loads((tmp_path / "robustness.json").read_text())
    again = robustness(
        TactileSensor.shipped("coarse"), SCENES["coarse"], name="coarse", conditions=["noise × 2"], searches=1, seed=3
    )
    assert numbers == json.loads(json.dumps(again.numbers))
    assert list(numbers["conditions"]) == [AS_TRAINED, "noise × 2"]
    assert (tmp_path / "robustness.md").read_text().count("\n| noise × 2 |") == 1
    assert (tmp_path / "report.html").read_text().count("noise × 2") >= 2
