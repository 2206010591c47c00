"""Bounds from what a network sees: neighbours are the nearest, views are averaged, and the findings are written."""

import json

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.special import log_softmax

from activetouch.data.dataset import CollectionPlan, read_split
from activetouch.errors import LabelMismatch
from activetouch.named_scenes import SCENES
from activetouch.perception.reader import Reading
from activetouch.scene import Symmetry
from activetouch.sensor import TactileSensor
from experiments.bayes_error.estimator import LimitStudy
from experiments.bayes_error.image_bank import symmetric_views
from experiments.bayes_error.learned import LearnedBounds, nearest_of_first, read_views
from experiments.bayes_error.limit import Limit
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect

pytestmark = pytest.mark.torch


def test_the_nearest_is_the_nearest_of_each_part(rng):
    known, asked = rng.normal(size=(9000, 3)), rng.normal(size=(50, 3))  # more than are compared at once
    sizes = [1, 10, 5000, 9000]
    found = nearest_of_first(known.astype(np.float32), asked.astype(np.float32), sizes)
    distances = cdist(asked.astype(np.float32), known.astype(np.float32))
    for size, nearest in zip(sizes, found, strict=True):
        assert nearest.max() < size
        least = distances[:, :size].min(axis=1)
        np.testing.assert_allclose(distances[np.arange(50), nearest], least, atol=1e-3)


def test_of_rows_equally_near_the_first_is_taken():
    known = np.array([[1.0], [2.0], [1.0], [2.0]], np.float32)
    assert nearest_of_first(known, np.array([[2.0], [1.0]], np.float32), [4]).tolist() == [[1, 0]]


class Corners:
    """Reads the first pixel of an image: its logit for shape 0, and its only feature."""

    def read(self, images, batch_size=64):
        corner = images[:, 0, 0].astype(float)
        feature = corner[:, None].astype(np.float32)
        return Reading(np.stack([corner, np.zeros_like(corner)], axis=1), feature, feature)


@pytest.mark.parametrize("symmetry", list(Symmetry))
def test_views_are_averaged_in_log_probability(symmetry, rng):
    images = rng.integers(0, 9, size=(300, 4, 4)).astype(np.uint8)
    found = read_views(Corners(), images, symmetry, "reading")
    corners = symmetric_views(images, symmetry)[:, :, 0, 0].astype(float)
    log_probs = log_softmax(np.stack([corners, np.zeros_like(corners)], axis=2), axis=2)
    np.testing.assert_allclose(found.logits, log_probs.mean(axis=1))
    np.testing.assert_allclose(found.features[:, 0], corners.mean(axis=1), rtol=1e-6)
    np.testing.assert_array_equal(found.embeddings, found.features)


@pytest.fixture(scope="module")
def collection(tmp_path_factory):
    folder = tmp_path_factory.mktemp("many")
    collect(SceneChoice("many", fidelity="quasistatic"), CollectionPlan(train=4, calibration=1, test=1), folder, jobs=1)
    return folder


def test_with_a_collection_the_network_is_studied_instead(collection):
    assert Limit(learned_from=collection).estimator(SCENES["hard"].scene) == LearnedBounds(collection)


def test_the_findings_are_written(collection, tmp_path):
    choice = SceneChoice("many", fidelity="quasistatic")
    Limit(choice, touches=24, learned_from=collection, out=tmp_path, jobs=1).run()
    numbers = json.loads((tmp_path / "limit.json").read_text())
    assert numbers["sizes"] == [18, 36, 72, 144, 288]
    for seen in numbers["neighbours"].values():
        assert all(nearest <= upper <= 1.0 for nearest, upper in zip(seen["nearest"], seen["upper"], strict=True))
    assert numbers["learned_from"]["value"] > 0.5  # of shapes it was trained on, 1 in 12 by chance
    assert f"{numbers['classifier']['value']:.4f}" in (tmp_path / "limit.md").read_text()


def test_the_bounds_are_those_of_the_readings(collection, tmp_path, rng, monkeypatch):
    def reading(count):
        return Reading(*(rng.normal(size=(count, width)).astype(np.float32) for width in (12, 5, 3)))

    known, asked, turned = reading(288), reading(24), reading(24)
    known, asked, turned = (some._replace(logits=log_softmax(some.logits, axis=1)) for some in (known, asked, turned))
    readings = iter((known, asked, turned))
    monkeypatch.setattr("experiments.bayes_error.learned.read_views", lambda *_: next(readings))
    sensor = TactileSensor.shipped("many", SceneChoice("many", fidelity="quasistatic").named.scene, anyway=True)
    study, shapes = LimitStudy(sensor, 24, 0, 1, tmp_path), np.arange(24) % 12
    numbers = LearnedBounds(collection).measure(study).numbers
    learned = read_split(collection, "train").shapes
    assert numbers["classifier"]["value"] == np.mean(asked.logits.argmax(axis=1) == shapes)
    assert numbers["all_views"]["value"] == np.mean(turned.logits.argmax(axis=1) == shapes)
    assert numbers["learned_from"]["value"] == pytest.approx(np.mean(known.logits.argmax(axis=1) == learned))
    gain = numbers["all_views"]["value"] - numbers["classifier"]["value"]
    assert numbers["gain_of_views"]["value"] == pytest.approx(gain)
    for seen, rows in (
        ("probabilities", lambda some: np.sqrt(np.exp(some.logits))),
        ("features", lambda s: s.features),
    ):
        for size, value in zip(numbers["sizes"], numbers["neighbours"][seen]["nearest"], strict=True):
            nearest = cdist(rows(asked), rows(known)[:size]).argmin(axis=1)
            assert value == np.mean(learned[nearest] == shapes)


def test_a_collection_of_other_shapes_is_refused(collection, tmp_path):
    with pytest.raises(LabelMismatch, match="knows the shapes"):
        Limit(SceneChoice("gel"), touches=24, learned_from=collection, out=tmp_path, jobs=1).run()
