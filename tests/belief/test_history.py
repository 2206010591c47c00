"""Histories of touches are immutable."""

import copy
import pickle

import numpy as np
import pytest

from belief import Touch, TouchHistory

TOUCHES = tuple(Touch(pose, np.full(2, float(pose))) for pose in (0, 2, 2, 1))


def test_a_history_is_the_sequence_of_its_touches():
    history = TouchHistory(TOUCHES)
    assert history == TOUCHES
    assert tuple(history) == TOUCHES
    assert (history[-1], history[1], history[1:3]) == (TOUCHES[-1], TOUCHES[1], TOUCHES[1:3])
    assert (len(history), bool(history), bool(TouchHistory())) == (4, True, False)
    assert history.uses(4).tolist() == [1, 1, 2, 0]
    for index in (4, -5):
        with pytest.raises(IndexError):
            history[index]


def test_a_longer_one_leaves_the_shorter_as_it_was_and_so_does_another():
    empty = TouchHistory()
    first = empty.extended(TOUCHES[:2])
    longer, other = first.extended(iter(TOUCHES[2:3])), first.extended(touch for touch in TOUCHES[3:])
    assert (empty, first, longer) == ((), TOUCHES[:2], TOUCHES[:3])
    assert other == (*TOUCHES[:2], TOUCHES[3])
    assert (first.uses(3).tolist(), longer.uses(3).tolist(), other.uses(3).tolist()) == (
        [1, 0, 1],
        [1, 0, 2],
        [1, 1, 1],
    )
    with pytest.raises(IndexError):
        first[2]


def test_it_is_copied_and_pickled_by_what_it_shows():
    history = TouchHistory(TOUCHES)
    shorter = TouchHistory().extended(TOUCHES[:1])
    shorter.extended(TOUCHES[1:])
    for some in (history, shorter):
        for again in (copy.deepcopy(some), pickle.loads(pickle.dumps(some))):
            assert [touch.pose for touch in again] == [touch.pose for touch in some]
            assert again.uses(3).tolist() == some.uses(3).tolist()


def test_a_pose_that_does_not_exist_is_not_counted_silently():
    with pytest.raises(ValueError, match="pose 2, there are 2 poses"):
        TouchHistory(TOUCHES).uses(2)
