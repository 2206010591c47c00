"""The conflict test of a set-up runs on from search to search, and nothing else does."""

import numpy as np
import pytest

from belief import Composition, SceneBelief, SearchProblem, Touch
from belief.observation_model.rigid_body import RigidBodyModel
from planners import Outcome, make_decider, search, search_lockstep
from planners.abstaining import Abstaining
from planners.search import log_bets_after

P, K, N = 2, 2, 6
POINTS = np.random.default_rng(0).normal(scale=3.0, size=(P, K, N, 2))


class World:
    """Bodies that show a point of the plane in each pose; ``noise`` 1.0 is that of the model."""

    def __init__(self, arrangement, noise=1.0):
        self.arrangement, self.noise, self.current = arrangement, noise, 0

    def reset(self):
        self.current = 0

    def advance(self):
        self.current += 1

    def touch(self, pose, rng):
        felt = POINTS[pose, self.arrangement[self.current], 2] + self.noise * rng.normal(size=2)
        return Touch(pose, np.zeros(K), np.array([*felt, -0.5]))


@pytest.fixture(scope="module")
def model():
    table = np.concatenate([POINTS, np.square(POINTS).sum(axis=-1, keepdims=True)], axis=-1).astype(np.float32)
    rng, touches, shapes, ids = np.random.default_rng(1), [], [], []
    for number in range(300):
        body = rng.integers(N)
        for pose in [0, 1] * 3:
            felt = POINTS[pose, number % K, body] + rng.normal(size=2)
            touches.append(Touch(pose, np.zeros(K), np.array([*felt, -0.5])))
            shapes.append(number % K)
            ids.append(number)
    return RigidBodyModel.fit(
        touches, shapes, ids, shape_labels=("a", "b"), embed=lambda number: table, num_hypotheses=N
    )


PROBLEM = SearchProblem(("a", "b"), ("p0", "p1"), 2, Composition.INDEPENDENT, unsure_reward=0.0)


def deployed(model, noise, num_set_ups=10, num_searches=10):
    arrangements = np.random.default_rng(2).integers(K, size=(num_set_ups, num_searches, 2)).tolist()
    worlds = [[World(tuple(one), noise) for one in some] for some in arrangements]
    seeds = [[(place, turn) for turn in range(num_searches)] for place in range(num_set_ups)]
    decider = Abstaining(make_decider("information_gain", model.outcome_table(), model), 0.02, promise=0.0)
    targets = [[0] * num_searches] * num_set_ups
    return decider, worlds, targets, seeds


def played(model, noise, **numbers):
    """The searches of each robot, whose test runs on."""
    decider, worlds, targets, seeds = deployed(model, noise, **numbers)
    found, log_bets = [[] for _ in worlds], [0.0] * len(worlds)
    for turn in range(len(targets[0])):
        now, words = [some[turn] for some in worlds], [some[turn] for some in seeds]
        episodes = search_lockstep(now, decider, PROBLEM, [0] * len(now), model, words, log_bets=log_bets)
        for robot, episode in enumerate(episodes):
            found[robot].append(episode)
            log_bets[robot] = log_bets_after(episode, PROBLEM, model, log_bets[robot])
    return found, log_bets


def test_a_search_begins_where_the_one_before_it_ended(model):
    decider, (worlds, *_), (targets, *_), (seeds, *_) = deployed(model, noise=1.3)
    log_bets, alone = 0.0, []
    for world, target, seed in zip(worlds, targets, seeds, strict=True):
        alone.append(search(world, decider, PROBLEM, target, model, seed, log_bets))
        log_bets = log_bets_after(alone[-1], PROBLEM, model, log_bets)
    together, bets = played(model, 1.3, num_set_ups=1)
    assert [episode.to_dict() for episode in together[0]] == [episode.to_dict() for episode in alone]
    np.testing.assert_array_equal(bets[0], log_bets)
    assert log_bets.shape == model.start().log_bets.shape


def test_several_searches_notice_what_one_does_not(model):
    found, _ = played(model, noise=2.5)
    unsure = np.array([[episode.outcome is Outcome.UNSURE for episode in some] for some in found])
    assert unsure[:, 0].mean() < 0.7
    assert unsure[:, -1].all()
    alarms = np.array([["is_conflict" in episode.steps[-1].decision.scores for episode in some] for some in found])
    assert alarms[:, -1].all()
    assert (np.diff(alarms.astype(int), axis=1) >= 0).all(), "an alarm is not taken back, only a suspicion is"


def test_in_its_own_world_hardly_a_robot_has_an_alarm(model):
    found, _ = played(model, noise=1.0, num_set_ups=12)
    assert sum(some[-1].outcome is Outcome.UNSURE for some in found) <= 1


@pytest.mark.parametrize("log_bets", [[0.0], np.nan, [np.inf] * 12])
def test_bets_of_another_test_are_refused(model, log_bets):
    with pytest.raises(ValueError, match="log_bets must be 12 finite numbers, from an earlier search"):
        SceneBelief(PROBLEM, model, log_bets=log_bets)
