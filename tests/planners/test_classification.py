"""The door for whoever knows nothing of touch: cases, actions, outcomes; what is asked, named, stated and promised."""

import copy
import csv
import pickle
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from belief import Belief
from belief.errors import ImpossibleObservation, InvalidArgument, UnknownName
from belief.observation_model import check_observation_model, read_observation_model
from belief.observation_model.context_fit import OutcomeCode, fit_contexts, merged_cells
from belief.observation_model.context_model import ContextModel
from belief.problem import Touch
from planners import ActiveClassification

TESTS = np.array([[[0.9, 0.1], [0.2, 0.8]], [[0.6, 0.4], [0.5, 0.5]], [[0.7, 0.3], [0.4, 0.6]]])


@pytest.fixture
def task():
    return ActiveClassification.from_probs(TESTS, ("ill", "well"), ("blood", "eyes", "skin"), stop=0.9)


def exact_posterior(outcomes, prior=(0.5, 0.5)):
    likelihood = np.array(prior)
    for action, outcome in enumerate(outcomes):
        likelihood = likelihood * (1.0 if outcome < 0 else TESTS[action, :, outcome])
    return likelihood / likelihood.sum()


def test_the_posterior_is_bayes_rule_whatever_the_order_and_what_is_missing(task):
    for outcomes in ((0, 1, 0), (1, -1, 0), (-1, -1, -1)):
        case = task.start()
        for action in (2, 0, 1):
            case.tell_outcome(outcomes[action], action)
        np.testing.assert_allclose(case.belief.probs, exact_posterior(outcomes))


def test_a_prior_counts_and_actions_have_names(task):
    other = ActiveClassification.from_probs(TESTS, ("ill", "well"), task.actions, prior=np.array([0.1, 0.9]), stop=1.0)
    case = other.start()
    case.tell(0, "skin")
    np.testing.assert_allclose(case.belief.probs, exact_posterior((-1, -1, 0), (0.1, 0.9)))
    assert case.taken == (2,)
    assert case.ask() == "blood"


@pytest.mark.parametrize("nothing", [None, np.nan, np.float64("nan"), np.float16("nan")])
def test_what_cannot_be_carried_out_is_not_asked_again(task, nothing):
    case = task.start()
    assert case.ask() == "blood"
    case.tell(nothing)
    assert case.ask() == "skin"
    case.tell(0)
    assert (case.ask(), case.taken, case.cost) == ("eyes", (2,), 1.0)


def test_the_action_with_the_largest_gain_for_its_cost_is_asked_and_the_budget_is_kept(task):
    dear = ActiveClassification.from_probs(TESTS, costs=np.array([50.0, 1.0, 2.0]), budget=3.0, stop=1.0)
    case, asked = dear.start(), []
    while (action := case.asked) is not None:
        asked.append(action)
        case.tell_outcome(0)
    assert asked == [2, 1]
    assert case.cost == 3.0


def test_a_case_stops_where_an_error_costs_less_than_the_next_action():
    costs = np.full(3, 1.0)
    cheap, dear = (
        ActiveClassification.from_probs(TESTS, costs=costs, error_cost=cost, stop=1.0) for cost in (1.0, 20.0)
    )
    assert cheap.start().ask() is None
    assert dear.start().ask() == "0"


def hidden_context(n, rng):
    """Action 0 says which of actions 1 and 2 shows the class; by itself it says nothing."""
    y, context = rng.integers(2, size=(2, n))
    rows = rng.integers(2, size=(n, 3))
    rows[:, 0] = context
    rows[np.arange(n), 1 + context] = np.where(rng.random(n) < 0.95, y, 1 - y)
    return rows, y


def test_looking_two_actions_ahead_finds_the_action_that_says_where_to_look():
    rows, y = hidden_context(2000, np.random.default_rng(0))
    one, two = (
        ActiveClassification.from_cases(rows, y, num_contexts=(1, 2), max_actions=2, stop=1.0, depth=depth)
        for depth in (1, 2)
    )
    assert two.model.weights.shape[1] >= 2
    assert two.start().ask() == "0"
    assert one.start().ask() != "0"
    cases, truth = hidden_context(150, np.random.default_rng(1))
    adaptive, random = (two.evaluate(cases, truth).after(2, rule)[0] for rule in ("adaptive", "random"))
    assert adaptive > 0.9 > random


