import numpy as np
import pytest

from belief.observation_model import ConfusionModel
from belief.selection import cross_validated_nll, fused_log_probs
from belief.synthetic import random_model


def collect(rng, num_objects=40, touches_each=6):
    """Touches of objects, their shapes and ids."""
    source = random_model(rng)
    shapes = np.repeat(np.arange(num_objects) % 4, touches_each)
    ids = np.repeat(np.arange(num_objects), touches_each)
    touches = [source.sample(int(k), [i % 3], rng)[0] for i, k in enumerate(shapes)]
    return source, touches, shapes, ids


def test_fused_posteriors_use_all_touches_of_an_object_whatever_their_order(rng):
    source, touches, _, ids = collect(rng)
    order = rng.permutation(len(touches))
    unique, log_probs = fused_log_probs(source, [touches[i] for i in order], ids[order])
    assert unique.tolist() == list(range(40))
    np.testing.assert_allclose(log_probs, fused_log_probs(source, touches, ids)[1], atol=1e-9)


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
