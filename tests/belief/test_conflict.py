"""The conflict test keeps its false-alarm rate, notices other worlds, and survives extremes."""

import json

import numpy as np
import pytest
from scipy.stats import binomtest

from belief.codec import from_fields, to_fields
from belief.conflict import MOST_TOUCHES, ConflictTest, Novelty, SimulatedTouches, UsualMisfit, log_conflict

D, THRESHOLD = 5, np.log(1 / 0.02)


def sequences(rng, number, length=MOST_TOUCHES, novelty=1.0, misfit=0.0):
    """Embeddings and misfits of objects whose touches are alike: an effect of the object is half of the variance."""
    embeddings = novelty * (rng.normal(size=(number, 1, D)) + rng.normal(size=(number, length, D))) / np.sqrt(2)
    misfits = misfit + (rng.normal(size=(number, 1)) + rng.normal(size=(number, length))) / np.sqrt(2)
    return embeddings, misfits


@pytest.fixture(scope="module")
def test_of_200():
    return ConflictTest.fit(*sequences(np.random.default_rng(0), 200), np.arange(200) % 2)


def followed(test, embeddings, misfits):
    state = test.start()
    for embedding, misfit in zip(embeddings, misfits, strict=True):
        state = state.update(embedding, misfit)
        yield state


def share_that_exceeds(test, rng, number, num_objects, length, **shift):
    fired = 0
    for _ in range(number):
        done, fires = [], False
        for embeddings, misfits in zip(*sequences(rng, num_objects, length, **shift), strict=True):
            states = list(followed(test, embeddings, misfits))
            fires |= any(log_conflict([*done, state.log_bets]) > THRESHOLD for state in states)
            done.append(states[-1].log_bets)
        fired += fires
    return fired


@pytest.mark.parametrize(("num_calibration", "num_objects", "length"), [(1000, 5, 5), (40, 4, 6), (200, 2, 12)])
def test_in_its_own_world_it_exceeds_the_threshold_as_rarely_as_stated(num_calibration, num_objects, length):
    """Each search meets a test from other calibration objects, so that their chance counts too."""
    rng, fired, searches = np.random.default_rng(1), 0, 0
    for _ in range(10):
        test = ConflictTest.fit(*sequences(rng, num_calibration), np.arange(num_calibration) % 2)
        fired += share_that_exceeds(test, rng, 8, num_objects, length)
        searches += 8
    assert binomtest(fired, searches, 0.02, alternative="greater").pvalue > 0.01


@pytest.mark.parametrize("shift", [{"novelty": 2.0}, {"misfit": 2.5}, {"novelty": 1.4, "misfit": 1.5}])
def test_it_notices_another_world_within_twenty_five_touches(test_of_200, shift):
    assert share_that_exceeds(test_of_200, np.random.default_rng(2), 20, 5, 5, **shift) > 15


def test_p_values_are_uniform_after_any_number_of_touches(test_of_200):
    found = sequences(np.random.default_rng(3), 200)
    p_values = np.array([[s.p_values for s in followed(test_of_200, *one)] for one in zip(*found, strict=True)])
    assert (p_values[:, 0, 1] == 1.0).all(), "the first touch has nothing to fit to"
    for level in (0.05, 0.2, 0.5):
        rates = (p_values <= level).mean(axis=0)
        assert (np.abs(np.r_[rates[:, 0], rates[1:, 1]] - level) < 0.16).all()


def test_earlier_touches_of_the_object_are_predicted(test_of_200):
    """After a rare touch of an object the next one is rare no more often, although its touches are alike."""
    found = sequences(np.random.default_rng(4), 1500, 2)
    novel = np.array([[s.p_values[0] for s in followed(test_of_200, *one)] for one in zip(*found, strict=True)])
    assert (novel[novel[:, 0] <= 0.1, 1] <= 0.1).mean() < 0.17


