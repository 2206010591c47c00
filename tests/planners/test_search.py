"""Laws that every decider in the table obeys in the one search loop, on a world sampled from the model."""

import json
from functools import cache

import numpy as np
import pytest
from scipy import stats

from belief import Belief, Composition, Confirm, ImpossibleObservation, Probe, Reject, SearchProblem, Touch, Unsure
from belief.calibration import TemperatureScaling
from belief.errors import InvalidArgument, UnknownName
from belief.observation_model import ConfusionModel
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import DECIDERS, Decision, Episode, Outcome, make_decider, search, search_lockstep
from planners.episode import Step
from planners.registry import NEED_FILES

SIMULATIONS = 20  # enough to be legal, too few to be good
UNTRAINED = [name for name in DECIDERS if name not in NEED_FILES]
every_decider = pytest.mark.parametrize("name", UNTRAINED)
every_composition = pytest.mark.parametrize("composition", list(Composition))


def problem_for(model, composition=Composition.DISTINCT, num_objects=None, touch_limit=60):
    poses = tuple(f"p{i}" for i in range(model.outcome_table().num_poses))
    return SearchProblem(
        model.shape_labels, poses, num_objects or len(model.shape_labels), composition, 0.02, touch_limit
    )


def play(name, model, problem, seeds, target=0):
    own = problem.seeking(target)
    worlds = [SyntheticWorld(model, sample_arrangement(own, np.random.default_rng([s, 99]))) for s in seeds]
    decider = make_decider(name, model.outcome_table(), simulations=SIMULATIONS)
    return search_lockstep(worlds, decider, problem, [target] * len(worlds), model, [(s,) for s in seeds])


@cache
def played(name, composition=Composition.DISTINCT):
    """Ten episodes in the world of the fixture ``model``, with seeds 0 to 9; four of the rarer compositions."""
    model = random_model(np.random.default_rng(0))
    return play(name, model, problem_for(model, composition), range(10 if composition is Composition.DISTINCT else 4))


@every_decider
@every_composition
def test_every_search_ends_and_its_steps_add_up(name, composition, model):
    problem = problem_for(model, composition)
    for episode in played(name, composition):
        *earlier, last = episode.steps
        rejected = sum(isinstance(step.decision.action, Reject) for step in episode.steps)
        assert not any(isinstance(step.decision.action, Confirm) for step in earlier)
        assert episode.num_touches <= problem.touch_limit
        if episode.outcome is Outcome.CONFIRMED:
            assert isinstance(last.decision.action, Confirm)
            assert last.object_index == rejected
        elif episode.outcome is Outcome.EXHAUSTED:
            assert rejected == problem.num_objects


@every_decider
def test_the_same_seed_gives_the_same_episode(name, model):
    again = play(name, model, problem_for(model), range(10))
    assert [e.to_dict() for e in again] == [e.to_dict() for e in played(name)]


@every_decider
def test_lockstep_gives_the_episodes_of_one_at_a_time(name, model):
    alone = [play(name, model, problem_for(model), [seed])[0] for seed in range(6)]
    assert [e.to_dict() for e in alone] == [e.to_dict() for e in played(name)[:6]]


@every_decider
def test_an_episode_survives_json(name, model):
    for episode in played(name)[:5]:
        text = json.dumps(episode.to_dict())
        copy = Episode.from_dict(json.loads(text), model.shape_labels)
        assert copy.num_touches == episode.num_touches
        assert copy.success == episode.success
        assert [s.decision for s in copy.steps] == [s.decision for s in episode.steps]
        for one, other in zip(copy.steps, episode.steps, strict=True):
            np.testing.assert_allclose(one.belief.probs, other.belief.probs, atol=1e-15)


def test_the_same_touch_of_the_same_episode_feels_the_same_to_every_decider():
    felt = {}
    for name in UNTRAINED:
        for episode in played(name):
            uses = {}
            for step in episode.steps:
                if isinstance(step.decision.action, Probe):
                    key = (*episode.seed, step.object_index, step.decision.action.pose)
                    uses[key] = uses.get(key, -1) + 1
                    logits = step.touch.logits.tolist()
                    assert felt.setdefault((*key, uses[key]), logits) == logits


