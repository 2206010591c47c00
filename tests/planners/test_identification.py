"""Naming one object: when it stops, what it states, and the order of its touches."""

import numpy as np
import pytest

from belief import SearchProblem
from belief.errors import InvalidArgument
from belief.observation_model import OutcomeTable
from belief.synthetic import SyntheticWorld, random_model
from benchmarks.tabular_model import TabularModel
from planners import make_decider, search
from planners.decider import SequentialDecider
from planners.probing import GivenOrder, RandomOrder, ShapeInformationGain
from planners.search import identify, naming_session
from planners.stopping import PosteriorThresholds

POSES = ("a", "b", "c")


@pytest.fixture
def model():
    return random_model(np.random.default_rng(0), sharpness=2.5)


def test_it_stops_at_the_threshold_and_is_right_as_often_as_it_states(model):
    results = []
    for number in range(150):
        world = SyntheticWorld(model, [number % 4])
        results.append(identify(world, RandomOrder(), model, POSES, [5, number], 0.9, max_touches=30))
    assert all(one.stated >= 0.9 for one in results if one.is_certain)
    certain = [one for one in results if one.is_certain]
    assert len(certain) > 120
    right, stated = np.mean([one.is_right for one in certain]), np.mean([one.stated for one in certain])
    assert abs(right - stated) < 0.06


def test_a_given_order_is_kept_and_the_limit_too(model):
    named = identify(SyntheticWorld(model, [1]), GivenOrder(("c", "a", "b")), model, POSES, 3, None, max_touches=5)
    assert named.poses == (2, 0, 1, 2, 0)
    assert not named.is_certain


def test_information_gain_needs_fewer_touches_than_a_random_order(model):
    numbers = {}
    for selector in (RandomOrder(), ShapeInformationGain(model.outcome_table())):
        runs = [identify(SyntheticWorld(model, [i % 4]), selector, model, POSES, [1, i], 0.95) for i in range(60)]
        numbers[type(selector)] = np.mean([len(run.poses) for run in runs])
    assert numbers[ShapeInformationGain] < numbers[RandomOrder]


@pytest.mark.parametrize("max_touches", [None, 0, 2.5, "3"])
def test_a_number_of_touches_that_is_none_is_refused(model, max_touches):
    with pytest.raises(InvalidArgument, match="max_touches must be an integer, at least 1, got"):
        naming_session(RandomOrder(), model, POSES, max_touches=max_touches)


@pytest.mark.parametrize("threshold", [0.0, 1.1, np.nan, "0.9"])
def test_a_threshold_out_of_range_is_refused(model, threshold):
    with pytest.raises(InvalidArgument, match=r"threshold must be a number in \(0, 1\]"):
        identify(SyntheticWorld(model, [1]), RandomOrder(), model, POSES, 0, threshold)


def test_it_names_the_first_object_of_a_world_wherever_a_search_has_left_it():
    model = TabularModel(tuple("abcd"), OutcomeTable(np.eye(4)[None]))
    world = SyntheticWorld(model, [2, 0, 1])
    world.advance()
    named = identify(world, RandomOrder(), model, ("p",), 0, 1.0)
    assert (named.truth, named.named, named.is_certain, named.poses) == (2, 2, True, (0,))  # no second touch


def test_its_touches_are_those_of_a_search_with_its_seed(model):
    class Recording(SyntheticWorld):
        def touch(self, pose, rng):
            touch = super().touch(pose, rng)
            felt.append(touch.logits)
            return touch

    felt = []
    identify(Recording(model, [1, 2]), GivenOrder(("c", "a", "b")), model, POSES, 3, 1.0, max_touches=6)
    named, felt = np.array(felt), []
    problem = SearchProblem(model.shape_labels, POSES, 2, "independent")
    decider = SequentialDecider(PosteriorThresholds(1.0, 0.0, 6), GivenOrder(("c", "a", "b")))
    search(Recording(model, [1, 2]), decider, problem, 0, model, 3)
    np.testing.assert_array_equal(named, felt[:6])


def test_an_opinion_is_believed_before_the_first_touch(model):
    """It adds the log odds that a tempered opinion has, whatever is felt."""
    found = [
        identify(SyntheticWorld(model, [1]), GivenOrder(POSES), model, POSES, 3, None, max_touches=1, opinion=opinion)
        for opinion in (None, [0.7, 0.1, 0.1, 0.1])
    ]
    plain, with_opinion = (one.log_probs[0] for one in found)
    shift = (with_opinion - plain) - (with_opinion - plain)[1]
    assert shift[0] > 0.5
    np.testing.assert_allclose(shift[1:], 0.0, atol=1e-5)


def test_a_decider_about_the_target_is_asked_about_the_most_probable_label():
    """Of the first label alone, which is no more the question than others, the touches would tell less."""
    model = random_model(np.random.default_rng(3), num_shapes=8, num_poses=12, sharpness=2.5)
    poses, numbers = tuple(map(str, range(12))), {}
    decider = make_decider("information_gain", model.outcome_table(), model)
    for name, asked in (("decider", decider), ("selector", decider.probing)):
        worlds = [SyntheticWorld(model, [number % 8]) for number in range(80)]
        runs = [identify(world, asked, model, poses, n, 0.95, 30) for n, world in enumerate(worlds)]
        numbers[name] = np.mean([len(one.poses) for one in runs])
    assert numbers["decider"] < 0.9 * numbers["selector"]
