"""Streams of touches, and alarms, are counted as stated."""

import numpy as np
import pytest

from activetouch import SCENES
from experiments.calibration.sequences import Stops
from experiments.robustness.conditions import CONDITIONS, DoesNotApply
from experiments.robustness.conflict import FALSE_ALARMS, STREAM, alarms, log_e_values, stranger_scores, stream_scores

P, J = 5, 3


def stops_of(number):
    """Every object stops after all its touches; the odd ones are right."""
    return Stops(np.arange(number), np.full(number, 0.96), np.arange(number) % 2 == 1, np.full(number, P))


def test_a_stream_without_conflict_is_quiet():
    found = stream_scores(np.zeros((20, P, J)), stops_of(20), seed=0)
    assert (found["streams"], found["fired"][0], found["touches"]) == (20 * P // STREAM, 0.0, None)
    assert (found["quiet"]["number"], found["quiet"]["achieved"]) == (20, 0.5)


def test_wealth_of_all_objects_of_a_stream_counts():
    """Each touch adds a quarter of the log threshold and a little, so that the fourth or fifth touch fires."""
    steps = np.arange(1, P + 1)[:, None] * np.log(1 / FALSE_ALARMS) / 7.5
    found = stream_scores(np.tile(steps, (20, 1, J)), stops_of(20), seed=0)
    assert (found["fired"][0], found["touches"], found["quiet"]) == (1.0, 8.0, None)


def test_a_stream_touches_each_object_until_its_stop_and_no_further():
    wealth = np.zeros((2 * STREAM, P, J))
    wealth[:, 1:] = 99.0  # after the stop
    once = Stops(np.arange(2 * STREAM), np.full(2 * STREAM, 0.96), np.ones(2 * STREAM, bool), np.ones(2 * STREAM, int))
    found = stream_scores(wealth, once, seed=0)
    assert (found["streams"], found["fired"][0], found["quiet"]["number"]) == (2, 0.0, 2 * STREAM)
    never = Stops(*(some[:0] for some in (once.sequences, once.claims, once.correct, once.num_touches)))
    found = stream_scores(wealth, never, seed=0)  # all poses
    assert (found["streams"], found["fired"][0], found["touches"]) == (2 * P, 1.0, 2.0)


def test_fewer_touches_than_a_stream_give_no_figures():
    found = stream_scores(np.zeros((3, P, J)), stops_of(3), seed=0)
    assert (found["streams"], found["fired"], found["quiet"]) == (0, None, None)


def test_strangers_by_the_e_value_at_a_touch_and_by_the_mean_of_other_scores():
    known, novel = np.zeros((8, P)), np.tile([0.0, 0.0, 9.0, 0.0, 0.0], (8, 1))
    names = ("conflict", "misfit", "energy")
    found = stranger_scores(dict.fromkeys(names, known), dict.fromkeys(names, novel), 4)
    assert [found[name][0] for name in names] == [0.5, 0.5, 1.0]
    assert [alarms(novel, after)[0] for after in (2, 4)] == [0.0, 1.0]


def test_the_e_value_is_the_mean_over_strategies():
    assert log_e_values(np.log([[[1.0, 3.0]]])).tolist() == [[pytest.approx(np.log(2.0))]]
    assert np.isfinite(log_e_values(np.array([[[-1e4, 1e4]]]))).all()


def test_all_of_these_changes_whatever_applies():
    for name in ("paper", "coarse"):
        scene = SCENES[name].scene
        changed = CONDITIONS["all of these"](scene)
        assert changed.variation.stiffness.support == (0.7, 0.7)
        assert changed.variation.force.support[0] == pytest.approx(0.7 * scene.variation.force.support[0])
    with pytest.raises(DoesNotApply):
        CONDITIONS["noise × 6"](SCENES["paper"].scene)
