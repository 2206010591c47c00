"""Bounds on touches against what tests and integrals come to."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belief.observation_model import OutcomeTable
from planners.bounds.touch_count import touch_count_bounds


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(0.001, 0.3))
def test_bounds_are_numbers_symmetric_where_they_should_be_and_fall_with_the_error_allowed(seed, error):
    rng = np.random.default_rng(seed)
    table = OutcomeTable(rng.dirichlet(np.full(4, 0.7), size=(3, 4)))
    limits, laxer = touch_count_bounds(table, error), touch_count_bounds(table, error * 1.2)
    assert (limits.least_touches >= 0.0).all()
    assert (laxer.least_touches <= limits.least_touches).all()
    np.testing.assert_allclose(limits.chernoff, limits.chernoff.T, rtol=1e-9, atol=1e-12)
    # Chernoff's exponent lies between half Bhattacharyya's bound and the divergence.
    bhattacharyya = -np.log(np.sqrt(table.probs[:, :, None] * table.probs[:, None]).sum(axis=3)).max(axis=0)
    assert (limits.chernoff >= bhattacharyya - 1e-9).all()
    needed = (1 - 2 * error) * np.log((1 - error) / error)
    off = ~np.eye(4, dtype=bool)
    assert (limits.chernoff[off] <= needed / limits.least_touches[off] + 1e-9).all()


def test_gaussian_like_channels_have_the_chernoff_information_of_theory():
    # Two unit Gaussians two apart, finely discretised: KL = 2, Chernoff = 1/2.
    edges = np.linspace(-8, 10, 4001)
    centres = (edges[1:] + edges[:-1]) / 2
    probs = np.exp(-0.5 * (centres[None] - np.array([[0.0], [2.0]])) ** 2)
    limits = touch_count_bounds(OutcomeTable((probs / probs.sum(axis=1, keepdims=True))[None]), 0.01)
    assert limits.chernoff[0, 1] == pytest.approx(0.5, rel=1e-3)
    assert limits.least_touches[0, 1] == pytest.approx(0.98 * np.log(99) / 2.0, rel=1e-3)


def test_no_sequential_test_touches_less_than_the_bound():
    # Wald's test on a channel right seven times in ten, 10 000 objects: it meets the bound but for overshoot.
    error, rng = 0.05, np.random.default_rng(0)
    least = touch_count_bounds(OutcomeTable([[[0.7, 0.3], [0.3, 0.7]]]), error).least_touches[0, 1]
    step, limit = np.log(0.7 / 0.3), np.log((1 - error) / error)
    walks = np.cumsum(np.where(rng.random((10_000, 400)) < 0.7, step, -step), axis=1)
    touches = (np.abs(walks) >= limit).argmax(axis=1) + 1
    assert least <= touches.mean() < 1.5 * least


def test_shapes_that_feel_alike_in_every_pose_are_named():
    row = [0.5, 0.3, 0.2]
    limits = touch_count_bounds(OutcomeTable([[row, row, [0.1, 0.1, 0.8]]] * 2))
    assert limits.indistinguishable == [(0, 1)]
    assert limits.least_touches[0, 1] == np.inf
    assert limits.chernoff[0, 1] == 0.0
    assert np.isfinite(limits.least_touches[0, 2])


def test_an_outcome_that_only_one_shape_gives_can_decide_at_once():
    limits = touch_count_bounds(OutcomeTable([np.eye(2)]))
    assert limits.least_touches.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert limits.chernoff[0, 1] == np.inf


def test_the_best_pose_sets_the_bound():
    limits = touch_count_bounds(
        OutcomeTable([[[0.5, 0.5], [0.5, 0.5]], [[0.6, 0.4], [0.4, 0.6]], [[0.9, 0.1], [0.1, 0.9]]])
    )
    assert limits.best_poses[0, 1] == 2


@pytest.mark.parametrize("error", [0.0, 0.5, -1.0, float("nan")])
def test_errors_out_of_range_are_refused(error):
    with pytest.raises(ValueError, match="error must be in"):
        touch_count_bounds(OutcomeTable([np.eye(2)]), error)
