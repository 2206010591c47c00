"""What an accuracy owes to force and depth: sensors that are known to cheat, or not to, are told apart."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from activetouch import SHAPES, Quasistatic, Scene
from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.pressing.contact import Phase, Trace, elastic_contact, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press
from activetouch.rendering import RENDERERS
from benchmarks.leak import (
    PLAIN,
    REMOVED,
    SHUFFLED,
    Leak,
    contact_at_depth,
    exchange,
    judged,
    shares_without_image,
    with_numbers_of,
)
from experiments.scene_choice import SceneChoice

PAD = Pad(num_taxels=16)
KEY = (0, 0)


@dataclass(frozen=True)
class OnlyDepthTells(Press):
    """Every object feels like one sphere, pressed as deep as its shape says."""

    def press(self, pad, placement, target_force):
        shape = next(k for k, shape in enumerate(SHAPES.values()) if shape is placement.shape)
        ball = surface_gap(pad, replace(placement, shape=SHAPES["sphere"], offset=np.zeros(2), scale=1.0))
        return contact_at_depth(pad, ball, 0.5e-3 * (1 + shape))


@dataclass(frozen=True)
class OnlyGeometryTells(Press):
    """Every object is pressed to one depth, and the force is said to be one force."""

    def press(self, pad, placement, target_force):
        contact = contact_at_depth(pad, surface_gap(pad, placement), 1e-3)
        return replace(contact, force=2.0)


def depth_reader(images):
    """The shape that goes with the deepest taxel under :class:`OnlyDepthTells`."""
    depth = images.max(axis=(1, 2)) / 255 * PAD.max_depth
    return np.rint(depth / 0.5e-3).astype(int) - 1


def test_a_sensor_that_reads_nothing_but_depth_is_exposed():
    # 960 exchanged touches of four shapes: 0.25 plus or minus 0.08 holds but with probability 1e-7.
    scene = Scene(pad=PAD, press_model=OnlyDepthTells(), faults=())
    touched = exchange(scene, 40, KEY, depth_reader)
    shares = judged(touched, touched.plain, touched.lent)
    assert shares_without_image(touched.numbers, touched.shapes, touched.object_ids)["depth"].mean() == 1.0
    assert shares[PLAIN].mean() == 1.0
    assert abs(shares[SHUFFLED].mean() - 0.25) < 0.08
    assert shares[REMOVED].mean() == 1.0


def test_where_all_are_pressed_alike_the_exchange_changes_no_image_and_numbers_tell_nothing():
    for renderer in RENDERERS.values():
        scene = Scene(pad=PAD, press_model=OnlyGeometryTells(), renderer=renderer)
        touched = exchange(scene, 5, KEY, np.asarray)
        np.testing.assert_array_equal(touched.plain, touched.lent)
        for share in shares_without_image(touched.numbers, touched.shapes, touched.object_ids).values():
            assert share.mean() == pytest.approx(0.25)


def test_an_exchanged_touch_has_the_depth_of_its_lender_and_the_contact_region_of_its_own_geometry():
    scene = Scene(pad=PAD, press_model=Quasistatic(), faults=())
    touched = exchange(scene, 10, KEY, np.asarray)
    lent = np.rint(255 * touched.numbers[touched.lenders, 1] / PAD.max_depth)
    np.testing.assert_array_equal(touched.lent.max(axis=(1, 2)), lent)
    deeper = touched.numbers[touched.lenders, 1] > touched.numbers[:, 1]
    assert 0 < deeper.sum() < len(deeper)
    # Deeper into the same object every taxel reads at least as much as before; another object would not keep to that.
    assert (touched.lent[deeper] >= touched.plain[deeper]).all()
    assert (touched.lent[~deeper] <= touched.plain[~deeper]).all()


@pytest.mark.mujoco
def test_the_command_says_how_much_is_lost_with_the_depth_of_another_touch(tmp_path):
    Leak(SceneChoice("coarse", fidelity="quasistatic"), objects=5, out=tmp_path, jobs=1).run()
    result = json.loads((tmp_path / "leak.json").read_text())
    assert (result["seed"], result["num_objects"], result["num_touches"], result["chance"]) == (0, 20, 120, 0.25)
    mean, low, high = result["accuracy"]["classifier"][PLAIN]
    assert low < mean < high
    assert mean > 0.45  # 0.70 on many objects; 120 touches of 20 objects spread by 0.06
    lost = result["differences"][f"classifier: {PLAIN} − {SHUFFLED}"][0]
    assert lost == pytest.approx(mean - result["accuracy"]["classifier"][SHUFFLED][0])


def held(force, point=(0.001, -0.002), steps=30):
    """A trace that holds a force vector at a point."""
    return Trace(
        time=0.002 * np.arange(steps),
        position=np.zeros((steps, 3)),
        force=np.tile(np.asarray(force, float), (steps, 1)),
        point=np.tile(point, (steps, 1)),
        phase=[Phase.PAUSE] * steps,
    )


def gap_of(shape):
    return surface_gap(PAD, Placement(SHAPES[shape], 1.0, random_orientation(np.random.default_rng(1))))


@pytest.mark.parametrize("renderer", RENDERERS.values(), ids=RENDERERS)
def test_a_contact_that_borrows_from_the_same_object_pressed_harder_looks_like_that(renderer):
    gap = gap_of("cone")
    for traces in ((None, None), (held([0.5, 0.0, 0.0]), held([2.0, 0.0, 0.0]))):
        gentle, hard = (elastic_contact(PAD, gap, f, trace=t) for f, t in zip((0.5, 2.0), traces, strict=True))
        assert (renderer(gentle) != renderer(hard)).any()
        np.testing.assert_allclose(renderer(with_numbers_of(hard, gentle)), renderer(hard), atol=1e-12)
        np.testing.assert_array_equal(renderer(with_numbers_of(hard, hard)), renderer(hard))
