"""A belief from coarse to fine agrees with the whole table, in bounded memory, at extremes too."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from belief.cell_kernel import CellKernel
from belief.coarse_to_fine import CoarseToFine, Effort, NestedCells
from belief.errors import ImpossibleObservation, InvalidArgument
from tests.belief.test_cell_kernel import transitions

BODIES, FINEST = 20, 6 * 4 * 4
CELLS = NestedCells(tuple(np.full(n, 1 / n) for n in (6, 24, FINEST)))


class Table:
    """Each touch is a table of the finest cells; a coarser cell has the mean likelihood of its parts."""

    def coarsest(self, touch):
        return means(touch, 6)

    def parts(self, touches, level, bodies, parents):
        tables = [
            means(touch, len(CELLS.shares[level]))[bodies[:, None], CELLS.parts(level, parents)] for touch in touches
        ]
        return np.sum(tables, axis=0)


def means(touch, number):
    parts = touch.reshape(len(touch), number, -1)
    return logsumexp(parts, axis=2) - np.log(parts.shape[2])


def touches_of(rng, truth, number, noise=1.5):
    found = []
    for _ in range(number):
        table = rng.normal(0.0, noise, (BODIES, FINEST))
        table[truth] += 2.0
        found.append(table)
    return found


def brute(touches, scale=1.0, prior=0.0):
    return logsumexp(scale * np.sum(touches, axis=0) - np.log(FINEST), axis=1) + prior


def updated(touches, effort, **settings):
    belief = CoarseToFine.start(np.zeros(BODIES), CELLS, Table(), effort, **settings)
    for touch in touches:
        belief = belief.update(touch)
    return belief


def test_with_no_tolerance_evidence_is_that_of_the_whole_table():
    touches = touches_of(np.random.default_rng(0), (3, 50), 5)
    effort = Effort(tolerance=0.0, splits=10**6, at_once=7, kept=10**6, floor=0.0)
    belief = updated(touches, effort, scale=0.7, drift=0.1)
    assert belief.unresolved == 0.0
    np.testing.assert_allclose(belief.log_evidence, brute(touches, 0.7 / 1.4), atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_with_little_effort_the_posterior_is_nearly_that_of_the_whole_table(seed):
    rng = np.random.default_rng(seed)
    touches = touches_of(rng, (rng.integers(BODIES), rng.integers(FINEST)), 8)
    belief = updated(touches, Effort(tolerance=0.01, splits=64, at_once=16, kept=64))
    expected = np.exp(brute(touches) - logsumexp(brute(touches)))
    assert np.abs(belief.probs - expected).max() < 0.05
    assert belief.num_split <= 2 * 64
    assert abs(belief.probs.sum() - 1.0) < 1e-9


def test_leaves_are_all_bodies_in_all_cells_once():
    touches = touches_of(np.random.default_rng(1), (3, 50), 6)
    belief = updated(touches, Effort(splits=20, kept=15))
    leaves = belief.leaves()
    shares = np.array([CELLS.shares[level][0] for level in leaves.level])
    np.testing.assert_allclose(np.bincount(leaves.body, shares), 1.0)
    np.testing.assert_allclose(logsumexp(leaves.log_weight), logsumexp(belief.log_evidence + belief.log_prior))


def test_parts_that_lost_the_posterior_are_set_aside_without_a_change_and_return():
    rng = np.random.default_rng(2)
    first, then = touches_of(rng, (3, 50), 6, 0.7), touches_of(rng, (11, 7), 14, 0.7)
    effort = Effort(tolerance=0.0, splits=10**6, kept=10**6, floor=0.0)
    belief = updated(first, effort)
    fewer = replace(belief, effort=Effort(kept=4))._less()
    assert fewer.num_split <= 5 < belief.num_split
    np.testing.assert_allclose(fewer.log_evidence, belief.log_evidence, atol=1e-9)
    belief = updated([*first, *then], Effort(tolerance=0.01, kept=16, floor=1e-4))
    assert belief.probs.argmax() == 11
    assert belief.probs[11] > 0.9
    leaves = belief.leaves()
    assert (leaves.body[leaves.log_weight.argmax()], leaves.cell[leaves.log_weight.argmax()]) == (11, 7)


def test_a_body_that_is_impossible_stays_so_and_one_body_is_certain():
    prior = np.where(np.arange(BODIES) == 3, -np.inf, 0.0)
    touch = touches_of(np.random.default_rng(4), (3, 50), 1)[0]
    belief = CoarseToFine.start(prior, CELLS, Table()).update(touch)
    assert belief.probs[3] == 0.0
    one = CoarseToFine.start([0.0], CELLS, Table()).update(touch[:1])
    np.testing.assert_allclose(one.probs, [1.0])


def test_what_cannot_be_is_refused_and_the_belief_stays():
    belief = CoarseToFine.start(np.zeros(BODIES), CELLS, Table())
    with pytest.raises(ImpossibleObservation, match="touch number 1"):
        belief.update(np.full((BODIES, FINEST), -np.inf))
    with pytest.raises(ValueError, match="NaN"):
        belief.update(np.full((BODIES, FINEST), np.nan))
    with pytest.raises(ValueError, match="shape"):
        belief.update(np.zeros((BODIES + 1, FINEST)))
    np.testing.assert_allclose(belief.probs, 1 / BODIES)
    for prior in (np.full(3, -np.inf), [np.nan, 0.0], []):
        with pytest.raises(ValueError, match="log_prior"):
            CoarseToFine.start(prior, CELLS, Table())
    with pytest.raises(InvalidArgument, match="splits"):
        Effort(splits=0)
    with pytest.raises(ValueError, match="division"):
        NestedCells((np.full(2, 0.5), np.full(3, 1 / 3)))
    with pytest.raises(ValueError, match="share"):
        NestedCells((np.full(2, 0.5), np.array([0.4, 0.2, 0.2, 0.2])))


def test_huge_evidence_neither_overflows_nor_underflows():
    touch = np.full((BODIES, FINEST), -1e300)
    touch[5, 9] = 0.0
    np.testing.assert_allclose(CoarseToFine.start(np.zeros(BODIES), CELLS, Table()).update(touch).probs[5], 1.0)


def test_a_closer_look_decides_between_some_bodies_and_leaves_their_sum():
    touches = touches_of(np.random.default_rng(7), (3, 50), 3, 0.7)
    belief = updated(touches, Effort())
    few, closer = np.array([3, 8, 11]), np.log([0.7, 0.3, 1e-9]) - 900.0
    looked = belief.corrected(few, closer)
    sum_of_few = belief.probs[few].sum()
    np.testing.assert_allclose(looked.probs[few], sum_of_few * np.array([0.7, 0.3, 1e-9]), rtol=1e-6)
    others = np.delete(np.arange(BODIES), few)
    np.testing.assert_allclose(looked.probs[others], belief.probs[others])
    np.testing.assert_allclose(looked.corrected(few, closer).probs, looked.probs)
    both = looked.update(touches[0]).probs, belief.update(touches[0]).probs
    change = [np.log(after[3] / after[8]) for after in (*both, looked.probs, belief.probs)]
    assert change[0] - change[1] == pytest.approx(change[2] - change[3], abs=1e-6)  # it stays
    assert abs(both[0].sum() - 1.0) < 1e-9
    for wrong in ([np.nan, 0.0, 0.0], [-np.inf] * 3, [np.inf, 0.0, 0.0]):
        with pytest.raises(ValueError, match="evidence"):
            belief.corrected(few, np.array(wrong))


def test_what_moves_between_touches_is_the_sum_over_all_cells_before_and_after():
    rng, prob = np.random.default_rng(3), 0.3
    touches = [0.5 * touch for touch in touches_of(rng, (3, 50), 4)]
    close = rng.uniform(0.1, 1.0, (6, 6))
    kernel = CellKernel.of(close + close.T, np.ones(6))
    number = FINEST // 6
    step = np.kron(transitions(kernel), np.full((number, number), 1 / number))
    weights, before = np.full((BODIES, FINEST), 1 / FINEST / BODIES), None
    for count, touch in enumerate(touches):
        before = (1 - prob) * weights if count else weights
        weights = (before + prob * weights @ step if count else weights) * np.exp(0.7 * touch)
    moved = 1.0 - (before * np.exp(0.7 * touches[-1])).sum(axis=1) / weights.sum(axis=1)
    effort = Effort(tolerance=0.0, splits=10**6, at_once=7, kept=10**6, floor=0.0)
    belief = updated(touches, effort, scale=0.7, moves=(kernel, prob))
    assert belief.unresolved == 0.0
    np.testing.assert_allclose(belief.log_of_bodies, np.log(weights.sum(axis=1)), atol=1e-4)
    np.testing.assert_allclose(belief.moved, moved, atol=1e-4)
    rough = updated(touches, Effort(tolerance=0.01, splits=64, at_once=16, kept=64), scale=0.7, moves=(kernel, prob))
    assert np.abs(rough.probs - weights.sum(axis=1) / weights.sum()).max() < 0.05
    assert rough.num_split <= 2 * 64


def test_what_never_moves_is_as_without_moves():
    touches = touches_of(np.random.default_rng(4), (3, 50), 5)
    kernel, effort = CellKernel.of(np.ones((6, 6)), np.ones(6)), Effort(splits=20, kept=15)
    still, never = (updated(touches, effort, moves=moves) for moves in (None, (kernel, 0.0)))
    np.testing.assert_allclose(never.log_probs, still.log_probs, atol=1e-9)
    np.testing.assert_allclose(never.moved, 0.0, atol=1e-6)
    with pytest.raises(ValueError, match="coarsest cells"):
        updated([], effort, moves=(CellKernel.of(np.ones((2, 2)), np.ones(2)), 0.1))
