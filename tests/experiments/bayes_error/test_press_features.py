"""Force-patch images are functions of the numbers that are kept, and neighbours read them as well as can be."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from activetouch.pressing.trace import Trace
from experiments.bayes_error.held_out import Stream, fresh_touch
from experiments.bayes_error.press_features import (
    NEIGHBOURS,
    NUMBERS,
    VIEWS,
    PressNumbers,
    cover_hart_accuracy,
    drawn_rows,
    neighbour_guesses,
    press_numbers,
    read_by_neighbours,
)

SCENE = SCENES["paper"].scene


def test_every_view_can_be_made():
    numbers = PressNumbers(np.zeros(2, int), np.ones((2, len(NUMBERS))))
    for columns in VIEWS.values():
        assert numbers.view(columns).shape == (2, len(columns))


@pytest.mark.mujoco
@pytest.mark.parametrize("number", range(8))
def test_an_image_is_drawn_from_the_size_of_the_force_and_the_contact_point_of_a_few_rows(number):
    contact = fresh_touch(SCENE, 0, Stream.TEST, number).contact
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
    contact = fresh_touch(SCENE, 0, Stream.TEST, number).contact
    rows = drawn_rows(contact, SCENE.renderer)
    still = replace(rows, point=np.broadcast_to(rows.point.mean(axis=0), rows.point.shape))
    same = (SCENE.renderer(replace(contact, trace=still)) == SCENE.renderer(contact)).all()
    creep = press_numbers(contact, SCENE.renderer)[[NUMBERS.index(f"{name} change") for name in ("along", "across")]]
    assert same == (not creep.any())


@pytest.mark.mujoco
def test_turning_and_mirroring_a_press_leaves_its_numbers():
    contact = fresh_touch(SCENE, 0, Stream.TEST, 1).contact
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
    contact = Quasistatic().press(SCENE.stage, replace(fresh_placement(), offset=np.array([1.0, 1.0])), 1.0)
    nothing = Trace(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2)), [])
    assert not press_numbers(replace(contact, trace=nothing), SCENE.renderer).any()


def test_a_press_without_trace_is_refused():
    with pytest.raises(ValueError, match="no trace"):
        press_numbers(Quasistatic().press(SCENE.stage, fresh_placement(), 1.0), SCENE.renderer)


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