def test_confirming_at_random_succeeds_once_in_n(model):
    # 500 searches at 1/4: outside [82, 168] with probability below 1e-4.
    episodes = play("random_confirm", model, problem_for(model), range(500))
    assert 82 <= sum(episode.success for episode in episodes) <= 168
    assert all(episode.num_touches == 0 for episode in episodes)


@every_composition
def test_information_gain_keeps_the_promise_of_its_confirm_threshold(composition):
    # Beliefs are exact in this world, so a stop at .99 is right at least 99 times in 100, whatever the poses.
    model = random_model(np.random.default_rng(3), sharpness=3.0)
    problem = problem_for(model, composition)
    stops = [
        episode.success
        for episode in play("information_gain", model, problem, range(250))
        if episode.outcome is Outcome.CONFIRMED and episode.steps[-1].decision.scores["target_prob"] >= 0.99
    ]
    assert len(stops) > 100
    assert stats.binomtest(sum(stops), len(stops), 0.99, alternative="less").pvalue > 1e-3


def test_fusing_touches_beats_the_rule_on_single_frames():
    # Paired over 200 searches with a sensor right nine times in ten; the gap is about .09, its standard error .025.
    model = random_model(np.random.default_rng(5), sharpness=4.5)
    problem = problem_for(model, touch_limit=200)
    success = {
        name: np.mean([e.success for e in play(name, model, problem, range(200))])
        for name in ("threshold", "information_gain")
    }
    assert success["information_gain"] > success["threshold"] + 0.01


@every_decider
def test_a_world_can_be_searched_again(name, model):
    problem, decider = problem_for(model), make_decider(name, model.outcome_table(), simulations=SIMULATIONS)
    world = SyntheticWorld(model, (3, 1, 0, 2))
    first, again = (search(world, decider, problem, 0, model, (5,)).to_dict() for _ in range(2))
    assert first == again


def test_the_touch_limit_cuts_a_search_off(model):
    [episode] = play("threshold", model, problem_for(model, touch_limit=1), [3])
    assert episode.num_touches == 1
    assert episode.outcome is Outcome.TRUNCATED
    assert isinstance(episode.steps[-1].decision.action, Probe)  # the one that was not allowed
    assert Episode.from_dict(episode.to_dict(), model.shape_labels).num_touches == 1
    assert episode.reward(problem_for(model)) == pytest.approx(-1.02)


def test_a_search_that_ends_unsure_is_no_success_and_survives_json(model):
    class TouchThenUnsure:
        def decide(self, info, rng):
            return Decision(Unsure() if info.history else Probe(0), {"target_prob": info.target_prob})

    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 4, unsure_reward=-0.5)
    episode = search(SyntheticWorld(model, (3, 1, 0, 2)), TouchThenUnsure(), problem, 0, model, (5,))
    copy = Episode.from_dict(json.loads(json.dumps(episode.to_dict())), model.shape_labels)
    for one in (episode, copy):
        assert one.outcome is Outcome.UNSURE
        assert one.steps[-1].decision.action == Unsure()
        assert (one.success, one.is_answered, one.confirmed_shape, one.num_touches) == (False, False, None, 1)
        assert one.reward(problem) == pytest.approx(-0.52)


@pytest.mark.parametrize(
    ("action", "outcome", "arrangement", "is_right"),
    [
        (Confirm(), Outcome.CONFIRMED, (0, 1), True),
        (Confirm(), Outcome.CONFIRMED, (1, 0), False),
        (Confirm(), Outcome.CONFIRMED, (1, 2), False),
        (Reject(), Outcome.EXHAUSTED, (1, 0), False),
        (Reject(), Outcome.EXHAUSTED, (1, 2), True),
        (Probe(0), Outcome.TRUNCATED, (1, 0), False),
        (Probe(0), Outcome.TRUNCATED, (1, 2), False),  # it did not say that there is no target
    ],
)
def test_only_a_confirmed_target_or_a_rightly_stated_absence_is_right(action, outcome, arrangement, is_right):
    problem = SearchProblem(("a", "b", "c"), ("p",), 2, Composition.INDEPENDENT)
    step = Step(0, Belief.uniform(problem.shape_labels), Decision(action), None)
    episode = Episode((0,), 0, arrangement, (step,), outcome)
    assert episode.success == is_right
    assert episode.reward(problem) == (1.0 if is_right else -1.0)


