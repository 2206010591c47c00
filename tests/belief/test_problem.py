import copy
import dataclasses
import pickle
from fractions import Fraction

import numpy as np
import pytest

from belief import ActiveTouchError, Composition, SearchProblem, Touch
from belief.synthetic import SyntheticWorld, random_model
from planners import Outcome, make_decider, search


def problem(**options):
    return SearchProblem(**({"shape_labels": tuple("abcd"), "pose_labels": tuple("pq"), "num_objects": 4} | options))


@pytest.mark.parametrize(
    ("confirmed", "target", "present", "expected"),
    [(1, 1, True, 1.0), (0, 1, True, -1.0), (None, 1, True, -1.0), (None, 1, False, 1.0), (0, 1, False, -1.0)],
)
def test_reward_is_plus_one_for_the_right_end_and_minus_one_otherwise(confirmed, target, present, expected):
    assert problem().reward(confirmed, target, num_touches=0, target_present=present) == expected
    assert problem(touch_cost=0.1).reward(confirmed, target, 3, present) == pytest.approx(expected - 0.3)


@pytest.mark.parametrize("reward", [-1.0, -0.25, 0.0, 0.9])
def test_the_answer_unsure_has_its_own_reward_and_touches_cost_as_always(reward):
    search = problem(unsure_reward=reward, touch_cost=0.1)
    assert search.reward(None, 1, 3, is_unsure=True) == pytest.approx(reward - 0.3)
    assert search.reward(None, 1, 3, target_present=False, is_unsure=True) == pytest.approx(reward - 0.3)
    assert search.reward(1, 1, 3) == problem(touch_cost=0.1).reward(1, 1, 3)


@pytest.mark.parametrize("target", [-1, 4, True, 0.0, None, "e"])
def test_the_reward_for_a_target_that_is_none_is_refused(target):
    for is_unsure in (False, True):
        with pytest.raises(ActiveTouchError, match="target"):
            problem(unsure_reward=0.0).reward(None, target, 1, is_unsure=is_unsure)
    assert problem().reward(1, "b", 0) == problem().reward(1, np.int64(1), 0) == 1.0


def test_a_search_without_the_answer_unsure_has_no_reward_for_it():
    with pytest.raises(ActiveTouchError, match="unsure_reward"):
        problem().reward(None, 1, 3, is_unsure=True)
    with pytest.raises(ActiveTouchError, match="confirms nothing"):
        problem(unsure_reward=0.0).reward(2, 1, 3, is_unsure=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"unsure_reward": 1.0}, "unsure_reward .* 1.0"),
        ({"unsure_reward": -1.01}, "unsure_reward .* -1.01"),
        ({"unsure_reward": float("nan")}, "unsure_reward .* nan"),
        ({"unsure_reward": float("-inf")}, "unsure_reward .* -inf"),
        ({"num_objects": 5}, "5 objects cannot all differ"),
        ({"num_objects": 0}, "at least 1"),
        ({"touch_cost": -0.1}, "≥ 0"),
        ({"touch_cost": float("nan")}, "finite"),
        ({"touch_cost": "0.1"}, "finite and ≥ 0, got 0.1"),
        ({"touch_limit": 0}, "touch_limit"),
        ({"touch_limit": float("nan")}, "touch_limit"),
        ({"num_objects": 1.5}, "num_objects .* 1.5"),
        ({"num_objects": float("nan")}, "num_objects .* nan"),
        ({"num_objects": True}, "num_objects"),
        ({"shape_labels": "abcd"}, "shape_labels .* 'abcd'"),
        ({"pose_labels": "pq"}, "pose_labels .* 'pq'"),
        ({"shape_labels": ("a", "b", "c", "a")}, "shape_labels must differ"),
        ({"pose_labels": ("p", "p")}, "pose_labels must differ"),
        ({"pose_labels": ()}, "pose_labels .* at least one"),
        ({"shape_labels": (1, 2, 3, 4)}, "shape_labels .* names"),
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


