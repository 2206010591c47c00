"""Wrong arguments of plans, rules and deciders are refused with what was given, and none gives a number."""

import numpy as np
import pytest

from belief import Belief, SearchProblem, Touch
from belief.errors import ActiveTouchError, InvalidArgument
from belief.observation_model import OutcomeTable
from belief.synthetic import SyntheticWorld
from planners import DECIDERS, InformationState, make_decider, search
from planners.decider import TableMismatch
from planners.point_based import PointBased
from planners.registry import NEED_FILES, TRAINED, WrongType, summary_of
from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value, solve
from planners.stopping import PosteriorThresholds, ThresholdRule
from planners.value_of_information import ValueOfInformation

TABLE = np.array([[[0.9, 0.1], [0.1, 0.9]]])
NAN, INF = float("nan"), float("inf")
BAD_BELIEFS = {
    "negative": [1.5, -0.5],
    "infinite": [INF, 0.0],
    "both infinities": [INF, -INF],
    "all zero": [0.0, 0.0],
    "unnormalised": [0.7, 0.7],
    "half of one": [0.25, 0.25],
    "NaN": [NAN, 0.5],
    "text": ["0.5", "0.5"],
    "one text": "0.5, 0.5",
    "nothing": None,
    "too long": [0.5, 0.25, 0.25],
    "a number": 1.0,
    "ragged": [[0.5, 0.5], [1.0]],
    "complex": [0.5 + 1j, 0.5 - 1j],
}


@pytest.fixture(scope="module")
def single():
    return solve(TouchProblem(TABLE, [0.5, 0.5], 0, 0.05), rounds=(20,))


@pytest.fixture(scope="module")
def whole():
    return solve(SearchTouchProblem(TABLE, 2, "independent", 0, 0.05), rounds=(20,))


@pytest.mark.parametrize("what", BAD_BELIEFS)
@pytest.mark.parametrize("asked", ["action", "value", "q_values"])
def test_what_is_no_belief_gets_no_answer_of_a_policy(single, what, asked):
    belief = BAD_BELIEFS[what]
    for given in (belief, [belief, [0.5, 0.5]]):
        with pytest.raises(InvalidArgument, match="a belief must be 2 probabilities"):
            getattr(single, asked)(given)


@pytest.mark.parametrize("index", [-1, 2, 0.0, None, "first", True])
def test_an_object_that_is_none_gets_no_answer(whole, index):
    problem = SearchProblem(("a", "b"), ("p",), 2)
    for ask in (
        lambda: whole.at(index),
        lambda: InformationState(problem, 0, Belief.uniform(("a", "b")), object_index=index),
    ):
        with pytest.raises(InvalidArgument, match=r"object_index must be an integer in \[0, 2\)"):
            ask()


@pytest.mark.parametrize("target", [-1, 2, 0.0, None, True, "c"])
def test_an_information_state_of_what_is_no_target_is_refused(target):
    with pytest.raises(ActiveTouchError, match="target"):
        InformationState(SearchProblem(("a", "b"), ("p",), 2), target, Belief.uniform(("a", "b")))


def test_an_information_state_knows_its_target_by_label_or_index_and_its_belief_by_the_same_labels():
    problem = SearchProblem(("a", "b"), ("p",), 2)
    for target in (1, np.int64(1), "b"):
        info = InformationState(problem, target, Belief.from_probs(["a", "b"], [0.25, 0.75]))
        assert (info.target, type(info.target), info.target_prob) == (1, int, pytest.approx(0.75))
    for labels in (("b", "a"), ("a", "b", "c")):
        with pytest.raises(InvalidArgument, match=r"the problem is about \('a', 'b'\), the belief about"):
            InformationState(problem, 0, Belief.uniform(labels))


@pytest.mark.parametrize("weights", [[NAN], [1.0, 7.0], [-0.1], ["1.0"], 1.0, [[1.0]]])
def test_repeat_weights_that_are_no_probabilities_are_refused(weights):
    with pytest.raises(InvalidArgument, match="repeat_weights must"):
        solve(SearchTouchProblem(TABLE, 2, "independent", 0, 0.05), rounds=(20,), repeat_weights=weights)


def test_rounds_may_come_from_a_generator(single):
    policy = solve(TouchProblem(TABLE, [0.5, 0.5], 0, 0.05), rounds=(number for number in (20,)))
    assert policy.vectors.alphas.tolist() == single.vectors.alphas.tolist()
    assert PointBased(OutcomeTable(TABLE), rounds=iter([np.int64(20), 30])).rounds == (20, 30)


def test_beliefs_of_any_real_type_are_answered_alike(single):
    for belief in ([0.75, 0.25], (0.75, 0.25), np.float32([0.75, 0.25]), np.float16([0.75, 0.25])):
        assert single.action(belief) == single.action(np.array([0.75, 0.25]))
        assert single.value([belief]).tolist() == [single.value(np.array([0.75, 0.25]))]


@pytest.mark.parametrize("touches", [-1, NAN, INF, 1.5, "2", None, True])
def test_a_horizon_that_is_no_number_of_touches_is_refused(touches):
    with pytest.raises(InvalidArgument, match="max_touches must be an integer"):
        finite_horizon_value(TouchProblem(TABLE, [0.5, 0.5], 0, 0.05), touches)