def test_the_fit_finds_contexts_probabilities_and_states_what_is_right():
    rng = np.random.default_rng(2)
    rows, y = hidden_context(3000, rng)
    rows[rng.random(rows.shape) < 0.2] = -1
    model = fit_contexts(rows, y, ("a", "b"), num_contexts=(1, 2), sizes=[2, 2, 2])
    assert model.weights.shape == (2, 2)
    cases, truth = hidden_context(2000, rng)
    log_likelihoods = model.log_likelihoods_of(cases)
    probs = np.exp(log_likelihoods - np.logaddexp.reduce(log_likelihoods, axis=1, keepdims=True))
    assert abs(probs.max(axis=1).mean() - (probs.argmax(axis=1) == truth).mean()) < 0.03
    assert (probs.argmax(axis=1) == truth).mean() > 0.93


def test_cells_are_joined_where_their_counts_do_not_tell_them_apart():
    cells = np.array([[[90.0, 10.0], [10.0, 90.0], [88.0, 12.0], [0.0, 0.0], [12.0, 88.0]]])
    owners = merged_cells(cells, np.full((1, 2), 0.5))[0].tolist()
    assert owners[0] == owners[2] != owners[1] == owners[4]


def test_a_model_with_contexts_keeps_the_contract_of_observation_models():
    rng = np.random.default_rng(0)
    probs = rng.dirichlet(np.ones(4), size=(3, 2, 5))
    model = ContextModel(("a", "b"), probs, rng.dirichlet(np.ones(5), size=2))
    check_observation_model(model, rng)
    touches = model.sample(1, [0, 2, 0], rng)
    assert touches[0].features == touches[2].features  # the same test again
    first, again = model.log_likelihood(touches[:2]), model.log_likelihood(touches)
    np.testing.assert_array_equal(first, again)
    everywhere = np.einsum("kh,pkhm->pkm", model.weights, model.probs)
    np.testing.assert_allclose(model.outcome_table().probs, everywhere)
    o, q = (int(touch.features[0]) for touch in touches[:2])
    both = (model.weights * probs[0, :, :, o] * probs[2, :, :, q]).sum(axis=1)
    np.testing.assert_allclose(np.exp(first), both)


def test_a_model_with_contexts_is_read_back_from_its_file():
    probs = np.random.default_rng(0).dirichlet(np.ones(3), size=(2, 2, 2))
    model = ContextModel(("ill", "well"), probs, np.array([[0.2, 0.8], [0.5, 0.5]]), 0.7, is_repeatable=True)
    text = model.to_json()
    again = read_observation_model(text)
    assert again.to_json() == text
    np.testing.assert_array_equal(again.probs, model.probs)
    with pytest.raises(ValueError, match="not an observation model"):
        read_observation_model(text.replace("0.2", "0.3", 1))


def test_a_repeatable_action_gives_new_evidence():
    model = ContextModel(("a", "b"), TESTS, is_repeatable=True)
    touch = Touch(0, features=np.array([0.0]))
    np.testing.assert_allclose(model.log_likelihood([touch, touch]), 2.0 * model.log_likelihood([touch]))


def test_values_become_outcomes_in_bins_joint_columns_and_missing_ones():
    rng = np.random.default_rng(0)
    table = np.stack([rng.normal(size=500), rng.integers(2, size=500), rng.integers(2, size=500)], axis=1)
    table[3, 1] = np.nan
    code = OutcomeCode.of(table, [(0,), (1, 2)], num_bins=5)
    outcomes = code.outcomes(table)
    assert code.sizes().tolist() == [5, 5]
    assert outcomes[3, 1] == -1
    whole = np.delete(np.arange(500), 3)
    pairs = {tuple(row) for row in np.column_stack([table[whole, 1:], outcomes[whole, 1]]).tolist()}
    assert len(pairs) == len({pair[2] for pair in pairs}) == 4
    assert (np.diff(outcomes[np.argsort(table[:, 0]), 0]) >= 0).all()


def drawn(rng, n):
    y = rng.integers(2, size=n)
    uniform = rng.random((n, 3))
    return (uniform > TESTS[:, :, 0][np.arange(3), y[:, None]]).astype(int), y


def test_a_certificate_keeps_its_promise_where_the_model_is_wrong():
    bold = np.clip((TESTS - 0.5) * 1.6 + 0.5, 0.02, 0.98)  # states more than is right
    task = ActiveClassification.from_probs(bold, stop=0.9)
    rng = np.random.default_rng(3)
    certified = task.certified(*drawn(rng, 1500), risk=0.15, confidence=0.9)
    assert certified.certificate is not None
    answers = certified.evaluate(*drawn(rng, 1500), rules=("adaptive",)).answers["adaptive"]
    stopped = [one for one in answers if one.is_certain]
    assert len(stopped) > 300
    assert np.mean([not one.is_right for one in stopped]) < 0.17
    assert np.mean([not one.is_right for one in stopped]) < np.mean([not one.is_right for one in answers])


