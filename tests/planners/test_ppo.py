"""Trained policies: their files, and what they decide in the one search loop."""

import itertools
import json

import numpy as np
import pytest
from safetensors.numpy import save

from belief import Confirm, Probe, Reject, SceneBelief, SearchProblem, Touch
from belief.bayes import Belief
from belief.policy_state import ENCODINGS, GOAL, WITH_GAINS, NoGains
from belief.synthetic import SyntheticWorld
from planners import make_decider, search
from planners.decider import InformationState
from planners.episode import Outcome
from planners.ppo import BadPolicy, MissingPolicy, Policy, PolicyCard, PPODecider, load_ppo_policy, policy_file

SIZES = {"paper": 10, "posterior": 9, "gains": 12, "goal": 16}
SHAPES, POSES = tuple(f"shape_{k}" for k in range(4)), ("p0", "p1", "p2")


def random_policy(rng, state="paper", target="shape_0", hidden=8, touch_limit=5):
    sizes = [SIZES[state], hidden, hidden, 5]
    pairs = list(itertools.pairwise(sizes))
    weights = tuple(rng.normal(size=(out, inn)).astype(np.float32) for inn, out in pairs)
    biases = tuple(rng.normal(size=out).astype(np.float32) for _, out in pairs)
    target = "" if state == GOAL else target
    return Policy(PolicyCard(state, target, SHAPES, POSES, touch_limit, "not at all"), weights, biases)


def constant_policy(scores, state="paper", touch_limit=5):
    card = PolicyCard(state, "shape_0", SHAPES, POSES, touch_limit)
    return Policy(card, (np.zeros((5, SIZES[state]), np.float32),), (np.array(scores, np.float32),))


def write(folder, policy):
    policy.save(folder / policy_file(policy.card.state, policy.card.target))


@pytest.fixture
def problem():
    return SearchProblem(SHAPES, POSES, num_objects=4)


