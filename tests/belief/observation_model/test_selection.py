import numpy as np
import pytest

from belief.errors import OverconfidentStops
from belief.observation_model import ConfusionModel
from belief.observation_model.registry import fits
from belief.observation_model.selection import (
    choose_observation_model,
    fit_observation_model,
    log_posteriors,
)
from belief.synthetic import random_model
from belief.touch_batch import TouchBatch, grouped


def loss_of(fit, touches, shapes, ids, num_folds=5):
    choice = choose_observation_model(
        touches, shapes, ids, shape_labels="abcd", num_poses=3, candidates={"it": fit}, num_folds=num_folds
    )
    return choice.losses["it"]


def collect(rng, num_objects=40, touches_each=6):
    """Touches of objects, their shapes and ids."""
    source = random_model(rng)
    shapes = np.repeat(np.arange(num_objects) % 4, touches_each)
    ids = np.repeat(np.arange(num_objects), touches_each)
    touches = [source.sample(int(k), [i % 3], rng)[0] for i, k in enumerate(shapes)]
    return source, touches, shapes, ids


def test_touches_are_grouped_in_the_order_they_came(rng):
    _, touches, _, ids = collect(rng)
    order = rng.permutation(len(touches))
    batch = TouchBatch.of([[touches[i] for i in order]])
    (some, rows), *rest = grouped(batch, ids[order])
    assert not rest  # all objects have as many touches
    for group in rows:
        assert len(set(ids[order][group].tolist())) == 1
        assert (np.diff(group) > 0).all()
    np.testing.assert_array_equal(some.logits, batch.logits[0, rows])


def test_posteriors_after_sequences_are_bayes_rule_from_a_uniform_prior(rng):
    source, touches, _, _ = collect(rng, num_objects=2)
    batch = TouchBatch.of([touches[:3], touches[3:6]])
    likelihoods = np.exp([source.log_likelihood(touches[:3]), source.log_likelihood(touches[3:6])])
    expected = likelihoods / likelihoods.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(np.exp(log_posteriors(source, batch)), expected)


def test_the_loss_is_the_mean_over_touches_seen_of_objects_and_of_their_poses(rng):
    source, touches, shapes, ids = collect(rng, num_objects=8)  # three poses, each touched twice
    losses = {"object": [], "pose": []}
    for i in range(8):
        own = [touch for touch, owner in zip(touches, ids, strict=True) if owner == i]
        groups = {"object": [own], "pose": [[touch for touch in own if touch.pose == pose] for pose in range(3)]}
        for kind, sequences in groups.items():
            for some in sequences:
                for seen in range(1, len(some) + 1):
                    losses[kind].append(-log_posteriors(source, TouchBatch.of([some[:seen]]))[0, i % 4])
    expected = np.mean([np.mean(some) for some in losses.values()])
    assert loss_of(lambda *_, **__: source, touches, shapes, ids, 2) == pytest.approx(expected)


def test_the_choice_is_the_candidate_of_least_loss_fitted_to_all(rng):
    _, touches, shapes, ids = collect(rng, num_objects=60)
    labels = ("a", "b", "c", "d")
    choice = choose_observation_model(touches, shapes, ids, shape_labels=labels, num_poses=3)
    assert choice.losses.keys() == fits().keys()
    assert choice.name == min(choice.losses, key=choice.losses.get)
    assert choice.model.shape_labels == labels
    assert np.isfinite(list(choice.losses.values())).all()


def test_an_object_is_never_on_both_sides_of_a_fold(rng):
    _, touches, shapes, ids = collect(rng)
    owner = {id(touch): i for touch, i in zip(touches, ids, strict=True)}
    seen = []

    def fit(some, truth, object_ids, **_):
        assert [owner[id(touch)] for touch in some] == object_ids.tolist()
        seen.append(set(object_ids.tolist()))
        return ConfusionModel.fit(some, truth, num_poses=3)

    loss_of(fit, touches, shapes, ids, num_folds=4)
    assert seen.pop() == set(range(40))  # the fit to all
    assert all({i % 4 for i in fold} == {0, 1, 2, 3} for fold in seen)  # every shape, in every fold
    assert [len(fold) for fold in seen] == [30] * 4
    assert set.intersection(*seen) == set()


