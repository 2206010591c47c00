"""Sessions whose features have another unit or sign than the others, or each other's place, and sets of noise."""

import re

import numpy as np
import pytest

from activetouch.recorded import RecordedTouches, check_recorded
from experiments.recorded.recorded import recorded

OBJECTS, SESSIONS, TOUCHES, FEATURES = 6, 8, 3, 5


def scaled(touches, here):
    touches[here] *= 1000.0


def shrunk(touches, here):
    touches[here, 2] /= 1000.0


def swapped(touches, here):
    touches[here, :2] = touches[here, 1::-1]


def flipped(touches, here):
    touches[here, 2] *= -1.0


def made(change=None, where=lambda thing, session: session == 6):
    """Touches of two actions; a change of those of an odd session."""
    rng = np.random.default_rng(0)
    things, numbers, _, actions = (axis.ravel() for axis in np.indices((OBJECTS, SESSIONS, TOUCHES, 2)))
    centres = 5.0 + 2.0 * rng.normal(size=(OBJECTS, 2, FEATURES))
    touches = centres[things, actions] + 0.7 * rng.normal(size=(len(things), FEATURES))
    if change is not None:
        change(touches, where(things, numbers))
    objects, names = tuple(f"o{i}" for i in range(OBJECTS)), tuple(f"f{i}" for i in range(FEATURES))
    return RecordedTouches(touches, actions, things, numbers, ("press", "rub"), objects, feature_names=names)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            scaled,
            r"f0, f1, f2, f3, f4 of {}: about 1000 times the values of other sessions of the same",
        ),
        (shrunk, r"f2 of {}: about 0\.001 times the values"),
        (swapped, r"f0, f1 of {}: they seem to be in each other's place"),
        (flipped, r"f2 of {}: the other sign than in other sessions of the same objects"),
    ],
)
def test_a_session_with_other_units_signs_or_columns_is_named(change, words):
    assert re.match(words.format("session 6"), check_recorded(made(change))[0])
    two = made(change, lambda thing, session: np.isin(session, (1, 6)))
    assert re.match(words.format("session 1, session 6"), check_recorded(two)[0])


def test_a_session_of_one_object_is_named_with_it():
    found = check_recorded(made(scaled, lambda thing, session: (thing == 1) & (session == 2)))
    assert found[0].startswith("f0, f1, f2, f3, f4 of session 2 of o1: about 1000 times")


def test_usual_touches_give_no_remark():
    assert check_recorded(made()) == ()


def test_noise_is_no_better_than_a_guess_and_the_verdict_says_so(rng):
    def noise(touches, _):
        touches[:] = rng.normal(size=touches.shape)

    touches = made(noise)
    assert "discriminants find nothing in these features" in check_recorded(touches)[0]
    verdict = recorded(touches, scenes=0, rounds=1).verdict()
    assert re.match(r"Do not trust these probabilities: 0\.\d+ .* no better than guessing", verdict[0])
    assert not recorded(made(), scenes=0, rounds=1).verdict()[0].startswith("Do not trust")
