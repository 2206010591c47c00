import pytest

from belief import Composition, SearchProblem


def problem(**options):
    return SearchProblem(**({"shape_labels": "abcd", "pose_labels": "pq", "num_objects": 4} | options))


@pytest.mark.parametrize(
    ("confirmed", "target", "present", "expected"),
    [(1, 1, True, 1.0), (0, 1, True, -1.0), (None, 1, True, -1.0), (None, 1, False, 1.0), (0, 1, False, -1.0)],
)
def test_reward_is_plus_one_for_the_right_end_and_minus_one_otherwise(confirmed, target, present, expected):
    assert problem().reward(confirmed, target, num_touches=0, target_present=present) == expected
    assert problem(touch_cost=0.1).reward(confirmed, target, 3, present) == pytest.approx(expected - 0.3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_objects": 5}, "5 objects cannot all differ"),
        ({"num_objects": 0}, "at least 1"),
        ({"touch_cost": -0.1}, "≥ 0"),
        ({"touch_cost": float("nan")}, "finite"),
        ({"touch_limit": 0}, "touch_limit"),
    ],
)
def test_a_problem_that_makes_no_sense_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        problem(**options)


def test_a_composition_may_be_given_by_name():
    assert problem(composition="independent").composition is Composition.INDEPENDENT
    with pytest.raises(ValueError, match="5 objects"):
        problem(num_objects=5, composition="distinct")
    with pytest.raises(ValueError, match="coupled"):
        problem(composition="coupled")


def test_more_objects_than_shapes_are_fine_when_independent():
    assert problem(num_objects=12, composition=Composition.INDEPENDENT).num_objects == 12