@pytest.mark.parametrize("rule", ["adaptive", "fixed"])
def test_a_case_like_an_earlier_one_has_the_answer_that_it_has_alone(task, rule):
    cases = np.random.default_rng(0).integers(-1, 2, size=(40, 3))
    truth = np.arange(40) % 2
    together = task.evaluate(cases, truth, [rule]).answers[rule]
    alone = [task.evaluate(cases[i : i + 1], truth[i : i + 1], [rule]).answers[rule][0] for i in range(40)]
    assert len({one.actions for one in alone}) > 4
    for one, other in zip(together, alone, strict=True):
        assert (one.truth, one.named, one.stated, one.is_certain) == (
            other.truth,
            other.named,
            other.stated,
            other.is_certain,
        )
        assert (one.actions, one.cost, one.probs.tolist()) == (other.actions, other.cost, other.probs.tolist())


def test_planned_stops_cost_least_and_fall_with_the_number_of_actions():
    rng = np.random.default_rng(0)
    probs = np.stack([[[0.3, 0.7], [0.7, 0.3]]] * 9)
    task = ActiveClassification.from_probs(probs, depth=1)
    planned = task.planned(40.0, num_cases=300)
    assert (np.diff(planned.stop) <= 0.0).all()
    truth = rng.integers(2, size=600)
    cases = (rng.random((600, 9)) > probs[:, :, 0].T[truth]).astype(int)

    def cost(other):
        answers = other.evaluate(cases, truth, rules=("adaptive",)).answers["adaptive"]
        return np.mean([one.cost + 40.0 * (1 - one.is_right) for one in answers])

    others = [cost(ActiveClassification.from_probs(probs, depth=1, stop=stop)) for stop in (0.6, 0.8, 0.99)]
    assert cost(planned) < min(others) + 0.3
    assert len(task.planned(0.1, num_cases=50).start().taken) == 0


def test_the_report_is_a_table_of_what_was_stated_right_taken_and_spent(task):
    found = task.evaluate(*drawn(np.random.default_rng(0), 400), rules=("adaptive", "random", "fixed"))
    rows = {row["rule"]: row for row in found.rows()}
    assert list(rows) == ["adaptive", "random", "fixed"]
    for row in rows.values():
        assert abs(row["stated"] - row["right"]) < 0.05
        assert row["actions"] == row["cost"] <= 3
    assert "400 cases" in str(found)
    assert "with_errors" not in rows["fixed"]
    dear = replace(task, error_cost=50.0).evaluate(*drawn(np.random.default_rng(0), 400), rules=("fixed",)).rows()[0]
    assert dear["with_errors"] == pytest.approx(dear["cost"] + 50.0 * (1.0 - dear["right"]))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"costs": [1.0]}, "actions need as many"),
        ({"costs": [1.0, -1.0, 1.0]}, "costs > 0: '1' costs -1"),
        ({"costs": [0.0, 1.0, np.inf]}, "costs > 0: '0' costs 0, '2' costs inf; give what is free a small cost"),
        ({"costs": [1e308, 1.0, 5e-324]}, "'0' costs 1e\\+308, '2' costs 4.9"),
        ({"error_cost": 1e308}, "error_cost must be a number in"),
        ({"prior": [1.0]}, "classes need"),
        ({"stop": 0.0}, "stop must be"),
        ({"stop": "0.9"}, "stop must be .* got '0.9'"),
        ({"stop": [[0.9]]}, "stop must be"),
        ({"stop": 90}, r"infinite for never, got 90 \(0.9\?\)"),
        ({"probs": 100.0 * TESTS}, r"probs\[action 0, class '0'\] is no .*: \[90.0, 10.0\]; divide percentages by 100"),
        ({"probs": np.stack([TESTS, 0.5 * TESTS], axis=2)}, r"probs\[action 0, class '0', context 1\] is .* 0.05\]$"),
        ({"depth": 3}, "depth must be"),
        ({"actions": ("a", "a", "b")}, "actions"),
        ({"weights": np.ones((2, 1)) * 0.5}, "weights must"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        ActiveClassification.from_probs(**{"probs": TESTS, **arguments})


def test_cases_that_do_not_fit_are_refused(task):
    with pytest.raises(ValueError, match="outcomes of cases must be"):
        task.evaluate([[0, 1]], ["ill"])
    with pytest.raises(ValueError, match="as many labels"):
        task.evaluate([[0, 1, 1]], [])
    with pytest.raises(UnknownName, match="class 'dead'"):
        task.evaluate([[0, 1, 1]], ["dead"])
    with pytest.raises(ValueError, match="no case of the class"):
        fit_contexts(np.zeros((4, 2), int), [0, 0, 0, 0], ("a", "b"))
    case = task.start()
    with pytest.raises(ValueError, match="has the outcomes 0, 1, got 7"):
        case.tell(7)
    assert isinstance(case.belief, Belief)


def test_a_case_that_no_class_can_have_is_named():
    sure = ActiveClassification.from_probs(np.array([np.eye(2), np.eye(2)]), stop=np.inf)
    with pytest.raises(ImpossibleObservation, match=r"the case in row 1 \(from 0\) has outcomes \[0, 1\]"):
        sure.evaluate([[0, 0], [0, 1]], [0, 0])
    endless = ActiveClassification.from_probs(TESTS, max_actions=2**53, is_repeatable=True)
    assert endless.start().ask() == "0"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"labels": np.array([1, "a"] * 4, object)}, "labels must be of one kind"),
        ({"labels": [(0, 1), (1, 0)] * 4}, r"labels must be \(n,\)"),
        ({"labels": 3}, r"labels must be \(n,\)"),
        ({"cases": np.empty((0, 2)), "labels": []}, "two or more classes, got none"),
        ({"cases": np.tile([[1e308, 1.0], [1.5e308, 2.0]], (4, 1))}, r"within ±1e\+150, .* got 1e\+308 in row 0"),
        ({"cases": np.array([[10**400, 1]] * 8, object)}, "got inf in row 0"),
        ({"num_contexts": ()}, "num_contexts must"),
        ({"num_contexts": 10**9}, "num_contexts must .* at most 100"),
        ({"num_bins": -1}, "num_bins must"),
        ({"groups": [[0.0], [1]]}, "groups must be different columns"),
        ({"groups": [[0, 0], [1]]}, "groups must be different columns of each action, below 2, got"),
        ({"seed": -1}, "seeds and keys must be"),
        ({"cases": np.ones((8, 70)), "groups": [range(70)], "num_bins": 2}, None),
        ({"cases": np.arange(8)[:, None] + np.arange(70), "groups": [range(70)]}, "70 columns of an action have"),
    ],
)
def test_tables_at_the_edge_are_fitted_or_refused_with_the_reason(arguments, message):
    given = {"cases": np.arange(16.0).reshape(8, 2), "labels": [0, 1] * 4, "num_contexts": 1, **arguments}
    if message is None:
        assert ActiveClassification.from_cases(**given).classes == ("0", "1")
        return
    with pytest.raises(InvalidArgument, match=message):
        ActiveClassification.from_cases(**given)