def test_a_world_that_does_not_make_all_touches_is_refused(model):
    worlds = [SyntheticWorld(model, (3, 1, 0, 2))] * 2
    decider = make_decider("information_gain", model.outcome_table())

    def one_too_few(requests):
        return [request.world.touch(request.pose, request.rng) for request in requests[1:]]

    with pytest.raises(ValueError, match="shorter"):
        search_lockstep(worlds, decider, problem_for(model), [0, 0], model, [(1,), (2,)], one_too_few)


def test_finding_nothing_is_right_when_the_target_is_absent():
    model = random_model(np.random.default_rng(5), sharpness=6.0)
    problem = problem_for(model, Composition.INDEPENDENT, num_objects=2)
    decider = make_decider("information_gain", model.outcome_table())
    episode = search(SyntheticWorld(model, (1, 2)), decider, problem, target=0, model=model, seed=(7,))
    assert episode.outcome is Outcome.EXHAUSTED
    assert episode.success
    assert episode.reward(problem) == pytest.approx(1.0 - 0.02 * episode.num_touches)


def test_a_touch_no_arrangement_explains_stops_the_search_with_an_error():
    labels = ("a", "b")
    model = ConfusionModel(labels, np.eye(2)[None], TemperatureScaling(1.0, "ok"))

    class TouchThenReject:
        def decide(self, info, rng):
            return Decision(Reject() if info.history else Probe(0))

    with pytest.raises(ImpossibleObservation):
        search(SyntheticWorld(model, (0, 0)), TouchThenReject(), problem_for(model), 1, model, (0,))


@pytest.mark.parametrize(("arrangement", "target", "message"), [((0, 1), 0, "2 objects"), ((0, 1, 2, 3), 4, "target")])
def test_a_world_or_target_that_does_not_fit_the_problem_is_refused(model, arrangement, target, message):
    decider = make_decider("threshold", model.outcome_table())
    with pytest.raises(ValueError, match=message):
        search(SyntheticWorld(model, arrangement), decider, problem_for(model), target, model, (0,))


@pytest.mark.parametrize("what", ["targets", "seeds", "log_bets"])
def test_lists_of_other_lengths_than_the_worlds_are_refused_by_name(model, what):
    lists = {"targets": [0, 1], "seeds": [1, 2], "log_bets": [0.0, 0.0]}
    worlds, decider = [SyntheticWorld(model, (0, 1, 2, 3))] * 2, make_decider("threshold", model.outcome_table())
    for wrong in ([], lists[what] * 2):
        with pytest.raises(InvalidArgument, match=f"as many {what} as worlds, 2, got {len(wrong)}"):
            search_lockstep(worlds, decider, problem_for(model), model=model, **lists | {what: wrong})


def test_an_unknown_decider_suggests_the_nearest(model):
    with pytest.raises(UnknownName, match="Did you mean 'information_gain'"):
        make_decider("infogain", model.outcome_table())


def test_an_episode_without_logits_survives_json_with_its_features():
    touch = Touch(1, features=np.array([0.5, 0.1], np.float32))
    steps = (Step(0, Belief.uniform(["a", "b"]), Decision(Probe(1), {}), touch),)
    fields = json.loads(json.dumps(Episode((1,), 0, (0, 1), steps, Outcome.TRUNCATED).to_dict()))
    found = Episode.from_dict(fields, ("a", "b")).steps[0].touch
    assert (found.pose, found.logits, found.features.tolist()) == (1, None, touch.features.tolist())
