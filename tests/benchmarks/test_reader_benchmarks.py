"""Scores of readers on a small collection: learning curve and frontier."""

import json

import numpy as np
import pytest

from activetouch.data.dataset import read_split
from activetouch.perception.classifier import TouchClassifier
from belief.statistics import clopper_pearson_interval
from benchmarks.frontier import Frontier
from benchmarks.learning_curve import LearningCurve
from benchmarks.reader_scores import scores
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import Collect, PlanArguments
from experiments.sensor.train import STATE_FILE, Changes, Train, card_for, new_classifier

pytestmark = [pytest.mark.mujoco, pytest.mark.torch]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("touches") / "coarse"
    choice = SceneChoice("coarse", fidelity="quasistatic")
    Collect(choice, out=folder, plan=PlanArguments(train=24, calibration=12, test=12), jobs=1).run()
    return folder


def test_scores_of_a_classifier_that_knows_are_perfect_and_of_one_that_does_not_are_chance(data):
    calibration, test = read_split(data, "calibration"), read_split(data, "test")
    card = card_for(test, "cnn", 16, ("a", "b", "c", "d"), ("p",))

    class Oracle(TouchClassifier):
        def __init__(self, answers):
            super().__init__(card, new_classifier(card, 0).network)
            self.answers = answers

        def read(self, images, batch_size=64):
            touches = calibration if images is calibration.images else test
            return super().read(images, batch_size)._replace(logits=20.0 * np.eye(4)[self.answers(touches)])

    rng = np.random.default_rng(0)
    knows = scores(Oracle(lambda touches: touches.shapes), calibration, test, rng)
    objects = len(np.unique(test.object_ids))
    assert (knows.accuracy, knows.interval) == (1.0, clopper_pearson_interval(objects, objects))  # and no point
    assert knows.nll < 0.01  # a fitted temperature never claims more than its data show
    guesses = scores(Oracle(lambda touches: np.zeros(len(touches.shapes), int)), calibration, test, rng)
    assert guesses.accuracy == 0.25
    assert guesses.nll == pytest.approx(np.log(4), abs=0.02)  # scaled down until nothing is claimed


@pytest.mark.slow
def test_a_learning_curve_gives_every_part_as_many_steps(data, tmp_path):
    LearningCurve(
        "coarse",
        data,
        shares=(0.25, 1.0),
        input_size=16,
        change=Changes(epochs=2, patience=99),
        threads=1,
        out=tmp_path,
    ).run()
    points = json.loads((tmp_path / "learning_curve.json").read_text())["points"]
    assert [(p["images"], p["epochs"]) for p in points] == [(36, 8), (144, 2)]
    assert all(0.0 <= p["scores"]["accuracy"] <= 1.0 for p in points)
    assert (tmp_path / "learning_curve.svg").exists()


@pytest.mark.slow
def test_the_frontier_compares_runtimes_with_the_first_as_reference(data, tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.frontier.which", lambda name: None)  # compiling takes half a minute
    change = Changes(epochs=1, batch_size=64)
    Train("coarse", data, tmp_path / "trained", 16, "cnn", recipe="large", change=change, jobs=1).run()
    Frontier(
        (tmp_path / "trained" / STATE_FILE,), "coarse", data, touches=60, batches=(1, 8), rounds=1, out=tmp_path
    ).run()
    numbers = json.loads((tmp_path / "frontier.json").read_text())
    assert [(entry["network"], entry["runtime"]) for entry in numbers["entries"]] == [
        ("cnn 16 px", runtime) for runtime in ("torch", "torch, bf16", "torch, int8", "ONNX Runtime")
    ]
    single, *others = numbers["entries"]
    assert single["ratio"] == {"1": 1.0, "8": 1.0}
    for other in others:
        assert abs(single["scores"]["accuracy"] - other["scores"]["accuracy"]) <= 0.05
        assert other["parameters"] == single["parameters"]
    assert numbers["num_touches"] == 60
    assert (tmp_path / "frontier.md").read_text().count("\n| cnn 16 px") == 4
    assert (tmp_path / "frontier.svg").exists()
