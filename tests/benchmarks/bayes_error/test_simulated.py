"""Bayes' rule over simulated bodies: its laws on small banks, and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch.data.manifest import CollectionPlan
from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from activetouch.sensor import TactileSensor
from benchmarks.bayes_error.body_bank import BodyBank
from benchmarks.bayes_error.evidence import Evidence, log_posterior
from benchmarks.bayes_error.findings import words
from benchmarks.bayes_error.simulated import JointBayes
from benchmarks.bayes_error.touched_objects import recorded_objects, sensor_evidence
from benchmarks.limit import Limit
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect

SCENE = replace(SCENES["coarse"].scene, press_model=Quasistatic())


def evidence_of(bank, touched, slices):
    parts = [[bank.evidence(touched, shape, n)[2] for shape in range(4)] for n in range(slices)]
    return [Evidence.of_shapes(part) for part in parts]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "quick"
    collect(SceneChoice("coarse", fidelity="quasistatic"), CollectionPlan(0, 1, 6, repeats=1), folder, jobs=1)
    return folder


@pytest.fixture(scope="module")
def found(data):
    touched = recorded_objects(data, 0)
    return touched, evidence_of(BodyBank.of(SCENE, 2, 0, slice_size=64), touched, 2)


def nll(logs, shapes):
    return -log_posterior(logs)[np.arange(len(shapes)), :, shapes].mean(axis=0)


def test_more_touches_and_more_bodies_help_and_forgetting_the_body_does_not(found):
    touched, slices = found
    whole = Evidence.pooled(slices)
    joint, independent = (nll(logs, touched.shapes) for logs in (whole.joint, whole.independent(touched.orders)))
    assert joint[0] == pytest.approx(independent[0])
    right = log_posterior(whole.joint).argmax(axis=2) == touched.shapes[:, None]
    assert right[:, 2].mean() > right[:, 0].mean() + 0.1
    assert right[:, -1].mean() > 0.8
    halves = [nll(part.joint, touched.shapes) for part in slices]
    assert nll(whole.joint, touched.shapes)[1] < np.mean(halves, axis=0)[1]


def test_a_sensors_evidence_is_that_of_its_observation_model(found):
    touched, _ = found
    sensor = TactileSensor.shipped("coarse")
    evidence = sensor_evidence(sensor, touched, touched.orders)
    assert evidence.shape == (*touched.orders.shape, 4)
    n = 13
    touches = sensor.read(touched.readings[n, touched.orders[n]], touched.orders[n].tolist())
    for number in (1, 3):
        expected = sensor.model.log_likelihood(touches[:number])
        np.testing.assert_allclose(log_posterior(evidence[n, number - 1]), log_posterior(expected), atol=1e-4)
    right = (evidence.argmax(axis=2) == touched.shapes[:, None]).mean(axis=0)
    assert right[2] > right[0] + 0.1  # three touches of one body tell more than one


def test_the_command_compares_the_sensor_with_both_readers(data, tmp_path, capsys):
    joint = JointBayes(bodies=8, draws=1)
    choice = SceneChoice("coarse", fidelity="quasistatic")
    Limit(choice, touches_per_object=(6, 1, 2), data=data, joint=joint, out=tmp_path, jobs=1).run()
    numbers = json.loads((tmp_path / "limit.json").read_text())
    assert [row["touches"] for row in numbers["readers"]["joint"]] == [1, 2, 6]
    assert (numbers["objects"], numbers["bodies"], numbers["images_per_body_and_pose"]) == (24, 8, 4)
    assert list(numbers["readers"]) == ["joint", "independent", "sensor"]
    joint, independent, sensor = numbers["readers"].values()
    for measure in ("accuracy", "nll", "stated_minus_accuracy"):  # of one touch
        assert joint[0][measure]["value"] == pytest.approx(independent[0][measure]["value"], rel=1e-4)
    for name, other in (("independent", independent), ("sensor", sensor)):
        for row, ours, theirs in zip(numbers["differences"][name], joint, other, strict=True):
            assert row["value"] == pytest.approx(theirs["nll"]["value"] - ours["nll"]["value"])
    last = numbers["curve"][-1]  # the whole bank
    assert last["bodies"] == 8
    assert last["accuracy"] == pytest.approx([row["accuracy"]["value"] for row in joint])
    assert last["nll"] == pytest.approx([row["nll"]["value"] for row in joint])
    said = (tmp_path / "limit.md").read_text()
    assert "After 6 touches the joint reader has accuracy " + words(joint[-1]["accuracy"]) in said
    assert "NLL minus that of the joint reader" in capsys.readouterr().out
