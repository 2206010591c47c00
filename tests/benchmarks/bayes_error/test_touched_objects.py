"""Objects that are touched in every pose."""

from dataclasses import replace

import numpy as np

from activetouch.data.dataset import CollectionPlan, record_shard, shard_path, write_manifest
from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from benchmarks.bayes_error.touched_objects import recorded_objects, touch_orders

SCENE = replace(SCENES["coarse"].scene, press_model=Quasistatic())


def test_every_order_has_every_pose_once():
    orders = touch_orders(200, 6, 0)
    assert (np.sort(orders, axis=1) == np.arange(6)).all()
    assert len(np.unique(orders[:, 0])) == 6
    assert not np.array_equal(orders, touch_orders(200, 6, 1))


def test_recorded_objects_are_those_of_the_first_round(tmp_path):
    first, both = (CollectionPlan(train=0, calibration=0, test=2, seed=5, repeats=rounds) for rounds in (1, 2))
    found = []
    for plan, folder in ((first, tmp_path / "one"), (both, tmp_path / "two")):
        write_manifest(folder, SCENE, plan)
        for split, shard, objects in plan.shards(4):
            record_shard(SCENE, plan, split, objects, shard_path(folder, split, shard))
        found.append(recorded_objects(folder, 0))
    assert found[0].readings.shape == (8, 6, 4, 4)
    assert found[0].shapes.tolist() == [0, 1, 2, 3] * 2
    np.testing.assert_array_equal(found[0].readings, found[1].readings)
    np.testing.assert_array_equal(found[0].orders, found[1].orders)