@pytest.mark.parametrize(
    ("pose", "logits", "message"),
    [
        (-1, [0.0, 1.0], "-1"),
        (0.5, [0.0, 1.0], "0.5"),
        (None, [0.0, 1.0], "None"),
        ("x", [0.0, 1.0], "'x'"),
        (True, [0.0, 1.0], "True"),
        (0, [np.nan, 1.0], "NaN"),
        (0, [np.inf, 1.0], "inf"),
        (0, 3.0, "row of logits"),
        (0, None, "real numbers"),
        (0, [], "row of logits"),
        (0, [[0.0, 1.0]], "row of logits"),
        (0, ["a", "b"], "real numbers"),
        (0, [1j, 0.0], "real numbers"),
        (0, [True, False], "real numbers"),
        (0, np.ma.masked_equal([3.0, 1.0], 1.0), "masked"),
    ],
)
def test_a_touch_of_what_is_no_touch_is_refused(pose, logits, message):
    with pytest.raises(ActiveTouchError, match=message):
        Touch(pose, logits)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_a_touch_may_rule_shapes_out_and_keeps_its_logits_in_double_precision(dtype):
    touch = Touch(np.int64(2), np.array([-np.inf, 0.5], dtype), np.zeros(2, dtype))
    assert (touch.logits.tolist(), touch.logits.dtype, touch.features.dtype) == ([-np.inf, 0.5], np.float64, dtype)


def test_no_object_follows_the_last():
    world = SyntheticWorld(random_model(np.random.default_rng(0)), arrangement=[2, 0])
    world.advance()
    with pytest.raises(ActiveTouchError, match="last of 2"):
        world.advance()
    assert world.touch(0, np.random.default_rng(0)).pose == 0


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64, Fraction])
def test_a_touch_cost_of_any_type_of_number_loses_no_digits_of_the_return(kind):
    cost = kind(0.0625)
    search = problem(touch_cost=cost)
    assert type(search.touch_cost) is float
    assert search.reward(1, 1, 1001) == 1.0 - 1001 * 0.0625


@pytest.mark.parametrize(("num_objects", "expected"), [(1, 48), (4, 48), (12, 48), (13, 52), (60, 240)])
def test_the_default_touch_limit_grows_with_the_number_of_objects(num_objects, expected):
    assert problem(num_objects=num_objects, composition="independent").touch_limit == expected
    assert problem(num_objects=num_objects, composition="independent", touch_limit=7).touch_limit == 7


def test_a_search_without_a_target_among_sixty_objects_ends_within_the_default_limit():
    model = random_model(np.random.default_rng(0), 4, 2, sharpness=3.0)
    sixty = problem(shape_labels=model.shape_labels, num_objects=60, composition="independent")
    decider = make_decider("information_gain", model.outcome_table())
    episode = search(SyntheticWorld(model, [1, 2, 3] * 20), decider, sixty, 0, model, (0,))
    assert (episode.outcome, episode.num_touches > 48) == (Outcome.EXHAUSTED, True)


def test_a_touch_is_a_plain_value_that_can_be_changed_copied_and_sent():
    touch = Touch(2, np.array([0.5, -1.0]), np.ones(3, np.float32))
    moved = dataclasses.replace(touch, pose=1)
    assert (moved.pose, moved.logits is touch.logits, moved.features is touch.features) == (1, True, True)
    for found in (copy.deepcopy(touch), pickle.loads(pickle.dumps(touch))):
        assert (found.pose, found.logits.tolist(), found.features.tolist()) == (2, [0.5, -1.0], [1.0] * 3)
        assert [array.flags.writeable for array in (found.logits, found.features)] == [False, False]


def test_a_touch_without_logits_says_so_to_whom_it_may_concern():
    touch = Touch(2, features=np.ones(3))
    with pytest.raises(ActiveTouchError, match=r"pose 2 has no logits.*Touch\(pose, logits, features\)"):
        touch.require_logits()
    assert pickle.loads(pickle.dumps(touch)).logits is None
    assert Touch(2, [0.5, 1.0]).require_logits().tolist() == [0.5, 1.0]
