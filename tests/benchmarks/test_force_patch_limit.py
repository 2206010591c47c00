"""Readers of force-patch images see what an image holds, and neighbours read its numbers as well as can be."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from activetouch.data.dataset import CollectionPlan
from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from activetouch.pressing.trace import Trace
from activetouch.rendering import ForcePatchRenderer, GelSightRenderer, read_out
from benchmarks.force_patch_limit import (
    NEIGHBOURS,
    NUMBERS,
    PLACE,
    REACH,
    VIEWS,
    WHOLE_SPOT,
    CloseReader,
    Main,
    PressNumbers,
    close_ups,
    cover_hart_accuracy,
    drawn_rows,
    neighbour_guesses,
    press_numbers,
    read_by_neighbours,
)
from benchmarks.force_patch_limit import levels as brightness_levels
from benchmarks.held_out import Stream, held_out_touch
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect

SCENE = SCENES["paper"].scene
RENDERER = SCENE.renderer
DARKEST = np.array([68, 1, 84], np.uint8)
"""Of the colours of viridis."""


def test_every_view_can_be_made():
    numbers = PressNumbers(np.zeros(2, int), np.ones((2, len(NUMBERS))))
    for columns in VIEWS.values():
        assert numbers.view(columns).shape == (2, len(columns))


@pytest.mark.mujoco
@pytest.mark.parametrize("number", range(8))
def test_an_image_is_drawn_from_the_size_of_the_force_and_the_contact_point_of_a_few_rows(number):
    contact = held_out_touch(SCENE, 0, Stream.TEST, number).contact
    rows = drawn_rows(contact, SCENE.renderer)
    along_x = np.zeros_like(rows.force)
    along_x[:, 0] = np.linalg.norm(rows.force, axis=1)
    bare = replace(rows, force=along_x, position=np.zeros_like(rows.position))
    nothing = np.zeros_like(contact.gap)
    other = replace(contact, gap=nothing, indentation=nothing, pressure=nothing, force=0.0, trace=bare)
    np.testing.assert_array_equal(SCENE.renderer(other), SCENE.renderer(contact))


@pytest.mark.mujoco
@pytest.mark.parametrize("number", [1, 2, 3, 7])
def test_creep_that_is_not_counted_is_not_in_the_image(number):
    contact = held_out_touch(SCENE, 0, Stream.TEST, number).contact
    rows = drawn_rows(contact, SCENE.renderer)
    still = replace(rows, point=np.broadcast_to(rows.point.mean(axis=0), rows.point.shape))
    same = (SCENE.renderer(replace(contact, trace=still)) == SCENE.renderer(contact)).all()
    creep = press_numbers(contact, SCENE.renderer)[[NUMBERS.index(f"{name} change") for name in ("along", "across")]]
    assert same == (not creep.any())


@pytest.mark.mujoco
def test_turning_and_mirroring_a_press_leaves_its_numbers():
    contact = held_out_touch(SCENE, 0, Stream.TEST, 1).contact
    trace = contact.trace
    expected = press_numbers(contact, SCENE.renderer)
    assert 0.0 < expected[2] < expected[1]
    for swap in (False, True):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            order = [1, 0] if swap else [0, 1]
            turned = replace(
                trace,
                point=trace.point[:, order] * signs,
                force=np.column_stack([trace.force[:, 0], trace.force[:, 1:][:, order] * signs]),
            )
            np.testing.assert_allclose(press_numbers(replace(contact, trace=turned), SCENE.renderer), expected)


def test_a_miss_has_no_numbers():
    contact = Quasistatic().press(SCENE.setup, replace(fresh_placement(), offset=np.array([1.0, 1.0])), 1.0)
    nothing = Trace(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2)), [])
    assert not press_numbers(replace(contact, trace=nothing), SCENE.renderer).any()


def test_a_press_without_trace_is_refused():
    with pytest.raises(ValueError, match="no trace"):
        press_numbers(Quasistatic().press(SCENE.setup, fresh_placement(), 1.0), SCENE.renderer)


def fresh_placement():
    rng = np.random.default_rng(0)
    return SCENE.place(SCENE.sample_object(1, rng), 0, rng)


def toy(count, rng, second=1.0):
    """Two shapes whose forces are Gaussians 2 apart, and whose contact points are ``second`` apart."""
    shapes = np.arange(count) % 2
    values = rng.normal(size=(count, len(NUMBERS)))
    values[:, 0] += 2.0 * shapes
    values[:, 1] += second * shapes
    return PressNumbers(shapes, values)


def test_neighbours_reach_the_best_accuracy_of_two_gaussians(rng):
    # Best: Φ(1) = .841. 4 000 guesses have a standard error of .006: four of them, and .01 for so few neighbours.
    known, choice, test = toy(8000, rng), toy(2000, rng), toy(4000, rng)
    reader = read_by_neighbours(known, choice, test, ("force",))
    accuracy = np.mean(reader.guesses == test.shapes)
    best = stats.norm.cdf(1.0)
    assert best - 0.034 < accuracy < best + 0.024
    assert reader.upper > best - 0.024


def test_more_numbers_tell_more(rng):
    # Best: Φ(1) = .841 and Φ(√2) = .921; the standard error of the difference is below .006.
    known, choice, test = toy(8000, rng, 2.0), toy(2000, rng, 2.0), toy(4000, rng, 2.0)
    one, two = (read_by_neighbours(known, choice, test, c).guesses for c in (("force",), ("force", "along")))
    assert np.mean(two == test.shapes) > np.mean(one == test.shapes) + 0.04


def test_units_do_not_matter(rng):
    known, test = toy(500, rng).values[:, :2], toy(200, rng).values[:, :2]
    shapes = np.arange(500) % 2
    first = neighbour_guesses(known, shapes, test, NEIGHBOURS)
    np.testing.assert_array_equal(first, neighbour_guesses(np.exp(known), shapes, np.exp(test), NEIGHBOURS))


def test_relabelling_permutes_the_guesses(rng):
    known, test = rng.normal(size=(300, 2)), rng.normal(size=(100, 2))
    shapes, order = rng.integers(0, 3, 300), np.array([2, 0, 1])
    np.testing.assert_array_equal(
        order[neighbour_guesses(known, shapes, test, (1, 5))], neighbour_guesses(known, order[shapes], test, (1, 5))
    )


def test_fewer_known_touches_than_neighbours_all_vote(rng):
    assert neighbour_guesses(
        rng.normal(size=(3, 1)), np.array([1, 1, 0]), rng.normal(size=(4, 1)), (101,)
    ).tolist() == [[1, 1, 1, 1]]


def test_the_bound_of_cover_and_hart_inverts_their_inequality():
    for error in (0.0, 0.1, 0.3, 0.6, 0.75):  # e* of four shapes
        worst = error * (2 - 4 / 3 * error)
        assert cover_hart_accuracy(1.0 - worst, 4) == pytest.approx(1.0 - error)
    assert cover_hart_accuracy(0.1, 4) == pytest.approx(0.25)  # worse than chance: no reader need be better


@pytest.fixture(scope="module")
def contact():
    """Of a cone; its contact point lies off the pad's centre and diagonals."""
    return held_out_touch(SCENE, 0, Stream.TEST, 3).contact


