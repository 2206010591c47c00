import numpy as np
import pytest

from belief.observation_model import ConfusionModel
from belief.selection import cross_validated_nll, group_by_object, log_posteriors
from belief.synthetic import random_model


def collect(rng, num_objects=40, touches_each=6):
    """Touches of objects, their shapes and ids."""
    source = random_model(rng)
    shapes = np.repeat(np.arange(num_objects) % 4, touches_each)
    ids = np.repeat(np.arange(num_objects), touches_each)
    touches = [source.sample(int(k), [i % 3], rng)[0] for i, k in enumerate(shapes)]
    return source, touches, shapes, ids


def test_touches_are_grouped_by_object_in_the_order_they_came(rng):
    _, touches, _, ids = collect(rng)
    order = rng.permutation(len(touches))
    groups = group_by_object([touches[i] for i in order], ids[order])
    assert list(groups) == list(range(40))
    for i, some in groups.items():
        assert [id(touch) for touch in some] == [id(touches[j]) for j in order if ids[j] == i]


def test_posteriors_after_sequences_are_bayes_rule_from_a_uniform_prior(rng):
    source, touches, _, _ = collect(rng, num_objects=2)
    likelihoods = np.exp([source.log_likelihood(touches[:n]) for n in (1, 3)])
    expected = likelihoods / likelihoods.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(np.exp(log_posteriors(source, [touches[:1], touches[:3]])), expected)


def test_the_loss_is_the_mean_over_objects_and_over_touches_seen(rng):
    source, touches, shapes, ids = collect(rng, num_objects=8)
    losses = []
    for i in range(8):
        for seen in range(1, 7):
            some = [touch for touch, owner in zip(touches, ids, strict=True) if owner == i][:seen]
            losses.append(-log_posteriors(source, [some])[0, i % 4])
    assert cross_validated_nll(lambda *_: source, touches, shapes, ids, 2) == pytest.approx(np.mean(losses))


def test_an_object_is_never_on_both_sides_of_a_fold(rng):
    _, touches, shapes, ids = collect(rng)
    owner = {id(touch): i for touch, i in zip(touches, ids, strict=True)}
    seen = []

    def fit(some, truth, object_ids):
        assert [owner[id(touch)] for touch in some] == object_ids.tolist()
        seen.append(set(object_ids.tolist()))
        return ConfusionModel.fit(some, truth, num_poses=3)

    cross_validated_nll(fit, touches, shapes, ids, num_folds=4)
    assert all({i % 4 for i in fold} == {0, 1, 2, 3} for fold in seen)  # every shape, in every fold
    assert [len(fold) for fold in seen] == [30] * 4
    assert set.intersection(*seen) == set()


def test_the_model_that_made_the_data_beats_a_blunt_one(rng):
    source, touches, shapes, ids = collect(rng, num_objects=200)
    blunt = random_model(rng, sharpness=0.0)
    losses = [cross_validated_nll(lambda *_, m=m: m, touches, shapes, ids) for m in (source, blunt)]
    assert losses[0] < losses[1]


def test_more_folds_than_objects_are_refused(rng):
    source, touches, shapes, ids = collect(rng, num_objects=3)
    with pytest.raises(ValueError, match="between 2 and 3 folds"):
        cross_validated_nll(lambda *_: source, touches, shapes, ids, num_folds=4)
