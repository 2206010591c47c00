"""The joint belief about a table against listing every way it can have been laid."""

import copy
import dataclasses
import itertools
import pickle
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import (
    AtMostOne,
    Belief,
    BeliefTracker,
    Counts,
    ImpossibleObservation,
    SceneBelief,
    SearchProblem,
    Touch,
    ZeroPriorTarget,
)
from belief.arrangement import log_at_most_one_marginals
from belief.errors import InvalidArgument, UnknownName
from belief.search_progress import SearchProgress

LABELS = ("a", "b", "c")
COMPOSITIONS = {
    "distinct": "distinct",
    "independent": "independent",
    "a bag": Counts({"a": 2, "b": 1, "c": 2}),
    "a bag without c": Counts({"a": 3, "b": 2}),
    "one of each and more": Counts({"a": 1, "b": 1, "c": 1}),
    "at most one b": AtMostOne("b"),
}
compositions = pytest.mark.parametrize("composition", list(COMPOSITIONS.values()), ids=list(COMPOSITIONS))


class Told:
    """An observation model that is told log-likelihoods: a touch's logits; touches are independent."""

    shape_labels = LABELS

    def log_likelihood(self, touches):
        with np.errstate(over="ignore", invalid="ignore"):
            return np.sum([touch.logits for touch in touches], axis=0) if touches else np.zeros(3)


def scene_of(composition, num_objects=3, **options):
    return SceneBelief(SearchProblem(LABELS, ("p",), num_objects, composition), Told(), **options)


def felt(scores):
    return [Touch(0, np.array(scores, np.float64))]


@dataclasses.dataclass(frozen=True)
class Weighed:
    """Evidence whose touches bring the log-likelihood of each shape as logits, and of a stranger as their feature."""

    log_likelihood: np.ndarray
    log_unlisted: float = 0.0
    num_touches: int = 0
    log_bets: None = None

    def update(self, touch):
        added = self.log_unlisted + float(touch.features[0])
        return Weighed(self.log_likelihood + touch.logits, added, self.num_touches + 1)


class ToldOfStrangers(Told):
    """An observation model whose evidence weighs strangers."""

    def start(self):
        return Weighed(np.zeros(3))


def every_table(composition, num_objects):
    """All tables, as shapes ``(tables, N)``, and the probability of each before any touch."""
    if isinstance(composition, AtMostOne):
        tables = np.array(list(itertools.product(range(3), repeat=num_objects)))
        number = (tables == 1).sum(axis=1)
        return tables, np.where(number < 2, 0.5 ** (num_objects - number) / (num_objects + 1), 0.0)
    if composition == "independent":
        tables = np.array(list(itertools.product(range(3), repeat=num_objects)))
    else:
        counts = (1, 1, 1) if composition == "distinct" else composition.of(LABELS)
        things = np.repeat(np.arange(3), counts)
        tables = things[np.array(list(itertools.permutations(range(len(things)), num_objects)))]
    return tables, np.full(len(tables), 1.0 / len(tables))


def joint(composition, weights):
    """Marginals ``(N, K)``, and tables with their posterior, given likelihoods."""
    tables, probs = every_table(composition, len(weights))
    posterior = probs * np.prod([weights[i, tables[:, i]] for i in range(len(weights))], axis=0)
    if posterior.sum() == 0.0:
        return None, tables, posterior
    posterior /= posterior.sum()
    marginals = [[posterior[tables[:, i] == shape].sum() for shape in range(3)] for i in range(len(weights))]
    return np.array(marginals), tables, posterior


scores = st.one_of(st.floats(-10, 10), st.just(0.0), st.just(-np.inf))


@compositions
@given(weights=arrays(np.float64, (3, 3), elements=scores))
def test_beliefs_presence_and_contradictions_equal_enumeration_of_all_tables(composition, weights):
    marginals, tables, posterior = joint(composition, np.exp(weights))
    scene = scene_of(composition)

    def live():
        for i, row in enumerate(weights):
            scene.update(i, felt(row))

    if marginals is None:
        with pytest.raises(ImpossibleObservation):
            live()
        return
    live()
    np.testing.assert_allclose(scene.marginals(), marginals, atol=1e-12)
    for target in range(3):
        present = posterior[(tables == target).any(axis=1)].sum()
        assert scene.prob_present(target) == pytest.approx(present, abs=1e-12)


