"""Recorded touches come back as they were recorded, or not at all."""

import io
import pickle
import shutil
import tracemalloc
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch import Quasistatic, Scene
from activetouch.data.dataset import object_rng, read_split, touches_of, write_shard
from activetouch.data.manifest import SPLITS, CollectionPlan, read_manifest, shard_path, write_manifest
from activetouch.errors import LabelMismatch, UnstablePress
from activetouch.poses import Placement, multiply
from activetouch.pressing.contact import Contact, Pad, Press
from activetouch.scene import Symmetry
from activetouch.scene_description import scene_fields
from belief.errors import CorruptFile, UnknownName
from belief.files import sealed_json, unsealed_json

PLAN = CollectionPlan(train=13, calibration=1, test=1)
SCENE = Scene(pad=Pad(num_taxels=16), press_model=Quasistatic())


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("touches")
    manifest = write_manifest(folder, SCENE, PLAN)
    for split, shard, objects in manifest.shards():
        write_shard(touches_of(SCENE, PLAN, split, objects), split, shard_path(folder, split, shard))
    return folder


@pytest.fixture
def folder(original, tmp_path):
    return Path(shutil.copytree(original, tmp_path / "copy"))


def change_manifest(folder, **changes):
    """Write other values into the manifest, as its digest has them; None removes one."""
    path = folder / "manifest.json"
    kept = {key: value for key, value in unsealed_json(path.read_text()).items() if key not in changes}
    path.write_text(sealed_json(kept | {key: value for key, value in changes.items() if value is not None}))


def change_shard(folder, split, shard, **changes):
    path = shard_path(folder, split, shard)
    with np.load(path) as file:
        columns = {**file, **changes}
    np.savez(path, **columns)


def test_every_object_is_touched_once_in_every_pose(original):
    touches = read_split(original, "train")
    assert len(touches.images) == 13 * 4 * 6
    pairs = set(zip(touches.object_ids.tolist(), touches.poses.tolist(), strict=True))
    assert len(pairs) == len(touches.images)
    assert np.bincount(touches.shapes).tolist() == [13 * 6] * 4


def test_splits_share_no_image(original):
    digests = [{image.tobytes() for image in read_split(original, split).images} for split in SPLITS]
    assert not digests[0] & digests[1]
    assert not digests[0] & digests[2]
    assert not digests[1] & digests[2]


KEYS = st.tuples(st.integers(0, 2**32 - 1), st.sampled_from(SPLITS), st.integers(0, 2**20), st.integers(0, 9))


@given(KEYS, KEYS)
def test_two_objects_never_draw_from_one_generator(one, other):
    states = [object_rng(CollectionPlan(seed=key[0]), *key[1:]).bit_generator.state for key in (one, other)]
    assert (states[0] == states[1]) == (one == other)


def test_the_first_round_of_touches_does_not_depend_on_how_many_follow(original, tmp_path):
    plan = CollectionPlan(train=0, calibration=1, test=0, repeats=3)
    manifest = write_manifest(tmp_path, SCENE, plan)
    (split, shard, objects), num_poses = next(iter(manifest.shards())), len(manifest.pose_labels)
    write_shard(touches_of(SCENE, plan, split, objects), split, shard_path(tmp_path, split, shard))
    rounds = read_split(tmp_path, "calibration").images.reshape(len(objects), 3, num_poses, -1)
    once = read_split(original, "calibration").images.reshape(len(objects), num_poses, -1)
    np.testing.assert_array_equal(rounds[:, 0], once)
    assert not (rounds[:, 0] == rounds[:, 1]).all(axis=-1).any()


@pytest.mark.parametrize("wrong", [{"train": -1}, {"seed": 2**32}, {"test": 1.5}])
def test_a_plan_that_cannot_be_keyed_is_refused(wrong):
    with pytest.raises(ValueError, match="must be an integer, at least 0"):
        CollectionPlan(**wrong)


