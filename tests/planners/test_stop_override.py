import numpy as np
import pytest
from scipy import stats

from belief import Belief, Confirm, Probe, Reject, SearchProblem
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import Decision, InformationState, Outcome, search_lockstep
from planners.probing import FixedOrder
from planners.stopping import PosteriorThresholds, StopOverride

PROBLEM = SearchProblem(("a", "b"), ("p", "q"), num_objects=2)


class Always:
    def __init__(self, action):
        self.action = action

    def decide(self, info, rng):
        return Decision(self.action, {"own": 7.0})


def info(prob):
    return InformationState(PROBLEM, 0, Belief.from_probs(tuple("ab"), [prob, 1 - prob]))


def confident(action):
    return StopOverride(PosteriorThresholds(0.9, 0.1), Always(action), FixedOrder())


@pytest.mark.parametrize("action", [Probe(1), Confirm(), Reject()])
def test_the_rule_is_asked_first(action, rng):
    assert confident(action).decide(info(0.95), rng).action == Confirm()
    assert confident(action).decide(info(0.05), rng).action == Reject()


def test_otherwise_the_deciders_probe_is_taken_with_its_scores(rng):
    decision = confident(Probe(1)).decide(info(0.5), rng)
    assert decision == Decision(Probe(1), {"own": 7.0})


@pytest.mark.parametrize("action", [Confirm(), Reject()])
def test_a_decider_that_would_stop_too_soon_is_overruled(action, rng):
    decision = confident(action).decide(info(0.5), rng)
    assert decision.action == Probe(0)
    assert decision.scores["overruled"] == 1.0


def test_stops_keep_the_rules_promise_whatever_the_decider():
    model = random_model(np.random.default_rng(3), sharpness=3.0)
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 4, touch_limit=200)
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([s, 9]))) for s in range(300)]
    decider = StopOverride(PosteriorThresholds(0.95, 0.05, max_touches=100), Always(Confirm()), FixedOrder())
    episodes = search_lockstep(worlds, decider, problem, [0] * 300, model, [(s,) for s in range(300)])
    stops = [
        e.success
        for e in episodes
        if e.outcome is Outcome.CONFIRMED and e.steps[-1].decision.scores["target_prob"] >= 0.95
    ]
    assert len(stops) > 200
    assert stats.binomtest(sum(stops), len(stops), 0.95, alternative="less").pvalue > 1e-3
