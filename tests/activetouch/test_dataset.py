import shutil
from pathlib import Path

import numpy as np
import pytest

from activetouch import Quasistatic, Scene
from activetouch.dataset import SPLITS, CollectionPlan, read_split, record_shard, shard_path, write_manifest
from activetouch.distributions import Constant
from activetouch.errors import CorruptFile, LabelMismatch
from activetouch.scene import Variation

PLAN = CollectionPlan(train=13, calibration=1, test=1)
SCENE = Scene(press_model=Quasistatic())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("touches")
    write_manifest(path, SCENE, PLAN)
    for split, shard, objects in PLAN.shards(len(SCENE.shapes)):
        record_shard(SCENE, PLAN, split, objects, shard_path(path, split, shard))
    return path


def test_every_object_is_touched_once_in_every_pose(folder):
    touches = read_split(folder, "train")
    assert len(touches.images) == 13 * 4 * 6
    pairs = set(zip(touches.object_ids.tolist(), touches.poses.tolist(), strict=True))
    assert len(pairs) == len(touches.images)
    assert np.bincount(touches.shapes).tolist() == [13 * 6] * 4


def test_splits_share_no_image(folder):
    digests = [{image.tobytes() for image in read_split(folder, split).images} for split in SPLITS]
    assert not digests[0] & digests[1]
    assert not digests[0] & digests[2]
    assert not digests[1] & digests[2]


def test_a_shard_recorded_again_has_the_same_bytes(folder, tmp_path):
    split, shard, objects = list(PLAN.shards(4))[1]
    record_shard(SCENE, PLAN, split, objects, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == shard_path(folder, split, shard).read_bytes()


def test_another_plan_does_not_mix_into_the_folder(folder):
    write_manifest(folder, SCENE, PLAN)
    with pytest.raises(LabelMismatch, match="other plan"):
        write_manifest(folder, SCENE, CollectionPlan(train=13, calibration=1, test=1, seed=1))


@pytest.fixture
def damaged(folder, tmp_path):
    return Path(shutil.copytree(folder, tmp_path / "copy"))


def test_a_truncated_shard_is_a_clear_error(damaged):
    path = shard_path(damaged, "test", 0)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(CorruptFile, match=r"00000.npz is damaged"):
        read_split(damaged, "test")


def test_an_unfinished_collection_is_not_used_in_silence(damaged):
    shard_path(damaged, "train", 1).unlink()
    with pytest.raises(CorruptFile, match="1 of 2 shards are missing"):
        read_split(damaged, "train")


def test_a_folder_without_a_collection_says_how_to_make_one(tmp_path):
    with pytest.raises(CorruptFile, match="activetouch collect"):
        read_split(tmp_path, "train")


def test_an_object_that_misses_the_pad_is_recorded_without_force():
    scene = Scene(press_model=Quasistatic(), variation=Variation(offset=Constant(0.5)))
    rng = np.random.default_rng(0)
    contact, image = scene.press(scene.sample_object(0, rng), 0, rng)
    assert (contact.force, contact.depth) == (0.0, 0.0)
    assert image.max() < 0.15 * 255  # noise only