def read(contact):
    return read_out(RENDERER(contact), (), np.random.default_rng(0))


@pytest.mark.parametrize("colormap", ["viridis", "magma", "gray"])
def test_colours_are_undone(colormap, contact):
    image = read_out(ForcePatchRenderer(colormap=colormap)(contact), (), np.random.default_rng(0))
    grey = read_out(ForcePatchRenderer(colormap="gray")(contact), (), np.random.default_rng(0))[..., 0]
    levels = brightness_levels(image, colormap).astype(int)
    # Two neighbouring levels may share a colour; then the lower is given.
    assert levels.max() == 255
    assert np.all((levels <= grey) & (levels + 1 >= grey))


def test_images_of_other_colours_are_refused(contact):
    gelsight = read_out(GelSightRenderer()(contact), (), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"the pixel at \[0, 0, 0\] has the colour .* viridis does not have"):
        close_ups(gelsight[None], RENDERER)


def test_turned_and_mirrored_images_look_the_same(contact):
    image = read(contact)
    views = [turned[:, ::mirror] for turned in (np.rot90(image, n) for n in range(4)) for mirror in (1, -1)]
    seen = close_ups(np.stack(views), RENDERER)
    assert seen.shape == (8, (2 * REACH + 1) ** 2 + PLACE)
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], seen.shape), atol=1e-6)


def test_place_and_brightness_are_those_of_the_spot(contact):
    *_, along, across, _, _, brightness = close_ups(read(contact)[None], RENDERER)[0]
    rows = contact.trace.select(slice(0, contact.trace.end_of_pause))
    place = np.sort(np.abs(rows.point[-1])) / contact.pad.half_width
    np.testing.assert_allclose((across, along), place, atol=0.5 / 128)  # half a pixel
    assert brightness**2 == pytest.approx(brightness_levels(read(contact), RENDERER.colormap).mean() / 255, rel=1e-5)


def test_a_spot_at_the_rim_and_an_empty_image_are_seen(contact):
    trace = replace(contact.trace, point=np.full_like(contact.trace.point, contact.pad.half_width))
    rim, empty = read(replace(contact, trace=trace)), np.zeros((128, 128, 3), np.uint8) + DARKEST
    seen = close_ups(np.stack([rim, empty]), RENDERER)
    assert np.isfinite(seen).all()
    assert 0.9 < seen[0, -PLACE] <= 1.0
    assert not seen[1, : (2 * REACH + 1) ** 2].any()


@pytest.mark.torch
def test_the_reader_reaches_the_best_accuracy_of_two_gaussians(rng):
    # Best: Φ(1) = .841; the standard error of 4 000 guesses is .006.
    shapes = np.arange(8000) % 2
    rows = rng.normal(size=(8000, 5)).astype(np.float32)
    rows[:, 0] += 2.0 * shapes
    read = CloseReader(epochs=5).learn(rows[:4000], shapes[:4000], seed=0)
    log_probs = read(rows[4000:])
    assert abs(np.mean(log_probs.argmax(axis=1) == shapes[4000:]) - stats.norm.cdf(1.0)) < 0.024
    np.testing.assert_allclose(np.exp(log_probs).sum(axis=1), 1.0, rtol=1e-5)


@pytest.mark.torch
@pytest.mark.mujoco
@pytest.mark.parametrize("is_pixels", [False, True])
def test_the_findings_are_written(is_pixels, tmp_path):
    data = tmp_path / "data" if is_pixels else None
    if data is not None:
        collect(SceneChoice("paper"), CollectionPlan(train=4, calibration=1, test=1), data, jobs=1)
    Main(data, touches=24, known=160, choice=40, out=tmp_path / "limit", jobs=1).run()
    numbers = json.loads((tmp_path / "limit" / "limit.json").read_text())
    assert numbers["sizes"] == ([24, 48, 96] if is_pixels else [10, 20, 40, 80, 160])
    assert 0.0 < numbers["classifier"]["value"] <= 1.0
    if is_pixels:
        assert numbers["views"][WHOLE_SPOT]["learned_from"] > 0.5  # four shapes
