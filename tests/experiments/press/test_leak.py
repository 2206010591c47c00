"""What an accuracy owes to force and depth: sensors that are known to cheat, or not to, are told apart."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from activetouch import SHAPES, Quasistatic, Scene
from activetouch.errors import WrongPress
from activetouch.pressing.contact import contact_at_depth, surface_gap
from activetouch.pressing.deformable import Deformable
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press
from activetouch.rendering import RENDERERS
from experiments.command_line.arguments import BadArgument
from experiments.press.leak import PLAIN, REMOVED, SHUFFLED, Leak, exchange, judged
from experiments.scene_choice import SceneChoice
from experiments.sensor.baseline import shares_without_image
from experiments.sensor.train import Changes

PAD = Pad(num_taxels=16)
KEY = (0, 0)


@dataclass(frozen=True)
class OnlyDepthTells(Press):
    """Every object feels like one sphere, pressed as deep as its shape says."""

    def press(self, setup, placement, target_force):
        shape = next(k for k, shape in enumerate(SHAPES.values()) if shape is placement.shape)
        ball = surface_gap(setup.pad, replace(placement, shape=SHAPES["sphere"], offset=np.zeros(2), scale=1.0))
        return contact_at_depth(setup.pad, ball, 0.5e-3 * (1 + shape))


@dataclass(frozen=True)
class OnlyGeometryTells(Press):
    """Every object is pressed to one depth, and the force is said to be one force."""

    def press(self, setup, placement, target_force):
        contact = contact_at_depth(setup.pad, surface_gap(setup.pad, placement), 1e-3)
        return replace(contact, force=2.0)


def depth_reader(images):
    """The shape that goes with the deepest taxel under :class:`OnlyDepthTells`."""
    depth = images.max(axis=(1, 2)) / 255 * PAD.max_depth
    return np.rint(depth / 0.5e-3).astype(int) - 1


def test_a_sensor_that_reads_nothing_but_depth_is_exposed():
    # 2 400 exchanged touches of four shapes: .25 plus or minus .05 holds but with probability 1e-7.
    scene = Scene(pad=PAD, press_model=OnlyDepthTells(), faults=())
    touched = exchange(scene, 100, KEY, {"guess": depth_reader})
    shares = judged(touched, touched.plain["guess"], touched.lent["guess"])
    assert shares_without_image(touched.numbers, touched.shapes, touched.object_ids)["depth"].mean() == 1.0
    assert shares[PLAIN].mean() == 1.0
    assert abs(shares[SHUFFLED].mean() - 0.25) < 0.05
    assert shares[REMOVED].mean() == 1.0


def test_where_all_are_pressed_alike_the_exchange_changes_no_image_and_numbers_tell_nothing():
    for renderer in RENDERERS.values():
        scene = Scene(pad=PAD, press_model=OnlyGeometryTells(), renderer=renderer)
        touched = exchange(scene, 5, KEY, {"image": np.asarray})
        np.testing.assert_array_equal(touched.plain["image"], touched.lent["image"])
        for share in shares_without_image(touched.numbers, touched.shapes, touched.object_ids).values():
            assert share.mean() == pytest.approx(0.25)


def test_an_exchanged_touch_has_the_depth_of_its_lender_and_the_contact_region_of_its_own_geometry():
    scene = Scene(pad=PAD, press_model=Quasistatic(), faults=())
    touched = exchange(scene, 10, KEY, {"deepest": lambda images: images.max(axis=(1, 2)), "image": np.asarray})
    lent = np.rint(255 * touched.numbers[touched.lenders, 1] / PAD.max_depth)
    np.testing.assert_array_equal(touched.lent["deepest"], lent)
    deeper = touched.numbers[touched.lenders, 1] > touched.numbers[:, 1]
    assert 0 < deeper.sum() < len(deeper)
    # Deeper into the same object every taxel reads at least as much as before; another object would not keep to that.
    assert (touched.lent["image"][deeper] >= touched.plain["image"][deeper]).all()
    assert (touched.lent["image"][~deeper] <= touched.plain["image"][~deeper]).all()


def test_every_touch_lends_once_and_objects_are_touched_in_every_pose():
    touched = exchange(Scene(pad=PAD, press_model=Quasistatic()), 9, KEY, {})
    assert sorted(touched.lenders) == list(range(9 * 4 * 6))
    assert sorted(zip(touched.object_ids, touched.poses, strict=True)) == [(n, p) for n in range(36) for p in range(6)]
    np.testing.assert_array_equal(np.bincount(touched.shapes), 4 * [9 * 6])


def test_other_streams_and_seeds_touch_other_objects():
    scene = Scene(pad=PAD, press_model=Quasistatic())
    numbers = [exchange(scene, 2, key, {}).numbers for key in ((0, 0), (0, 1), (1, 0))]
    assert not (set(numbers[0][:, 0]) & set(numbers[1][:, 0]))
    assert not (set(numbers[0][:, 0]) & set(numbers[2][:, 0]))


def test_an_imprint_that_does_not_follow_from_a_depth_cannot_be_lent_one():
    with pytest.raises(WrongPress, match="deformable pad"):
        exchange(Scene(press_model=Deformable()), 2, KEY, {})


def test_a_single_object_is_too_few():
    with pytest.raises(BadArgument, match="--objects"):
        Leak(objects=1).run()


@pytest.mark.slow
@pytest.mark.torch
@pytest.mark.mujoco
def test_the_result_is_the_same_whatever_the_number_of_workers(tmp_path):
    for jobs in (1, 2):
        Leak(SceneChoice("coarse"), objects=5, out=tmp_path / str(jobs), jobs=jobs).run()
    for name in ("leak.json", "leak.md"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()
    result = json.loads((tmp_path / "1" / "leak.json").read_text())
    assert (result["seed"], result["num_objects"], result["num_touches"], result["chance"]) == (0, 20, 120, 0.25)
    mean, low, high = result["accuracy"]["classifier"][PLAIN]
    assert low < mean < high
    assert mean > 0.45  # .70 on many objects; 120 touches of 20 objects spread by .06
    lost = result["differences"][f"classifier: {PLAIN} − {SHUFFLED}"][0]
    assert lost == pytest.approx(mean - result["accuracy"]["classifier"][SHUFFLED][0])


@pytest.mark.slow
@pytest.mark.torch
def test_a_network_learns_from_each_kind_of_image_only_what_that_kind_tells():
    # 480 exchanged touches of four shapes, read by depth: .25 plus or minus .12 holds but with probability 2e-9.
    scene = Scene(pad=PAD, press_model=OnlyDepthTells(), faults=())
    leak = Leak(train=20, input_size=16, change=Changes(epochs=8, batch_size=16, learning_rate=3e-3), jobs=1)
    shares = leak._small_networks(scene, exchange(scene, 20, KEY, {"image": np.asarray}))
    natural, shuffled, removed = (shares[f"small network, trained on: {kind}"] for kind in (PLAIN, SHUFFLED, REMOVED))
    assert natural[PLAIN].mean() == natural[REMOVED].mean() == removed[REMOVED].mean() == 1.0
    assert abs(natural[SHUFFLED].mean() - 0.25) < 0.12
    assert abs(shuffled[SHUFFLED].mean() - 0.25) < 0.12


@pytest.mark.slow
@pytest.mark.torch
def test_without_a_sensor_for_the_images_the_baselines_and_small_networks_remain(tmp_path, capsys):
    choice = SceneChoice("coarse", fidelity="quasistatic", renderer="gelsight")
    Leak(choice, objects=2, train=2, change=Changes(epochs=1), out=tmp_path, jobs=1).run()
    assert "no sensor for these images" in capsys.readouterr().out
    result = json.loads((tmp_path / "leak.json").read_text())
    assert result["sensor"] is None
    assert set(result["accuracy"]) == {
        "nearest neighbours, no image",
        *(f"small network, trained on: {kind}" for kind in (PLAIN, SHUFFLED, REMOVED)),
    }
    assert "small networks, each as it was trained" in (tmp_path / "leak.md").read_text()