def test_going_on_with_little_known_objects_alone_is_no_conflict():
    """A search touches those again whose shape is uncertain, and a touch of them always fits less well."""
    rng = np.random.default_rng(6)
    embeddings, misfits = sequences(rng, 2000, 4)
    certainties = rng.uniform(size=misfits.shape)
    misfits = (0.3 * misfits + 2.0) * (1.1 - certainties)
    for told, fires in ((certainties, False), (np.full_like(certainties, 0.5), True)):
        test = ConflictTest.fit(embeddings[:800], misfits[:800], np.arange(800) % 2, told[:800])
        wealth = np.zeros(12)
        for one in 800 + np.flatnonzero((certainties[800:, 1:] < 0.35).all(axis=1)):
            state = test.start()
            for values in zip(embeddings[one], misfits[one], told[one], strict=True):
                state = state.update(*values)
            wealth = wealth + state.log_bets
        assert (log_conflict([wealth]) > THRESHOLD) == fires


def test_after_the_last_tested_touch_nothing_changes(test_of_200):
    states = list(followed(test_of_200, np.full((40, D), 9.0), np.full(40, 9.0)))
    assert states[-1].log_bets is states[MOST_TOUCHES - 1].log_bets
    assert (states[-1].num_touches, states[-1].p_values.tolist()) == (40, [1.0, 1.0])


@pytest.mark.parametrize("number", [0.0, -0.0, 1e-300, 1e300, -1e300, np.finfo(float).max])
@pytest.mark.parametrize("misfit", [0.0, 1e33, -1e33, np.inf, -np.inf])
def test_extreme_touches_give_numbers(test_of_200, number, misfit):
    for state in followed(test_of_200, np.full((4, D), number), np.full(4, misfit)):
        assert np.isfinite(state.log_bets).all()
        assert ((state.p_values > 0.0) & (state.p_values <= 1.0)).all()


@pytest.mark.parametrize("number", [0.0, 3.0, 1e-30, 1e30, 1e300])
def test_calibration_touches_that_are_all_the_same(number):
    test = ConflictTest.fit(np.full((30, 4, D), number), np.zeros((30, 4)), np.zeros(30, int))
    *_, same = followed(test, np.full((4, D), number), np.zeros(4))
    assert log_conflict([same.log_bets]) <= 0.0
    *_, other = followed(test, np.full((4, D), 7.0), np.ones(4))
    assert np.isfinite(other.log_bets).all()


@pytest.mark.parametrize("extreme", [np.inf, -np.inf, 1e300])
def test_calibration_misfits_of_any_size_leave_a_test_of_finite_numbers(extreme):
    embeddings, misfits = sequences(np.random.default_rng(0), 60, 4)
    misfits[::3] = extreme
    test = ConflictTest.fit(embeddings, misfits, np.arange(60) % 2)
    for array in (test.quantiles, test.correlations, test.usual_misfit.medians, test.usual_misfit.widths):
        assert np.isfinite(array).all()
    *_, usual = followed(test, np.zeros((4, D)), np.full(4, extreme))
    assert usual.p_values[1] > 0.01  # a third of the calibration objects are like it


@pytest.mark.parametrize("number", [1, 2, 19])
def test_a_few_objects_make_no_test(number):
    assert ConflictTest.fit(*sequences(np.random.default_rng(0), number), np.zeros(number, int)) is None


def test_one_touch_of_each_object_tests_first_touches_only():
    test = ConflictTest.fit(*sequences(np.random.default_rng(0), 50, 1), np.arange(50) % 2)
    first, second = followed(test, np.full((2, D), 9.0), np.full(2, 9.0))
    assert first.p_values[0] == pytest.approx(1 / 51)
    assert second.log_bets is first.log_bets


def test_json_gives_the_same_test(test_of_200):
    again = from_fields(ConflictTest, json.loads(json.dumps(to_fields(test_of_200))))
    embeddings, misfits = (one[0] for one in sequences(np.random.default_rng(5), 1))
    for here, there in zip(
        followed(test_of_200, embeddings, misfits), followed(again, embeddings, misfits), strict=True
    ):
        np.testing.assert_array_equal(here.log_bets, there.log_bets)


def plain_test(scores, correlation=0.0):
    """A test with these calibration scores of both kinds, ``(2, T, S)``, whose misfits are in nats."""
    length, number = scores.shape[1:]
    novelty = Novelty.fit(np.zeros((number, D)), np.zeros(number, int))
    usual = UsualMisfit(np.zeros((length, 0)), np.zeros((length, 1)), np.ones((length, 1)))
    return ConflictTest(novelty, usual, np.zeros(length), np.full(2, correlation), scores, number)


