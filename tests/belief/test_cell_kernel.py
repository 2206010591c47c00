"""Kernels of moves: they keep sums and the prior, and are the products of the matrices that they stand for."""

import numpy as np
import pytest

from belief.cell_kernel import CellKernel

RNG = np.random.default_rng(0)
CLOSE = RNG.uniform(0.0, 1.0, (5, 5)) ** 3 + np.eye(5)
CLOSE += CLOSE.T
WIDE = np.array([0, 3, 3, 1, 4, 2, 0, 1, 4, 4])
SHARES = RNG.uniform(0.5, 2.0, 10) / 10


def transitions(kernel):
    """From each cell to each other one, ``(N, N)``, whose rows sum to 1."""
    joint = np.zeros((len(kernel.shares),) * 2)
    rows = np.repeat(np.arange(len(kernel.shares)), np.diff(kernel.starts))
    joint[rows, kernel.columns] = kernel.joint
    found = joint / kernel.shares[:, None]
    return found[np.ix_(kernel.wide, kernel.wide)] * kernel.parts if len(kernel.wide) else found


KERNELS = {"of cells": CellKernel.of(CLOSE, SHARES[:5]), "of wide cells": CellKernel.of(CLOSE, SHARES, WIDE)}


@pytest.mark.parametrize("name", KERNELS)
def test_a_move_is_the_product_with_its_matrix_and_keeps_sums_and_the_prior(name):
    kernel = KERNELS[name]
    matrix = transitions(kernel)
    number = kernel.num_cells
    shares = SHARES[:number] / SHARES[:number].sum()
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=1e-9)
    np.testing.assert_allclose(shares @ matrix, shares, rtol=1e-6)
    weights = RNG.uniform(0.0, 1.0, (3, 2, number))
    for prob in (0.0, 0.2, 1.0):
        found = np.exp(kernel.moved(np.log(weights), prob))
        np.testing.assert_allclose(found, (1 - prob) * weights + prob * weights @ matrix, rtol=1e-5)
        np.testing.assert_allclose(found.sum(axis=-1), weights.sum(axis=-1), rtol=1e-5)
    np.testing.assert_allclose(np.exp(kernel.mean(np.log(weights))), weights @ matrix.T, rtol=1e-5)


def test_what_is_impossible_stays_so_and_nothing_overflows():
    kernel = KERNELS["of cells"]
    logs = np.array([[-np.inf] * 5, [900.0, -900.0, 0.0, 0.0, 0.0]])
    found = kernel.moved(logs, 0.5)
    assert not np.isnan(found).any()
    assert found[0].max() < -80.0
    assert found[1].max() == pytest.approx(900.0, abs=2.0)


@pytest.mark.parametrize(
    ("closeness", "shares", "wide"),
    [
        (CLOSE, np.ones(4), None),
        (CLOSE, np.array([1.0, 1.0, 0.0, 1.0, 1.0]), None),
        (CLOSE, np.array([1.0, 1.0, np.nan, 1.0, 1.0]), None),
        (-CLOSE, np.ones(5), None),
        (CLOSE - np.diag(np.diag(CLOSE)), np.ones(5), None),
        (CLOSE, np.ones(10), np.minimum(WIDE, 3)),
    ],
)
def test_what_is_no_kernel_is_refused(closeness, shares, wide):
    with pytest.raises(ValueError, match=r"closeness|shares"):
        CellKernel.of(closeness, shares, wide)
