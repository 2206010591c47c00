"""What a repeat is worth, against the models that say so."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief.calibration import TemperatureScaling
from belief.observation_model import PLDAModel, RatioModel
from belief.observation_model.logit_embedding import LogitEmbedding
from belief.observation_model.plda import Components
from belief.observation_model.repeat_discount import effective_touches
from planners.repeats import CorrelatedRepeats, LeastUsedFirst, repeat_discount

uses = st.lists(st.integers(0, 10_000), min_size=1, max_size=12)
T1 = TemperatureScaling(1.0, "ok")


@given(uses, st.floats(0, 1))
def test_a_repeat_is_worth_at_most_a_fresh_touch_and_never_less_than_nothing(counts, rho):
    for discount in (CorrelatedRepeats(rho), LeastUsedFirst()):
        weights = discount.weights(counts)
        assert ((weights >= 0.0) & (weights <= 1.0)).all()
        assert weights.max() > 0.0 or rho == 1.0


@given(st.integers(1, 60), st.floats(0, 1))
def test_the_worths_of_successive_touches_add_up_to_the_effective_number(n, rho):
    total = CorrelatedRepeats(rho).weights(np.arange(n)).sum()
    assert total == pytest.approx(float(effective_touches(n, rho)), rel=1e-9)


def test_without_correlation_repeats_are_fresh_and_with_full_correlation_worthless():
    assert CorrelatedRepeats(0.0).weights([0, 1, 9]).tolist() == [1.0, 1.0, 1.0]
    assert CorrelatedRepeats(1.0).weights([0, 1, 9]).tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("rho", [-0.1, 1.1, float("nan")])
def test_a_correlation_out_of_range_is_refused(rho):
    with pytest.raises(ValueError, match="correlation"):
        CorrelatedRepeats(rho)


def test_every_model_says_what_its_repeats_are_worth(model):
    ratio = RatioModel(model.shape_labels, T1, np.full(4, 0.25), 0.3, np.zeros((2, 1, 4)))
    assert repeat_discount(ratio) == CorrelatedRepeats(0.3)
    assert repeat_discount(model) == repeat_discount(None) == LeastUsedFirst()
    assert repeat_discount(plda(0.0, 0.2, 0.8)).correlation == pytest.approx(0.2)


def plda(of_object, of_pose, of_touch):
    eye = np.eye(3)
    means = np.random.default_rng(0).normal(size=(2, 4, 3))
    embedding = LogitEmbedding(np.full(4, -9.0), np.full(4, 9.0))
    return PLDAModel(tuple("abcd"), embedding, means, Components(of_object * eye, of_pose * eye, of_touch * eye))


def test_the_correlation_of_plda_is_that_of_touches_beyond_their_object():
    # Where objects share nothing, equal covariances V = ρ, W = 1 - ρ are equal correlation.
    for rho in (0.0, 0.3, 0.9):
        assert plda(0.0, rho, 1.0 - rho).repeat_correlation == pytest.approx(rho)
    # What objects share takes worth from every second touch, in the same pose and in another, so repeats lose less.
    assert plda(5.0, 0.0, 1.0).repeat_correlation == pytest.approx(0.0)
    assert 0.1 < plda(5.0, 0.3, 0.7).repeat_correlation < 0.3


@pytest.mark.parametrize("direction", range(3))
def test_only_the_direction_in_which_shapes_differ_counts_and_no_common_offset(direction):
    repeated, model = np.array([0.2, 0.5, 0.9]), plda(0.0, 0.5, 0.5)
    parts = Components(*(np.diag(part) for part in (np.zeros(3), repeated, 1.0 - repeated)))
    means = np.array([40.0, -7.0, 9.0]) + np.linspace(-1.0, 1.0, 8).reshape(2, 4, 1) * np.eye(3)[direction]
    found = PLDAModel(model.shape_labels, model.embedding, means, parts).repeat_correlation
    assert found == pytest.approx(repeated[direction])


def test_shapes_that_feel_alike_have_no_repeats_to_discount():
    model = plda(1.0, 1.0, 1.0)
    alike = PLDAModel(model.shape_labels, model.embedding, np.zeros_like(model.means), model.components)
    assert alike.repeat_correlation == 0.0
