"""Search metrics on episodes made by hand."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from belief import Belief, Confirm, Probe, Reject, SearchProblem, Touch, Unsure
from belief.naming import UNLISTED
from belief.statistics import clopper_pearson_interval, wilson_interval
from belief.statistics.comparison import episodes_for_success
from belief.table import Table
from experiments.meshes.find import Found
from experiments.meshes.identify import Identified
from experiments.search.page import shown_searches
from experiments.search.play import Seconds
from experiments.search.summary import ALL, Summary, calibration_of_confirmations, prob_best, summarise
from experiments.search.verdict import (
    answer_sentences,
    comparison_tables,
    failure_sentence,
    terminal_table,
    verdict_sentences,
    why_failed,
)
from planners import Decision, Episode, Outcome, Step

PROBLEM = SearchProblem(("a", "b"), ("p",), num_objects=2, touch_cost=0.1)


def search(actions, target=0, arrangement=(0, 1), outcome=Outcome.CONFIRMED, claim=0.5, number=0):
    """An episode from a string of "t" (touch), "r" (reject), "c" (confirm) and "u" (unsure), all on one belief."""
    steps, position = [], 0
    probs = (claim, 1 - claim) if target == 0 else (1 - claim, claim)
    for name in actions:
        action = {"t": Probe(0), "r": Reject(), "c": Confirm(), "u": Unsure()}[name]
        touch = Touch(0, np.zeros(2)) if name == "t" else None
        steps.append(Step(position, Belief.from_probs(tuple("ab"), probs), Decision(action), touch))
        position += name == "r"
    return Episode((0, target, number), target, arrangement, tuple(steps), outcome)


def compared(by_decider, rng, reference=None, pressed_again=0):
    """A comparison on one target, "a"."""
    return Summary.from_episodes(
        PROBLEM,
        {(name, "a"): some for name, some in by_decider.items()},
        {(name, "a"): Seconds(0.1, 0.2, 0.3, 10, pressed_again) for name in by_decider},
        reference or next(iter(by_decider)),
        rng,
    )


def test_a_cell_counts_successes_failures_and_touches():
    episodes = [
        search("tc"),  # found with one touch
        search("rttc", target=1),  # found with two
        search("rc"),  # confirmed the wrong one, no touch
        search("trtr", outcome=Outcome.EXHAUSTED),  # found nothing, two touches
        search("ttt", outcome=Outcome.TRUNCATED),
    ]
    cell = summarise(episodes, Seconds(1.0, 2.0, 3.0, 8), PROBLEM)
    assert (cell.successes, cell.wrong, cell.none, cell.truncated) == (2, 1, 1, 1)
    assert cell.success == 0.4
    assert cell.success_interval == wilson_interval(2, 5)
    assert cell.touches == pytest.approx((1 + 2 + 0 + 2 + 3) / 5)
    assert cell.touch_quantiles == (2, 3, 3)  # of 0 1 2 2 3: the third, and nine tenths need the last
    assert cell.reward == pytest.approx((0.9 + 0.8 - 1.0 - 1.2 - 1.3) / 5)
    assert cell.seconds.ms_per_touch() == {"physics": 125.0, "network": 250.0, "decision": 375.0}


def test_differences_are_paired_episode_by_episode(rng):
    good, bad = [search("tc")] * 30, [search("tc")] * 20 + [search("rc")] * 10
    comparison = compared({"good": good, "bad": bad}, rng)
    difference = comparison.differences["bad"]
    mean, low, high = difference.success
    assert mean == pytest.approx(-1 / 3)
    # Standard error of the mean of 30 zeros and minus ones: .086; a 95 % interval is about ±.17.
    assert (low, high) == pytest.approx((-1 / 3 - 0.17, -1 / 3 + 0.17), abs=0.04)
    assert (difference.mcnemar.first_only, difference.mcnemar.second_only) == (0, 10)
    exact = stats.binomtest(0, 10).pvalue
    assert difference.mcnemar.p_value == pytest.approx(exact)
    assert difference.p_value == pytest.approx(exact - stats.binom.pmf(0, 10, 0.5))
    assert difference.touches[0] == pytest.approx(-1 / 3)
    assert difference.reward[0] == pytest.approx((10 * (-1.0 - 0.9)) / 30)
    assert comparison.no_touch_baseline == 0.5


def test_p_values_are_corrected_for_the_number_of_deciders(rng):
    base, worse = [search("tc")] * 20, [search("tc")] * 14 + [search("rc")] * 6
    one = compared({"base": base, "worse": worse}, rng).differences["worse"]
    two = compared({"base": base, "worse": worse, "same": base}, rng).differences["worse"]
    assert two.p_value == pytest.approx(2 * one.p_value)


def test_the_searches_needed_are_those_of_the_corrected_test(rng):
    base, worse = [search("tc")] * 100, [search("tc")] * 90 + [search("rc")] * 10
    one = compared({"base": base, "worse": worse}, rng).differences["worse"]
    others = {f"same {n}": base for n in range(4)}
    five = compared({"base": base, "worse": worse, **others}, rng).differences["worse"]
    assert one.episodes_for_success == episodes_for_success(one.mcnemar)
    assert five.episodes_for_success == episodes_for_success(one.mcnemar, level=0.05 / 5)
    assert five.episodes_for_success > one.episodes_for_success


def test_the_best_decider_is_best_in_most_resamples(rng):
    # Paired differences of mean .1 and standard deviation 1 over 100 episodes: positive with Φ(1) = .841.
    noise = np.concatenate([np.ones(50), -np.ones(50)])
    probs = prob_best({"x": (noise + 0.1).tolist(), "y": [0.0] * 100}, rng)
    assert probs["x"] == pytest.approx(stats.norm.cdf(1.0), abs=0.05)
    assert sum(probs.values()) == pytest.approx(1.0)


def test_claims_are_the_posterior_of_the_confirmed_object_by_its_own_touches():
    episodes = [
        search("ttrtc", target=1, claim=0.9),  # three touches, one of them on the confirmed object
        search("tc", claim=0.8),
        search("rtc", claim=0.7),  # wrong
        search("rr", outcome=Outcome.EXHAUSTED),  # confirms nothing, calibration_of_confirmations nothing
        search("ttt", outcome=Outcome.TRUNCATED),
    ]
    found = calibration_of_confirmations(episodes)
    assert [(s.num_touches, s.count) for s in found.by_num_touches] == [(1, 3)]
    assert found.overall.mean_stated == pytest.approx(0.8)
    assert found.overall.share_right == pytest.approx(2 / 3)
    assert (found.overall.low, found.overall.high) == clopper_pearson_interval(2, 3)
    assert calibration_of_confirmations(episodes[3:]) is None


def test_a_clear_result_is_called_settled(rng):
    told = " ".join(
        verdict_sentences(compared({"good": [search("tc", claim=0.99)] * 60, "bad": [search("rc")] * 60}, rng))
    )
    assert "it succeeds in 1.000 [0.940, 1.000] of 60" in told
    assert "almost certainly" in told
    assert "of 60 episodes, 0 succeed only with bad and 60 only with good (p < 0.001)" in told
    assert "bad succeeds significantly less" in told
    assert "bad is overconfident when confirming: its mean stated confidence is 0.500, and it is right in 0.000" in told
    assert "No disagreement between stated confidence and success was found for good." in told
    told = verdict_sentences(compared({"x": [search("tc", claim=0.99)]}, rng))
    assert told[-1] == "There are too few confirmations to judge the stated confidence of x (1)."


def test_the_first_sentence_says_how_often_right_how_fast_and_how_much_better(rng):
    good, misled = [search("ttc", claim=0.99)] * 40, [search("rtc", claim=0.99, arrangement=(0, 1))] * 30
    some = {"mine": good, "threshold": misled + good[:10], "random_confirm": [search("rc")] * 40}
    answer, *rest = answer_sentences(compared(some, rng))
    assert answer == (
        "mine is best: it found the target in all 40 searches, with 2.0 touches on average. threshold, the paper's "
        "rule, found it in 10, with 1.2; random_confirm, which guesses, in none, without a touch. The best guess "
        "without a touch is right in 50 %."
    )
    assert [sentence.partition(" fails")[0] for sentence in rest if sentence.startswith("Why")] == ["Why threshold"]
    absent = [search("trtr", arrangement=(1, 1), outcome=Outcome.EXHAUSTED)] * 25
    assert answer_sentences(compared({"mine": absent}, rng))[0].startswith("mine is right in all 25 searches, with 2.0")
    cheap = compared({"slow": [search("tttttttc")] * 40, "fast": [search("c")] * 37 + [search("rc")] * 3}, rng)
    assert answer_sentences(cheap)[0].startswith("fast is best, where a touch costs 0.1 of a success: it found")


def test_of_many_deciders_the_answer_names_a_few(rng):
    some = {f"d{n}": [search("tc")] * (40 - 3 * n) + [search("rc")] * 3 * n for n in range(12)}
    answer = answer_sentences(compared(some, rng))[0]
    assert answer.startswith("d0 is best")
    assert "; 4 more; d11 in 7" in answer
    assert "d7" not in answer


@pytest.mark.parametrize(
    ("failed", "words"),
    [
        (search("rtc"), "passed the target over without touching it"),
        (search("trrr", claim=0.9, outcome=Outcome.EXHAUSTED), "although all touches together make it probable"),
        (search("trc", claim=0.3), "while it was still possible"),
        (search("trc", claim=0.01), "was misled: the touches of the target speak against it"),
        (search("tc", arrangement=(1, 0), claim=0.9), "was misled: the touches of another object speak for it"),
        (search("tc", arrangement=(1, 0), claim=0.1), "although touches do not make it probable"),
        (search("c", arrangement=(1, 0)), "confirmed another object without touching it"),
        (search("ttt", outcome=Outcome.TRUNCATED), "used up its touches before an answer"),
        (search("tu", outcome=Outcome.UNSURE), "answered “I do not know”"),
    ],
)
def test_a_failure_has_the_reason_of_its_first_wrong_step(failed, words):
    assert not failed.success
    assert words in why_failed(failed).words


@pytest.mark.parametrize(("value", "is_planned"), [(0.5, True), (0.6, False)])
def test_a_plan_without_touches_says_what_it_expects(value, is_planned):
    failed = search("rtc")
    planned = Decision(Reject(), {"value": value, "value_reject": 0.5})
    words = why_failed(replace(failed, steps=(replace(failed.steps[0], decision=planned), *failed.steps[1:]))).words
    assert words.endswith("without touching it, as its plan expects a touch to cost more than it tells") is is_planned


def test_reasons_are_counted_the_most_frequent_first():
    some = [search("trc", claim=0.3)] * 2 + [search("ttrc", claim=0.01)] * 3 + [search("tc")] * 4
    assert failure_sentence("mine", some) == (
        "Why mine fails in 5: in 3 it was misled: the touches of the target speak against it (median: 2 touches of "
        "it, probability 0.01); in 2 it gave the target up while it was still possible (median: 1 touch of it, "
        "probability 0.30). There, b was taken for a 5 times."
    )
    assert failure_sentence("mine", some[5:]) == ""
    assert failure_sentence("random_confirm", [search("rc")] * 3) == ""


@pytest.mark.parametrize(
    ("some", "how"),
    [
        ([search("rr", outcome=Outcome.EXHAUSTED)] * 3, ", and rejects every object"),
        ([search("c", arrangement=(1, 0)), search("c")], ", and confirms the first object"),
        ([search("rc"), search("c"), search("u", outcome=Outcome.UNSURE)], ""),
    ],
)
def test_a_decider_that_never_touches_fails_for_that_reason(some, how):
    number = sum(not one.success for one in some)
    assert failure_sentence("mine", some) == f"Why mine fails in {number}: it answers without a touch{how}."


def test_the_pairs_that_are_confused_most_are_named():
    def confused(shape, target):
        arrangement = (shape, shape)
        steps = (Step(0, Belief.from_probs(tuple("abcd"), [0.25] * 4), Decision(Confirm()), Touch(0, np.zeros(4))),)
        return Episode((0, target, 0), target, arrangement, steps, Outcome.CONFIRMED)

    some = [confused(1, 0), confused(3, 2), confused(3, 2), confused(0, 2), confused(UNLISTED, 0)]
    assert failure_sentence("mine", some).endswith("Most often, d was taken for c 2 times and b was taken for a.")
    assert failure_sentence("mine", some[-1:]).endswith(". There, an unlisted object was taken for a.")
    assert "taken" not in failure_sentence("mine", [search("ttt", outcome=Outcome.TRUNCATED)])


def test_the_featured_search_is_one_in_which_deciders_differ_in_success(rng):
    good = [search("tttc", number=n) for n in range(4)]
    bad = [search("tttttttc", number=0), search("ttrc", number=1), search("trc", number=2), search("rtc", number=3)]
    shown = shown_searches(compared({"bad": bad, "good": good}, rng))
    assert [(name, one.seed[-1], bool(one.success)) for name, one in shown.searches] == [
        ("good", 2, True),
        ("bad", 2, False),
    ]
    assert "bad fails, for its most frequent reason there: it gave the target up" in shown.why
    same = shown_searches(compared({"bad": bad[:1], "good": good[:1]}, rng))
    assert {one.num_touches for _, one in same.searches} == {3, 7}
    assert shown_searches(compared({"guess": [search("c")]}, rng)) is None
    [(_, alone)] = shown_searches(compared({"bad": bad}, rng)).searches
    assert alone.seed[-1] == 1  # the longest failure


@pytest.mark.parametrize("number", [1, 2, 19])
def test_few_searches_have_no_best_decider_and_no_significant_difference(rng, number):
    comparison = compared({"x": [search("ttc")] * number, "y": [search("tc")] * number}, rng)
    told = " ".join(verdict_sentences(comparison))
    assert "y has the highest return in the mean" in told
    assert "at least 20 searches" in told
    assert "In touches y minus x is -1.00" in told
    for word in ("is best", "certainly", "probably", "takes 1.00"):
        assert word not in told


def test_an_open_result_says_how_many_searches_would_settle_it(rng):
    x = [search("tc")] * 97 + [search("rc")] * 3
    y = [search("rc")] + [search("tc")] * 99
    told = " ".join(verdict_sentences(compared({"x": x, "y": y}, rng)))
    assert "of 100 episodes, 3 succeed only with y and 1 only with x (p = 0.38)" in told
    # ψ = .04 and δ = .02 need (1.96 · .2 + .8416 · √(.04 - .0004))² / .0004 = 783 in all, so 683 more.
    assert "about 690 more searches would show it with a probability of 0.8 (in all --episodes 790)" in told
    assert any(word in told for word in ("probably", "possibly", "certainly"))


def test_deciders_that_never_differ_are_bounded_not_extrapolated(rng):
    same = [search("tc")] * 100
    told = " ".join(verdict_sentences(compared({"x": same, "y": same}, rng)))
    assert "they differ in fewer than 3 % of all searches (95 %" in told  # 1 - .05^(1/100)


def test_every_table_has_as_many_values_as_headings_and_reads_back_exactly(rng):
    comparison = compared(
        {"x": [search("tc")] * 7 + [search("rc")], "y": [search("rr", outcome=Outcome.EXHAUSTED)] * 8}, rng
    )
    for table in comparison_tables(comparison):
        assert {len(row) for row in table.cells()} <= {len(table.columns)}, table.name
        rows = list(csv.DictReader(io.StringIO(table.csv())))
        assert len(rows) == len(table.rows) == len(table.records())
        names = table.csv().partition("\n")[0].split(",")
        assert len(set(names)) == len(names), table.name
        assert all([*record] == names for record in table.records())
        assert all(None not in row and None not in row.values() for row in rows), table.name
    [row, *_] = csv.DictReader(io.StringIO(comparison_tables(comparison)[0].csv()))
    assert float(row["success_low"]) == wilson_interval(7, 8)[0]


def test_every_table_has_the_numbers_of_the_comparison(rng):
    right, wrong = search("ttc", claim=0.97), search("rc", claim=0.97)
    none = search("rtr", outcome=Outcome.EXHAUSTED)
    cut = search("tttt", outcome=Outcome.TRUNCATED)
    some = {"x": [right] * 18 + [wrong, wrong, none, cut], "y": [none] * 22}
    found = compared(some, rng)
    told = {table.name: table for table in comparison_tables(found)}
    low, high = wilson_interval(18, 22)
    x = (22, 18 / 22, (low, high), 2, 1, 1, pytest.approx(41 / 22), 2, 2, 4, found.cells["x", "a"].reward)
    y = (22, 0.0, wilson_interval(0, 22), 0, 22, 0, 1.0, 1, 1, 1, found.cells["y", "a"].reward)
    expected = [
        (name, target, *row, found.prob_best[name] if target == "all" else None)
        for name, row in (("x", x), ("y", y))
        for target in ("a", "all")
    ]
    assert [tuple(row) for row in told["results"].rows] == expected
    [row], d = told["differences"].rows, found.differences["y"]
    assert row == (
        *("y", d.success[0], d.success[1:], 0, 18, d.p_value, d.episodes_for_success),
        *(d.touches[0], d.touches[1:], d.reward[0], d.reward[1:]),
    )
    assert (d.success[0], d.touches[0]) == (pytest.approx(-18 / 22), pytest.approx(1.0 - 41 / 22))
    low, high = clopper_pearson_interval(18, 20)
    stated = ("x", 20, pytest.approx(0.03), pytest.approx(0.1), (1.0 - high, 1.0 - low), "no disagreement")
    assert told["stated_confidence"].rows == [stated, ("y", 0, None, None, None, "never confirmed")]
    assert told["times"].rows == [(name, 10, *map(pytest.approx, (10.0, 20.0, 30.0, 60.0))) for name in "xy"]
    boasts = compared({"x": [wrong] * 22}, rng)
    doubts = compared({"x": [search("tc", claim=0.5)] * 22}, rng)
    words = [{t.name: t for t in comparison_tables(c)}["stated_confidence"].rows[0][-1] for c in (boasts, doubts)]
    assert words == ["overconfident", "underconfident"]


def test_nothing_to_tell_is_a_dash_for_readers_and_empty_for_machines():
    table = Table("S", [("who", ""), ("x", ".2f"), ("95 %", ".1f")], [("a", None, None), ("b", 1 / 3, (0.1, 0.2))])
    assert table.cells() == [["a", "–", "–"], ["b", "0.33", "0.1 … 0.2"]]
    assert table.csv().splitlines() == ["who,x,x_low,x_high", "a,,,", f"b,{1 / 3},0.1,0.2"]


def test_the_floor_is_the_mean_over_the_targets_asked_for(rng):
    problem = SearchProblem(("a", "b"), ("p",), num_objects=3, composition="independent")
    comparison = Summary.from_episodes(
        problem,
        {("x", "a"): [search("c", arrangement=(0, 1, 1))]},
        {("x", "a"): Seconds()},
        "x",
        rng,
    )
    assert "can lie above it" in " ".join(verdict_sentences(comparison))  # the first object was the target, untouched
    assert comparison.no_touch_baseline == 0.5  # confirming any object; that none of three is there has probability 1/8


def test_without_a_touch_it_may_be_best_to_reject_all(rng):
    problem = SearchProblem(("a", "b", "c"), ("p",), num_objects=1, composition="independent")
    targets = {(("x", label)): [search("c", arrangement=(0,))] for label in "ab"}
    found = Summary.from_episodes(problem, targets, dict.fromkeys(targets, Seconds()), "x", rng)
    assert found.no_touch_baseline == pytest.approx(2 / 3)  # of three shapes the target is absent in two of three cases


def test_the_interval_of_a_thousand_successes_is_no_point_in_table_and_verdict(rng):
    comparison = compared({"a": [search("tc", number=i) for i in range(4)]}, rng)
    cells = {key: replace(cell, success_interval=(0.99617, 1.0)) for key, cell in comparison.cells.items()}
    assert terminal_table(replace(comparison, cells=cells)).text(100).count("0.996–1.000") == 2
    cells = {key: replace(cell, success_interval=(0.999617, 1.0)) for key, cell in comparison.cells.items()}
    assert "succeeds in 1.000 [0.9996, 1.0000] of" in " ".join(verdict_sentences(replace(comparison, cells=cells)))


def test_unsure_searches_are_counted_priced_and_shown(rng):
    right, wrong = search("tc"), search("tc", arrangement=(1, 0))
    mixed = [*[right] * 6, wrong, *[search("tu", outcome=Outcome.UNSURE)] * 2, search("t", outcome=Outcome.TRUNCATED)]
    comparison = Summary.from_episodes(
        replace(PROBLEM, unsure_reward=-0.25),
        {("x", "a"): mixed, ("bare", "a"): [right] * 10},
        {(name, "a"): Seconds(0.1, 0.2, 0.3, 10) for name in ("x", "bare")},
        "x",
        rng,
    )
    cell = comparison.cells["x", ALL]
    assert (cell.successes, cell.wrong, cell.none, cell.truncated, cell.unsure) == (6, 1, 0, 1, 2)
    assert cell.reward == pytest.approx((6 - 1 - 1 - 2 * 0.25) / 10 - 0.1)
    assert comparison.differences["bare"].mcnemar.first_only == 4  # one that is unsure does not succeed
    results = {table.name: table for table in comparison_tables(comparison)}["results"]
    assert results.rows[0][results.headings.index("unsure")] == 2
    assert "-0.25 for “I do not know”" in results.note
    assert "unsure" in terminal_table(comparison).headings
    assert any("in 0.200 of the searches; it is right in 6 of its 7" in said for said in verdict_sentences(comparison))


@pytest.mark.parametrize("kind", [Found, Identified])
def test_the_interval_of_a_thousand_right_answers_is_no_point_below_the_table(kind, monkeypatch):
    row = dict.fromkeys((name for name, _ in kind._columns), 1) | {
        "result": "right",
        "right": 1,
        "stated": 0.99,
        "touches": 2,
        "certain": True,
    }
    monkeypatch.setattr(kind, "rows", lambda _: [row] * 1000)
    monkeypatch.setattr(kind, "_title", "")
    assert "0.996 to 1.000; stated 0.99" in object.__new__(kind).table().note