def test_more_classes_than_can_be_compared_are_refused_at_once():
    with pytest.raises(InvalidArgument, match=r"2000 classes and . contexts .* join classes"):
        fit_contexts(np.zeros((2000, 3), int), np.arange(2000), [str(k) for k in range(2000)])


def test_values_of_an_action_are_as_many_as_its_columns():
    task = ActiveClassification.from_cases(np.arange(16.0).reshape(8, 2), [0, 1] * 4, groups=[[0, 1]], num_contexts=1)
    for values in (1.0, [1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(InvalidArgument, match="an outcome has 2 values, of column 0 of cases, column 1"):
            task.start().tell(values)


def test_a_task_prints_in_a_line_and_says_that_nothing_is_promised(task):
    assert repr(task) == "ActiveClassification(classes: ill, well; actions: blood, eyes, skin; stop: 0.9)"
    printed = str(task.certified(*drawn(np.random.default_rng(0), 20)))
    assert "stop: never; certificate: Nothing is promised with 20 cases: at least" in printed
    assert "\n" not in printed
    certified = task.certified(*drawn(np.random.default_rng(0), 1000), risk=0.3)
    promise = "after every number of actions, at most 0.3 of the stops are wrong, with confidence 0.9, from 1000 cases"
    assert repr(certified).endswith(f"stop: never, any; certificate: {promise})")
    printed = " ".join(str(certified.certificate).split())
    assert printed.startswith(f"A{promise[1:]} actions stop from stops wrong")


def test_a_case_prints_its_classes_and_its_cost(task):
    case = task.start()
    case.tell(0)
    assert repr(case) == "Case('ill', probability 0.82, cost 1)"
    assert case.rows()[0]["class"] == "ill"
    assert str(case).endswith("well          0.18\nActions: 1, cost: 1.")
    assert "<table>" in case._repr_html_()


def test_a_table_as_of_a_spreadsheet_names_the_cell_that_is_no_number():
    assert OutcomeCode.of([[0.0], [1.0]]).outcomes([[1], [None], [np.float32(0.0)]]).tolist() == [[1], [-1], [0]]
    for cell in ("x", 1j):
        for cells in ([[1.0, 2.0], [1.5, cell]], np.array([[None, 2.0], [1.5, cell]], object)):
            with pytest.raises(ValueError, match=r"column 1 of cases is .* in row 1 \(from 0\), no number; missing"):
                OutcomeCode.of(np.array(cells, object))


def test_columns_of_words_are_outcomes_and_numbers_in_quotes_are_numbers():
    rows = [["yes", "31", ""], ["no", " 7 ", "b"], ["yes", "31.0", None], [" no", "", "a"]]
    code = OutcomeCode.of(rows)
    assert code.words == (("no", "yes"), (), ("a", "b"))
    assert code.outcomes(rows).tolist() == [[1, 1, -1], [0, 0, 1], [1, 1, -1], [0, -1, 0]]
    assert (code.told(0, "yes"), code.told(1, 31), code.told(1, "7"), code.told(2, " a"), code.told(2, "")) == (
        *(1, 1, 0, 0),
        -1,
    )
    with pytest.raises(ValueError, match=r"'maybe' in row 0 .*, which no case had: no, yes"):
        code.told(0, "maybe")
    many = [[f"patient {number}"] for number in range(65)]
    with pytest.raises(ValueError, match="65 different words"):
        OutcomeCode.of(many)
    paired = OutcomeCode.of(rows, [(0, 2), (1,)])
    assert paired.outcomes([["yes", 7, "b"]]).shape == (1, 2)


def test_rows_of_a_csv_file_are_read_by_their_names(rng):
    lines = ["age,fever,class"]
    for is_ill in (rng.random(200) < 0.5).tolist():
        age = "" if rng.random() < 0.1 else f"{30 + 10 * is_ill + rng.integers(12)}"
        lines.append(f"{age},{'yes' if rng.random() < 0.2 + 0.6 * is_ill else 'no'},{'ill' if is_ill else 'well'}")
    rows = list(csv.DictReader(lines))
    labels = [row.pop("class") for row in rows]
    plain = [[float(row["age"] or "nan"), row["fever"]] for row in rows]
    task, other = (ActiveClassification.from_cases(cases[:100], labels[:100]) for cases in (rows, plain))
    assert task.actions == ("age", "fever")
    np.testing.assert_array_equal(task.model.probs, other.model.probs)
    turned = [dict(reversed(row.items())) for row in rows[100:]]
    assert str(task.evaluate(turned, labels[100:])) == str(other.evaluate(plain[100:], labels[100:]))
    known = ActiveClassification.from_probs(TESTS, actions=("blood", "eyes", "skin"))
    read = known.evaluate([{"skin": "1", "eyes": "", "blood": "0"}], [0], ("fixed",))
    assert str(read) == str(known.evaluate([[0, -1, 1]], [0], ("fixed",)))
    for cases, words in (
        ([rows[0], {"age": "3"}], r"all have the columns age, fever, got .* in row 1 \(from 0\)"),
        ([["1", "inf"], ["2", "3"]], r"finite numbers .* got inf in row 0 \(from 0\)"),
        (csv.DictReader(lines), r"rows of equal length, or dictionaries, such as list\(\) of a csv.DictReader"),
        ([["1_0", 2.0], [1.0, 2.0]], "column 0 of cases is '1_0' in row 0 .*, no number; missing values are NaN, None"),
    ):
        with pytest.raises(InvalidArgument, match=words):
            ActiveClassification.from_cases(cases, ["ill", "well"])


def test_rows_of_unequal_length_are_refused_by_their_number_at_every_door():
    rows, labels = [(0, 1), (1, 0), (1,), (0, 1)], ["ill", "well"] * 2
    known = ActiveClassification.from_probs(TESTS[:2], classes=("ill", "well"))
    fitted = ActiveClassification.from_cases([[0, 1], [1, 0]] * 10, ["ill", "well"] * 10)
    doors = [task.evaluate for task in (known, fitted)] + [task.certified for task in (known, fitted)]
    for door in (ActiveClassification.from_cases, *doors):
        with pytest.raises(InvalidArgument, match=r"the first one has 2 cells, got 1, \(1,\) in row 2 \(from 0\)"):
            door(rows, labels)


def test_a_task_of_cases_in_words_takes_its_names_and_is_told_words():
    class Frame(list):
        """As a data frame of pandas is seen: rows, and names of columns."""

        columns = ("fever", "age")

    rng = np.random.default_rng(0)
    ill = rng.random(200) < 0.5
    rows = [["yes" if rng.random() < (0.9 if one else 0.1) else "no", str(30 + one)] for one in ill]
    labels = np.where(ill, "ill", "well")
    task = ActiveClassification.from_cases(Frame(rows), labels)
    assert tuple(task.actions) == ("fever", "age")
    case = task.start()
    case.tell("31", "age")
    assert case.answer == "ill"
    with pytest.raises(ValueError, match=r"label is missing in row 1 \(from 0\): leave"):
        ActiveClassification.from_cases(rows[:3], ["ill", None, "well"])


def test_classes_that_differ_in_spaces_and_actions_without_a_value_are_warned_of():
    rows, y = drawn(np.random.default_rng(0), 60)
    table = np.where([True, False, True], rows, np.nan)
    with pytest.warns(UserWarning, match="no case has a value of eyes: leave out"):
        task = ActiveClassification.from_cases(table, y, ("blood", "eyes", "skin"), num_contexts=1)
    assert task.start().ask() in ("blood", "skin")
    with pytest.warns(UserWarning, match="the classes 'Flu ' and 'flu' differ in spaces or case only"):
        ActiveClassification.from_cases(rows, np.array(["Flu ", "flu"])[y], num_contexts=1)


def test_costs_may_be_given_by_the_names_of_actions():
    probs = np.array([[[0.9, 0.1], [0.2, 0.8]], [[0.6, 0.4], [0.5, 0.5]]])
    task = ActiveClassification.from_probs(probs, ("ill", "well"), ("blood", "scan"), costs={"scan": 5.0, "blood": 1.0})
    assert task.costs.tolist() == [1.0, 5.0]
    with pytest.raises(ValueError, match="costs by name are of the actions blood, scan, got scan"):
        ActiveClassification.from_probs(probs, ("ill", "well"), ("blood", "scan"), costs={"scan": 5.0})


def test_actions_may_have_different_numbers_of_outcomes():
    two, three = [[0.9, 0.1], [0.2, 0.8]], [[0.5, 0.3, 0.2], [0.1, 0.1, 0.8]]
    case = ActiveClassification.from_probs([two, three], stop=1.0).start()
    for action, outcome in enumerate((1, 2)):
        case.tell(outcome, action=str(action))
    wanted = np.array([0.1 * 0.2, 0.8 * 0.8])
    np.testing.assert_allclose(case.belief.probs, wanted / wanted.sum())


@pytest.mark.parametrize(
    ("probs", "words"),
    [
        ([[[0.9, 0.1], [0.2, 0.8]], [[0.5, 0.5]]], r"as many classes, \(K, outcomes\) each, got \(2, 2\), \(1, 2\)"),
        ([[[0.9, 0.1], [0.2, 0.8]], [[0.5, 0.3, 0.2], [0.1, 0.9]]], "as many outcomes for each class"),
        (np.array([[[0.9, 0.2], [0.1, 0.8]]]), r"swap it with the last: np.swapaxes\(probs, 1, -1\)"),
        ([], r"probs must be \(P, K, M\)"),
    ],
)
def test_tables_of_another_form_are_refused_with_what_is_wanted(probs, words):
    with pytest.raises(ValueError, match=words):
        ActiveClassification.from_probs(probs)


class Frame:
    """What a data frame has that is read: columns with names."""

    def __init__(self, values, columns):
        self.values, self.columns = np.asarray(values), columns

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype)


def test_columns_of_a_data_frame_are_read_by_their_names(rng):
    truth = rng.integers(2, size=400)
    cases = np.stack([truth, 1 - truth, rng.integers(2, size=400)], axis=1) ^ (rng.random((400, 3)) < 0.2)
    task = ActiveClassification.from_cases(Frame(cases, ("a", "b", "c")), truth, stop=0.9)
    cases, truth = cases[:50], truth[:50]
    wanted = str(task.evaluate(cases, truth))
    assert str(task.evaluate(Frame(cases, ("a", "b", "c")), truth)) == wanted
    assert str(task.evaluate(Frame(cases[:, [2, 0, 1]], ("c", "a", "b")), truth)) == wanted
    with pytest.raises(InvalidArgument, match=r"no column b; their columns are a, x, c"):
        task.evaluate(Frame(cases, ("a", "x", "c")), truth)


@pytest.mark.parametrize("is_fine", [True, False])  # values of which nearly all differ, or few that many cases share
def test_cases_of_the_fit_certify_nothing(rng, is_fine):
    truth = rng.integers(2, size=600)
    cases = rng.normal(size=(600, 8)) + truth[:, None] if is_fine else drawn(rng, 600)[0]
    task = ActiveClassification.from_cases(cases[:300], truth[:300], num_contexts=1)
    fresh = task.certified(cases[300:], truth[300:], risk=0.3)
    assert fresh.certificate is not None
    some = [(cases[:300], truth[:300]), (cases[::-1], truth[::-1]), (cases[50:90], truth[50:90])]
    for known in some[: 3 if is_fine else 1]:
        with pytest.raises(InvalidArgument, match=r"\d+ cases equal those that the model was fitted to, .* one part"):
            fresh.certified(*known, risk=0.3)


def test_a_certificate_is_of_its_stops(rng):
    task = ActiveClassification.from_probs(TESTS, stop=0.9)
    truth = rng.integers(2, size=400)
    cases = [[int(rng.choice(2, p=TESTS[action][label])) for action in range(len(TESTS))] for label in truth]
    certified = task.certified(cases, truth, risk=0.3)
    assert certified.certificate is not None
    assert certified.planned(40.0).certificate is None
    with pytest.raises(InvalidArgument, match="the certificate is of other stops"):
        replace(certified, stop=0.5)
    assert replace(certified, error_cost=3.0).certificate is not None


def test_cases_that_are_read_have_one_outcome_of_each_action(rng):
    task = ActiveClassification.from_probs(TESTS, is_repeatable=True, stop=0.999, max_actions=9)
    answers = task.evaluate([[0, 1, 0]] * 3, [0, 1, 0], ("adaptive", "random", "fixed")).answers
    assert {tuple(sorted(one.actions)) for some in answers.values() for one in some} == {(0, 1, 2)}
    case = task.start()
    while case.ask() is not None:
        case.tell(0)
    assert len(case.taken) > 3  # here, another try is another outcome


@pytest.mark.parametrize("outcome", [2, -1, "ill", 0.5, [0]])
def test_an_outcome_that_an_action_does_not_have_is_named(outcome):
    case = ActiveClassification.from_probs(TESTS, actions=("blood", "eyes", "skin")).start()
    with pytest.raises(InvalidArgument, match=r"'blood' has the outcomes 0, 1, got"):
        case.tell(outcome, action="blood")
    assert len(repr(ActiveClassification.from_probs(TESTS).evaluate([[0, 1, 0]] * 9, [0] * 9))) < 100


def test_a_value_far_outside_those_of_the_fit_warns(rng):
    labels = rng.integers(2, size=200)
    cases = np.stack([rng.normal(5.0, 1.0, 200) + labels, np.full(200, np.nan), np.ones(200)], axis=1)
    with pytest.warns(UserWarning, match="never seen"):
        task = ActiveClassification.from_cases(cases, labels, ("blood", "none", "same"))
    case = task.start()
    with pytest.warns(UserWarning, match=r"column 0 of cases is 5000, and cases .* had .* another unit"):
        case.tell(5000.0, "blood")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        task.start().tell(9.0, "blood")
        task.start().tell(2.0, "same")


def test_what_was_told_last_can_be_taken_back(task):
    case = task.start()
    before, first = case.belief.probs, case.ask()
    with pytest.raises(InvalidArgument, match="nothing was told"):
        case.undo()
    case.tell(1)
    case.tell(None)
    case.undo()
    assert case.undo() == first
    np.testing.assert_array_equal(case.belief.probs, before)
    assert (case.taken, case.cost, case.ask()) == ((), 0.0, first)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda case: pickle.loads(pickle.dumps(case))])
