"""The cards of a report put the best first and call a tie a tie; touches are described in words."""

import numpy as np
import pytest

from belief import SearchProblem
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from experiments.search.figures import pictures
from experiments.search.page import image_in_words
from experiments.search.play import Seconds
from experiments.search.summary import Summary
from experiments.search.verdict import cards, tied, verdict_sentences
from planners import make_decider, search_lockstep

SAME = "information_gain(confirm=0.99)"  # its default by another name


def compared(*names, number=40):
    model = random_model(np.random.default_rng(0), num_shapes=4, num_poses=6, sharpness=4.5)
    problem = SearchProblem(model.shape_labels, tuple(f"p{i}" for i in range(6)), num_objects=4)
    seeds = [(0, n) for n in range(number)]
    label, episodes = model.shape_labels[0], {}
    for name in names:
        arrangements = [sample_arrangement(problem, np.random.default_rng([*seed, 2])) for seed in seeds]
        worlds = [SyntheticWorld(model, arrangement) for arrangement in arrangements]
        decider = make_decider(name, model.outcome_table())
        episodes[name, label] = search_lockstep(worlds, decider, problem, [0] * number, model, seeds)
    seconds = dict.fromkeys(episodes, Seconds())
    return Summary.from_episodes(problem, episodes, seconds, {label: [True] * 4}, names[0], np.random.default_rng(0))


@pytest.fixture(scope="module")
def with_a_tie():
    return compared("random_confirm", "information_gain", SAME)


def test_equals_are_tied_and_the_verdict_says_so(with_a_tie):
    found = cards(with_a_tie)
    assert {card.name for card in found[:2]} == {"information_gain", SAME}
    assert [card.rank for card in found] == ["tied for best", "tied for best", ""]
    assert set(tied(with_a_tie)) == {card.name for card in found[:2]}
    told = verdict_sentences(with_a_tie)[0]
    assert "This is a tie of 2" in told
    assert "the highest return is that of" in told


def test_a_clear_winner_is_best():
    found = compared("random_confirm", "information_gain")
    assert [(card.name, card.rank) for card in cards(found)] == [("information_gain", "best"), ("random_confirm", "")]
    assert "information_gain is best" in verdict_sentences(found)[0]
    assert "tie" not in verdict_sentences(found)[0]


def test_failures_are_drawn_on_a_logarithmic_axis_whatever_their_number(with_a_tie):
    drawn = {picture.name: picture for picture in pictures(with_a_tie)}
    for name in ("success", "frontier"):
        [panel] = drawn[name].inline()
        assert "nan" not in panel.lower()
        assert panel.count("<use") >= 3  # a marker for each decider


@pytest.mark.parametrize(
    ("rows", "columns", "words"), [(0, 0, "bottom left"), (9, 9, "top right"), (5, 5, "centre"), (5, 0, "middle left")]
)
def test_the_place_of_a_touch_is_named(rows, columns, words):
    image = np.zeros((10, 10), np.uint8)
    image[rows, columns] = 200
    assert image_in_words(image) == f"1 % of the image pressed, strongest at the {words}"
    assert image_in_words(np.repeat(image[..., None], 3, axis=2)) == image_in_words(image)