@pytest.mark.filterwarnings("ignore:logits has no negative number")
@compositions
@given(
    weights=arrays(np.float64, (3, 4), elements=scores), unlisted=st.sampled_from([1e-300, 1e-3, 0.05, 0.5, 1 - 1e-9])
)
def test_with_unlisted_shapes_beliefs_equal_enumeration_of_all_tables_and_all_strangers(composition, weights, unlisted):
    listed, found = every_table(composition, 3)
    rows = []
    for strange in itertools.product([False, True], repeat=3):
        with np.errstate(over="ignore"):
            chance = unlisted ** sum(strange) * (1.0 - unlisted) ** (3 - sum(strange))
        rows.append((np.where(strange, 3, listed), found * chance))
    tables, probs = (np.concatenate(part) for part in zip(*rows, strict=True))
    problem = SearchProblem(LABELS, ("p",), 3, composition, unlisted=unlisted)
    np.testing.assert_allclose(problem.prior_probs, [probs @ (tables[:, 0] == shape) for shape in range(3)], atol=1e-12)
    absent = [probs @ (tables != shape).all(axis=1) for shape in range(3)]
    np.testing.assert_allclose(problem.prior_absent_probs, absent, atol=1e-12)
    posterior = probs * np.prod([np.exp(weights)[i, tables[:, i]] for i in range(3)], axis=0)
    if posterior.sum() < 1e-290:
        return  # no table is possible, or the enumeration has lost it to underflow
    posterior /= posterior.sum()
    scene = SceneBelief(problem, ToldOfStrangers())
    for i, row in enumerate(weights):
        try:
            scene.update(i, [Touch(0, row[:3], features=row[3:])])
        except ValueError:  # a feature must be finite for Touch, or no shape is left
            assert not np.isfinite(row).all()
            return
    for shape in range(3):
        for i in range(3):
            assert scene.marginals()[i, shape] == pytest.approx(posterior @ (tables[:, i] == shape), abs=1e-9)
        assert scene.prob_present(shape) == pytest.approx(posterior @ (tables == shape).any(axis=1), abs=1e-9)
    strange = posterior @ (tables == 3)
    np.testing.assert_allclose(scene.unlisted(), strange, atol=1e-9)
    np.testing.assert_allclose(scene.view().unlisted(), strange, atol=1e-9)
    belief = pickle.loads(pickle.dumps(scene)).belief(1)
    assert belief.unlisted == pytest.approx(strange[1], abs=1e-9)
    assert belief.probs.sum() + belief.unlisted == pytest.approx(1.0, abs=1e-9)


def test_unlisted_shapes_need_a_model_that_weighs_them_and_a_probability_below_one():
    with pytest.raises(InvalidArgument, match="Told cannot weigh whether an object has none of the shapes"):
        SceneBelief(SearchProblem(LABELS, ("p",), 2, unlisted=0.05), Told())
    for wrong in (1.0, -0.1, np.nan):
        with pytest.raises(InvalidArgument, match=r"unlisted must be a number in \[0, 1\), got"):
            SearchProblem(LABELS, ("p",), 2, unlisted=wrong)


EXTREMES = (0.0, -0.0, 1.0, 0.25, 1e-3, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e-300, 1e308, -1e308, -1.0, 6e4)


@pytest.mark.filterwarnings("ignore:logits has no negative number")
@given(
    st.sampled_from(["distinct", "independent", Counts({"a": 2, "b": 1}), Counts({"a": 2**53, "c": 1})]),
    st.lists(
        st.tuples(st.integers(0, 2), arrays(np.float64, 3, elements=st.sampled_from(EXTREMES))), min_size=1, max_size=4
    ),
)
def test_extreme_touches_are_evidence_or_refused_and_then_leave_scene_and_tracker_as_they_were(composition, rounds):
    scene, tracker = scene_of(composition), BeliefTracker(Belief.from_probs(LABELS, [0.5, 0.5, 0.0]), Told())
    for index, scores in rounds:
        before, belief = scene.log_marginals(), tracker.belief
        try:
            scene.update(index, [Touch(0, scores)])
        except ValueError:
            assert (scene.log_marginals() == before).all()
        try:
            tracker.update(Touch(0, scores))
        except ValueError:
            assert tracker.belief is belief
        for logs in (scene.log_marginals(), tracker.belief.log_probs):
            np.testing.assert_allclose(np.exp(logs).sum(axis=-1), 1.0, rtol=1e-12)
        assert np.isfinite(tracker.log_evidence)
        assert all(0.0 <= scene.prob_present(target) <= 1.0 for target in range(3))