@pytest.mark.parametrize("touches", [531, 2400, 10**9])
def test_a_horizon_whose_histories_do_not_fit_in_memory_is_refused_at_once(touches):
    with pytest.raises(InvalidArgument, match=r"more than 50000000 numbers; .* at most 530 touches"):
        finite_horizon_value(TouchProblem(TABLE, [0.5, 0.5], 0, 0.05), touches)


@pytest.mark.parametrize("rules", [{"max_touches": n} for n in (0, -1, NAN, INF, 1.5, "12", True)])
@pytest.mark.parametrize("kind", [ThresholdRule, PosteriorThresholds, "value of information"])
def test_a_number_of_touches_that_is_none_is_refused(kind, rules):
    with pytest.raises(InvalidArgument, match="max_touches must be an integer, at least 1"):
        ValueOfInformation(OutcomeTable(TABLE), **rules) if isinstance(kind, str) else kind(**rules)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"touch_cost": NAN}, "touch_cost"),
        ({"touch_cost": INF}, "touch_cost"),
        ({"touch_cost": "free"}, "touch_cost"),
        ({"touch_cost": -0.1}, "touch_cost"),
        ({"discount": NAN}, "discount"),
        ({"discount": 0.0}, "discount"),
        ({"discount": 1.1}, "discount"),
        ({"discount": None}, "discount"),
        ({"target": -1}, "target"),
        ({"target": 2}, "target"),
        ({"target": 0.5}, "target"),
        ({"target": NAN}, "target"),
    ],
)
def test_a_problem_out_of_range_is_refused(arguments, message):
    rules = {"target": 0, "touch_cost": 0.05} | arguments
    for make in (
        lambda: TouchProblem(TABLE, [0.5, 0.5], **rules),
        lambda: SearchTouchProblem(TABLE, 2, "distinct", **rules),
    ):
        with pytest.raises(InvalidArgument, match=f"{message} must be"):
            make()


@pytest.mark.parametrize("change", [{"prior": [0.5, 0.6]}, {"prior": [NAN, 1.0]}, {"outcome_probs": TABLE[0]}])
def test_a_prior_or_a_table_that_is_none_is_refused(change):
    with pytest.raises(ValueError, match=r"prior|probs"):
        TouchProblem(**{"outcome_probs": TABLE, "prior": [0.5, 0.5], "target": 0, "touch_cost": 0.1} | change)


@pytest.mark.parametrize("number", [0, -1, NAN, 1.5, "2"])
def test_a_search_among_no_number_of_objects_is_refused(number):
    with pytest.raises(InvalidArgument, match="num_objects must be an integer"):
        SearchTouchProblem(TABLE, number, "distinct", 0, 0.05)


def test_a_problem_cannot_be_written_to():
    problem = TouchProblem(TABLE, [0.5, 0.5], 0, 0.05)
    for array in (problem.prior, problem.outcome_probs):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


@pytest.mark.parametrize("name", [name for name in DECIDERS if name not in TRAINED])
def test_a_model_in_place_of_its_table_is_told_what_works(name, model):
    with pytest.raises(WrongType, match=r"model\.outcome_table\(\)") as caught:
        make_decider(name, model)
    assert isinstance(caught.value, ActiveTouchError)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"table": TABLE}, "table"),
        ({"table": None}, "table"),
        ({"model": OutcomeTable(TABLE)}, "model"),
        ({"model": "coarse"}, "model"),
        ({"policies": "runs/ppo"}, "policies"),
        ({"simulations": 10.5}, "simulations"),
        ({"simulations": "many"}, "simulations"),
        ({"name": None}, "name"),
        ({"name": DECIDERS["threshold"]}, "name"),
    ],
)
def test_a_decider_made_from_something_else_is_an_error_that_names_it(arguments, named):
    with pytest.raises(WrongType, match=f"^{named} must be"):
        make_decider(**({"name": "point_based", "table": OutcomeTable(TABLE)} | arguments))


PLANNERS = [
    name for name in DECIDERS if name not in (*NEED_FILES, "random_confirm", "threshold", "random_poses", "fixed_poses")
]


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("shape", [(2, 4, 3), (4, 4, 3), (3, 3, 3), (3, 5, 3)])
def test_a_table_of_other_poses_or_shapes_than_the_search_is_refused(name, shape, model):
    table = OutcomeTable(np.random.default_rng(0).dirichlet(np.ones(shape[2]), size=shape[:2]))
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 4)
    with pytest.raises(TableMismatch, match=f"{shape[0]} poses and {shape[1]} shapes"):
        search(SyntheticWorld(model, (0, 1, 2, 3)), make_decider(name, table, simulations=20), problem, 0, model, (0,))


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_the_papers_rule_reads_the_logits_of_a_perfect_table(dtype):
    rows = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.0]], dtype)
    with np.errstate(divide="ignore"):
        frames = [Touch(0, np.log(row)) for row in rows]
    problem, rule = SearchProblem(tuple("abc"), ("p",), 3), ThresholdRule()

    def stop(*touches):
        decision = rule.stop(InformationState(problem, 0, Belief.uniform(tuple("abc")), touches))
        return None if decision is None else (type(decision.action).__name__, decision.scores["frame_prob"])

    certain, even, other = frames
    assert stop(certain) is None
    assert stop(certain, certain) == ("Confirm", 1.0)
    assert stop(certain, even) is None
    assert stop(other) == ("Reject", 0.0)


@pytest.mark.parametrize("name", DECIDERS)
def test_every_decider_says_in_a_line_what_it_is(name):
    assert 10 < len(summary_of(name)) < 90
    assert summary_of(name).endswith(".")
