"""Bayes' rule over simulated bodies: its laws on small banks, and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch.data.dataset import CollectionPlan
from activetouch.distributions import Constant
from activetouch.named_scenes import SCENES
from activetouch.orientations import Resampled
from activetouch.pressing.press import Quasistatic
from activetouch.scene import Variation
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import MODELS
from benchmarks.bayes_error.body_bank import BodyBank, force_ratio
from benchmarks.bayes_error.evidence import Evidence, log_posterior
from benchmarks.bayes_error.findings import words
from benchmarks.bayes_error.noise import SensorNoise, UnknownLikelihood
from benchmarks.bayes_error.simulated import JointBayes
from benchmarks.bayes_error.touched_objects import TouchedObjects, recorded_objects, sensor_evidence, touch_orders
from benchmarks.limit import Limit
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect
from experiments.sensor_choice import WrongScene

SCENE = replace(SCENES["coarse"].scene, press_model=Quasistatic())
FIXED = replace(SCENE, variation=Variation(offset=Constant(0.0), force=Constant(2.0)))


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


def test_a_slice_depends_on_its_number_alone(found):
    touched, slices = found
    again = BodyBank.of(SCENE, 2, 0, slice_size=64).evidence(touched, 3, 1)[2]
    np.testing.assert_array_equal(again.joint[..., 0], slices[1].joint[..., 3])
    assert not np.array_equal(slices[0].joint, slices[1].joint)


def test_touches_of_a_body_in_the_bank_are_of_that_body(monkeypatch):
    """Without nuisances, and with little noise, only the touched body explains its touches."""
    bank, kept = BodyBank(FIXED, 1, (1.0,) * 4, 0, slice_size=4), []
    monkeypatch.setattr(
        SensorNoise, "log_mean_likelihoods", lambda self, readings, means: kept.append(means) or np.zeros((1, 4))
    )
    nothing = TouchedObjects(np.zeros((1, 6, 4, 4), np.uint8), np.array([1]), touch_orders(1, 6, 0))
    bank.evidence(nothing, 1, 0)
    monkeypatch.undo()
    noise = SensorNoise.of(FIXED.faults, 4)
    readings = np.zeros((4, 6, 4, 4), np.uint8)  # of the four bodies, with the mean gain and without noise
    readings[:, :, noise.live] = np.stack([np.rint(255 * means.mean(axis=1)) for means in kept], axis=1)
    logs = np.stack([noise.log_mean_likelihoods(readings[:, p], kept[p]) for p in range(6)]).sum(axis=0)
    np.testing.assert_array_equal(logs.argmax(axis=1), np.arange(4))


def test_quasistatic_presses_have_exactly_their_target(rng):
    assert force_ratio(SCENE, 0, rng) == pytest.approx(1.0)


@pytest.mark.mujoco
def test_dynamic_presses_stop_a_few_per_cent_above_their_target(rng):
    assert 1.0 < force_ratio(SCENES["coarse"].scene, 0, rng) < 1.1


def test_scenes_without_a_body_or_a_closed_form_are_refused():
    with pytest.raises(UnknownLikelihood, match="does not follow from the pose"):
        BodyBank.of(replace(SCENE, presentation=Resampled()), 2, 0)
    with pytest.raises(UnknownLikelihood, match="Noise"):
        BodyBank.of(replace(SCENE, faults=()), 2, 0)
    with pytest.raises(UnknownLikelihood, match="mean_pressure"):
        BodyBank.of(replace(SCENES["paper"].scene, faults=SCENE.faults, press_model=Quasistatic()), 2, 0)


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


def test_single_touches_are_counted_in_every_pose(data, tmp_path):
    """Of all touches of all objects; the sensor's are those that its model tells of single touches."""
    sensor, touched = TactileSensor.shipped("coarse"), recorded_objects(data, 0)
    numbers = JointBayes(bodies=8, draws=1).measure(sensor, data, (1,), 0, 1).numbers["single_touches"]
    right = []
    for readings, shape in zip(touched.readings, touched.shapes, strict=True):
        logs = [sensor.model.log_likelihood(sensor.read(readings[[pose]], [pose])) for pose in range(6)]
        right.append(np.argmax(logs, axis=1) == shape)
    assert numbers["sensor"]["accuracy"]["value"] == pytest.approx(np.mean(right))
    assert 0.25 < numbers["joint"]["accuracy"]["value"] < numbers["joint"]["stated"]["value"] < 1.0


@pytest.mark.parametrize("touches", [(7,), (0,), ()])
def test_numbers_of_touches_that_there_are_not_are_refused(tmp_path, touches):
    with pytest.raises(BadArgument, match="touches-per-object"):
        Limit(SceneChoice("coarse"), touches_per_object=touches, out=tmp_path).run()


def test_a_sensor_or_a_collection_of_another_scene_is_refused(data, tmp_path):
    with pytest.raises(WrongScene, match="num_taxels"):
        Limit(SceneChoice("gel"), data=data, out=tmp_path).run()
    with pytest.raises(WrongScene, match="num_taxels"):
        Limit(SceneChoice("coarse"), sensor=MODELS / "gel", data=data, out=tmp_path).run()