def test_a_copy_of_a_case_goes_on_by_itself(copied, task):
    case = task.start()
    case.tell(1)
    twin = copied(case)
    assert (twin.taken, twin.ask(), twin.answer) == (case.taken, case.ask(), case.answer)
    twin.undo()
    assert (len(case.taken), twin.taken) == (1, ())


def test_an_action_is_told_once_where_another_try_tells_nothing_new(task):
    case = task.start()
    case.tell(None, "blood")
    case.tell(1, "blood")
    with pytest.raises(InvalidArgument, match=r"'blood' was told already; undo\(\)"):
        case.tell(0, "blood")
    assert case.cost == 1.0
    repeated = ActiveClassification.from_probs(TESTS, is_repeatable=True, stop=np.inf).start()
    repeated.tell(1, 0)
    repeated.tell(0, 0)


def test_missing_labels_of_a_list_and_rows_in_another_order_are_refused(rng):
    cases = rng.normal(size=(6, 2))
    with pytest.raises(InvalidArgument, match="label is missing in row 0"):
        ActiveClassification.from_cases(cases, [float("nan"), "a", "b", "a", "b", "a"])

    class Rows(list):
        def __init__(self, values, order):
            super().__init__(values)
            self.index = SimpleNamespace(order=order, equals=lambda other: other.order == order)

    labels = ["a", "b"] * 3
    with pytest.raises(InvalidArgument, match="different indexes"):
        ActiveClassification.from_cases(Rows(cases.tolist(), 1), Rows(labels, 2))
    assert ActiveClassification.from_cases(Rows(cases.tolist(), 1), Rows(labels, 1)).classes == ("a", "b")


