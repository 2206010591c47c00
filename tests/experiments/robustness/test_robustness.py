"""Conditions change what they name and nothing else; what a sensor then tells is measured pair by pair."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.distributions import Constant
from activetouch.rendering import Blur, DeadTaxels, Noise, Shift
from activetouch.rendering.faults import faults_of
from belief.errors import UnknownName
from experiments.parallel import Shared
from experiments.robustness.conditions import AS_TRAINED, CONDITIONS, DoesNotApply, _together, applicable_conditions
from experiments.robustness.robustness import Robustness, RobustnessReport, press_paired, robustness

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


def test_a_condition_without_an_answer_has_no_gap(tmp_path):
    none = {
        "changed": 0,
        "presses": 160,
        "number": 4,
        "success": 0.0,
        "interval": [0.0, 0.6],
        "wrong": [0.0, 0.0, 0.6],
        "touches": 9.0,
    }
    report = RobustnessReport(REPORT | {"conditions": {AS_TRAINED: none | {"stated": None, "achieved": None}}})
    report.save(tmp_path)
    assert "gap" not in str(report)
    assert AS_TRAINED in (tmp_path / "report.html").read_text()


def test_a_condition_that_changes_nothing_says_so(tmp_path):
    row = {"presses": 160, "number": 4, "success": 1.0, "interval": [0.5, 1.0], "wrong": [0.0, 0.0, 0.6]}
    row |= {"touches": 9.0, "stated": 0.9, "achieved": 0.9}
    changed = {AS_TRAINED: 0, "friction 0.05": 3, "stiffness × 0.4": 0, "cone × 1.5": 40}
    report = RobustnessReport(REPORT | {"conditions": {name: row | {"changed": n} for name, n in changed.items()}})
    report.save(tmp_path)
    said = "change hardly anything here, so their searches tell nothing about them: friction 0.05 (3 of 160), "
    for text in (str(report), (tmp_path / "report.html").read_text(), (tmp_path / "robustness.md").read_text()):
        assert f"{said}stiffness × 0.4 (0 of 160)." in text
    assert [one[1] for one in report.tables()[0].rows] == [0.0, 3 / 160, 0.0, 0.25]


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("coarse", {"friction 0.3 to 1", "friction 0.05"}, {"size ± 25 %", "stiffness × 0.5 to 2", "noise × 2"}),
     ("paper", {"stiffness × 0.4", "stiffness × 0.5 to 2", "friction 0.05"}, {"size ± 25 %", "force 1 to 4 N"})],
)  # fmt: skip
def test_presses_are_paired_so_that_what_differs_is_the_condition_alone(name, least, most, monkeypatch):
    monkeypatch.setattr("experiments.robustness.robustness._PRESSES", 24)
    scene = SCENES[name].scene
    scenes, _ = applicable_conditions(scene, [*least, *most])
    images = dict(press_paired(Shared(scenes), 7, condition) for condition in scenes)
    share = {
        condition: np.mean((np.abs(np.stack(images[AS_TRAINED]).astype(int) - found) > 1).any(axis=(1, 2)))
        for condition, found in images.items()
    }
    assert {condition for condition in share if share[condition] == 0.0} == {AS_TRAINED, *least}
    assert all(share[condition] > 0.5 for condition in most)


@pytest.mark.parametrize("name", SCENES)
def test_friction_is_changed_alone_where_something_may_slide(name):
    scene = SCENES[name].scene
    scenes, left_out = applicable_conditions(scene, ["friction 0.05", "friction 0.3 to 1"])
    if not scene.press_model.moves:
        assert set(left_out.values()) == {"nothing slides in a quasistatic press"}
        return
    for changed in scenes.values():
        same = replace(changed.variation, friction=scene.variation.friction)
        assert replace(changed, variation=same) == scene


@pytest.mark.mujoco
def test_conditions_may_be_your_own(sensor, monkeypatch):
    monkeypatch.setattr("experiments.robustness.robustness._PRESSES", 4)
    own = {"louder": CONDITIONS["noise × 6"]}
    found = robustness(sensor, SCENES["coarse"], conditions=own, searches=1, seed=3)
    assert list(found.numbers["conditions"]) == [AS_TRAINED, "louder"]
    assert found.numbers["conditions"]["louder"]["changed"] == 4
    with pytest.raises(UnknownName, match="condition"):
        robustness(sensor, SCENES["coarse"], conditions=["louder"])


def test_an_unknown_condition_is_refused_with_the_nearest(tmp_path):
    with pytest.raises(UnknownName, match="noise × 2"):
        Robustness("coarse", conditions=("noise x 2",), out=tmp_path).run()


@pytest.mark.torch
@pytest.mark.mujoco
@pytest.mark.slow
def test_the_command_writes_a_page_and_the_same_numbers_as_the_function(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.robustness.robustness._PRESSES", 24)
    options = {"conditions": ("noise × 2",), "searches": 1, "seed": 3, "jobs": 1}
    Robustness("coarse", as_described=True, out=tmp_path, **options).run()
    numbers = json.loads((tmp_path / "robustness.json").read_text())
    again = robustness(
        TactileSensor.shipped("coarse"), SCENES["coarse"], name="coarse", conditions=["noise × 2"], searches=1, seed=3
    )
    assert numbers == json.loads(json.dumps(again.numbers))
    assert not numbers["doubts"]
    assert list(numbers["conditions"]) == [AS_TRAINED, "noise × 2"]
    [table] = again.tables()
    for row, found in zip(table.rows, numbers["conditions"].values(), strict=True):
        assert found["number"] == 4
        assert row[1] == found["changed"] / found["presses"]
        assert row[4:] == [found[name] for name in ("touches", "stated", "achieved")]
    assert [row["changed"] for row in numbers["conditions"].values()] == [0, 24]
    assert "hardly anything" not in table.note
    assert "Largest gap: " in table.note
    assert (tmp_path / "robustness.md").read_text().count("\n| noise × 2 |") == 1
    assert "noise × 2" in (tmp_path / "report.html").read_text()