def test_the_model_that_made_the_data_beats_a_blunt_one(rng):
    source, touches, shapes, ids = collect(rng, num_objects=200)
    blunt = random_model(rng, sharpness=0.0)
    with pytest.warns(OverconfidentStops, match="Held-out stops at 0.95: .* of 200, stated 0.9.*certified_stops"):
        losses = [loss_of(lambda *_, m=m, **__: m, touches, shapes, ids) for m in (source, blunt)]
    assert losses[0] < losses[1]


def test_more_folds_than_objects_are_refused(rng):
    source, touches, shapes, ids = collect(rng, num_objects=3)
    with pytest.raises(
        ValueError, match="4 folds of whole objects need as many objects, got 3: record more, or give num_folds=3"
    ):
        loss_of(lambda *_, **__: source, touches, shapes, ids, num_folds=4)


def test_groups_of_every_length_are_found_once(rng):
    batch = TouchBatch(np.zeros((1, 60), int), rng.normal(size=(1, 60, 3)), rng.normal(size=(1, 60, 2)))
    names = rng.choice(["mug", "ball", "cup", "can"], size=60, p=[0.5, 0.3, 0.15, 0.05])
    found = []
    for some, rows in grouped(batch, names):
        np.testing.assert_array_equal(some.logits, batch.logits[0, rows])
        np.testing.assert_array_equal(some.features, batch.features[0, rows])
        assert all(len(set(names[row])) == 1 for row in rows)
        found += rows.ravel().tolist()
    assert sorted(found) == list(range(60))


def test_where_touches_repeat_a_model_that_knows_is_chosen(world, rng):
    shapes, ids = (np.arange(120) % 3).repeat(8), np.arange(120).repeat(8)
    touches = [touch for i in range(120) for touch in world.sample(i % 3, [0, 1] * 4, rng)]
    choice = choose_observation_model(
        touches, shapes, [f"object {i}" for i in ids], shape_labels=world.shape_labels, num_poses=2
    )
    assert choice.name == "plda"
    assert choice.losses["plda"] < choice.losses["gaussian"] < np.log(3.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"candidates": {}}, "no candidate"),
        ({"num_folds": 1}, "num_folds must be .* at least 2"),
        ({"num_folds": 99}, "99 folds of whole objects need as many objects, got 4: record more, or give num_folds=4"),
        ({"shape_labels": ("a", "b")}, "names 2"),
        ({"num_poses": 2}, "num_poses is 2"),
    ],
)
def test_choices_that_cannot_be_made_are_refused(changes, message, rng):
    _, touches, shapes, ids = collect(rng, num_objects=4)
    options = {"shape_labels": tuple("abcd"), "num_poses": 3, "num_folds": 3, **changes}
    with pytest.raises(ValueError, match=message):
        choose_observation_model(touches, shapes, ids, **options)


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (lambda shapes, ids: shapes != 2, "no touch is of the shape c: .* add touches of such"),
        (lambda shapes, ids: np.diff(ids, prepend=-1) > 0, "each of 40 objects has one touch: .* several times"),
    ],
)
def test_what_touches_cannot_tell_is_warned_of(kept, message, rng):
    _, touches, shapes, ids = collect(rng)
    rows = np.flatnonzero(kept(shapes, ids))
    given = [touches[i].logits for i in rows], shapes[rows], ids[rows]
    some = {"confusion": fits()["confusion"]}
    with pytest.warns(UserWarning, match=message):
        fit_observation_model(*given, shape_labels="abcd", candidates=some)