def test_a_rare_class_that_is_never_named_is_said_and_each_class_has_its_shares():
    rng = np.random.default_rng(0)
    y = (np.arange(400) % 20 == 0).astype(int)
    rows = rng.normal(size=(400, 1)) + 0.5 * y[:, None]
    names = np.where(y, "rare", "usual")
    found = ActiveClassification.from_cases(rows, names, num_contexts=1).evaluate(rows, names)
    assert "400 cases. Of 'rare', adaptive names 0 of 20 rightly: see by_class()." in " ".join(str(found).split())
    [one, other] = found.by_class().records()[:2]
    assert (one["class"], one["cases"], one["right"], one["named_so"], one["right_of_these"]) == (
        "rare",
        20,
        0,
        0,
        None,
    )
    assert (other["cases"], other["right"], other["named_so"], other["right_of_these"]) == (380, 1, 400, 0.95)
    assert 0 < one["right_high"] < 0.2


def test_messages_about_a_table_name_the_column():
    rows = [{"age": "31", "fever": word, "crp": "1.5"} for word in ("yes", "no", "Yes", "no")]
    labels = ["ill", "well"] * 2
    with pytest.warns(UserWarning, match="words of 'fever' 'Yes' and 'yes' differ in spaces or case only"):
        task = ActiveClassification.from_cases(rows, labels, num_contexts=1)
    for name, told, words in (
        ("fever", "maybe", "'fever' is 'maybe' .*, which no case had: Yes, no, yes"),
        ("age", "old", "'age' is 'old' .*, no number; missing values are"),
        ("crp", "1,5", "'crp' is '1,5' .*, no number; decimals have a point"),
    ):
        with pytest.raises(InvalidArgument, match=words):
            task.start().tell(told, name)
        with pytest.raises(InvalidArgument, match=words):
            task.evaluate([{**rows[0], name: told}], ["ill"])
    with pytest.raises(InvalidArgument, match=r"'crp' is '1,5' in row 0 .*decimals have a point"):
        ActiveClassification.from_cases([{"crp": f"{i % 3},5"} for i in range(1, 61)], ["ill", "well", "well"] * 20)


