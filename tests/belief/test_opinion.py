"""Opinions about objects: what they say, how far they are believed, and that a wrong one does not break the promise."""

from dataclasses import replace

import numpy as np
import pytest

from belief import SceneBelief, SearchProblem
from belief.errors import UnknownName
from belief.opinion import BadOpinion, as_opinion, opinion_of, read_opinion, tempered
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import make_decider, search
from planners.session import Session
from planners.session_log import problem_fields, problem_from

LABELS = ("mug", "bowl", "cup")


def test_odds_that_are_wrong_by_a_factor_change_what_is_stated_by_a_smaller_one():
    for wrong_by in (20.0, 100.0):
        one, other = tempered([[0.5, 0.5], [1 / (1 + wrong_by), wrong_by / (1 + wrong_by)]], wrong_by)
        odds = (other[1] / other[0]) / (one[1] / one[0])
        assert 0.8 * (99 / 19) < odds <= 99 / 19
    np.testing.assert_allclose(tempered([0.3, 0.7], 1.0), [0.3, 0.7], atol=0.01)
    assert tempered(np.eye(3)).min() > 0.0


@pytest.mark.parametrize("composition", ["distinct", "independent", "at_most_one"])
def test_an_opinion_counts_as_a_touch_of_each_object_with_these_likelihoods(composition):
    model = random_model(np.random.default_rng(0), num_shapes=3)
    opinion = np.array([[0.7, 0.2, 0.1], [0.2, 0.2, 0.6]])
    problem = SearchProblem(model.shape_labels, ("a", "b", "c"), 2, composition, opinion=opinion).seeking(0)
    found = SceneBelief(problem, model).marginals()
    weights = tempered(opinion)
    plain = SceneBelief(SearchProblem(model.shape_labels, ("a", "b", "c"), 2, composition).seeking(0), model)
    expected = plain._marginals_of(np.log(weights))
    np.testing.assert_allclose(found, np.exp(expected))
    if composition == "distinct":
        joint = np.array([[weights[0, i] * weights[1, j] * (i != j) for j in range(3)] for i in range(3)])
        np.testing.assert_allclose(found[0], joint.sum(axis=1) / joint.sum())


def test_a_search_keeps_its_opinion_in_words_and_logs(tmp_path):
    model = random_model(np.random.default_rng(0), num_shapes=3)
    problem = SearchProblem(model.shape_labels, ("a", "b", "c"), 2, opinion=[0.5, 0.25, 0.25])
    assert problem.opinion == ((0.5, 0.25, 0.25),) * 2
    assert "opinion" in repr(problem)
    assert "opinion" not in repr(SearchProblem(model.shape_labels, ("a", "b", "c"), 2))
    assert problem_from(problem_fields(problem)) == problem
    decider = make_decider("fixed_poses", model.outcome_table())
    session = Session(problem, decider, 0, model, seed=3)
    session.save(tmp_path / "log.jsonl")
    session.tell(model.sample(0, [0], np.random.default_rng(0))[0])
    session.close()
    again = Session.load(tmp_path / "log.jsonl", model=model, decider=decider)
    np.testing.assert_array_equal(again.belief.probs, session.belief.probs)


def test_a_right_opinion_saves_touches_and_a_wrong_one_keeps_what_is_stated_right():
    model = random_model(np.random.default_rng(0), num_shapes=4, sharpness=3.0)
    problem = SearchProblem(model.shape_labels, ("a", "b", "c"), 4)
    decider, touches, right = make_decider("information_gain", model.outcome_table()), {}, []
    for kind in ("none", "right", "wrong"):
        rng, numbers = np.random.default_rng(1), []
        for number in range(150):
            shapes = np.array(sample_arrangement(problem, np.random.default_rng([number, 2])))
            is_right = rng.random(4) < (0.95 if kind == "right" else 19 / 39)
            named = np.where(is_right, shapes, (shapes + rng.integers(1, 4, 4)) % 4)
            opinion = np.where(np.eye(4)[named] > 0, 0.95, 0.05 / 3)
            told = problem if kind == "none" else replace(problem, opinion=opinion)
            found = search(SyntheticWorld(model, shapes.tolist()), decider, told, number % 4, model, number)
            numbers.append(found.num_touches)
            if kind == "wrong" and found.steps[-1].belief.probs[found.target] >= 0.95:
                right.append(found.success)
        touches[kind] = np.mean(numbers)
    assert touches["right"] < 0.75 * touches["none"]
    assert len(right) > 100
    assert np.mean(right) >= 0.94


def test_words_and_files_say_probabilities(tmp_path):
    np.testing.assert_allclose(read_opinion("mug=.7, bowl=.3", LABELS, 2), [[0.7, 0.3, 0.0]] * 2)
    file = tmp_path / "camera.csv"
    file.write_text("object,shape,prob\n1,mug,0.8\n3,cup,0.4\n3,bowl,0.4\n")
    expected = [[0.8, 0.1, 0.1], [1 / 3] * 3, [0.2, 0.4, 0.4]]
    np.testing.assert_allclose(read_opinion(str(file), LABELS, 3), expected)
    file.write_text("shape,prob\nbowl,1\n")
    np.testing.assert_allclose(read_opinion(str(file), LABELS, 1), [[0.0, 1.0, 0.0]])
    file.write_text("object,shape,prob\n1,mug,1\n,bowl,1\n")
    np.testing.assert_allclose(read_opinion(str(file), LABELS, 2), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("mug", BadOpinion),
        ("mug=a", BadOpinion),
        ("mug=.7,bowl=.7", BadOpinion),
        ("mug=.2,bowl=.2,cup=.2", BadOpinion),
        ("mug=1.5", ValueError),
        ("mug=.7,mug=.2", BadOpinion),
        ("mug=1_0e-2", BadOpinion),
        ("hat=.5", UnknownName),
        (",".join(f"hat {number}=.001" for number in range(300)), UnknownName),
    ],
)
def test_what_is_no_opinion_is_refused(text, error, tmp_path):
    with pytest.raises(error):
        read_opinion(text, LABELS, 2)


def test_files_and_arrays_that_do_not_fit_are_refused(tmp_path):
    file = tmp_path / "camera.csv"
    for content, message in (
        ("mug,0.8\n1,2\n", "columns"),
        ("object,shape,prob\n4,mug,1\n", "objects are 1 to 2"),
        ("object,shape,prob\n1,mug,1\n01,bowl,1\n", "names the object '01'"),
        (f"object,shape,prob\n{'1' * 5000},mug,1\n", "objects are 1 to 2"),
        ("shape,prob\nmug,.5\nmug,.2\n", "'mug' is named twice"),
    ):
        file.write_text(content)
        with pytest.raises(BadOpinion, match=message):
            read_opinion(str(file), LABELS, 2)
    with pytest.raises(ValueError, match=r"must be \(2, 3\)"):
        as_opinion(np.full((3, 3), 1 / 3), 2, 3)
    with pytest.raises(ValueError, match="wrong_by"):
        tempered([0.5, 0.5], 0.5)
    assert opinion_of({}, LABELS).tolist() == [1 / 3] * 3