@pytest.mark.parametrize("state", list(ENCODINGS))
def test_a_policy_survives_its_file(state, rng, tmp_path):
    policy = random_policy(rng, state)
    policy.save(tmp_path / "policy")
    copy = Policy.load(tmp_path / "policy")
    assert copy.card == policy.card
    states = rng.normal(size=(7, policy.weights[0].shape[1]))
    np.testing.assert_array_equal(copy.scores(states), policy.scores(states))
    copy.save(tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == (tmp_path / "policy").read_bytes()


def test_scores_are_those_of_torchs_network(rng):
    torch = pytest.importorskip("torch")
    policy = random_policy(rng, hidden=16)
    layers = []
    for weight, bias in zip(policy.weights, policy.biases, strict=True):
        linear = torch.nn.Linear(*weight.shape[::-1])
        linear.load_state_dict({"weight": torch.tensor(weight), "bias": torch.tensor(bias)})
        layers += [linear, torch.nn.Tanh()]
    states = rng.normal(size=(9, 10)).astype(np.float32)
    expected = torch.nn.Sequential(*layers[:-1])(torch.tensor(states)).detach().numpy()
    np.testing.assert_allclose(policy.scores(states), expected, rtol=1e-4, atol=1e-5)


def test_a_damaged_file_is_refused_and_no_bit_goes_unnoticed(rng, tmp_path):
    path = tmp_path / "policy"
    random_policy(rng).save(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(BadPolicy):
        Policy.load(path)
    for place in rng.integers(8, len(data), size=60).tolist():
        torn = bytearray(data)
        torn[place] ^= 1
        path.write_bytes(bytes(torn))
        with pytest.raises(BadPolicy):
            Policy.load(path)
    for foreign in (b"", save({"weight_0": np.zeros(3)}), save({}, {"activetouch-policy-1": json.dumps({"card": 3})})):
        path.write_bytes(foreign)
        with pytest.raises(BadPolicy, match="no policy file"):
            Policy.load(path)


def test_layers_that_do_not_fit_are_refused():
    good = constant_policy([0, 0, 0, 0, 1])
    with pytest.raises(BadPolicy, match="5 scores"):
        Policy(good.card, (good.weights[0][:4],), (good.biases[0][:4],))
    with pytest.raises(BadPolicy, match="layer 0"):
        Policy(good.card, (good.weights[0][:, :4],), good.biases)
    with pytest.raises(BadPolicy, match="finite"):
        Policy(good.card, (good.weights[0] * np.float32(np.nan),), good.biases)
    with pytest.raises(BadPolicy, match="known state"):
        Policy(PolicyCard("images", "shape_0", SHAPES, POSES, 5), good.weights, good.biases)


def test_a_missing_policy_says_what_to_run(tmp_path, model, problem):
    with pytest.raises(MissingPolicy, match="folder of policies is needed"):
        load_ppo_policy(None, "paper", "shape_0")
    with pytest.raises(MissingPolicy, match="'shape_2' and the state 'posterior' in"):
        load_ppo_policy(tmp_path, "posterior", "shape_2")
    decider = make_decider("ppo", model.outcome_table(), model, tmp_path)
    with pytest.raises(MissingPolicy):
        search(SyntheticWorld(model, (0, 1, 2, 3)), decider, problem, 0, model, (0,))
    write(tmp_path, constant_policy([0, 0, 0, 0, 1]))
    (tmp_path / policy_file("paper", "shape_1")).write_bytes((tmp_path / policy_file("paper", "shape_0")).read_bytes())
    with pytest.raises(BadPolicy, match="is for the target 'shape_0'"):
        load_ppo_policy(tmp_path, "paper", "shape_1")


def test_a_policy_of_another_scene_is_refused(tmp_path, model):
    write(tmp_path, constant_policy([0, 0, 0, 0, 1]))
    problem = SearchProblem(SHAPES, ("a", "b", "c"), num_objects=4)
    with pytest.raises(BadPolicy, match="'a', 'b', 'c'"):
        search(SyntheticWorld(model, (0, 1, 2, 3)), PPODecider(tmp_path), problem, 0, model, (0,))


@pytest.mark.parametrize(("scores", "kinds"), [([0, 0, 0, 1, 0], [Confirm]), ([0, 0, 0, 0, 1], [Reject] * 4)])
def test_the_highest_score_is_what_happens(scores, kinds, tmp_path, model, problem):
    write(tmp_path, constant_policy(scores))
    episode = search(SyntheticWorld(model, (3, 1, 2, 0)), PPODecider(tmp_path), problem, 0, model, (0,))
    assert [type(step.decision.action) for step in episode.steps] == kinds


def test_after_the_touches_it_was_trained_for_a_policy_has_to_decide(tmp_path, model, problem):
    write(tmp_path, constant_policy([0, 9, 0, 1, 2], touch_limit=3))
    episode = search(SyntheticWorld(model, (3, 1, 2, 0)), PPODecider(tmp_path), problem, 0, model, (0,))
    assert episode.outcome is Outcome.EXHAUSTED
    assert [step.decision.action for step in episode.steps] == [*[Probe(1)] * 3, Reject()] * 4


def test_confident_stopping_takes_the_policys_poses_and_nothing_else(tmp_path, model, problem):
    write(tmp_path, constant_policy([0, 0, 1, 9, 0]))  # would confirm at once
    decider = make_decider("ppo_confident", model.outcome_table(), model, tmp_path)
    for prob, action in ((0.5, Probe(2)), (0.995, Confirm()), (0.005, Reject())):
        belief = Belief.from_probs(SHAPES, [prob, *[(1 - prob) / 3] * 3])
        assert decider.decide(InformationState(problem, 0, belief), np.random.default_rng(0)).action == action


@pytest.mark.parametrize("state", list(ENCODINGS))
def test_a_policy_sees_in_a_search_what_it_saw_in_training(state, rng, model, body):
    # The environment's own observation, after the same touches of one object, gives the same scores.
    from activetouch.envs.object_test import ObjectTestEnv
    from activetouch.envs.touch_source import SampledTouches

    touches = SampledTouches(body if state in WITH_GAINS else model, POSES)
    seen = ("gains", None) if state == GOAL else (state, "shape_0")
    env = ObjectTestEnv(touches=touches, state=seen[0], target=seen[1], touch_limit=5)
    policy = random_policy(rng, state)
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        for _ in range(5):
            inner = env.unwrapped
            scene = SceneBelief(inner.problem, touches.model, inner.belief)  # of its prior; only the evidence is read
            scene.update(0, inner.history)
            info = InformationState(inner.problem, inner.target, inner.belief, inner.history, scene=scene.view())
            decider = PPODecider(None, state)
            decider_scores = decider.scores(info, policy)
            np.testing.assert_allclose(decider_scores, policy.scores(observation[None])[0], atol=1e-4)
            observation, *_ = env.step(int(rng.integers(3)))


def test_touches_with_extreme_logits_give_finite_scores(rng, problem):
    policy = random_policy(rng)
    belief = Belief.from_probs(SHAPES, [1.0, 0.0, 0.0, 0.0])
    for logits in ([1e308, -1e308, 0, 0], [0.0] * 4, [1e4, -1e4, 1e4, 0]):
        info = InformationState(problem, 0, belief, (Touch(1, np.array(logits)),))
        for state in ENCODINGS:
            policy = random_policy(rng, state)
            if state in WITH_GAINS:  # without evidence of one body
                with pytest.raises(NoGains, match="one rigid body"):
                    PPODecider(None, state).scores(info, policy)
            else:
                assert np.isfinite(PPODecider(None, state).scores(info, policy)).all()


def test_one_policy_serves_all_targets_and_is_found_by_each(tmp_path, body, problem):
    rng = np.random.default_rng(3)
    write(tmp_path, random_policy(rng, GOAL))
    decider = make_decider("ppo_goal", body.outcome_table(), body, tmp_path)
    assert {decider.files(target) for target in SHAPES} == {(tmp_path / "goal.safetensors",)}
    for target in range(4):
        episode = search(SyntheticWorld(body, (0, 1, 2, 3)), decider, problem, target, body, (0, target))
        assert episode.outcome in (Outcome.CONFIRMED, Outcome.EXHAUSTED)
    (tmp_path / "gains-shape_0.safetensors").write_bytes((tmp_path / "goal.safetensors").read_bytes())
    with pytest.raises(BadPolicy, match="is for the target ''"):
        load_ppo_policy(tmp_path, "gains", "shape_0")
    with pytest.raises(BadPolicy, match="known state"):
        Policy(PolicyCard(GOAL, "shape_0", SHAPES, POSES, 5), (), ())
