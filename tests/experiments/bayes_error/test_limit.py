"""The command chooses the estimator by the scene's images, and writes what it found."""

import json

import numpy as np
import pytest

from activetouch.errors import UnknownLikelihood
from activetouch.named_scenes import SCENES
from activetouch.sensor import TactileSensor
from belief.errors import UnknownName
from experiments.bayes_error.ambiguity import NEAR, AmbiguitySearch, tally
from experiments.bayes_error.estimator import LimitStudy, chunks, paired_difference, share
from experiments.bayes_error.limit import Limit
from experiments.bayes_error.simulation import SimulatedBayes, by_shape, nll, summary
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice

ESTIMATORS = {"coarse": SimulatedBayes, "gel": AmbiguitySearch, "hard": AmbiguitySearch, "many": AmbiguitySearch}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_scene_has_the_estimator_its_images_ask_for(name):
    assert isinstance(Limit().estimator(SCENES[name].scene), ESTIMATORS[name])


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
