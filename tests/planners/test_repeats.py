"""What a repeat is worth, against the models that say so."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief.calibration import TemperatureScaling
from belief.observation_model import RatioModel
from belief.observation_model.repeat_discount import effective_touches
from planners.probing import RepeatDiscount, repeat_discount

uses = st.lists(st.integers(0, 10_000), min_size=1, max_size=12)
T1 = TemperatureScaling(1.0, "ok")


@given(uses, st.floats(0, 1))
def test_a_repeat_is_worth_at_most_a_fresh_touch_and_never_less_than_nothing(counts, rho):
    for discount in (RepeatDiscount(rho), RepeatDiscount()):
        weights = discount.weights(counts)
        assert ((weights >= 0.0) & (weights <= 1.0)).all()
        assert weights.max() > 0.0 or rho == 1.0


@given(st.integers(1, 60), st.floats(0, 1))
def test_the_worths_of_successive_touches_add_up_to_the_effective_number(n, rho):
    total = RepeatDiscount(rho).weights(np.arange(n)).sum()
    assert total == pytest.approx(float(effective_touches(n, rho)), rel=1e-9)


def test_without_correlation_repeats_are_fresh_and_with_full_correlation_worthless():
    assert RepeatDiscount(0.0).weights([0, 1, 9]).tolist() == [1.0, 1.0, 1.0]
    assert RepeatDiscount(1.0).weights([0, 1, 9]).tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("rho", [-0.1, 1.1, float("nan")])
def test_a_correlation_out_of_range_is_refused(rho):
    with pytest.raises(ValueError, match="correlation"):
        RepeatDiscount(rho)


def test_every_model_says_what_its_repeats_are_worth(model):
    ratio = RatioModel(model.shape_labels, T1, np.full(4, 0.25), 0.3, np.zeros((2, 1, 4)))
    assert repeat_discount(ratio) == RepeatDiscount(0.3)
    assert repeat_discount(model) == repeat_discount(None) == RepeatDiscount()
