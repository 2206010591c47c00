"""Tables of outcomes: what is refused, what they tell, and how they are merged."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief.observation_model import OutcomeTable

sizes = st.tuples(st.integers(1, 3), st.integers(1, 4), st.integers(1, 5))


@st.composite
def tables(draw):
    """Tables with plenty of zeros, ties and repeated columns."""
    num_poses, num_shapes, num_outcomes = draw(sizes)
    entries = st.sampled_from([0.0, 0.0, 1.0, 1.0, 2.0, 5.0, 1e-9, 1e-300])
    weights = np.array(draw(st.lists(entries, min_size=60, max_size=60)))[: num_poses * num_shapes * num_outcomes]
    weights = weights.reshape(num_poses, num_shapes, num_outcomes)
    weights[weights.max(axis=2) < 1e-3, 0] = 1.0
    return OutcomeTable(weights / weights.sum(axis=2, keepdims=True))


@pytest.mark.parametrize(
    ("probs", "message"),
    [
        ([[[0.5, 0.6]]], r"probs\[pose 0, shape 0\] is no distribution"),
        ([[[-0.5, 1.5]]], "no distribution"),
        ([[[np.nan, 1.0]]], "no distribution"),
        ([[[np.inf, -np.inf]]], "no distribution"),
        ([[[1e308, 1e308]]], "no distribution"),
        ([[0.5, 0.5]], r"must be \(P, K, M\)"),
        (np.empty((1, 2, 0)), "no axis empty"),
        ([[["0.5", "0.5"]]], "real numbers"),
        ([[[True, False]]], "real numbers"),
        (np.ma.masked_equal([[[1.0, 0.0]]], 0.0), "masked"),
    ],
)
def test_what_is_no_table_is_refused(probs, message):
    with pytest.raises(ValueError, match=message):
        OutcomeTable(probs)


def test_a_row_of_small_floats_is_normalised_and_an_exact_one_kept_to_the_bit():
    third = OutcomeTable(np.full((1, 1, 3), 1 / 3, np.float16))
    np.testing.assert_allclose(third.probs, 1 / 3, rtol=1e-15)
    assert OutcomeTable(third.probs).probs.tolist() == third.probs.tolist()


def test_a_table_cannot_be_changed(model):
    given_ = np.full((1, 2, 2), 0.5)
    table = OutcomeTable(given_)
    with pytest.raises(ValueError, match="read-only"):
        table.probs[0, 0, 0] = 1.0
    given_[:] = 7.0
    assert table.probs.max() == 0.5


@given(tables(), st.integers(0, 2**32 - 1))
def test_information_is_that_of_the_joint_distribution(table, seed):
    given_ = np.random.default_rng(seed).dirichlet(np.ones(table.num_shapes))
    for prior, asked in ((given_, given_), (np.full(table.num_shapes, 1.0 / table.num_shapes), None)):
        joint = table.probs * prior[:, None]
        independent = joint.sum(axis=1, keepdims=True) * joint.sum(axis=2, keepdims=True)
        ratio = np.divide(joint, independent, out=np.ones_like(joint), where=joint > 0.0)
        np.testing.assert_allclose(table.information(asked), (joint * np.log(ratio)).sum(axis=(1, 2)), atol=1e-12)