def test_p_values_count_the_calibration_objects_that_score_at_least_as_high_or_as_low(rng):
    scores = np.sort(rng.normal(size=(2, 1, 30)).round(1))  # some are equal
    for kind, values in enumerate(scores[:, 0]):
        for score in (-9.0, *values, *(values + 0.05), 9.0):
            expected = (1 + (values >= score - 1e-4).sum()) / 31, (1 + (values <= score + 1e-4).sum()) / 31
            assert plain_test(scores).p_values(kind, 0, score) == pytest.approx(expected)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.9])
def test_a_misfit_that_the_earlier_ones_predict_best_is_the_most_usual(correlation):
    """The prediction is that of least squares, where any two scores of an object have this correlation."""
    state, earlier = plain_test(np.tile(np.linspace(-14.5, 14.5, 30), (2, 6, 1)), correlation).start(), []
    state = state.update(np.zeros(D), 99.0)  # the first touch has no misfit
    for surprise in (4.0, -2.0, 5.0, 0.0, 0.0):
        number = len(earlier)
        covariance = (1.0 - correlation) * np.eye(number + 1) + correlation
        predicted = np.linalg.solve(covariance[:-1, :-1], covariance[:-1, -1]) @ np.array(earlier)
        earlier.append(float(predicted) + surprise)
        state = state.update(np.zeros(D), earlier[-1])
        assert state.p_values[1] == pytest.approx((1 + 15 - surprise) / 31)  # as many are as high


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("length", [3, 6])
def test_the_correlation_of_misfits_is_what_touches_of_an_object_share(share, length, rng):
    alone, shared = rng.normal(size=(10_000, length)), rng.normal(size=(10_000, 1))
    misfits = np.sqrt(share) * shared + np.sqrt(1.0 - share) * alone
    test = ConflictTest.fit(np.zeros((10_000, length, 1)), misfits, np.zeros(10_000, int))
    assert test.correlations[1] == pytest.approx(min(share, 0.9), abs=0.04)  # four standard errors


def test_novelty_is_comparable_between_shapes():
    rng = np.random.default_rng(0)
    shapes = np.arange(2000) % 2
    spread = 1.0 + 20.0 * shapes[:, None]
    touches = spread * rng.normal(size=(2000, D)) + 300.0 * shapes[:, None]
    scores = Novelty.fit(touches, shapes).score(touches)
    assert np.quantile(scores[shapes == 0], 0.9) == pytest.approx(np.quantile(scores[shapes == 1], 0.9), abs=0.4)


def test_a_touch_is_bet_on_by_its_distance_to_simulated_ones(rng):
    known = SimulatedTouches.of(rng.normal(size=(2000, 6)))
    usual = [known.e_value(one) for one in rng.normal(size=(2000, 6))]
    assert np.mean(usual) < 1.1
    assert np.median(usual) < 0.8
    assert known.e_value(np.full(6, 5.0)) > 30.0
    assert known.e_value(known.embeddings[0]) == pytest.approx((1.0 + 0.5 + 0.2) / 3.0)


def test_touches_of_a_noisy_state_are_compared_with_each_other(rng):
    """They are far from each other, and one in forty of the simulated ones."""
    noise = 6.0 * rng.normal(size=(140, 6)) + 30.0 * np.eye(6)[0]
    every, states = np.concatenate([rng.normal(size=(3900, 6)), noise[:100]]), np.arange(4000) >= 3900
    known, pooled = SimulatedTouches.of(every, states), SimulatedTouches.of(every)
    felt = [[one.e_value(touch) for touch in noise[100:]] for one in (known, pooled)]
    assert np.mean(felt[0]) < 1.2 < 5.0 < np.mean(felt[1])
    assert np.mean([known.e_value(touch) for touch in rng.normal(size=(400, 6))]) < 1.2
    assert known.e_value(np.full(6, 40.0)) > 30.0
    other_way = SimulatedTouches.of(every[::-1], states[::-1])
    assert [other_way.e_value(touch) for touch in noise[100:]] == pytest.approx(felt[0])
    assert np.bincount(other_way.states).tolist() == [3900, 100]