def test_certainty_about_a_scene_is_undone_by_as_much_evidence_against():
    scene = scene_of("distinct")
    scene.update(0, felt([5000.0, 0.0, 0.0]))
    assert scene.belief(1).prob("a") == 0.0
    assert np.isfinite(scene.log_marginals()).all()
    scene.update(0, felt([-5000.0, 0.0, 0.0]))
    np.testing.assert_allclose(scene.marginals(), 1 / 3, rtol=1e-12)


@compositions
@pytest.mark.parametrize("num_objects", [1, 2])
def test_one_or_two_objects_are_no_special_case(composition, num_objects):
    weights = np.log([[0.7, 0.2, 0.4], [0.1, 0.5, 0.3]])[:num_objects]
    scene = scene_of(composition, num_objects)
    for i, row in enumerate(weights):
        scene.update(i, felt(row))
    np.testing.assert_allclose(scene.marginals(), joint(composition, np.exp(weights))[0], atol=1e-14)


def test_before_any_touch_presence_is_the_problems_own():
    for composition in COMPOSITIONS.values():
        problem = SearchProblem(LABELS, ("p",), 2, composition)
        scene = SceneBelief(problem, Told())
        np.testing.assert_allclose(scene.marginals(), np.tile(problem.prior_probs, (2, 1)), atol=1e-15)
        present = [scene.prob_present(target) for target in range(3)]
        np.testing.assert_allclose(present, 1.0 - problem.prior_absent_probs, atol=1e-15)


def test_a_target_without_a_chance_warns_once():
    with pytest.warns(ZeroPriorTarget, match="the target c has probability zero in the bag") as caught:
        scene = scene_of(COMPOSITIONS["a bag without c"], target=2)
    assert len(caught) == 1
    assert caught[0].filename == __file__.replace(".pyc", ".py")
    scene.update(0, felt([0.0, 0.0, 9.0]))  # and never again
    prior = Belief.from_probs(LABELS, [0.5, 0.5, 0.0])
    with pytest.warns(ZeroPriorTarget, match="in the prior"):
        scene_of("independent", prior=prior, target=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene_of("distinct", num_objects=1, target=2)


def test_what_does_not_fit_is_refused():
    for call in (
        lambda: scene_of("distinct").update(3, felt([0, 0, 0])),
        lambda: scene_of("distinct").touches(-1),
        lambda: scene_of("distinct").belief(7),
        lambda: scene_of("distinct").belief(0.0),
        lambda: scene_of("distinct").update(True, felt([0, 0, 0])),
        lambda: scene_of("distinct").prob_present(-1),
        lambda: scene_of("distinct", target=3),
    ):
        with pytest.raises(InvalidArgument, match=r"must be (an integer )?in"):
            call()
    for call in (
        lambda: scene_of("distinct").prob_present("d"),
        lambda: scene_of("distinct", target="d"),
    ):
        with pytest.raises(UnknownName, match="unknown shape 'd'"):
            call()
    with pytest.raises(ValueError, match="fixes the prior"):
        scene_of(COMPOSITIONS["a bag"], prior=Belief.uniform(LABELS))
    with pytest.raises(ValueError, match="the prior about"):
        scene_of("independent", prior=Belief.uniform(tuple("xyz")))


@pytest.mark.parametrize("kind", [list, tuple, iter])
def test_touches_of_any_iterable_are_evidence_and_are_recorded(kind):
    scene = scene_of("independent")
    scene.update(0, kind(felt([0.0, -1.0, -2.0]) * 2))
    assert scene.log_likelihoods()[0].tolist() == [0.0, -2.0, -4.0]
    assert (len(scene.touches(0)), scene.touches(0).uses(1).tolist()) == (2, [2])


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_evidence_of_narrow_logits_is_summed_in_double_precision(dtype):
    scene = scene_of("independent")
    scene.update(0, [Touch(0, np.array([-300, -301, -np.inf], dtype))] * 200)
    assert scene.log_likelihoods()[0].tolist() == [-60000.0, -60200.0, -np.inf]
    assert scene.log_marginals()[0].tolist() == [0.0, -200.0, -np.inf]


def test_a_presence_far_below_the_rounding_error_of_one_is_kept():
    scene = scene_of("independent")
    for i in range(3):
        scene.update(i, felt([-50.0, 0.0, 0.0]))
    assert scene.prob_present(0) == pytest.approx(3 * scene.marginals()[0, 0], rel=1e-12, abs=0.0)
    nothing = scene_of("independent", prior=Belief.from_probs(LABELS, [0.0, 0.5, 0.5]))
    assert str(nothing.prob_present(0)) == "0.0"


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))])
@pytest.mark.parametrize("kind", [SceneBelief, SearchProgress])
def test_a_copy_and_what_was_copied_do_not_share_what_they_are_told(kind, copied, model):
    problem, rng = SearchProblem(model.shape_labels, ("front", "side", "top"), 2), np.random.default_rng(0)
    first = kind(problem, model)

    def tell(one, pose=0):
        touch = model.sample(0, [pose], rng)[0]
        one.touch(touch) if kind is SearchProgress else one.update(0, [touch])

    def told(one):
        scene = getattr(one, "scene", one)
        counted = getattr(one, "num_touches", None)
        return scene.marginals().tolist(), scene.touches(0), scene.evidence(0).log_likelihood.tolist(), counted

    tell(first)
    twin, before = copied(first), told(first)
    assert len(told(twin)[1]) == 1
    tell(twin)
    assert told(first) == before
    tell(first, 1)
    assert (len(told(first)[1]), len(told(twin)[1])) == (2, 2)
    assert told(first)[0] != told(twin)[0]


