"""A function from an observation to an action plays as a decider, and sees what the environment shows."""

import numpy as np
import pytest

from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touch_source import SampledTouches
from belief.errors import BrokenContract, InvalidArgument, UnknownName
from belief.references import BadReference
from planners import InformationState, check_decider, make_decider
from planners.other_agents import FunctionPolicy, SB3Policy

MINE = """
import numpy as np


def act(observation):
    poses = len(observation) - 4 - 2
    return poses + (observation[0] < 0.5) if observation[-1] > 0.2 else np.int64(0)


class Acts:
    def __call__(self, observation):
        return act(observation)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder, because a module is imported once."""
    found = tmp_path_factory.mktemp("mine")
    (found / "my_acting_policy.py").write_text(MINE)
    return found


@pytest.fixture
def mine(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return "policy:my_acting_policy"


@pytest.mark.parametrize("name", ["act(state='posterior')", "Acts(state='posterior',touch_limit=3)"])
def test_a_function_of_a_user_keeps_the_contract_of_deciders(name, mine, model):
    decider = make_decider(f"{mine}:{name}", model.outcome_table())
    assert check_decider(decider, np.random.default_rng(0), model, num_searches=4)


@pytest.mark.parametrize("state", ["paper", "posterior", "gains"])
def test_it_sees_what_the_environment_shows(state, model, body):
    model = body if state == "gains" else model
    poses = tuple(f"pose_{i}" for i in range(model.outcome_table().num_poses))
    label = model.shape_labels[1]
    env = ObjectTestEnv(touches=SampledTouches(model, poses), target=label, state=state)
    shown, seen = [], []
    decider = FunctionPolicy(lambda observation: seen.append(observation) or 0, state)
    shown.append(env.reset(seed=3)[0])
    for _ in range(12):
        info = InformationState(env.problem, env.target, env.belief, env.history, scene=env._scene.view())
        env.step(decider.decide(info, np.random.default_rng(0)).action.pose)
        shown.append(env.observe())
    info = InformationState(env.problem, env.target, env.belief, env.history, scene=env._scene.view())
    decided = decider.decide(info, np.random.default_rng(0))
    np.testing.assert_array_equal(seen, shown)
    assert type(decided.action).__name__ == ("Confirm" if info.target_prob >= 0.5 else "Reject")  # the limit


class Counts:
    """Probes the pose after the last one, and counts for itself what it was shown."""

    def __init__(self):
        self.seen = []

    def __call__(self, observation):
        self.seen.append(observation)
        return 4 if len(self.seen) == 4 else (len(self.seen) - 1) % 3


def test_an_agent_with_a_memory_sees_every_observation_of_an_object_in_order(model):
    label, players = model.shape_labels[1], []

    class Agent(Counts):
        def __init__(self):
            super().__init__()
            players.append(self)

    env = ObjectTestEnv(touches=SampledTouches(model, ("a", "b", "c")), target=label)
    decider, shown, poses = FunctionPolicy(Agent, remembers=True, sees_target=True), [env.reset(seed=3)[0]], []
    while True:
        action = decider.decide(InformationState(env.problem, env.target, env.belief, env.history), None).action
        np.testing.assert_array_equal([row[:-4] for row in players[-1].seen], shown)
        if not hasattr(action, "pose"):
            break
        poses.append(action.pose)
        shown.append(env.step(action.pose)[0])
    assert (poses, type(action).__name__, len(players)) == ([0, 1, 2], "Reject", 4)
    assert check_decider(FunctionPolicy(Counts, remembers=True), np.random.default_rng(0), model, num_searches=4)
    with pytest.raises(InvalidArgument, match="state"):
        FunctionPolicy(Counts, "posterior", remembers=True)


@pytest.mark.parametrize("given", [-1, 99, 0.0, None, [0, 1], "0", True])
def test_what_is_no_action_is_said(given, model):
    env = ObjectTestEnv(touches=SampledTouches(model, ("a", "b", "c")), target=model.shape_labels[0])
    env.reset(seed=0)
    info = InformationState(env.problem, env.target, env.belief, env.history)
    with pytest.raises(BrokenContract, match=r"^<lambda> must return an action, an integer from 0 to 4, got"):
        FunctionPolicy(lambda observation: given).decide(info, np.random.default_rng(0))


def test_what_cannot_be_a_policy_is_said(mine, model):
    table = model.outcome_table()
    for name, error in {
        "nothing": UnknownName,
        "np": BrokenContract,
        "act(state='image')": InvalidArgument,
        "act(touch_limit=0)": InvalidArgument,
        "act(limit=3)": BadReference,
    }.items():
        with pytest.raises(error):
            make_decider(f"{mine}:{name}", table)
    assert SB3Policy("a.zip").touch_limit == FunctionPolicy(len).touch_limit
