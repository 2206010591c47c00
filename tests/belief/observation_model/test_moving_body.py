"""A body that moves: the belief is the sum over all that may have happened, and says when something has."""

from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp

from belief import SceneBelief, SearchProblem, Touch
from belief.cell_kernel import CellKernel
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.observation_model.moving_body import MovingBodyModel
from belief.search_progress import Outcome
from belief.touch_batch import TouchBatch
from planners import Session, make_decider
from planners.episode import MOVED, Episode
from tests.belief.test_cell_kernel import transitions

P, K, N, D = 3, 2, 4, 3
RNG = np.random.default_rng(4)
TABLE = RNG.normal(size=(P, K, N, D)).astype(np.float32)
CLOSE = RNG.uniform(0.1, 1.0, (N, N)) + np.eye(N)
KERNEL = CellKernel.of(CLOSE + CLOSE.T, np.ones(N))
TOUCHES = [Touch(pose, features=1.5 * RNG.normal(size=D)) for pose in (0, 2, 0, 1)]


def still(correlation=0.0, drift=0.0):
    references, logits = RNG.normal(size=(P, 5, D)), np.zeros((P, 5, K))
    settings = {"correlation": correlation, "drift": drift, "hypotheses": FixedHypotheses(TABLE)}
    return RigidBodyModel(("mug", "cup"), N, 0.7, references, logits, **settings)


def after(model, touches=TOUCHES):
    evidence = model.start()
    for touch in touches:
        evidence = evidence.update(touch)
    return evidence


def by_all_histories(model, prob, matrix, error):
    """Log-likelihood of the shapes, and p(moved before the last touch | shape), summed over all histories."""
    scores = np.stack([model.scores_of(touch, model.embedding_of(touch)) for touch in TOUCHES])  # (n, K, N)
    likelihood = np.exp(scores.astype(float)) @ error.T
    total, moved = np.zeros(K), np.zeros(K)
    for flags in product((0, 1), repeat=len(TOUCHES) - 1):
        steps = [prob * matrix if flag else (1 - prob) * np.eye(N) for flag in flags]
        for path in product(range(N), repeat=len(TOUCHES)):
            chance = 1.0 / N * np.prod([step[path[i], path[i + 1]] for i, step in enumerate(steps)])
            joint = chance * np.prod([likelihood[i, :, cell] for i, cell in enumerate(path)], axis=0)
            total += joint
            moved += joint * flags[-1]
    return np.log(total), moved / total


@pytest.mark.parametrize("error", [None, KERNEL])
def test_the_belief_is_the_sum_over_all_histories(error):
    model, matrix = still(), transitions(KERNEL)
    moving = MovingBodyModel.of(model, 0.3, KERNEL, error)
    wanted, moved = by_all_histories(model, 0.3, matrix, np.eye(N) if error is None else matrix)
    found = after(moving)
    np.testing.assert_allclose(np.diff(found.log_likelihood), np.diff(wanted), atol=1e-5)
    np.testing.assert_allclose(found.moved, moved, atol=1e-5)
    batch = moving.log_likelihood_batch(TouchBatch.of([TOUCHES, TOUCHES[::-1]]))
    np.testing.assert_allclose(np.diff(batch[0]), np.diff(wanted), atol=1e-5)


@pytest.mark.parametrize(("correlation", "drift"), [(0.0, 0.0), (0.4, 0.0), (0.4, 0.1)])
def test_bodies_that_hardly_ever_move_are_bodies_at_rest(correlation, drift):
    model = still(correlation, drift)
    moving = MovingBodyModel.of(model, 1e-15, KERNEL)
    for number in range(len(TOUCHES) + 1):
        rested, found = (after(each, TOUCHES[:number]) for each in (model, moving))
        np.testing.assert_allclose(np.diff(found.log_likelihood), np.diff(rested.log_likelihood), atol=1e-5)
        wanted, told = (each.outcome_mixture(4, 3).table.probs for each in (rested, found))
        np.testing.assert_allclose(told, wanted, atol=1e-5)
        assert found.moved.max() < 1e-4
    together = moving.log_likelihood(TOUCHES)
    np.testing.assert_allclose(np.diff(together), np.diff(found.log_likelihood), atol=1e-5)


def test_a_touch_that_contradicts_the_others_says_that_the_body_has_moved():
    table = np.full((1, 1, 2, 2), -6.0, np.float32)
    table[0, 0] += 12.0 * np.eye(2, dtype=np.float32)
    one = np.ones((1, 1, 2))
    model = RigidBodyModel(("mug",), 2, 1.0, one, one[..., :1], hypotheses=FixedHypotheses(table))
    moving = MovingBodyModel.of(model, 0.1, CellKernel.of(np.ones((2, 2)), np.ones(2)))
    here, there = Touch(0, features=np.array([1.0, 0.0])), Touch(0, features=np.array([0.0, 1.0]))
    assert after(moving, [here]).moved[0] == 0.0
    assert after(moving, [here, here]).moved[0] < 0.1
    assert after(moving, [here, here, there]).moved[0] > 0.95
    problem = SearchProblem(("mug",), ("front",), 1, "independent")
    scene = SceneBelief(problem, moving)
    scene.update(0, [here, there])
    assert scene.prob_moved(0) == pytest.approx(after(moving, [here, there]).moved[0])
    assert SceneBelief(problem, model).prob_moved(0) == 0.0


def test_a_session_tells_of_moves_where_bodies_move():
    told = {}
    for name, model in {"moves": MovingBodyModel.of(still(), 0.5, KERNEL), "rests": still()}.items():
        problem = SearchProblem(("mug", "cup"), ("front", "side", "top"), num_objects=2)
        session = Session(problem, make_decider("fixed_poses", model.outcome_table()), "mug", model, abstain=False)
        for touch in TOUCHES[:2]:
            session.tell(touch)
        session.ask()
        told[name] = session
    assert told["rests"].prob_moved == 0.0
    assert told["moves"].prob_moved > 0.0
    told["moves"].tell(TOUCHES[2])
    first, second, third = (step.decision.scores for step in told["moves"].steps)
    assert not {MOVED} & {*first, *second}  # nothing was touched twice by then
    assert 0.0 < third[MOVED] <= 1.0
    words = str(Episode((0,), 0, (0, 1), told["moves"].steps, Outcome.TRUNCATED))
    assert ("has moved before touch 2" in words) == (third[MOVED] >= 0.5)


def test_kernels_of_other_hypotheses_are_refused():
    with pytest.raises(ValueError, match="about 2 hypotheses of 4"):
        MovingBodyModel.of(still(), 0.3, CellKernel.of(np.ones((2, 2)), np.ones(2)))


def test_models_that_expect_other_moves_have_other_fields():
    model = still()
    texts = {MovingBodyModel.of(model, prob, KERNEL).to_json() for prob in (0.1, 0.2)}
    assert len(texts | {model.to_json()}) == 3


def test_sums_do_not_change_with_moves():
    weights = RNG.normal(size=(2, 3, N))
    moved = MovingBodyModel.of(still(), 0.4, KERNEL).before_next(weights)
    np.testing.assert_allclose(logsumexp(moved, axis=-1), logsumexp(weights, axis=-1), atol=1e-5)
