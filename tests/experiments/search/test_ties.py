"""The verdict of a report calls a tie a tie."""

import numpy as np
import pytest

from belief import SearchProblem
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from experiments.search.page import pictures
from experiments.search.play import Seconds
from experiments.search.summary import Summary
from experiments.search.verdict import tied, verdict_sentences
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
    return Summary.from_episodes(problem, episodes, seconds, names[0], np.random.default_rng(0))


@pytest.fixture(scope="module")
def with_a_tie():
    return compared("random_confirm", "information_gain", SAME)


def test_equals_are_tied_and_the_verdict_says_so(with_a_tie):
    assert set(tied(with_a_tie)) == {"information_gain", SAME}
    answer, *details = verdict_sentences(with_a_tie)
    assert "as far as 40 searches tell, they are equally good" in answer
    assert f"; {SAME} in" in answer or answer.startswith(SAME)
    [told] = [sentence for sentence in details if "This is a tie of 2" in sentence]
    assert "the highest return is that of" in told


def test_a_clear_winner_is_best():
    found = compared("random_confirm", "information_gain")
    assert tied(found) == ["information_gain"]
    assert verdict_sentences(found)[0].startswith("information_gain is best: it found the target in ")
    assert "equally" not in verdict_sentences(found)[0]
    assert not any("tie" in sentence for sentence in verdict_sentences(found))


def test_failures_are_drawn_on_a_logarithmic_axis_whatever_their_number(with_a_tie):
    drawn = {picture.name: picture for picture in pictures(with_a_tie)}
    for name in ("answer", "success", "frontier"):
        [panel] = drawn[name].inline()
        assert "nan" not in panel.lower()
        assert panel.count("<use") >= 3 or name == "answer"  # a marker for each decider
