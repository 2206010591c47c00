"""The paper's Table 1: what the splits share, and the command from nothing to its files."""

from types import SimpleNamespace

import numpy as np
import pytest

from activetouch.named_scenes import SCENES
from belief.metrics import shape_scores
from belief.statistics import clopper_pearson_interval
from experiments.paper.table1 import (
    PAPER,
    Result,
    WindowPlan,
    _read,
    record_windows,
    split_by_image,
    split_by_object,
    table,
)

pytestmark = [pytest.mark.mujoco, pytest.mark.torch]
PLAN = WindowPlan(objects=5, presses=2, images=4)


@pytest.fixture(scope="module")
def images():
    return record_windows(SCENES["paper"].scene, PLAN, 0, jobs=1)


def test_every_shape_has_as_many_images_as_planned(images):
    assert images.images.shape == (160, 128, 128, 3)
    assert np.bincount(images.shapes).tolist() == [40] * 4
    assert len(np.unique(images.object_ids)) == 20


@pytest.mark.parametrize("split", [split_by_image, split_by_object])
def test_a_split_keeps_every_image_once(images, split):
    first, second = split(images, 0.8, np.random.default_rng(0))
    assert (len(first.images), len(second.images)) == (128, 32)
    rows = sorted(image.tobytes() for part in (first, second) for image in part.images)
    assert rows == sorted(image.tobytes() for image in images.images)


def test_split_by_object_shares_no_object_and_by_image_nearly_all(images):
    first, second = split_by_object(images, 0.8, np.random.default_rng(0))
    assert not set(first.object_ids) & set(second.object_ids)
    assert np.bincount(second.shapes).tolist() == [8] * 4
    first, second = split_by_image(images, 0.8, np.random.default_rng(0))
    # An object has 8 images: none among the 128 with probability C(152, 128) / C(160, 128) below 1e-5.
    assert set(second.object_ids) <= set(first.object_ids)


def test_the_papers_table_agrees_with_itself():
    # Counts of right answers follow from recall and support; 0.81 is their share of all.
    right = sum(round(score.recall * score.support) for score in PAPER.values())
    assert right / sum(score.support for score in PAPER.values()) == pytest.approx(0.81, abs=0.005)
    for score in PAPER.values():
        mean = 2 * score.precision * score.recall / (score.precision + score.recall)
        assert score.f1 == pytest.approx(mean, abs=0.011)


def test_the_table_holds_the_scores_of_the_confusion_matrix():
    confusion = [[9, 1, 0, 0], [2, 8, 0, 0], [0, 0, 5, 5], [0, 0, 4, 6]]
    labels = ("sphere", "cube", "cylinder", "cone")
    text = table({"by image": {"held out": Result(0.7, (0.6, 0.8), confusion, 0.4, (0.3, 0.5))}}, labels).markdown()
    cube = shape_scores(confusion)[1]
    assert f"| cube | 0.77 / 0.80 / 0.78 (144) | {cube.precision:.2f} / 0.80 / {cube.f1:.2f} (10) |" in text
    assert "| accuracy | 0.81 | 0.700 [0.600, 0.800] |" in text
    assert " |  | 0.400 [0.300, 0.500] |" in text


def test_a_classifier_that_is_always_right_has_no_interval_of_width_zero(images):
    reads = SimpleNamespace(labels=images.shapes)
    knows = SimpleNamespace(read=lambda _: reads, card=SimpleNamespace(shape_labels=tuple(PAPER)))
    result = _read(knows, images, images, np.random.default_rng(0))
    assert (result.accuracy, result.nearest) == (1.0, 1.0)
    assert result.interval == result.nearest_interval == clopper_pearson_interval(20, 20)
