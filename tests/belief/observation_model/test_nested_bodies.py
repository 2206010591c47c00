"""Nested cells beside the table of hypotheses: with one level of cells, both are the same model."""

from dataclasses import replace

import numpy as np
import pytest

from belief.cell_kernel import CellKernel
from belief.coarse_to_fine import Effort, NestedCells
from belief.errors import InvalidArgument
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.observation_model.model import check_observation_model
from belief.observation_model.moving_body import MovingBodyModel
from belief.observation_model.nested_bodies import NestedBodyModel
from belief.problem import Elsewhere, SearchProblem, Touch
from belief.synthetic import sample_arrangement
from planners import Outcome, make_decider, search

POSES, BODIES, CELLS, WIDTH = 3, 5, 16, 4
LABELS = tuple("abcde")


class Table:
    """Cells of bodies that look in each pose as a table says; each cell has two parts, which look the same."""

    num_poses = POSES

    def __init__(self, table):
        self.table = table  # (P, K, N, D)

    def felt(self, pose, embedding):
        return pose, embedding

    def coarsest(self, touch):
        return self.table[touch[0]] @ touch[1]

    def parts(self, touches, level, bodies, parents):
        return sum(self.coarsest(touch)[bodies, parents] for touch in touches)[:, None].repeat(2, axis=1)

    def log_ratios(self, level, bodies, cells, references, poses=None):
        chosen = self.table if poses is None else self.table[list(poses)]
        return (chosen[:, bodies, np.where(level, cells // 2, cells)] @ references.T).astype(np.float32)

    def looked(self, belief):
        return belief

    def fields(self):
        return {}


@pytest.fixture(scope="module")
def table():
    return np.random.default_rng(0).normal(0.0, 1.2, (POSES, BODIES, CELLS, WIDTH)).astype(np.float32)


def nested(table, num_levels=1, **options):
    cells = NestedCells(tuple(np.full(CELLS * 2**level, 1 / CELLS / 2**level) for level in range(num_levels)))
    references = np.random.default_rng(1).normal(0.0, 1.5, (64, WIDTH)).astype(np.float32)
    return NestedBodyModel(LABELS, cells, Table(table), 0.8, 0.1, references, np.zeros(64, np.float32), **options)


def touches(number, rng):
    poses = rng.integers(POSES, size=number).tolist()
    return [Touch(pose, features=rng.normal(0.0, 1.5, WIDTH)) for pose in poses]


@pytest.mark.parametrize("num_levels", [1, 2])
def test_one_level_of_cells_is_a_table_of_hypotheses_also_with_repeats_and_drift(table, num_levels):
    rng, model = np.random.default_rng(2), nested(table, num_levels, effort=Effort(tolerance=0.0))
    blank = np.ones((POSES, 1, WIDTH)), np.zeros((POSES, 1, BODIES))
    flat = RigidBodyModel(LABELS, CELLS, 1 / 0.8, *blank, 0.5, None, (), 0.1, hypotheses=FixedHypotheses(table))
    mine, theirs = model.start(), flat.start()
    for touch in touches(7, rng):
        mine, theirs = mine.update(touch), theirs.update(touch)
        ours = mine.log_likelihood - mine.log_likelihood.max()
        np.testing.assert_allclose(ours, theirs.log_likelihood - theirs.log_likelihood.max(), atol=1e-4)
    assert mine.num_touches == 7


@pytest.mark.parametrize("num_levels", [1, 2])
def test_bodies_that_move_are_those_of_a_table(table, num_levels):
    close = np.random.default_rng(5).uniform(0.0, 1.0, (CELLS, CELLS)) ** 4 + np.eye(CELLS)
    kernel = CellKernel.of(close + close.T, np.ones(CELLS))
    model = replace(nested(table, num_levels, effort=Effort(tolerance=0.0), moves=(kernel, 0.3)), drift=0.0)
    blank = np.ones((POSES, 1, WIDTH)), np.zeros((POSES, 1, BODIES))
    flat = RigidBodyModel(LABELS, CELLS, 1 / 0.8, *blank, hypotheses=FixedHypotheses(table))
    mine, theirs = model.start(), MovingBodyModel.of(flat, 0.3, kernel).start()
    assert mine.moved.tolist() == [0.0] * BODIES
    rng = np.random.default_rng(6)
    for pose in (2, 0, 1):
        touch = Touch(pose, features=rng.normal(0.0, 1.5, WIDTH))
        mine, theirs = mine.update(touch), theirs.update(touch)
        ours = mine.log_likelihood - mine.log_likelihood.max()
        np.testing.assert_allclose(ours, theirs.log_likelihood - theirs.log_likelihood.max(), atol=1e-4)
        np.testing.assert_allclose(mine.moved, theirs.moved, atol=1e-4)
    assert mine.update(touch).num_touches == 4  # a repeat, which counts less
    assert model.to_json() != replace(model, moves=(kernel, 0.2)).to_json()


def test_it_keeps_the_contract_of_observation_models(table):
    check_observation_model(nested(table, 2), np.random.default_rng(3), num_objects=3)


def test_outcomes_are_those_of_all_cells_where_all_are_drawn(table):
    model = nested(table)
    evidence = model.start().update(touches(1, np.random.default_rng(4))[0])
    mixture, belief = evidence.outcome_mixture(64, 4096), np.exp(evidence.log_likelihood)
    belief /= belief.sum()
    factors = np.stack([belief * (np.arange(BODIES) == 2), belief * (np.arange(BODIES) != 2)])
    leaves = evidence.belief.leaves()
    weights = np.exp(leaves.log_weight - evidence.belief.log_of_bodies[leaves.body])
    probs = model.outcome_probs(leaves, 1.0, 64)
    expected = np.einsum("jn,pnm->pjm", factors[:, leaves.body] * weights, probs)
    np.testing.assert_allclose(mixture.one_touch(factors), expected, atol=2e-4)
    both = mixture.two_touches(1, factors)
    np.testing.assert_allclose(both.sum(axis=3)[:, :-1, 0] / mixture.new[1], expected[1], atol=5e-4)
    payoffs, chance = mixture.payoffs_after(np.ones((2, BODIES)), belief)
    np.testing.assert_allclose(payoffs[0], chance, atol=1e-5)
    np.testing.assert_allclose(chance.sum(axis=1), 1.0, atol=1e-5)


def test_bodies_without_a_drawn_cell_keep_their_weight(table):
    mixture = nested(table).start().outcome_mixture(16, 1)
    factors = np.eye(BODIES)
    np.testing.assert_allclose(mixture.one_touch(factors).sum(axis=2), 1.0, atol=1e-5)
    np.testing.assert_allclose(mixture.table.probs.sum(axis=2), 1.0)


class NoisyWorld:
    """Objects whose touches are the embedding of their cell with noise, for which the ratios are exact."""

    def __init__(self, table, arrangement, rng):
        self.table, self.arrangement, self.current = table, arrangement, 0
        self.cells = rng.integers(CELLS, size=len(arrangement))

    def touch(self, pose, rng):
        shown = self.table[pose, self.arrangement[self.current], self.cells[self.current]]
        return Touch(pose, features=rng.normal(shown, 1.0))

    def advance(self):
        self.current += 1

    def reset(self):
        self.current = 0


@pytest.mark.parametrize("decider", ["information_gain", "shape_information_gain", "value_of_information"])
def test_searches_among_nested_bodies_are_right_as_often_as_they_state(table, decider):
    table = 3.0 * table / np.linalg.norm(table, axis=3, keepdims=True)
    model = replace(nested(table, 2), scale=1.0, drift=0.0)
    problem = SearchProblem(LABELS, ("p", "q", "r"), 3, "at_most_one")
    player = make_decider(decider, model.outcome_table(), model)
    episodes = []
    for seed in range(32):
        rng = np.random.default_rng([seed, 5])
        world = NoisyWorld(table, sample_arrangement(problem.seeking(2), rng), rng)
        episodes.append(search(world, player, problem, 2, model, seed))
    stops = [one for one in episodes if one.outcome is Outcome.CONFIRMED]
    assert sum(one.success for one in stops) >= 0.85 * len(stops) > 10
    assert sum(one.success for one in episodes) >= 24


def test_a_touch_that_does_not_fit_is_refused(table):
    model = nested(table)
    for touch in (Touch(0, np.zeros(5)), Touch(0, features=np.ones(3)), Touch(3, features=np.ones(WIDTH))):
        with pytest.raises(ValueError, match="must have an embedding of 4 numbers"):
            model.start().update(touch)
    with pytest.raises(ValueError, match="finite"):
        model.start().update(Touch(0, features=np.full(WIDTH, np.nan)))
    away = Elsewhere((1.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.zeros((BODIES, CELLS, WIDTH)))
    with pytest.raises(ValueError, match="in its poses only"):
        model.start().update(Touch(0, features=np.ones(WIDTH), elsewhere=away))
    with pytest.raises(ValueError, match="not read from a file"):
        NestedBodyModel.from_fields({})
    with pytest.raises(InvalidArgument, match="drift"):
        NestedBodyModel(LABELS, model.cells, model.bodies, 1.0, 2.0, model.references, model.constants)