def test_at_most_one_target_is_known_by_name_or_asked_for():
    problem = SearchProblem(LABELS, ("p",), 2, "at_most_one")
    scene = SceneBelief(problem, Told(), target="c")
    assert scene.log_marginals().tolist() == scene_of(AtMostOne("c"), 2).log_marginals().tolist()
    with pytest.raises(InvalidArgument, match="say which, SceneBelief"):
        SceneBelief(problem, Told())
    with pytest.raises(ValueError, match="fixes the prior"):
        scene_of(AtMostOne("c"), prior=Belief.uniform(LABELS))
    with pytest.raises(UnknownName, match="d"):
        SearchProblem(LABELS, ("p",), 2, AtMostOne("d"))
    with pytest.raises(InvalidArgument, match="another shape"):
        SearchProblem(("a",), ("p",), 1, "at_most_one")


@pytest.mark.parametrize("size", [1e-300, 1e3, 1e150, 1e307])
def test_at_most_one_target_stands_weights_of_all_sizes(size):
    weights = size * np.array([[3.0, -1.0, 2.0], [-1.0, 1.0, 0.5], [0.0, -1.0, -2.0]])
    found = log_at_most_one_marginals(weights, 1)
    np.testing.assert_allclose(np.exp(found).sum(axis=1), 1.0)
    assert not np.isnan(found).any()
    if size > 1:
        assert np.exp(found[:, 1]).round(9).tolist() == [0.0, 1.0, 0.0]


def test_a_tracker_is_bayes_rule_on_all_touches_at_once(model, rng):
    tracker = BeliefTracker(Belief.uniform(model.shape_labels), model)
    touches = model.sample(1, [0, 1, 2, 0], rng)
    for touch in touches:
        belief = tracker.update(touch)
    expected = Belief.uniform(model.shape_labels).update(model.log_likelihood(touches))
    np.testing.assert_allclose(belief.probs, expected.probs, atol=1e-12)
    assert tracker.touches == tuple(touches)


def test_an_impossible_touch_is_named_and_leaves_tracker_and_scene_as_they_were():
    [cube], [cone] = felt([0.0, -np.inf, -np.inf]), felt([-np.inf, 0.0, -np.inf])
    tracker, scene = BeliefTracker(Belief.uniform(LABELS), Told()), scene_of("distinct")
    tracker.update(cube)
    scene.update(0, [cube])
    with pytest.raises(ImpossibleObservation, match=r"pose 0, Belief\(a 1.000, .*log-likelihood \[-inf, "):
        tracker.update(cone)
    with pytest.raises(ImpossibleObservation, match="touching object 1 in poses"):
        scene.update(1, [cube])
    assert (tracker.belief.probs.tolist(), len(tracker.touches)) == ([1.0, 0.0, 0.0], 1)
    assert scene.marginals().tolist() == [[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.5, 0.5]]
    assert scene.touches(1) == ()


def test_a_model_of_other_shapes_is_refused(model):
    for make in (
        lambda: SceneBelief(SearchProblem(LABELS, ("p",), 2), model),
        lambda: BeliefTracker(Belief.uniform(LABELS), model),
    ):
        with pytest.raises(ValueError, match="the model about"):
            make()
