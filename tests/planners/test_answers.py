"""Whatever a decider answers, a search ends: with an episode, or with an error that says what was answered."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from belief import Confirm, Probe, Reject, SearchProblem, Unsure
from belief.errors import ActiveTouchError, InvalidArgument
from belief.synthetic import SyntheticWorld
from planners import Decision, Outcome, Session, search
from planners.decider import BadDecision
from planners.probing import FixedOrder
from planners.search import naming_session
from planners.stopping import PosteriorThresholds, StopOverride


class Answers:
    """A decider that always answers the same."""

    def __init__(self, answer):
        self.answer = answer

    def decide(self, info, rng):
        return self.answer


def play(decider, model, **rules):
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 4, **rules)
    return search(SyntheticWorld(model, (0, 1, 2, 3)), decider, problem, 0, model, (0,))


NO_DECISIONS = {
    "None": None,
    "a word": "confirm",
    "a number": 3,
    "an action by itself": Confirm(),
    "something like a decision": SimpleNamespace(action=Confirm(), scores={}),
    "a decision on nothing": Decision(None),
    "a decision on a word": Decision("confirm"),
    "a decision on a number": Decision(3),
    "the class of an action": Decision(Confirm),
    "a pose of no such name": Decision(Probe("nowhere")),
    "half a pose": Decision(Probe(0.5)),
    "a pose as a float": Decision(Probe(1.0)),
    "a pose that is NaN": Decision(Probe(float("nan"))),
    "no pose": Decision(Probe(None)),
    "a truth value for a pose": Decision(Probe(True)),
    "a pose too many": Decision(Probe(3)),
    "a pose before the first": Decision(Probe(-1)),
    "a score that is no number": Decision(Probe(0), {"value": "high"}),
    "a score that is NaN": Decision(Probe(0), {"value": float("nan")}),
    "a score without a name": Decision(Probe(0), {1: 0.5}),
    "no scores": Decision(Probe(0), None),
}


@pytest.mark.parametrize("what", NO_DECISIONS)
@pytest.mark.parametrize(
    "wrap", [Answers, lambda answer: StopOverride(PosteriorThresholds(), Answers(answer), FixedOrder())]
)
def test_what_is_no_decision_is_an_error_that_says_who_answered_what(what, wrap, model):
    with pytest.raises(BadDecision, match="Answers answered") as caught:
        play(wrap(NO_DECISIONS[what]), model)
    assert isinstance(caught.value, ActiveTouchError)
    answer = NO_DECISIONS[what]
    named = answer.action if isinstance(answer, Decision) and answer.scores == {} else answer
    assert isinstance(answer, Decision) or repr(named) in str(caught.value)


@pytest.mark.parametrize("decider", [None, 5, object(), Answers, FixedOrder(), FixedOrder])
def test_what_is_no_decider_is_refused_before_it_is_asked(decider, model):
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 4)
    with pytest.raises(InvalidArgument, match="must be an object with a method decide, such as make_decider"):
        Session(problem, decider, 0, model)
    if not isinstance(decider, FixedOrder):  # which selects poses
        with pytest.raises(InvalidArgument, match="must be an object with a method decide"):
            naming_session(decider, model, ("p0", "p1", "p2"))


def test_an_action_by_itself_is_told_what_works(model):
    with pytest.raises(BadDecision, match=r"Decision\(Confirm\(\)\)"):
        play(Answers(Confirm()), model)


def test_unsure_is_an_answer_only_of_a_search_that_has_it(model):
    with pytest.raises(BadDecision, match=r"Answers answered Unsure\(\).*unsure_reward=0.0"):
        play(Answers(Decision(Unsure())), model)
    episode = play(Answers(Decision(Unsure(), {"why": 1})), model, unsure_reward=0.0)
    assert (episode.outcome, episode.num_touches, len(episode.steps)) == (Outcome.UNSURE, 0, 1)


@pytest.mark.parametrize("pose", [np.int64(2), np.uint8(2), np.array(2), "p2"])
def test_numbers_of_numpy_are_numbers_and_are_written_down_as_such(pose, model):
    class Numpy:
        def decide(self, info, rng):
            done = len(info.history) > 1
            return Decision(Reject() if done else Probe(pose), {"value": np.float32(0.5), "touches": 2})

    episode = play(Numpy(), model)
    assert episode.num_touches == 8
    first = json.loads(json.dumps(episode.to_dict()))["steps"][0]
    assert (first["action"], first["scores"]) == (2, {"value": 0.5, "touches": 2.0})


@pytest.mark.parametrize("limit", [float("nan"), float("inf"), 1.5, 0, -1, "48"])
def test_a_touch_limit_that_cuts_nothing_off_is_refused(limit, model):
    with pytest.raises(ValueError, match="touch_limit must be an integer, at least 1"):
        play(Answers(Decision(Probe(0))), model, touch_limit=limit)


def test_who_probes_for_ever_is_cut_off(model):
    assert play(Answers(Decision(Probe(0))), model, touch_limit=5).num_touches == 5
