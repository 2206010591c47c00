"""Fidelities are compared press by press."""

import json

import numpy as np
import pytest

from benchmarks.fidelity import FidelityCommand, Pressed, agreement_of

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


@pytest.mark.slow
def test_the_comparison_is_written_whatever_the_number_of_workers(tmp_path):
    for jobs in (1, 2):
        FidelityCommand(presses=12, soft_presses=0, out=tmp_path / f"{jobs}.json", jobs=jobs).run()
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()
    numbers = json.loads((tmp_path / "1.json").read_text())
    assert set(numbers["agreement"]) == {"dynamic"}
    for row in numbers["agreement"]["dynamic"].values():
        assert row["num_presses"] == 12
        assert row["correlation"] > 0.98
        assert row["force_error_high"] < 0.11
