"""Objects that are none of the bodies: the currency of scores, two statistics, and objects that differ from files."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch.perception.contacts.bodies import random_body
from activetouch.perception.contacts.close_look import CloseLook
from activetouch.perception.contacts.inexact import inexact
from activetouch.perception.contacts.random_views import FIRST, log_normalisers, random_views
from activetouch.perception.contacts.views import ViewPlan
from activetouch.perception.many_bodies import NestedPlan
from activetouch.perception.strangers import TwoDensities
from activetouch.shapes import SHAPES, Box, Mesh
from belief.problem import Touch
from experiments.meshes.setting import scene_of, sensor_of

FILES = {"cube": SHAPES["cube"], "bar": Box((0.008, 0.008, 0.022)), "plate": Box((0.02, 0.016, 0.005))}
PLAN = NestedPlan(ViewPlan(24, 8), (0, 1), look=CloseLook(proposed=4, divided=2), pressed=6, check=4)


@pytest.fixture(scope="module")
def sensor():
    return sensor_of(FILES, plan=PLAN, jobs=1)


def pressed(sensor, solids, number, touches=4):
    """Evidence about objects of some solids, pressed by the sensor."""
    scene, found = scene_of(solids), []
    for count in range(number):
        rng = np.random.default_rng([count, 7])
        obj, evidence = scene.sample_object(count % len(solids), rng), sensor.model.start()
        for pose in rng.permutation(26)[:touches].tolist():
            (embedding,) = sensor.reader.run(scene.press(obj, pose, rng).image[None])[0]
            evidence = evidence.update(Touch(pose, features=embedding.astype(float)))
        found.append(evidence)
    return found


def log_ratio(evidence):
    """Log likelihood ratio of an unlisted body against equally probable listed ones."""
    return evidence.log_unlisted - np.log(np.exp(evidence.log_likelihood).mean())


def test_scores_less_the_normaliser_are_ratios_to_some_body(sensor):
    bodies = sensor.model.bodies
    bank = random_views(bodies.hypotheses, bodies.code)[0]
    others = random_views(bodies.hypotheses, bodies.code, 64, 4, FIRST + 5_000)[0]
    felt = np.stack([touch.embedding for one in pressed(sensor, FILES, 6) for touch in one.belief.touches])
    mean = log_normalisers(bank, felt, 0.8)
    ratios = log_normalisers(others, felt, 0.8) - mean
    assert abs(ratios.mean()) < 0.7
    assert abs(mean.mean()) > 3 * abs(ratios.mean())  # the constant of an image is no small number
    own = np.array(
        [sensor.model.bodies.view_scores(0, touch).max() for touch in pressed(sensor, FILES, 1)[0].belief.touches]
    )
    assert (0.8 * own > log_normalisers(bank, felt[:4], 0.8)).all()


@pytest.mark.parametrize("truth", [0, 1, 2])
def test_what_no_body_feels_like_is_probably_unlisted(sensor, truth):
    rng, scene, poses = np.random.default_rng(truth), sensor.scene, (0, 4, 9, 13)
    obj = scene.sample_object(truth, rng)
    images = np.stack([scene.press(obj, pose, rng).image for pose in poses])
    rows = np.arange(images.shape[1])[None, :, None]

    def ratio(changed):
        evidence = sensor.model.start()
        for pose, embedding in zip(poses, sensor.reader.run(np.ascontiguousarray(changed))[0], strict=True):
            evidence = evidence.update(Touch(pose, features=embedding.astype(float)))
        return log_ratio(evidence)

    usual = ratio(images)
    assert usual < 0.0
    assert ratio(rng.integers(0, 256, images.shape).astype(np.uint8)) > usual + 5.0
    assert ratio(np.where(rows < images.shape[1] // 2, images, 0).astype(np.uint8)) > usual + 5.0  # dead rows
    assert ratio(images[:, :, ::-1]) > usual + 4.0  # mirrored, which some bodies of the bank resemble


def test_strangers_have_more_evidence_than_bodies_of_the_set(sensor):
    usual = np.array([log_ratio(one) for one in pressed(sensor, FILES, 9)])
    strange = np.array(
        [log_ratio(one) for one in pressed(sensor, {name: SHAPES[name] for name in ("cone", "sphere")}, 6)]
    )
    assert np.median(strange) > np.median(usual) + 1.0
    assert (usual < 3.0).all()


def test_the_same_touches_give_the_same_evidence_and_none_is_computed_unasked(sensor):
    one, again = (pressed(sensor, FILES, 1)[0] for _ in range(2))
    assert "log_unlisted" not in vars(one)
    assert one.log_unlisted == again.log_unlisted
    assert sensor.model.start().log_unlisted == 0.0
    without = replace(sensor.model, strangers=None).start().update(Touch(3, features=np.zeros(96)))
    assert log_ratio(without) == pytest.approx(0.0, abs=1e-9)


def test_a_statistic_never_speaks_for_a_stranger_by_being_larger():
    rng = np.random.default_rng(0)
    both = TwoDensities.of(rng.normal(10.0, 2.0, (40, 6)), rng.normal(4.0, 3.0, (40, 6)))
    ratios = [both.log_ratio(3, value) for value in np.linspace(-40.0, 40.0, 60)]
    assert (np.diff(ratios) <= 1e-9).all()
    assert ratios[0] > 2.0 > 0.0 > ratios[-1]
    along = TwoDensities.along(np.array([[2, 0.0], [5, -0.5]]), np.array([[2, -4.0], [5, -9.0]]), 12)
    assert along.log_ratio(20, -15.0) > along.log_ratio(20, -1.0)
    with pytest.raises(ValueError, match="positive"):
        TwoDensities(np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"\(2, N\)"):
        TwoDensities(np.zeros((3, 3)), np.ones((3, 3)))


def test_an_inexact_object_differs_from_its_file_by_the_tolerance():
    box, rng = Box((0.012, 0.009, 0.02)), np.random.default_rng(0)
    assert inexact(box, 0.0, rng) is box
    found = [inexact(box, 0.0005, rng) for _ in range(8)]
    assert all(isinstance(one, Mesh) for one in found)
    exact = np.stack([inexact(box, 1e-9, rng).surface.vertices for _ in range(2)])
    moved = np.concatenate([(one.vertices - exact[0].T).ravel() for one in found])
    assert 0.0004 < moved.std() < 0.0011  # noise and the displacement of the centre
    usual = inexact(box, None, rng).vertices - exact[0].T
    assert 0.3 < usual.std() / (0.01 * np.linalg.norm([0.012, 0.009, 0.02])) < 2.5
    assert len(found[0].faces) > 100


def test_random_bodies_of_the_bank_are_new_to_every_reader():
    assert random_body(FIRST).vertices.shape[0] == 3
