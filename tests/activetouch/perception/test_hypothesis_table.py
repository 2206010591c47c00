"""Hypotheses in poses that the reader was not trained in."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, TactileSensor, TouchWorld
from activetouch.distributions import quaternions
from activetouch.perception.reader import HypothesisTable
from activetouch.poses import facing, turned
from belief.touch_batch import TouchBatch


@pytest.mark.mujoco
def test_poses_that_no_training_touch_was_made_in_are_read_by_their_rotations():
    shipped = TactileSensor.shipped("coarse")
    directions = np.random.default_rng(0).normal(size=(6, 3))
    poses = {f"direction {n}": facing(tuple(d / np.linalg.norm(d))) for n, d in enumerate(directions)}
    scene = replace(shipped.scene, poses=poses)
    sensor = TactileSensor(scene, shipped.reader, shipped.model.with_hypotheses(HypothesisTable(shipped.reader, scene)))
    touches, shapes = [], np.arange(60) % 4
    for number, shape in enumerate(shapes.tolist()):
        rng = np.random.default_rng(number)
        world = TouchWorld.sample(sensor, (shape,), rng)
        touches.append([world.touch(pose, rng) for pose in range(4)])
    found = sensor.model.log_likelihood_batch(TouchBatch.of(touches)).argmax(axis=1)
    assert (found == shapes).mean() >= 0.95  # 0.998 in the poses of training, of thousands of objects
    wrong = shipped.model.log_likelihood_batch(TouchBatch.of(touches)).argmax(axis=1)
    assert (wrong == shapes).mean() < 0.8  # with the rotations of other poses


@pytest.mark.parametrize("first_to_last", [True, False])
def test_a_hypothesis_looks_like_the_one_whose_orientation_before_the_pad_is_nearest(first_to_last):
    scene = SCENES["keyed"].scene
    if not first_to_last:  # poses that begin with one that turns objects
        scene = replace(scene, poses=dict(reversed(scene.rotations.items())))
    table = HypothesisTable(TactileSensor.shipped("keyed").reader, scene)
    views, rests = table.views(64), quaternions(64)
    rotations = list(scene.rotations.values())
    for pose, group in enumerate(table.groups):
        first = table.groups.index(group)
        np.testing.assert_array_equal(scene.aim_offsets[pose], scene.aim_offsets[first])
        shown, there = turned(rotations[pose], rests), turned(rotations[first], rests)
        likeness = np.abs(shown @ there.T)  # cosine of half the angle between what both show
        np.testing.assert_allclose(likeness[np.arange(64), views.same[pose]], likeness.max(axis=1), atol=1e-9)
    assert len(set(table.groups)) == len(set(map(tuple, scene.aim_offsets.tolist())))
