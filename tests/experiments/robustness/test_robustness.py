"""Conditions change what they name and nothing else; what a sensor then tells is measured pair by pair."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.distributions import Constant, Uniform
from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact
from activetouch.pressing.press import Press
from activetouch.pressing.setup import Setup
from activetouch.rendering import Blur, DeadTaxels, Hysteresis, Noise, Shift
from activetouch.rendering.faults import faults_of
from belief import Belief, Confirm, Probe, Reject, Touch, Unsure
from belief.errors import UnknownName
from belief.statistics import clopper_pearson_interval
from experiments.robustness.conditions import CONDITIONS, DoesNotApply, _together
from experiments.robustness.report import robustness_tables
from experiments.robustness.robustness import Robustness, condition_scores, robustness
from experiments.robustness.searches import _abstention, confidence_at_stops, search_scores
from experiments.robustness.strangers import alarms, e_values, stranger_scores
from experiments.robustness.touches import (
    AS_TRAINED,
    ClassifierOutputs,
    Quantity,
    applicable_conditions,
    measure_touches,
    quantity_rng,
)
from planners import Decision, Episode, Outcome, Step

COARSE = replace(SCENES["coarse"].scene, press_model=Quasistatic())
REPORT = {"scene": "coarse", "objects_per_shape": 4, "num_poses": 6, "unseen": {}, "left_out": {}}


@pytest.fixture(scope="module")
def sensor():
    return TactileSensor.shipped("coarse", COARSE, anyway=True)


def measured(sensor, scenes, num_objects=4):
    """Figures of all scenes, the first being the one trained in."""
    outputs = measure_touches(sensor, scenes, num_objects, seed=5, jobs=1)
    trained = next(iter(outputs.values()))
    return outputs, {name: condition_scores(some, trained, sensor.model, seed=5) for name, some in outputs.items()}


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
def test_a_condition_that_changes_nothing_makes_no_difference_at_all(sensor):
    # The first is pressed anew and draws a friction; the second reads the same presses through one more fault.
    drawn = replace(COARSE, variation=replace(COARSE.variation, friction=Uniform(1.0, 1.0)))
    idle = replace(COARSE, faults=(Hysteresis(0.0), *COARSE.faults))
    outputs, numbers = measured(sensor, {AS_TRAINED: COARSE, "drawn": drawn, "idle": idle})
    for name in ("drawn", "idle"):
        np.testing.assert_array_equal(outputs[name].logits, outputs[AS_TRAINED].logits)
        assert (numbers[name]["difference"], *numbers[name]["difference_interval"]) == (0.0, 0.0, 0.0)
        assert numbers[name] | {"difference": 0.0} == numbers[AS_TRAINED]


@pytest.mark.torch
def test_a_sensor_without_information_is_reported_at_chance(sensor):
    # Every image is the same, so one shape is named throughout: of equally many objects a shape, exactly a quarter is
    # right. As trained .708 of 12 000 touches were; below .35 here lie five standard errors even if the six touches of
    # each of the 40 objects were right or wrong together, a probability below 1e-5.
    scenes = {AS_TRAINED: COARSE, "all taxels dead": CONDITIONS["all taxels dead"](COARSE)}
    _, numbers = measured(sensor, scenes, num_objects=10)
    blank, trained = numbers["all taxels dead"], numbers[AS_TRAINED]
    assert blank["accuracy"] == 0.25
    assert blank["is_chance"]
    assert not trained["is_chance"]
    assert trained["accuracy"] > 0.35
    assert blank["difference"] == pytest.approx(0.25 - trained["accuracy"])
    assert blank["difference_interval"][0] <= blank["difference"] <= blank["difference_interval"][1]
    text = "\n".join(table.markdown() for table in robustness_tables(REPORT | {"conditions": numbers}))
    assert [line.split(" | ")[0] for line in text.splitlines() if "(chance)" in line] == ["| all taxels dead"]


@dataclass(frozen=True)
class Fragile(Press):
    """Presses like ``Quasistatic``, but gives up on what is larger than ``limit``."""

    limit: float

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        if placement.scale > self.limit:
            raise UnstablePress(f"{placement} is too large")
        return Quasistatic().press(setup, placement, target_force)


@pytest.mark.torch
def test_objects_that_cannot_be_pressed_are_missing_and_the_others_still_paired(sensor):
    outputs, numbers = measured(sensor, {AS_TRAINED: COARSE, "fragile": replace(COARSE, press_model=Fragile(1.02))})
    kept = np.isin(outputs[AS_TRAINED].numbers, outputs["fragile"].numbers)
    assert 0 < numbers["fragile"]["num_objects"] == kept.sum() < 16
    # Not bit by bit: batches of another size are multiplied in another order.
    np.testing.assert_allclose(outputs["fragile"].logits, outputs[AS_TRAINED].logits[kept], atol=1e-3)
    assert numbers["fragile"]["difference"] == 0.0


@pytest.mark.torch
def test_searches_and_stops_state_what_they_achieve_and_a_shy_decider_makes_the_same_searches(sensor):
    scenes = {AS_TRAINED: COARSE, "noise × 4": CONDITIONS["noise × 4"](COARSE)}
    outputs = measure_touches(sensor, scenes, 4, seed=5, jobs=1)
    trained = outputs[AS_TRAINED]
    numbers = {name: condition_scores(some, trained, sensor.model, seed=5) for name, some in outputs.items()}
    searched = search_scores(sensor, scenes, SCENES["coarse"], episodes=1, seed=0, jobs=1)
    assert list(searched) == list(scenes)
    for condition, row in numbers.items():
        own, found = row["models"]["rigid body"], searched[condition]
        assert 1.0 <= own["stops"]["touches"] <= 6.0
        assert 0.95 <= own["stops"]["stated"] <= 1.0
        assert found["number"] == 4
        assert found["touches"] > 0
        own["searches"] = found
    stops, searched_table = robustness_tables(REPORT | {"conditions": numbers})[1:]
    assert [len(table.columns) for table in (stops, searched_table)] == [7, 5]
    assert all("Largest gap: " in table.note for table in (stops, searched_table))
    [shy] = search_scores(sensor, {AS_TRAINED: COARSE}, SCENES["coarse"], 1, 0, 1, abstain=0.02).values()
    abstaining = shy.pop("abstaining")
    assert shy == searched[AS_TRAINED]
    assert abstaining["unsure"][1] <= abstaining["unsure"][0] <= abstaining["unsure"][2]
    assert all(low < high for _, low, high in (abstaining["wrong"], abstaining["unsure"]))  # of few searches, too
    assert abstaining["wrong"][0] + abstaining["unsure"][0] + abstaining["sure"]["number"] / 4 >= 1.0
    for row in numbers.values():
        row["models"]["rigid body"]["searches"]["abstaining"] = abstaining
    abstention = robustness_tables(REPORT | {"conditions": numbers})[3]
    assert len(abstention.rows) == len(numbers)
    assert len(abstention.rows[0]) == len(abstention.columns)


def test_no_stops_have_no_confidence():
    assert confidence_at_stops([], [], []) is None
    found = confidence_at_stops([0.96, 0.98], [True, False], [1, 3])
    assert (found["number"], found["touches"], found["stated"], found["achieved"]) == (2, 2.0, 0.97, 0.5)


def test_an_unknown_condition_is_refused_with_the_nearest(tmp_path):
    with pytest.raises(UnknownName, match="noise × 2"):
        Robustness("coarse", conditions=("noise x 2",), objects=2, out=tmp_path).run()


class Evidence:
    """Says its wealth: that of an object with logits x grows by x with every touch."""

    def __init__(self, wealth=0.0):
        self.log_bets = np.full(3, wealth)

    def update(self, touch):
        return Evidence(self.log_bets[0] + touch.logits[0])


def read(logits):
    """Outputs for objects of three shapes in turn, in four poses."""
    logits = np.asarray(logits, float)[:, None, None] * np.ones((1, 4, 3))
    return ClassifierOutputs(np.arange(len(logits)), np.arange(len(logits)) % 3, logits)


def test_strangers_are_distinguished_by_their_e_values_and_alarms_are_counted_of_each_shape(model, monkeypatch):
    model = replace(model, shape_labels=("a", "b", "c"), probs=np.full((4, 3, 3), 1 / 3))
    assert e_values(model, read([0.0]).singles()) is None  # no test
    assert stranger_scores(read([0.0] * 3), read([0.0] * 3), model, ("x", "y", "z"), 0) == {}
    monkeypatch.setattr(type(model), "start", lambda self: Evidence())
    found = stranger_scores(read([0.0] * 30), read([0.0, 1.0, 2.0] * 10), model, ("x", "y", "z"), 0)
    # The threshold is log(50) = 3.91: z exceeds it with the second touch, y with the fourth.
    assert {label: row["after"]["3"]["alarms"][0] for label, row in found.items()} == {
        "x": 0.0, "y": 0.0, "z": 1.0, "all": pytest.approx(1 / 3)}  # fmt: skip
    assert {row["after"]["3"]["false_alarms"][0] for row in found.values()} == {0.0}
    for score in ("conflict", "stranger"):
        separated = {label: row["after"]["3"]["auroc"][score][0] for label, row in found.items()}
        assert separated == {"x": 0.5, "y": 1.0, "z": 1.0, "all": pytest.approx(5 / 6)}
    assert [row["num_objects"] for row in found.values()] == [10, 10, 10, 30]
    assert alarms(np.array([[0.0, 9.0, 0.0], [0.0, 0.0, 3.9]]))[0] == 0.5  # an alarm stays


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
    sure = found["sure"]
    assert (sure["number"], sure["achieved"]) == (8, 7 / 8)
    assert sure["stated"] == pytest.approx((7 * 0.97 + 0.95) / 8)
    assert sure["touches"] == pytest.approx((7 * 2 + 4) / 8)
    for share, low, high in (found["wrong"], found["unsure"]):
        least, most = clopper_pearson_interval(round(12 * share), 12)
        assert low <= least
        assert high >= most
    for events, name in (([[doubt] * 3] * 2, "unsure"), ([[wrong] * 3] * 2, "wrong")):  # always: no point
        assert _abstention(events)[name] == [1.0, *clopper_pearson_interval(6, 6)]
    assert _abstention([[doubt]])["sure"] is None
    assert _abstention([[doubt]])["searches_to_alarm"] is _abstention([[doubt]])["touches_to_alarm"] is None


RECORDS = Path(__file__).parents[3] / "records" / "robustness"


def test_the_tables_hold_the_numbers_of_a_record():
    numbers = json.loads((RECORDS / "coarse.json").read_text())
    tables = {table.title.split(": ")[-1].split(" (")[0]: table for table in robustness_tables(numbers)}
    for part, title in (("stops", "objects touched in"), ("searches", "200 live searches by")):
        [table] = [table for name, table in tables.items() if name.startswith(title)]
        for (condition, row), cells in zip(numbers["conditions"].items(), table.rows, strict=True):
            own = row["models"]["rigid body"]
            ends = own[part]
            assert cells[0] == condition
            assert cells[-3:] == [ends["touches"], ends["stated"], ends["achieved"]]
            right = ends["success"] if part == "searches" else own["fused_accuracy"]
            assert cells[1].startswith(f"{right:.3f} [")
    stops = {name: row["models"]["rigid body"]["stops"] for name, row in numbers["conditions"].items()}
    gaps = {name: found["stated"] - found["achieved"] for name, found in stops.items()}
    informed = [name for name, row in numbers["conditions"].items() if not row["is_chance"]]
    worst = max(informed, key=lambda name: abs(gaps[name]))
    [table] = [table for name, table in tables.items() if name.startswith("objects touched in")]
    assert f"Largest gap: {gaps[worst]:+.3f} ({worst})." in table.note


@pytest.mark.torch
@pytest.mark.mujoco
@pytest.mark.slow
def test_the_report_does_not_depend_on_the_number_of_workers(tmp_path):
    names = ("noise × 2", "friction 0.3 to 1", "size ± 25 %")  # read through another fault, pressed anew, other objects
    Robustness("coarse", conditions=names, objects=2, seed=3, out=tmp_path, jobs=1).run()
    numbers = json.loads((tmp_path / "robustness.json").read_text())
    sensor = TactileSensor.shipped("coarse")
    again = robustness(sensor, SCENES["coarse"], conditions=names, objects=2, seed=3, jobs=2)
    for name in (AS_TRAINED, *names):
        row = numbers["conditions"][name]
        assert row["num_objects"] == 8
        assert row | {"models": {}} == again.numbers["conditions"][name] | {"models": {}}
    assert numbers["conditions"].keys() == {AS_TRAINED, *names}
    assert numbers["unseen"] == again.numbers["unseen"]
    assert set(numbers["unseen"]) > {"torus", "wedge", "all"}
    assert numbers["unseen"]["all"]["num_objects"] == 16
    assert (tmp_path / "robustness.md").read_text().count("\n| noise × 2 |") >= 2
    page = (tmp_path / "report.html").read_text()
    assert "it states" in page
    assert page.count("noise × 2") >= 3


def test_an_accuracy_below_chance_is_not_chance(model):
    shapes = np.arange(40) % 4
    logits = np.eye(4)[(shapes + 1) % 4][:, None].repeat(3, axis=1)  # always another shape
    wrong = ClassifierOutputs(np.arange(40), shapes, logits)
    numbers = condition_scores(wrong, wrong, model, seed=0)
    assert numbers["accuracy"] == 0.0
    assert numbers["accuracy_interval"] == [0.0, pytest.approx(1.0 - 0.025 ** (1 / 40))]
    assert not numbers["is_chance"]


def test_parts_objects_poses_and_seeds_have_chance_of_their_own():
    keys = [(seed, number, part, pose) for seed in (0, 1, 2**32) for number in (0, 1)
            for part in Quantity for pose in (0, 1)]  # fmt: skip
    assert len({quantity_rng(*key).integers(2**62) for key in keys}) == len(keys)