def test_columns_that_are_true_or_false_are_outcomes():
    fever = np.arange(40) % 2 == 0
    task = ActiveClassification.from_cases(fever[:, None], np.where(fever, "ill", "well"), num_contexts=1)
    case = task.start()
    case.tell(True)
    assert case.answer == "ill"


@pytest.mark.parametrize(
    ("cases", "labels", "words"),
    [
        (np.zeros((0, 3)), [], "cases must be of two or more classes, got none"),
        (np.zeros((9, 3)), ["ill"] * 9, "cases must be of two or more classes, got ill"),
        (np.zeros((2, 3)), np.array([["ill"], ["well"]]), r"labels must be \(n,\), one for each case, got \(2, 1\)"),
    ],
)
def test_cases_without_two_classes_or_with_a_table_of_labels_are_refused(cases, labels, words):
    with pytest.raises(InvalidArgument, match=words):
        ActiveClassification.from_cases(cases, labels)


def test_an_action_of_several_columns_is_named_by_them_and_told_as_many_values():
    rows = [{"age": str(i % 3), "crp": f"{i % 2}.5", "fever": "yes" if i % 2 else "no"} for i in range(40)]
    labels = ["ill" if i % 2 else "well" for i in range(40)]
    named, numbered = (
        ActiveClassification.from_cases(rows, labels, groups=groups, num_contexts=1)
        for groups in (["age", ("crp", "fever")], [(0,), (1, 2)])
    )
    np.testing.assert_array_equal(named.model.probs, numbered.model.probs)
    case = named.start()
    for told in ("1.5", ["1.5"], ["1.5", "yes", 3]):
        with pytest.raises(InvalidArgument, match="an outcome has 2 values, of 'crp', 'fever'; got"):
            case.tell(told, 1)
    case.tell(["1.5", "yes"], 1)
    assert case.answer == "ill"
    with pytest.raises(InvalidArgument, match="groups must be different columns of each action, age, crp, fever, got"):
        ActiveClassification.from_cases(rows, labels, groups=[["age"], ["crb"]])
