"""Files of touch problems read back as they were, and say what the solver's stages say."""

import re
import tracemalloc

import numpy as np
import pytest

from planners.export import BadPomdp, as_pomdp, legal_labels, read_pomdp, to_pomdp
from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value

TABLE = np.random.default_rng(0).dirichlet(np.ones(3), size=(2, 3))
PROBLEMS = [
    TouchProblem(TABLE, [0.5, 0.3, 0.2], 1, 0.05),
    TouchProblem(TABLE, [1.0, 0.0, 0.0], 0, 0.0, 0.95),
    SearchTouchProblem(TABLE, 2, "distinct", 0, 0.02),
    SearchTouchProblem(TABLE, 3, "independent", 2, 0.02, [0.2, 0.2, 0.6], 0.99),
]
every_problem = pytest.mark.parametrize("problem", PROBLEMS)


@every_problem
def test_what_is_written_reads_back_to_the_last_bit(problem):
    pomdp, copy = as_pomdp(problem), read_pomdp(to_pomdp(problem))
    assert (copy.discount, copy.states, copy.actions, copy.observations) == (
        pomdp.discount,
        pomdp.states,
        pomdp.actions,
        pomdp.observations,
    )
    for name in ("start", "transitions", "observation_probs", "rewards"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(pomdp, name))


def test_a_discount_that_numpy_computed_reads_back():
    problem = TouchProblem(TABLE, [0.5, 0.3, 0.2], 1, 0.05, np.float64(0.9))
    assert read_pomdp(to_pomdp(problem)).discount == 0.9


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


def test_the_file_has_the_value_of_the_problem():
    # Two touches and a stop are three steps. A value without a stop is not worth more here: it costs and earns nothing.
    problem = TouchProblem(TABLE, [0.5, 0.3, 0.2], 1, 0.05)
    assert value(read_pomdp(to_pomdp(problem)), np.array([0.5, 0.3, 0.2, 0.0]), 3) == pytest.approx(
        finite_horizon_value(problem, 2)
    )


def test_a_search_in_the_file_pays_what_a_search_pays():
    # Reject both of two distinct objects untouched: one of three shapes was on neither place.
    pomdp = read_pomdp(to_pomdp(SearchTouchProblem(TABLE, 2, "distinct", 0, 0.02)))
    reject, belief, total = pomdp.actions.index("reject"), pomdp.start, 0.0
    for _ in range(3):
        total += belief @ pomdp.rewards[reject]
        belief = belief @ pomdp.transitions[reject]
    assert total == pytest.approx(1 / 3 - 2 / 3)
    assert belief[-1] == pytest.approx(1.0)


def test_identity_and_uniform_and_wildcards_are_read():
    text = """discount: 0.9
values: reward
states: a b
actions: look take
observations: x y   # two
start: 0.25 0.75
T: *
identity
O: look
0.9 0.1
0.2 0.8
O: take
uniform
R: look : * : * : * -1
R: take : a : * : * 10
"""
    pomdp = read_pomdp(text)
    assert pomdp.transitions[1].tolist() == [[1, 0], [0, 1]]
    assert pomdp.observation_probs[1].tolist() == [[0.5, 0.5], [0.5, 0.5]]
    assert pomdp.rewards.tolist() == [[-1, -1], [10, 0]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("states:", "stats:"), "not a preamble"),
        (("values: reward", "values: cost"), "values: reward"),
        (("R: confirm", "Q: confirm"), "not understood"),
        (("R: confirm : shape_0", "R: confirm : shape_9"), "'shape_9' is none of"),
        (("start: 0.5 0.3", "start: 0.5 0.9"), "no distributions"),
        ((" : * : * 0.0", " : shape_0 : * 0.0"), "may not depend"),
    ],
)
def test_what_is_no_such_file_is_refused_with_the_line(change, message):
    text = unsealed(to_pomdp(PROBLEMS[0]))
    assert change[0] in text
    with pytest.raises(ValueError, match=re.escape(message)):
        read_pomdp(text.replace(*change))


