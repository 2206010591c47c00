"""Search metrics on episodes made by hand."""

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, Reject, SearchProblem, Touch
from belief.statistics import wilson_interval
from experiments.results import Seconds
from experiments.summary import compare_episodes, summarise
from planners import Decision, Episode, Outcome, Step

PROBLEM = SearchProblem(("a", "b"), ("p",), num_objects=2, touch_cost=0.1)


def episode(actions, target=0, arrangement=(0, 1), outcome=Outcome.CONFIRMED):
    """An episode from a list of "t" (touch), "r" (reject) and "c" (confirm)."""
    steps, position = [], 0
    for name in actions:
        action = {"t": Probe(0), "r": Reject(), "c": Confirm()}[name]
        touch = Touch(0, np.zeros(2)) if name == "t" else None
        steps.append(Step(position, Belief.uniform("ab"), Decision(action), touch))
        position += name == "r"
    return Episode((0, target, 0), target, arrangement, tuple(steps), outcome)


def test_a_cell_counts_successes_failures_and_touches():
    episodes = [
        episode("tc"),  # found with one touch
        episode("rttc", target=1),  # found with two
        episode("rc"),  # confirmed the wrong one, no touch
        episode("trtr", outcome=Outcome.EXHAUSTED),  # found nothing, two touches
        episode("ttt", outcome=Outcome.TRUNCATED),
    ]
    cell = summarise(episodes, Seconds(1.0, 2.0, 3.0, 8), PROBLEM)
    assert (cell.successes, cell.wrong, cell.none, cell.truncated) == (2, 1, 1, 1)
    assert cell.success == 0.4
    assert cell.success_interval == wilson_interval(2, 5)
    assert cell.touches == pytest.approx((1 + 2 + 0 + 2 + 3) / 5)
    assert cell.reward == pytest.approx((0.9 + 0.8 - 1.0 - 1.2 - 1.3) / 5)
    assert cell.seconds.ms_per_touch() == {"physics": 125.0, "network": 250.0, "decision": 375.0}


def test_differences_are_paired_episode_by_episode(rng):
    good, bad = [episode("tc")] * 30, [episode("tc")] * 20 + [episode("rc")] * 10
    comparison = compare_episodes(
        PROBLEM,
        {("good", "a"): good, ("bad", "a"): bad},
        {("good", "a"): Seconds(pressed_again=2), ("bad", "a"): Seconds(pressed_again=3)},
        ceiling=(30, 30),
        reference="good",
        rng=rng,
    )
    mean, low, high = comparison.differences["bad"].success
    assert mean == pytest.approx(-1 / 3)
    # Standard error of the mean of 30 zeros and minus ones: .086; a 95 % interval is about ±.17.
    assert (low, high) == pytest.approx((-1 / 3 - 0.17, -1 / 3 + 0.17), abs=0.04)
    assert comparison.floor == 0.5
    assert comparison.pressed_again == 5


def test_no_touches_cost_no_time():
    assert Seconds().ms_per_touch() == {"physics": 0.0, "network": 0.0, "decision": 0.0}