def test_a_shard_recorded_again_has_the_same_bytes(original, tmp_path):
    split, shard, objects = list(PLAN.shards(4))[1]
    write_shard(touches_of(SCENE, PLAN, split, objects), split, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == shard_path(original, split, shard).read_bytes()


@dataclass(frozen=True)
class Fragile(Press):
    """Presses like ``Quasistatic``, but does not settle on what is larger than ``limit``."""

    limit: float

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        if placement.scale > self.limit:
            raise UnstablePress(f"{placement} is too large")
        return Quasistatic().press(pad, placement, target_force)


def test_an_object_that_cannot_be_pressed_is_replaced_and_the_others_keep_their_touches(original, tmp_path):
    split, shard, objects = list(PLAN.shards(4))[1]
    path, fragile = shard_path(tmp_path, split, shard), replace(SCENE, press_model=Fragile(1.05))
    write_shard(touches_of(fragile, PLAN, split, objects), split, path)
    write_shard(touches_of(fragile, PLAN, split, objects), split, tmp_path / "again.npz")
    assert path.read_bytes() == (tmp_path / "again.npz").read_bytes()
    with np.load(path) as file, np.load(shard_path(original, split, shard)) as unlimited:
        scales = [
            [SCENE.sample_object(number % 4, object_rng(PLAN, split, number, draw)).scale for draw in range(10)]
            for number in objects
        ]
        wanted = [next(draw for draw, scale in enumerate(some) if scale <= 1.05) for some in scales]
        kept = np.repeat(np.array(wanted) == 0, 6)
        assert 0 < kept.sum() < len(kept)
        np.testing.assert_array_equal(file["images"][kept], unlimited["images"][kept])
        assert not (file["images"] == unlimited["images"])[~kept].all(axis=(1, 2)).any()
        for name in ("shapes", "poses", "object_ids"):
            np.testing.assert_array_equal(file[name], unlimited[name])


def test_a_scene_in_which_nothing_can_be_pressed_names_the_shape_and_the_last_press(tmp_path):
    hopeless = replace(SCENE, press_model=Fragile(0.5))
    with pytest.raises(UnstablePress, match=r"10 objects of the shape 'sphere' in turn .* cannot be collected.*Sphere"):
        write_shard(touches_of(hopeless, PLAN, "train", range(4)), "train", tmp_path / "never.npz")
    assert not list(tmp_path.iterdir())


# What a folder says about itself


def test_a_manifest_comes_back_as_it_was_written(original):
    manifest = read_manifest(original)
    assert (manifest.plan, manifest.scene, manifest.choice) == (PLAN, scene_fields(SCENE), None)
    assert manifest.shape_labels == SCENE.shape_labels
    assert manifest.pose_labels == SCENE.pose_labels
    assert manifest.symmetry is Symmetry.ROTATIONS_AND_MIRROR
    assert manifest.image_shape == (16, 16)
    assert manifest.versions.keys() == {"activetouch", "mujoco", "numpy", "python"}
    assert read_manifest(original / "manifest.json") == manifest


def test_another_plan_or_scene_does_not_mix_into_the_folder(folder):
    write_manifest(folder, SCENE, PLAN)
    with pytest.raises(LabelMismatch, match=r"other plan \(plan: .*'seed': 0.* there, .*'seed': 1.* here"):
        write_manifest(folder, SCENE, replace(PLAN, seed=1))
    softer = replace(SCENE, pad=Pad(num_taxels=16, stiffness=1e7))
    with pytest.raises(LabelMismatch, match=r"other scene .*pad\.stiffness is 10000000\.0, not 14500000\.0"):
        write_manifest(folder, softer, PLAN)


def test_other_physics_does_not_mix_into_the_folder(folder):
    versions = read_manifest(folder).versions
    change_manifest(folder, versions={**versions, "mujoco": "3.9.0"})
    with pytest.raises(LabelMismatch, match=r"other MuJoCo .*3\.9\.0"):
        write_manifest(folder, SCENE, PLAN)


DAMAGE = {
    "no JSON": "{",
    "a list": "[]",
    "nothing": "{}",
    "no plan": {"plan": None},
    "a plan of text": {"plan": "all"},
    "a plan of other words": {"plan": {"trains": 1}},
    "a negative plan": {"plan": {"train": -1}},
    "a label that is a number": {"shape_labels": [1, 2, 3, 4]},
    "an unknown symmetry": {"symmetry": "all"},
    "versions of text": {"versions": "4.0.1"},
    "versions without MuJoCo": {"versions": {"numpy": "2.1.0"}},
    "format of text": {"format": "two"},
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_manifest_is_a_clear_error(folder, what):
    if isinstance(DAMAGE[what], str):
        (folder / "manifest.json").write_text(DAMAGE[what])
    else:
        change_manifest(folder, **DAMAGE[what])
    with pytest.raises(CorruptFile, match=r"manifest\.json is damaged .*Restore it"):
        read_split(folder, "train")


def test_a_collection_of_an_earlier_format_is_to_be_recorded_anew(folder):
    change_manifest(folder, format=3)
    with pytest.raises(CorruptFile, match="format 3, this version reads 4; record the touches anew"):
        read_manifest(folder)


def test_touches_record_where_the_body_was(folder):
    touches = read_split(folder, "train")
    assert np.allclose(np.linalg.norm(touches.orientations, axis=1), 1.0)
    poses = np.array(list(SCENE.poses.values()))
    shown = [multiply(poses[pose], rest) for pose, rest in zip(touches.poses, touches.rests, strict=True)]
    assert np.allclose(shown, touches.orientations)
    for column in (touches.rests, touches.sizes[:, None], touches.stiffnesses[:, None]):
        for number in np.unique(touches.object_ids):
            assert len(np.unique(column[touches.object_ids == number], axis=0)) == 1
    low, high = SCENE.variation.offset.support
    assert ((touches.offsets >= low) & (touches.offsets <= high)).all()


def test_shards_without_a_manifest_are_not_adopted(folder):
    (folder / "manifest.json").unlink()
    with pytest.raises(CorruptFile, match=r"4 shards without a manifest\.json"):
        write_manifest(folder, SCENE, PLAN)


def test_a_manifest_in_which_one_digit_flipped_is_refused(folder):
    text = (folder / "manifest.json").read_text()
    assert '"train": 13' in text
    (folder / "manifest.json").write_text(text.replace('"train": 13', '"train": 12'))
    with pytest.raises(CorruptFile, match="was changed after it was written"):
        read_manifest(folder)


# What is wrong with a shard


def test_an_unfinished_collection_is_not_used_in_silence(folder):
    shard_path(folder, "train", 1).unlink()
    with pytest.raises(CorruptFile, match=r"1 of 2 shards are missing .*with the command or program that began it"):
        read_split(folder, "train")


def test_a_split_without_objects_and_a_misspelt_one_are_refused(folder, tmp_path):
    write_manifest(tmp_path / "no train", SCENE, replace(PLAN, train=0))
    with pytest.raises(CorruptFile, match="planned without any train"):
        read_split(tmp_path / "no train", "train")
    with pytest.raises(UnknownName, match="Did you mean 'test'"):
        read_split(folder, "tset")


def test_a_shard_truncated_anywhere_is_a_clear_error(folder, rng):
    path = shard_path(folder, "test", 0)
    whole = path.read_bytes()
    for length in [0, 1, 2, len(whole) - 1, *rng.integers(len(whole), size=40)]:
        path.write_bytes(whole[:length])
        with pytest.raises(CorruptFile, match=r"00000.npz is truncated or damaged.*Delete it and"):
            read_split(folder, "test")


def test_a_flipped_bit_in_a_column_is_noticed(folder, rng):
    path, touches = shard_path(folder, "test", 0), read_split(folder, "test")
    whole = path.read_bytes()
    for column in (touches.images, touches.forces):
        content = column.tobytes()
        changed = bytearray(whole)
        changed[whole.index(content) + rng.integers(len(content))] ^= 1
        path.write_bytes(changed)
        with pytest.raises(CorruptFile, match=r"truncated or damaged .*Bad CRC-32"):
            read_split(folder, "test")


def test_splits_that_changed_places_are_noticed(folder):
    paths = [shard_path(folder, split, 0) for split in ("calibration", "test")]
    contents = [path.read_bytes() for path in paths]
    for path, content in zip(paths, reversed(contents), strict=True):
        path.write_bytes(content)
    with pytest.raises(CorruptFile, match="objects 0 to 3 of test, the plan puts 0 to 3 of calibration there"):
        read_split(folder, "calibration")


def test_a_shard_of_other_objects_is_foreign(folder):
    touches = read_split(folder, "test")
    change_shard(folder, "test", 0, object_ids=touches.object_ids + 4)
    with pytest.raises(
        CorruptFile, match="the shard of that name: it holds objects 4 to 7 of test, the plan puts 0 to 3"
    ):
        read_split(folder, "test")
    shutil.copy(shard_path(folder, "train", 1), shard_path(folder, "train", 0))
    with pytest.raises(CorruptFile, match=r"images are \(24, 16, 16\)"):
        read_split(folder, "train")


@pytest.mark.parametrize(
    ("column", "change", "told"),
    [
        ("images", lambda images: images[:, ::2], r"images are \(24, 8, 16\) uint8.* make them \(24, 16, 16\) uint8"),
        ("images", lambda images: images.astype(float), r"images are .* float64"),
        ("images", lambda images: np.stack([images] * 3, axis=-1), r"images are \(24, 16, 16, 3\)"),
        ("poses", lambda poses: poses.astype(np.int32), r"poses are \(24,\) int32"),
        ("forces", lambda forces: forces[:-1], r"forces are \(23,\) float64"),
    ],
)
def test_columns_of_another_size_or_type_are_foreign(folder, column, change, told):
    change_shard(folder, "test", 0, **{column: change(getattr(read_split(folder, "test"), column))})
    with pytest.raises(CorruptFile, match=f"not of this collection: its {told}"):
        read_split(folder, "test")


@pytest.mark.parametrize(
    ("column", "number", "told"),
    [
        ("poses", -1, "wrong labels: 1 of 24 poses are not the planned ones, first that of object 2"),
        ("shapes", 3, "wrong labels: 1 of 24 shapes are not the planned ones, first that of object 2"),
        ("poses", 0, "wrong labels: 1 of 24 poses are not the planned ones, first that of object 2"),
    ],
)
def test_wrong_labels_are_told(folder, column, number, told):
    numbers = getattr(read_split(folder, "test"), column)
    numbers[13] = number  # of object 2, in pose 1
    change_shard(folder, "test", 0, **{column: numbers})
    with pytest.raises(LabelMismatch, match=told):
        read_split(folder, "test")


class Trap:
    """Leaves a file behind where it is unpickled."""

    def __init__(self, bait):
        self.bait = bait

    def __reduce__(self):
        return Path.touch, (self.bait,)


@pytest.mark.parametrize("wrapped", [True, False])
def test_nothing_is_unpickled(folder, tmp_path, wrapped):
    bait = tmp_path / "unpickled"
    payload = pickle.dumps(Trap(bait))
    pickle.loads(payload)
    assert bait.exists()  # the trap works
    bait.unlink()
    if wrapped:
        change_shard(folder, "test", 0, depths=np.array([Trap(bait)] * 24, dtype=object))
    else:
        shard_path(folder, "test", 0).write_bytes(payload)
    with pytest.raises(CorruptFile, match="truncated or damaged"):
        read_split(folder, "test")
    assert not bait.exists()


def test_a_shard_of_zeros_that_would_unpack_to_much_more_is_not_unpacked(folder):
    path = shard_path(folder, "test", 0)
    zeros = io.BytesIO()
    np.lib.format.write_array(zeros, np.zeros(2**24, np.uint8))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in read_split.__globals__["_NUMBERS"] | {"images": None}:
            archive.writestr(f"{name}.npy", zeros.getvalue())
    tracemalloc.start()
    with pytest.raises(CorruptFile, match="would unpack to more bytes"):
        read_split(folder, "test")
    assert tracemalloc.get_traced_memory()[1] < 2**23
    tracemalloc.stop()


def test_a_header_that_promises_more_than_the_file_has_gets_no_memory(folder):
    path = shard_path(folder, "test", 0)
    content = io.BytesIO()
    np.lib.format.write_array_header_1_0(content, {"descr": "|u1", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("images.npy", content.getvalue())
    with pytest.raises(CorruptFile, match=r"is said to be \(1000000000000,\)"):
        read_split(folder, "test")
