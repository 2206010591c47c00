"""Files of touch problems hold the numbers of the problem exactly, with labels that every parser accepts."""

import re

import numpy as np
import pytest

from planners.export import as_pomdp, legal_labels, to_pomdp
from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value

TABLE = np.random.default_rng(0).dirichlet(np.ones(3), size=(2, 3))
PROBLEMS = [
    TouchProblem(TABLE, [0.5, 0.3, 0.2], 1, 0.05),
    TouchProblem(TABLE, [1.0, 0.0, 0.0], 0, 0.0, np.float64(0.95)),
    SearchTouchProblem(TABLE, 2, "distinct", 0, 0.02),
    SearchTouchProblem(TABLE, 3, "independent", 2, 0.02, [0.2, 0.2, 0.6], 0.99),
]
every_problem = pytest.mark.parametrize("problem", PROBLEMS)


def tables(text, kind, pomdp):
    """The matrices T or O of all actions in a file."""
    found = []
    for action in pomdp.actions:
        rows = text.split(f"\n{kind}: {action}\n")[1].split("\n")[: len(pomdp.states)]
        found.append([[float(number) for number in row.split()] for row in rows])
    return np.array(found)


@every_problem
def test_what_is_written_is_the_problem_to_the_last_bit(problem):
    pomdp, text = as_pomdp(problem), to_pomdp(problem)
    preamble = dict(line.split(": ", 1) for line in text.split("\nT:")[0].splitlines() if not line.startswith("#"))
    assert float(preamble["discount"]) == pomdp.discount
    assert preamble["values"] == "reward"
    for name in ("states", "actions", "observations"):
        assert tuple(preamble[name].split()) == getattr(pomdp, name)
    assert [float(number) for number in preamble["start"].split()] == pomdp.start.tolist()
    np.testing.assert_array_equal(tables(text, "T", pomdp), pomdp.transitions)
    np.testing.assert_array_equal(tables(text, "O", pomdp), pomdp.observation_probs)
    rewards = re.findall(r"^R: (\S+) : (\S+) : \* : \* (\S+)$", text, re.MULTILINE)
    assert [float(reward) for _, _, reward in rewards] == pomdp.rewards.ravel().tolist()
    assert [(action, state) for action, state, _ in rewards] == [(a, s) for a in pomdp.actions for s in pomdp.states]


@every_problem
def test_tables_are_distributions_labels_are_legal_and_the_end_is_absorbing(problem):
    pomdp = as_pomdp(problem, ["45° cube", "45. cube", "-"], ["p q", "p.q"])
    for probs in (pomdp.start, pomdp.transitions, pomdp.observation_probs):
        np.testing.assert_allclose(probs.sum(axis=-1), 1.0, atol=1e-12)
    for labels in (pomdp.states, pomdp.actions, pomdp.observations):
        assert len(set(labels)) == len(labels)
        assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", label) for label in labels)
    assert (pomdp.transitions[:, -1, -1] == 1.0).all()
    assert (pomdp.rewards[:, -1] == 0.0).all()


def value(pomdp, belief, steps):
    """Value of the best policy of so many steps, by recursion over the arrays alone."""
    if steps == 0:
        return 0.0
    best = -np.inf
    for action in range(len(pomdp.actions)):
        worth = belief @ pomdp.rewards[action]
        joint = (belief @ pomdp.transitions[action])[:, None] * pomdp.observation_probs[action]
        for column in joint.T:
            if column.sum() > 0.0 and column[:-1].any():
                worth += pomdp.discount * column.sum() * value(pomdp, column / column.sum(), steps - 1)
        best = max(best, worth)
    return best


def test_the_arrays_have_the_value_of_the_problem():
    # Two touches and a stop are three steps. A value without a stop is not worth more here: it costs and earns nothing.
    problem = TouchProblem(TABLE, [0.5, 0.3, 0.2], 1, 0.05)
    expected = finite_horizon_value(problem, 2)
    assert value(as_pomdp(problem), np.array([0.5, 0.3, 0.2, 0.0]), 3) == pytest.approx(expected)


def test_a_search_in_the_file_pays_what_a_search_pays():
    # Reject both of two distinct objects untouched: one of three shapes was on neither place.
    pomdp = as_pomdp(SearchTouchProblem(TABLE, 2, "distinct", 0, 0.02))
    reject, belief, total = pomdp.actions.index("reject"), pomdp.start, 0.0
    for _ in range(3):
        total += belief @ pomdp.rewards[reject]
        belief = belief @ pomdp.transitions[reject]
    assert total == pytest.approx(1 / 3 - 2 / 3)
    assert belief[-1] == pytest.approx(1.0)


def test_names_must_fit_and_large_searches_are_refused():
    with pytest.raises(ValueError, match="3 shapes, names are"):
        as_pomdp(PROBLEMS[0], ["a", "b"])
    large = SearchTouchProblem(np.full((6, 8, 40), 1 / 40), 7, "distinct", 0, 0.02)
    with pytest.raises(ValueError, match="export fewer objects"):
        as_pomdp(large)


RESERVED = ["discount", "values", "states", "actions", "observations", "T", "O", "R", "uniform", "identity", "reward"]
RESERVED += ["cost", "start", "include", "exclude", "reset"]


def test_no_label_is_a_word_of_the_format_and_the_file_says_what_was_renamed():
    labels = [*RESERVED, "cube", "45°", "a\nT: *"]
    table = np.full((len(labels), len(labels), 2), 0.5)
    problem = TouchProblem(table, np.full(len(labels), 1 / len(labels)), 0, 0.05)
    text, pomdp = to_pomdp(problem, labels, labels), as_pomdp(problem, labels, labels)
    for kind in (pomdp.states, pomdp.actions, pomdp.observations):
        assert not set(kind) & set(RESERVED)
    renamed = dict(re.findall(r"^# (\S+) stands for (.+)$", text, re.MULTILINE))
    for label, state in zip(labels, pomdp.states, strict=False):
        assert renamed.get(state, repr(state)) == ascii(label)
    assert legal_labels(["T", "xT"]) == ("xT", "xT_2")
    assert legal_labels(["a b", "a.b", "a_b", "a_b_2"]) == ("a_b", "a_b_2", "a_b_3", "a_b_2_2")
