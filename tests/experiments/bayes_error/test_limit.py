"""The command chooses the estimator by the scene's images, and writes what it found."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch.errors import UnknownLikelihood
from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from activetouch.rendering import Gain, GelSightRenderer
from activetouch.sensor import TactileSensor
from belief.errors import UnknownName
from experiments.bayes_error.ambiguity import NEAR, AmbiguitySearch, _target, tally
from experiments.bayes_error.counterparts import Counterpart
from experiments.bayes_error.estimator import LimitStudy, chunks, paired_difference, share
from experiments.bayes_error.held_out import Stream, held_out_touch
from experiments.bayes_error.image_bank import log_posterior
from experiments.bayes_error.limit import Limit, has_few_taxels
from experiments.bayes_error.simulation import SimulatedBayes, by_shape, nll, summary
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.sensor.scores import read_images

ESTIMATORS = {"coarse": SimulatedBayes, "gel": AmbiguitySearch, "hard": AmbiguitySearch, "many": AmbiguitySearch}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_scene_has_the_estimator_its_images_ask_for(name):
    assert isinstance(Limit().estimator(SCENES[name].scene), ESTIMATORS[name])


def test_images_of_few_taxels_in_colour_have_no_closed_form():
    scene = SCENES["coarse"].scene
    assert has_few_taxels(scene)
    coloured = replace(scene, renderer=GelSightRenderer(), pad=replace(scene.pad, num_taxels=4))
    assert coloured.image_shape == (4, 4, 3)
    assert not has_few_taxels(coloured)


def test_too_few_touches_and_unknown_scenes_are_refused(tmp_path):
    with pytest.raises(BadArgument, match="at least 12"):
        Limit(SceneChoice("hard"), touches=11, out=tmp_path).run()
    with pytest.raises(UnknownName, match="fine"):
        Limit(SceneChoice("fine"), out=tmp_path).run()
    assert not list(tmp_path.iterdir())


def small(name, folder, jobs):
    return Limit(
        SceneChoice(name, fidelity="quasistatic"),
        touches=24,
        bayes=SimulatedBayes(bank=300, checked=300),
        ambiguity=AmbiguitySearch(pairs=1, bank=200, starts=1),
        out=folder,
        jobs=jobs,
    )


@pytest.mark.mujoco
@pytest.mark.parametrize(("bank", "checked", "images"), [(3000, 2500, 2000), (1000, 5000, 1000), (3000, 10, 1000)])
def test_the_images_of_the_second_bank_are_those_that_were_compared(bank, checked, images, tmp_path, monkeypatch):
    pressed = []

    def evidence(scene, noise, readings, shape, number, seed):
        pressed.append((type(scene.press_model), shape))
        return shape, number, np.zeros(len(readings))

    monkeypatch.setattr("experiments.bayes_error.simulation.log_evidence_of_slice", evidence)
    study = LimitStudy(TactileSensor.shipped("coarse"), 8, 0, 1, tmp_path)
    numbers = SimulatedBayes(bank=bank, checked=checked).measure(study).numbers
    assert numbers["pressed_as_the_scene_does"]["images_per_shape"] == images
    assert 1000 * pressed.count((type(study.scene.press_model), 0)) == images
    assert numbers["pressed_against_quasistatic"]["value"] == 0.0


def test_the_readings_and_poses_of_a_study_are_those_of_its_touches_in_whatever_order_they_come(tmp_path, monkeypatch):
    scene = replace(SCENES["coarse"].scene, press_model=Quasistatic())
    study = LimitStudy(replace(TactileSensor.shipped("coarse"), scene=scene), 60, 7, 1, tmp_path)
    module = "experiments.bayes_error.estimator"
    monkeypatch.setattr(f"{module}.run_tasks", lambda tasks, *_: [task() for task in reversed(tasks)])
    read, touches = study.read(), [held_out_touch(scene, 7, Stream.TEST, number) for number in range(60)]
    np.testing.assert_array_equal(read, [touch.reading for touch in touches])
    np.testing.assert_array_equal(study.shapes, [touch.shape for touch in touches])
    asked = []
    monkeypatch.setattr(f"{module}.read_images", lambda *given: asked.append(given[2]) or read_images(*given))
    logs = study.classify(read)
    np.testing.assert_array_equal(asked[0], [touch.pose for touch in touches])
    np.testing.assert_allclose(np.exp(logs).sum(axis=1), 1.0)
    alone = study.sensor.model.log_likelihood(study.sensor.read(read[33:34], [touches[33].pose]))
    np.testing.assert_allclose(logs[33], log_posterior(alone), atol=1e-4)


def test_bayes_rule_and_the_classifier_are_scored_on_the_same_touches(tmp_path, monkeypatch, rng):
    shapes = np.arange(40) % 4
    slices = rng.normal(size=(3, 40, 4))  # log likelihoods
    logits = rng.normal(size=(40, 4))
    monkeypatch.setattr(
        "experiments.bayes_error.simulation.log_evidence_of_slice",
        lambda scene, noise, readings, shape, number, seed: (shape, number, slices[number, :, shape]),
    )
    monkeypatch.setattr(LimitStudy, "read", lambda self: np.zeros((40, 4, 4), np.uint8))
    monkeypatch.setattr(LimitStudy, "classify", lambda self, readings: log_posterior(logits))
    study = LimitStudy(TactileSensor.shipped("coarse"), 40, 0, 1, tmp_path)
    found = SimulatedBayes(bank=3000, checked=0).measure(study)
    numbers, reader = found.numbers, np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    bayes = np.exp(slices).mean(axis=0)
    bayes /= bayes.sum(axis=1, keepdims=True)
    right, known = bayes.argmax(axis=1) == shapes, reader.argmax(axis=1) == shapes
    assert (numbers["limit"]["value"], numbers["classifier"]["value"]) == (right.mean(), known.mean())
    loss = [-np.log(probs[np.arange(40), shapes]) for probs in (bayes, reader)]
    assert numbers["classifier"]["nll"] == pytest.approx(loss[1].mean())
    assert numbers["difference"]["value"] == pytest.approx(right.mean() - known.mean())
    assert numbers["nll_difference"]["value"] == pytest.approx((loss[0] - loss[1]).mean())
    assert numbers["same_guess"] == np.mean(bayes.argmax(axis=1) == reader.argmax(axis=1))
    for k, label in enumerate(study.scene.shape_labels):
        assert numbers["limit_by_shape"][label] == right[shapes == k].mean()
        assert numbers["classifier_by_shape"][label] == known[shapes == k].mean()
    assert [row["images_per_shape"] for row in numbers["curve"]] == [1000, 3000]
    assert numbers["curve"][0]["accuracy"] == np.mean(slices[0].argmax(axis=1) == shapes)
    assert numbers["curve"][-1]["nll"] == pytest.approx(loss[0].mean())
    assert [row[0] for row in found.tables[0].rows][-1] == "classifier"


LABELS = SCENES["gel"].scene.shape_labels


@pytest.fixture
def searched(tmp_path, monkeypatch):
    """A search for counterparts of 12 touches, four of them misread, at distances by touch; and what it drew."""
    log_probs = np.log(np.full((12, 4), 0.1))
    shapes = np.arange(12) % 4
    log_probs[np.arange(12), shapes] = np.log(0.5)
    log_probs[np.arange(12), (shapes + 3) % 4] = np.log(0.3)  # the second most likely
    for touch, taken in ((0, 1), (4, 1), (5, 0), (2, 3)):
        log_probs[touch, taken] = 0.0
    distances, drawn = {0: 2.5, 4: 0.50049, 5: 1.5, 2: 9.0}, []

    def search(scene, wanted, starts):
        distance = distances.get(wanted.number, 4.0) if wanted.group != "control" else 0.1
        return wanted, Counterpart(distance, starts, np.zeros(1), np.zeros(1))

    monkeypatch.setattr("experiments.bayes_error.ambiguity._search", search)
    monkeypatch.setattr(AmbiguitySearch, "_starts", lambda self, study, wanted: dict.fromkeys(wanted, ()))
    monkeypatch.setattr("experiments.bayes_error.figures.draw_counterparts", lambda *given: drawn.append(given))
    monkeypatch.setattr(LimitStudy, "read", lambda self: None)
    monkeypatch.setattr(LimitStudy, "classify", lambda self, readings: log_probs)
    study = LimitStudy(TactileSensor.shipped("gel"), 12, 0, 1, tmp_path)
    return study, drawn


def test_counterparts_are_searched_of_the_shape_that_each_group_asks_for(searched):
    study, drawn = searched
    numbers = AmbiguitySearch(pairs=10).measure(study).numbers
    assert numbers["classifier"]["value"] == 8 / 12
    assert {group: entry["touches"] for group, entry in numbers["groups"].items()} == {
        "misread": 4, "right": 8, "control": 4,
    }  # fmt: skip
    asked = {(one["group"], one["touch"]): (one["shape"], one["other"]) for one in numbers["searches"]}
    for touch, taken in ((0, 1), (4, 1), (5, 0), (2, 3)):
        assert asked["misread", touch] == (LABELS[touch % 4], LABELS[taken])
        assert asked["control", touch] == (LABELS[touch % 4], LABELS[touch % 4])
    for touch in (1, 3, 6, 7, 8, 9, 10, 11):
        assert asked["right", touch] == (LABELS[touch % 4], LABELS[(touch + 3) % 4])
    assert [near["value"] for near in numbers["groups"]["misread"]["near"].values()] == [0.25, 0.5, 0.75]
    assert {one["distance"] for one in numbers["searches"]} == {2.5, 0.5, 1.5, 9.0, 4.0, 0.1}
    first, *others = numbers["pairs"].items()  # the most frequent confusion first
    assert (first[0], first[1]["touches"]) == (f"{LABELS[0]} taken for {LABELS[1]}", 2)
    assert first[1]["median"] == 1.5
    assert [entry["touches"] for _, entry in others] == [1, 1]
    [(_, pictures, _)] = drawn  # the nearest of each pair, nearest first, and none beyond 3
    assert [(one, other, found.distance) for one, other, found in pictures] == [
        (LABELS[0], LABELS[1], 0.5), (LABELS[1], LABELS[0], 1.5),
    ]  # fmt: skip


def test_as_many_misread_as_other_touches_are_searched_for(searched):
    study, _ = searched
    numbers = AmbiguitySearch(pairs=3).measure(study).numbers
    assert {entry["touches"] for entry in numbers["groups"].values()} == {3}
    of_group = [
        {one["touch"] for one in numbers["searches"] if one["group"] == name} for name in ("misread", "control")
    ]
    assert of_group[0] == of_group[1]


def test_counterparts_are_compared_with_what_the_sensor_would_read_without_noise(tmp_path):
    scene = replace(SCENES["gel"].scene, press_model=Quasistatic())
    assert any(isinstance(fault, Gain) for fault in scene.faults)
    study = LimitStudy(replace(TactileSensor.shipped("gel"), scene=scene), 12, 3, 1, tmp_path)
    for number in (0, 5):
        touch = held_out_touch(scene, 3, Stream.TEST, number)
        np.testing.assert_allclose(_target(study, number).image, touch.clean, atol=1e-9)


@pytest.mark.slow
@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.parametrize("name", ["coarse", "hard"])
def test_the_findings_are_written_whatever_the_number_of_workers(name, tmp_path):
    for jobs in (1, 2):
        small(name, tmp_path / str(jobs), jobs).run()
    first, second = ((tmp_path / jobs / "limit.json").read_text() for jobs in "12")
    assert first == second
    numbers = json.loads(first)
    assert (numbers["scene"], numbers["num_touches"]) == (name, 24)
    assert 0.0 < numbers["classifier"]["value"] <= 1.0
    assert f"{numbers['classifier']['value']:.4f}" in (tmp_path / "1" / "limit.md").read_text()
    figures = {path.name for path in (tmp_path / "1").iterdir()} - {"limit.json", "limit.md"}
    assert figures <= {"counterparts.png"}  # neither of two misread touches need have a counterpart


@pytest.mark.torch
def test_images_without_noise_are_refused_with_what_works_for_them(tmp_path):
    with pytest.raises(UnknownLikelihood, match=r"--learned-from.*force_patch_limit"):
        Limit(SceneChoice("paper"), out=tmp_path, jobs=1).run()


def test_a_smaller_expectation_than_one_is_the_mean_of_the_largest():
    log_probs = np.log([[0.7, 0.3], [0.4, 0.6]])
    found = summary(log_probs, np.array([0, 0]), 3)
    assert found["accuracy"] == 0.5
    assert found["expected_accuracy"] == pytest.approx(0.65)
    assert found["nll"] == pytest.approx(-(np.log(0.7) + np.log(0.4)) / 2)
    assert nll(log_probs, np.array([1, 1])) == pytest.approx(-(np.log(0.3) + np.log(0.6)) / 2)


def test_shares_by_shape_average_to_the_whole(rng):
    shapes, right = np.arange(40) % 4, rng.uniform(size=40) < 0.5
    assert np.mean(list(by_shape(right, shapes, tuple("abcd")).values())) == pytest.approx(right.mean())
    assert share(right)["value"] == right.mean()


def test_a_reader_does_not_differ_from_itself(rng):
    right = rng.uniform(size=50) < 0.5
    assert paired_difference(right, right, 0) == {"value": 0.0, "interval": (0.0, 0.0)}


def test_counterparts_are_counted_by_distance():
    found = tally([0.5, 1.5, 2.5, 10.0])
    assert [found["near"][f"{limit:g}"]["value"] for limit in NEAR] == [0.25, 0.5, 0.75]
    assert (found["touches"], found["median"]) == (4, 2.0)
    assert tally([]) == {"touches": 0, "near": {}, "median": None}


def test_chunks_hold_every_number_once():
    assert [number for numbers in chunks(11, 4) for number in numbers] == list(range(11))
    assert [len(numbers) for numbers in chunks(11, 4)] == [4, 4, 3]
