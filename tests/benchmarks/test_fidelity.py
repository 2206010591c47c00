"""Fidelities are compared press by press."""

import json

import numpy as np
import pytest

from benchmarks.fidelity import FidelityCommand, Pressed, agreement_of, shape_accuracy

pytestmark = pytest.mark.mujoco


def pressed(images, force, depth=None):
    n = len(force)
    depth = np.full(n, 1e-3) if depth is None else depth
    return Pressed(np.full(n, 2.0), np.asarray(force), depth, depth, np.asarray(images), np.zeros(n, bool))


def test_equal_presses_agree_completely(rng):
    images = rng.uniform(size=(5, 9))
    agreement = agreement_of(pressed(images, [2.0] * 5), pressed(images, [2.0] * 5))
    assert agreement.correlation == pytest.approx(1.0)
    assert agreement.force_error == 0.0


def test_an_unstable_press_is_counted_and_not_compared(rng):
    images = rng.uniform(size=(3, 9))
    other = pressed(np.vstack([images[:2], np.full((1, 9), np.nan)]), [2.0, 2.2, np.nan])
    agreement = agreement_of(pressed(images, [2.0] * 3), other)
    assert (agreement.num_presses, agreement.unstable) == (2, 1)
    assert agreement.force_error == pytest.approx(0.05)


def test_two_evenly_pressed_pads_agree():
    assert agreement_of(pressed(np.ones((1, 4)), [2.0]), pressed(np.ones((1, 4)), [2.0])).correlation == 1.0


def test_a_depth_that_follows_the_shape_gives_it_away(rng):
    blank = np.zeros((400, 1))
    told = {
        name: pressed(blank, rng.uniform(1, 3, 400), np.full(400, depth)) for name, depth in (("a", 1.0), ("b", 2.0))
    }
    same = {name: pressed(blank, rng.uniform(1, 3, 400), rng.uniform(size=400)) for name in "ab"}
    assert shape_accuracy(told, "depth") == 1.0
    assert shape_accuracy(same, "depth") < 0.65


@pytest.mark.slow
def test_the_comparison_is_written_whatever_the_number_of_workers(tmp_path):
    for jobs in (1, 2):
        FidelityCommand(presses=30, soft_presses=0, out=tmp_path / f"{jobs}.json", jobs=jobs).run()
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()
    numbers = json.loads((tmp_path / "1.json").read_text())
    assert set(numbers["agreement"]) == {"dynamic"}
    for row in numbers["agreement"]["dynamic"].values():
        assert row["num_presses"] == 30
        assert row["correlation"] > 0.98
        assert row["force_error_high"] < 0.11