def test_a_file_cut_short_is_refused():
    text = unsealed(to_pomdp(PROBLEMS[0]))
    with pytest.raises(ValueError, match="a matrix of 4 rows"):
        read_pomdp(text[: text.index("T: reject") + 12])


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
    text = to_pomdp(problem, labels, labels)
    copy = read_pomdp(text)
    for kind in (copy.states, copy.actions, copy.observations):
        assert not set(kind) & set(RESERVED)
        assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", label) for label in kind)
    renamed = dict(re.findall(r"^# (\S+) stands for (.+)$", text, re.MULTILINE))
    for label, state in zip(labels, copy.states, strict=False):
        assert renamed.get(state, repr(state)) == ascii(label)
    assert legal_labels(["T", "xT"]) == ("xT", "xT_2")


def test_labels_stay_different():
    assert legal_labels(["a b", "a.b", "a_b", "a_b_2"]) == ("a_b", "a_b_2", "a_b_3", "a_b_2_2")


@every_problem
@pytest.mark.parametrize("seed", range(3))
def test_a_changed_character_is_noticed(problem, seed):
    text, rng = to_pomdp(problem), np.random.default_rng(seed)
    body = text.index("\n") + 1
    for place in rng.integers(body, len(text), 60).tolist():
        other = "7" if text[place] != "7" else "8"
        with pytest.raises(BadPomdp, match="changed after it was written"):
            read_pomdp(text[:place] + other + text[place + 1 :])


def unsealed(text):
    return text.split("\n", 1)[1]


def test_a_file_without_our_digest_is_read_as_others_write_them():
    for pomdp in (read_pomdp(unsealed(to_pomdp(PROBLEMS[0]))), read_pomdp(to_pomdp(PROBLEMS[0]))):
        assert pomdp.rewards.tolist() == as_pomdp(PROBLEMS[0]).rewards.tolist()


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"discount: \S+", "discount: nan", "discount"),
        (r"discount: \S+", "discount: -1", "discount"),
        (r"discount: \S+", "discount: 0.9 0.8", "discount"),
        (r"discount: \S+", "discount:", "discount"),
        (r"discount: \S+", "discount: high", "high"),
        (r"\* (-?1\.0)\n", "* nan\n", "finite"),
        (r"\* (-?1\.0)\n", "* inf\n", "finite"),
        (r"\* (-?1\.0)\n", "*\n", "."),
        (r"start: .*", "start: nan nan nan nan", "distributions"),
        (r"start: .*", "start: 1.0", "start must give 4"),
        (r"states: \S+", "states: end", "differ"),
        (r"states: .*", "states:", "differ"),
        (r"values: reward", "values: reward\nvalues: reward", "twice"),
        (r"T: probe_pose_0\n\S+", "T: probe_pose_0\nnan", "distributions"),
    ],
)
def test_numbers_and_labels_that_are_none_are_refused(pattern, replacement, message):
    text, times = re.subn(pattern, replacement, unsealed(to_pomdp(PROBLEMS[0])), count=1)
    assert times == 1
    with pytest.raises(BadPomdp, match=message):
        read_pomdp(text)


def test_forty_thousand_declared_states_are_refused_before_their_tables_are_made():
    states = " ".join(f"s{number}" for number in range(40_000))
    text = f"discount: 0.9\nvalues: reward\nstates: {states}\nactions: look take\nobservations: x\nstart: uniform\n"
    tracemalloc.start()
    try:
        with pytest.raises(BadPomdp, match=r"40000 states.*more than 4000000"):
            read_pomdp(text)
        assert tracemalloc.get_traced_memory()[1] < 50e6  # bytes; the tables would be 26 GB
    finally:
        tracemalloc.stop()


def test_any_damage_is_answered_with_one_error():
    text, rng = unsealed(to_pomdp(PROBLEMS[2])), np.random.default_rng(0)
    refused = 0
    for place in rng.integers(len(text), size=150).tolist():
        for damaged in (text[:place], text[:place] + chr(rng.integers(32, 127)) + text[place + 1 :]):
            try:
                read_pomdp(damaged)
            except BadPomdp:
                refused += 1
    assert refused > 150
