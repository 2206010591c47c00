"""Touches as arrays: what goes in comes out, and what does not fit is named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief import Touch
from belief.observation_model.calibration_data import LabelledTouches, numbered_objects
from belief.touch_batch import TouchBatch


def some_touches(rng, n=4, features=True):
    return [
        Touch(i % 3, rng.normal(size=3), rng.normal(size=5).astype(np.float32) if features else None) for i in range(n)
    ]


def same(touch, other):
    return (
        touch.pose == other.pose
        and touch.logits.tolist() == other.logits.tolist()
        and (touch.features is other.features is None or touch.features.tolist() == other.features.tolist())
    )


@pytest.mark.parametrize("features", [True, False])
def test_touches_come_out_as_they_went_in(features, rng):
    sequences = [some_touches(rng, features=features) for _ in range(3)]
    batch = TouchBatch.of(sequences)
    assert (len(batch), batch.num_touches, batch.num_shapes) == (3, 4, 3)
    for row, sequence in enumerate(sequences):
        assert all(map(same, batch.sequence(row), sequence))


def test_parts_of_a_batch_are_those_touches(rng):
    sequences = [some_touches(rng) for _ in range(3)]
    batch = TouchBatch.of(sequences)
    assert all(map(same, batch.first(2).sequence(1), sequences[1][:2]))
    assert all(map(same, batch.touches(np.array([3, 0])).sequence(2), [sequences[2][3], sequences[2][0]]))
    assert all(map(same, batch.sequences(np.array([2, 0])).sequence(0), sequences[2]))
    assert len(batch.sequences(slice(1, 1))) == 0


def test_features_are_kept_only_where_all_touches_have_them(rng):
    assert TouchBatch.of([[*some_touches(rng, 2), *some_touches(rng, 2, features=False)]]).features is None


@given(st.sampled_from([np.float16, np.float32, np.float64, np.longdouble, np.int8]))
def test_any_type_of_number_will_do(dtype):
    batch = TouchBatch(np.zeros((1, 2), np.uint8), np.array([[[1, 0], [0, 1]]], dtype))
    assert (batch.logits.dtype, batch.poses.dtype) == (np.float64, np.int64)
    assert TouchBatch.of([[Touch(np.uint8(1), np.array([1, 0], dtype))]]).logits.tolist() == [[[1.0, 0.0]]]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (Touch(0, np.zeros(2)), "as many as in the first touch"),
        (Touch(0, np.array([0, -np.inf, 0])), "finite logits"),
        (Touch(0, np.array([0, 0, 0]), np.array([np.nan] * 5)), "finite features"),
        (Touch(0, np.array([0, 0, 0]), np.zeros(4)), "row of features"),
    ],
)
def test_a_bad_touch_is_named(bad, message, rng):
    sequences = [some_touches(rng, features=bad.features is not None) for _ in range(2)]
    sequences[1][2] = bad
    with pytest.raises(ValueError, match=rf"touch 2 of sequence 1 .*{message}"):
        TouchBatch.of(sequences)


@pytest.mark.parametrize(
    "sequences",
    [[], [[]], [[], []], [[Touch(0, np.zeros(2))], []], [[Touch(0, np.zeros(2))] * 2, [Touch(0, np.zeros(2))]]],
)
def test_sequences_without_touches_or_of_unequal_length_are_refused(sequences):
    with pytest.raises(ValueError, match="equal length with at least one touch"):
        TouchBatch.of(sequences)


@pytest.mark.parametrize(
    ("poses", "logits", "message"),
    [
        (np.zeros(2, int), np.zeros((2, 3)), r"need poses \(S, n\)"),
        (np.zeros((1, 2), int), np.zeros((1, 3, 2)), r"need poses \(S, n\)"),
        (np.zeros((1, 2), int), np.zeros((1, 2, 0)), r"need poses \(S, n\)"),
        (np.zeros((1, 2), int), np.zeros((1, 2)), r"need poses \(S, n\)"),
        (np.zeros((1, 2), int), np.zeros((1, 2, 3, 1)), r"need poses \(S, n\)"),
        (np.zeros((1, 2)), np.zeros((1, 2, 2)), "poses must be integers"),
        (np.zeros((1, 2), bool), np.zeros((1, 2, 2)), "poses must be integers"),
        (np.array([[0, -1]]), np.zeros((1, 2, 2)), "touch 1 of sequence 0 has pose -1"),
        (np.array([[2**63, 0]], np.uint64), np.zeros((1, 2, 2)), f"touch 0 of sequence 0 has pose {2**63}"),
        (np.ma.masked_equal([[0, 1]], 1), np.zeros((1, 2, 2)), "poses must not be masked"),
        (np.zeros((1, 2), int), np.array([[["a", "b"]] * 2]), "real numbers"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(poses, logits, message):
    with pytest.raises(ValueError, match=message):
        TouchBatch(poses, logits)


def test_features_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="features must be"):
        TouchBatch(np.zeros((1, 2), int), np.zeros((1, 2, 3)), np.zeros((1, 3, 4)))


def test_objects_are_numbered_in_the_order_of_their_names():
    touches = [Touch(i, np.zeros(3)) for i in (0, 4, 1)]
    data = LabelledTouches.of(touches, [2, 0, 2], ["x", "a", "x"])
    assert (data.objects.tolist(), data.shape_of_object.tolist()) == ([1, 0, 1], [0, 2])
    assert (data.num_poses, data.num_shapes, data.num_objects, data.counts.tolist()) == (5, 3, 2, [1, 0, 2])
    assert data.shape_labels == ("shape_0", "shape_1", "shape_2")


@pytest.mark.parametrize(
    "ids", [[3, 3, 1], [3.0, 3.0, 1.0], ["b", "b", "a"], [True, True, False], [(2**63), (2**63), 0], [b"b", b"b", b"a"]]
)
def test_ids_may_be_of_any_kind_that_sorts(ids):
    objects, shapes = numbered_objects([1, 1, 0], ids)
    assert (objects.tolist(), shapes.tolist()) == ([1, 1, 0], [0, 1])


@pytest.mark.parametrize(
    ("shapes", "ids", "message"),
    [
        ([0, 1], [5, 5], r"object 5 has shape 0, and shape 1 in row 1 \(from 0\)"),
        ([0, 1], [5], "a shape and an object id for every touch"),
        ([[0, 1]], [[5, 6]], "a shape and an object id for every touch"),
        ([0.0, 1.0], [5, 6], "shapes must be integers, got float64"),
        (["cube", "cone"], [5, 6], "shapes must be integers"),
        ([0, 1], [5.0, np.nan], "row 1 has no object"),
        ([0, 1], np.array([5, None]), "can be sorted"),
    ],
)
def test_what_is_no_number_or_no_object_is_refused(shapes, ids, message):
    with pytest.raises(ValueError, match=message):
        numbered_objects(shapes, ids)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([0, 3], r"in \[0, 3\)"),
        ([-1, 0], r"in \[0, 3\)"),
        ([0.0, 1.0], "float64"),
        ([0], "one shape and object for each"),
        ([[0], [1]], "for each"),
    ],
)
def test_shapes_out_of_range_are_refused(shapes, message):
    with pytest.raises(ValueError, match=message):
        LabelledTouches.of([Touch(0, np.zeros(3))] * 2, shapes, None)


def test_lists_become_arrays_of_their_numbers():
    batch = TouchBatch([[0, 1]], [[[1, 2], [3, 4]]], [[[5], [6]]])
    assert (batch.poses.dtype, batch.logits.dtype, batch.features.dtype) == (np.int64, np.float64, np.float64)
    assert TouchBatch([[0]], [[[1, 2]]], np.zeros((1, 1, 3), np.float32)).features.dtype == np.float32


def test_touches_without_logits_make_a_batch_without(rng):
    sequences = [[Touch(i % 3, features=rng.normal(size=5)) for i in range(4)] for _ in range(3)]
    batch = TouchBatch.of(sequences)
    assert batch.logits is None
    for found, touch in zip(batch.sequences(np.array([2, 0])).first(2).sequence(0), sequences[2], strict=False):
        assert (found.pose, found.logits, found.features.tolist()) == (touch.pose, None, touch.features.tolist())
    for ask in (batch.require_logits, lambda: batch.num_shapes):
        with pytest.raises(ValueError, match="these touches have no logits"):
            ask()


def test_touches_of_which_some_have_logits_only_and_some_features_only_are_no_batch(rng):
    with pytest.raises(ValueError, match="all touches need logits"):
        TouchBatch.of([[Touch(0, np.zeros(3)), Touch(1, features=np.zeros(5))]])


def test_taken_and_reshaped_touches_are_those_touches(rng):
    sequences = [some_touches(rng) for _ in range(3)]
    batch = TouchBatch.of(sequences)
    taken = batch.take((np.array([[2], [0]]), np.array([[3, 1], [0, 0]])))
    expected = [[sequences[2][3], sequences[2][1]], [sequences[0][0]] * 2]
    assert all(map(same, taken.sequence(0) + taken.sequence(1), expected[0] + expected[1]))
    assert all(map(same, batch.reshaped((1, -1)).sequence(0), [touch for sequence in sequences for touch in sequence]))
    assert batch.reshaped((6, 2)).features.shape == (6, 2, 5)
