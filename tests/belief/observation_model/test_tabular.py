import numpy as np
import pytest

from belief.observation_model import OutcomeTable
from belief.observation_model.tabular import TabularModel

TABLE = OutcomeTable([[[0.7, 0.3, 0.0], [0.1, 0.2, 0.7]], [[0.2, 0.5, 0.3], [0.3, 0.3, 0.4]]])


def test_outcomes_come_as_often_as_the_table_says():
    model = TabularModel(("a", "b"), TABLE)
    felt = np.exp([touch.logits for touch in model.sample(1, [1] * 20_000, np.random.default_rng(0))])
    shares = [np.isclose(felt, column).all(axis=1).mean() for column in TABLE.probs[1].T]
    assert shares == pytest.approx(TABLE.probs[1, 1].tolist(), abs=0.015)


def test_touches_multiply_and_an_outcome_a_shape_cannot_give_rules_it_out():
    model = TabularModel(("a", "b"), TABLE)
    touches = [t for t in model.sample(1, [0] * 50, np.random.default_rng(0)) if t.logits[0] == -np.inf]
    assert touches
    assert model.log_likelihood(touches)[0] == -np.inf
    assert model.log_likelihood([]).tolist() == [0.0, 0.0]


def test_as_many_names_as_shapes_are_needed():
    with pytest.raises(ValueError, match="2 shapes"):
        TabularModel(("a",), TABLE)


def test_a_planner_may_ask_for_fewer_outcomes():
    model = TabularModel(("a", "b"), TABLE)
    assert model.outcome_table() is model.outcome_table(3) is TABLE
    assert model.outcome_table(2).num_outcomes == 2
